//! The place of a raster on the Earth, as GeoTIFF tells it.
//!
//! Literature: OGC, "GeoTIFF Standard", version 1.1, 2019.

use crate::ellipsoid::metres_of_degree;
use std::io::{Read, Seek};
use tiff::TiffResult;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

/// Metres of a foot, and of that of surveys in the United States.
const FOOT: f64 = 0.3048;
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;

/// Keys of the directory, and what some of their values mean.
const MODEL_TYPE: u32 = 1024;
const RASTER_TYPE: u32 = 1025;
const GEOGRAPHIC_CRS: u32 = 2048;
const PROJECTED_CRS: u32 = 3072;
const LINEAR_UNITS: u32 = 3076;
const VERTICAL_UNITS: u32 = 4099;
const IS_GEOGRAPHIC: u32 = 2;
/// Of longitude and latitude, by EPSG.
const WGS_84: u32 = 4326;
const PIXEL_IS_POINT: u32 = 2;
const USER_DEFINED: u32 = 32767;

/// Where the pixels of a raster lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Georeference {
    /// The middle of the pixel of column `c` and row `r` from the top lies at
    /// `x = t[0] + c t[1] + r t[2]` and `y = t[3] + c t[4] + r t[5]`.
    pub transform: [f64; 6],
    /// The EPSG code of the coordinate system, where it has one.
    pub epsg: Option<u32>,
    /// Whether coordinates are degrees of longitude and latitude.
    pub is_geographic: bool,
    /// Metres of a unit of projected coordinates.
    pub linear_unit: f64,
}

impl Georeference {
    /// Reads the tags: the place, and the metres of a unit of heights; `None` where the file has no
    /// usable transformation.
    ///
    /// # Errors
    /// When a tag cannot be read.
    pub(crate) fn read<R: Read + Seek>(
        decoder: &mut Decoder<R>,
    ) -> TiffResult<Option<(Self, f64)>> {
        let mut numbers = |tag| -> TiffResult<Option<Vec<f64>>> {
            Ok(decoder.find_tag(tag)?.and_then(|value| value.into_f64_vec().ok()))
        };
        let matrix = numbers(Tag::ModelTransformationTag)?;
        let scale = numbers(Tag::ModelPixelScaleTag)?;
        let tie = numbers(Tag::ModelTiepointTag)?;
        let keys = decoder.find_tag_unsigned_vec::<u32>(Tag::GeoKeyDirectoryTag)?;
        let keys = keys.unwrap_or_default();
        let key = |wanted| {
            let entries = keys.get(4..).unwrap_or_default().as_chunks::<4>().0;
            // A location of 0 says that the value is in the entry itself.
            let found = entries.iter().find(|entry| entry[0] == wanted && entry[1] == 0);
            found.map(|entry| entry[3])
        };
        let corner = match (matrix.as_deref(), scale.as_deref(), tie.as_deref()) {
            (Some(&[a, b, _, d, e, f, _, h, ..]), ..) => [d, a, b, h, e, f],
            (_, Some(&[x, y, ..]), Some(&[column, row, _, east, north, ..])) => {
                [east - column * x, x, 0.0, north + row * y, 0.0, -y]
            }
            _ => return Ok(None),
        };
        let [x, a, b, y, d, e] = corner;
        let is_point = key(RASTER_TYPE) == Some(PIXEL_IS_POINT);
        let half = if is_point { 0.0 } else { 0.5 };
        let transform = [x + half * (a + b), a, b, y + half * (d + e), d, e];
        let is_geographic = key(MODEL_TYPE) == Some(IS_GEOGRAPHIC);
        let crs = if is_geographic { GEOGRAPHIC_CRS } else { PROJECTED_CRS };
        let epsg = key(crs).filter(|&code| code > 0 && code != USER_DEFINED);
        let place = Self::new(transform, epsg, is_geographic, unit(key(LINEAR_UNITS)));
        Ok(place.map(|place| (place, unit(key(VERTICAL_UNITS)))))
    }

    /// A place of its parts; `None` where the transformation does not give each pixel a place of its
    /// own.
    #[must_use]
    pub fn new(
        transform: [f64; 6],
        epsg: Option<u32>,
        is_geographic: bool,
        linear_unit: f64,
    ) -> Option<Self> {
        let [_, a, b, _, d, e] = transform;
        let determinant = a * e - b * d;
        let is_usable =
            transform.iter().all(|number| number.is_finite()) && determinant.is_normal();
        is_usable.then_some(Self { transform, epsg, is_geographic, linear_unit })
    }

    /// The coordinates of a pixel's middle, by column and row from the top.
    #[must_use]
    pub fn at(&self, column: f64, row: f64) -> [f64; 2] {
        let [x, a, b, y, d, e] = self.transform;
        [x + column * a + row * b, y + column * d + row * e]
    }

    /// West, south, east and north of the middles of the outermost pixels of a raster of this size, in
    /// degrees of WGS 84; `None` where its coordinates are others, or its columns do not go to the east
    /// and its rows to the south.
    #[must_use]
    pub fn degrees(&self, width: usize, height: usize) -> Option<[f64; 4]> {
        let [_, a, b, _, d, e] = self.transform;
        let is_upright = a > 0.0 && b == 0.0 && d == 0.0 && e < 0.0;
        if !(self.is_geographic && self.epsg == Some(WGS_84) && is_upright) {
            return None;
        }
        let [west, north] = self.at(0.0, 0.0);
        let [east, south] = self.at((width - 1) as f64, (height - 1) as f64);
        let is_on_earth = south >= -90.0 && north <= 90.0 && west >= -360.0 && east <= 360.0;
        is_on_earth.then_some([west, south, east, north])
    }

    /// Metres from a column to the next and from a row to the next, in the middle of a raster of
    /// this size. Degrees become metres on the ellipsoid WGS 84 at the latitude there.
    #[must_use]
    pub fn pixel_metres(&self, width: usize, height: usize) -> [f64; 2] {
        let [_, latitude] = self.at((width - 1) as f64 / 2.0, (height - 1) as f64 / 2.0);
        let [_, a, b, _, d, e] = self.transform;
        let [east, north] =
            if self.is_geographic { metres_of_degree(latitude) } else { [self.linear_unit; 2] };
        [(a * east).hypot(d * north), (b * east).hypot(e * north)]
    }
}

/// Metres of the unit of this EPSG code.
fn unit(code: Option<u32>) -> f64 {
    match code {
        Some(9002) => FOOT,
        Some(9003) => SURVEY_FOOT,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_are_metres_on_the_ellipsoid() {
        let transform = [10.0, 1.0 / 3600.0, 0.0, 60.0, 0.0, -1.0 / 3600.0];
        let place = Georeference::new(transform, Some(4326), true, 1.0).unwrap();
        assert_eq!(place.at(0.0, 0.0), [10.0, 60.0]);
        // A degree at 60 degrees is 55,800 m across and 111,412 m along.
        let [across, along] = place.pixel_metres(1, 1).map(|metres| metres * 3600.0);
        assert!((across - 55_800.0).abs() < 2.0 && (along - 111_412.0).abs() < 2.0);
        let feet = Georeference { is_geographic: false, linear_unit: FOOT, ..place };
        assert_eq!(feet.pixel_metres(1, 1), [FOOT / 3600.0; 2]);
    }
}
