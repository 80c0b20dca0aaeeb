//! Elevation models in TIFF: heights become samples of 16 bits.

use super::refusal;
use crate::canvas::{Canvas, Row};
use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::orientation::Orientation;
use crate::terrain::{Nodata, Terrain, component_count};
use crate::wanted::{Wanted, WantedBytes};
use pixmesh_terrain::{Elevation, Heights, StepError, Steps, Wish, filled};
use tiff::decoder::Decoder;

/// The header of an elevation model, and the function that decodes it.
pub(super) fn open<'a>(
    elevation: Elevation,
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let header = header(&elevation, options)?;
    Ok(Opened::new(header, move || decode(elevation, header, bytes, options, wanted)))
}

/// The header, which counts an alpha where samples may be missing; the image has it where one is.
pub(super) fn header(
    elevation: &Elevation,
    options: &DecodeOptions,
) -> Result<Header, DecodeError> {
    let limits = &options.limits;
    let (width, height) = limits.check(elevation.width as u64, elevation.height as u64)?;
    let may_miss = elevation.nodata.is_some() || elevation.is_float;
    let may_have_holes = may_miss && options.nodata == Nodata::Hole;
    let precision = if elevation.is_plain { elevation.bits } else { 16 };
    let component_count = component_count(may_have_holes);
    Ok(Header { format: PictureFormat::Tiff, width, height, component_count, precision })
}

/// The heights as the file has them.
pub(super) fn heights(
    elevation: Elevation,
    header: Header,
    bytes: &[u8],
    wanted: &Wanted<'_>,
) -> Result<Heights, DecodeError> {
    let stored = header.width * header.height * usize::from(elevation.bits / 8);
    let mut limits = tiff::decoder::Limits::default();
    limits.decoding_buffer_size = stored;
    limits.intermediate_buffer_size = bytes.len().max(stored);
    let decoder = Decoder::new(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
    elevation.heights(&mut decoder.with_limits(limits)).map_err(refusal)
}

fn decode(
    elevation: Elevation,
    header: Header,
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let heights = heights(elevation, header, bytes, wanted)?;
    let steps = heights.in_steps(Wish { step: options.step, bound: options.bound });
    let steps = steps.map_err(|error| match error {
        StepError::Empty => PictureFormat::Tiff.malformed(error.to_string()),
        _ => PictureFormat::Tiff.unsupported(error.to_string()),
    })?;
    let rows = || (0..header.height).map(|y| heights.row(y).map(|height| steps.sample(height)));
    let mut is_missing = false;
    for mut row in rows() {
        wanted()?;
        is_missing |= row.any(|sample| sample.is_none());
    }
    let has_holes = is_missing && options.nodata == Nodata::Hole;
    let made = Header { component_count: component_count(has_holes), ..header };
    let mut canvas = Canvas::new(made, Orientation::NoTransforms, wanted)?;
    canvas.terrain = Some(Terrain::new(heights.elevation(), steps, options.bound, has_holes));
    if has_holes {
        let largest = u16::MAX >> (16 - header.precision);
        for (y, row) in rows().enumerate() {
            wanted()?;
            let pixel = |sample: Option<u16>| sample.map_or([0, 0], |sample| [sample, largest]);
            let row: Vec<u16> = row.flat_map(pixel).collect();
            canvas.put_row(Row::whole(y), &row);
        }
        return Ok(canvas);
    }
    if is_missing {
        let samples = all(&heights, steps, wanted)?;
        drop(heights);
        canvas.put_rows(&filled(&samples, header.width), wanted)?;
        return Ok(canvas);
    }
    for (y, row) in rows().enumerate() {
        wanted()?;
        let row: Vec<u16> = row.map(Option::unwrap_or_default).collect();
        canvas.put_row(Row::whole(y), &row);
    }
    Ok(canvas)
}

fn all(
    heights: &Heights,
    steps: Steps,
    wanted: &Wanted<'_>,
) -> Result<Vec<Option<u16>>, DecodeError> {
    let mut samples = Vec::with_capacity(heights.elevation().width * heights.elevation().height);
    for y in 0..heights.elevation().height {
        wanted()?;
        samples.extend(heights.row(y).map(|height| steps.sample(height)));
    }
    Ok(samples)
}
