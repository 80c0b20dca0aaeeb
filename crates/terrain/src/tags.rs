//! What the first directory of a TIFF says of an elevation model.
//!
//! The tags of GDAL are 42112 (metadata in XML: scale, offset and unit of a band) and 42113 (the
//! value of samples that are missing, as text).

use crate::georeference::Georeference;
use std::io::{Read, Seek};
use tiff::TiffResult;
use tiff::decoder::Decoder;
use tiff::tags::{SampleFormat, Tag};

const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// Metres of a foot, and of that of surveys in the United States.
const FOOT: f64 = 0.3048;
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;

/// What is known of an elevation model before its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bits of a stored sample.
    pub bits: u8,
    /// Whether the samples are floating-point numbers, of which some may be none.
    pub is_float: bool,
    /// Whether the samples are whole numbers from 0 to 65535 that are the heights themselves.
    pub is_plain: bool,
    /// What a sample is multiplied by, and what is added then.
    pub scale: f64,
    /// What is added to a sample times the scale.
    pub offset: f64,
    /// The value of samples that are missing.
    pub nodata: Option<f64>,
    /// Metres of a unit of the heights.
    pub unit: f64,
    /// Its place on the Earth.
    pub georeference: Option<Georeference>,
}

impl Elevation {
    /// Reads the directory; `None` where the file is a picture: of several samples a pixel, or of
    /// whole numbers without a sign and without a tag that elevation models have.
    ///
    /// # Errors
    /// When a tag cannot be read.
    pub fn open<R: Read + Seek>(decoder: &mut Decoder<R>) -> TiffResult<Option<Self>> {
        let number = |decoder: &mut Decoder<R>, tag, otherwise| -> TiffResult<u32> {
            let values = decoder.find_tag_unsigned_vec(tag)?;
            Ok(values.and_then(|values: Vec<u32>| values.first().copied()).unwrap_or(otherwise))
        };
        let (width, height) = decoder.dimensions()?;
        let bits = number(decoder, Tag::BitsPerSample, 1)?;
        let format = number(decoder, Tag::SampleFormat, 1)?;
        let is_unsigned = format == u32::from(SampleFormat::Uint.to_u16());
        let photometric = number(decoder, Tag::PhotometricInterpretation, 1)?;
        let is_gray = number(decoder, Tag::SamplesPerPixel, 1)? == 1 && photometric == 1;
        let is_of_whole_bytes = matches!(bits, 8 | 16 | 32 | 64);
        if !is_gray || !is_of_whole_bytes {
            return Ok(None);
        }
        let nodata = text(decoder, Tag::GdalNodata)?.and_then(|text| text.trim().parse().ok());
        let metadata = text(decoder, GDAL_METADATA)?.unwrap_or_default();
        let (georeference, vertical_unit) = Georeference::read(decoder)?.unzip();
        let of_band = |role| item(&metadata, role);
        let [scale, offset] = ["scale", "offset"].map(|role| of_band(role)?.parse().ok());
        let is_scaled = scale.is_some() || offset.is_some();
        let is_picture = is_unsigned && bits <= 16;
        if is_picture && nodata.is_none() && georeference.is_none() && !is_scaled {
            return Ok(None);
        }
        let unit = match of_band("unittype").unwrap_or_default() {
            "ft" | "foot" | "feet" => FOOT,
            "US survey foot" | "ftUS" | "us-ft" => SURVEY_FOOT,
            _ => vertical_unit.unwrap_or(1.0),
        };
        Ok(Some(Self {
            width: width as usize,
            height: height as usize,
            bits: bits as u8,
            is_float: format == u32::from(SampleFormat::IEEEFP.to_u16()),
            is_plain: is_picture && !is_scaled,
            scale: scale.filter(|scale: &f64| scale.is_normal()).unwrap_or(1.0),
            offset: offset.filter(|offset: &f64| offset.is_finite()).unwrap_or(0.0),
            nodata,
            unit,
            georeference,
        }))
    }
}

/// The text of a tag.
fn text<R: Read + Seek>(decoder: &mut Decoder<R>, tag: Tag) -> TiffResult<Option<String>> {
    let Some(value) = decoder.find_tag(tag)? else { return Ok(None) };
    Ok(value.into_string().ok().map(|text| text.trim_end_matches('\0').to_owned()))
}

/// The content of the first band's item of this role in GDAL's metadata.
fn item<'m>(metadata: &'m str, role: &str) -> Option<&'m str> {
    let role = format!("role=\"{role}\"");
    metadata.split("<Item ").skip(1).find_map(|item| {
        let (attributes, rest) = item.split_once('>')?;
        let is_first = !attributes.contains("sample=") || attributes.contains("sample=\"0\"");
        let (content, _) = rest.split_once('<')?;
        (attributes.contains(&role) && is_first).then(|| content.trim())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_found_by_role_and_band() {
        let metadata = "<GDALMetadata>\n  <Item name=\"AREA\">x</Item>\n  \
            <Item name=\"SCALE\" sample=\"1\" role=\"scale\">9</Item>\n  \
            <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.01</Item>\n  \
            <Item name=\"OFFSET\" sample=\"0\" role=\"offset\"> -5 </Item>\n</GDALMetadata>";
        assert_eq!(item(metadata, "scale"), Some("0.01"));
        assert_eq!(item(metadata, "offset"), Some("-5"));
        assert_eq!(item(metadata, "unittype"), None);
        assert_eq!(item("<Item role=\"scale\"", "scale"), None);
    }
}
