//! TIFF, in: the first page.
//!
//! Gray of 1, 2, 4, 8 and 16 bits and RGB of 8 and 16 keep their bits, with or without an alpha
//! component (straight or premultiplied); palettes become RGB of 16 bits, which is how TIFF stores
//! them; CMYK becomes RGB. Strips and tiles, both byte orders, components side by side or one after
//! the other; uncompressed, LZW, Deflate, PackBits and fax group 4. The orientation tag is applied.
//! BigTIFF too. A gray page of signed, floating-point or 32-bit samples, or with tags that elevation
//! models have, is an elevation model, whose heights become whole steps. Not read, and refused as
//! such: YCbCr and Lab, JPEG within TIFF.
//!
//! The decoder is that of `tiff`, since `image` reads no palettes, no samples of 2 and 4 bits, and
//! makes 8 bits of 1.
//!
//! Literature: Adobe, "TIFF, Revision 6.0", 1992.

mod elevation;
mod page;
mod samples;

use crate::canvas::{Canvas, Row};
use crate::decode::{DecodeOptions, METADATA_BYTES, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::wanted::{Wanted, WantedBytes};
use page::Page;
use pixmesh_terrain::{Elevation, Heights};
use samples::Samples;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::{TiffError, TiffUnsupportedError};

/// The heights of a file that is an elevation model, as it has them.
pub(crate) fn heights(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Option<Heights>, DecodeError> {
    let mut decoder = Decoder::new(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
    let Some(elevation) = Elevation::open(&mut decoder).map_err(refusal)? else { return Ok(None) };
    let header = elevation::header(&elevation, options)?;
    options.check_memory(&header)?;
    elevation::heights(elevation, header, bytes, wanted).map(Some)
}

/// Reads the first page's directory.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let mut decoder = Decoder::new(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
    if let Some(elevation) = Elevation::open(&mut decoder).map_err(refusal)? {
        return elevation::open(elevation, bytes, options, wanted);
    }
    let page = Page::read(&mut decoder)?;
    let is_big = bytes.get(2..4).is_some_and(|version| version.contains(&b'+'));
    if is_big && page.is_indexed() {
        return Err(PictureFormat::Tiff.unsupported("BigTIFF with a palette is not supported"));
    }
    let header = page.header(&options.limits)?;
    Ok(Opened::new(header, move || {
        let stored = read_stored(bytes, &page, wanted)?;
        let mut canvas = Canvas::new(header, page.orientation, wanted)?;
        canvas.is_premultiplied = page.is_premultiplied;
        let mut samples = Samples::new(&page, &stored)?;
        for y in 0..page.height {
            wanted()?;
            canvas.put_row(Row::whole(y), samples.row(y));
        }
        Ok(canvas)
    }))
}

/// The samples as stored, several to a byte where they have less than 8 bits.
fn read_stored(
    bytes: &[u8],
    page: &Page,
    wanted: &Wanted<'_>,
) -> Result<DecodingResult, DecodeError> {
    let mut limits = tiff::decoder::Limits::default();
    limits.decoding_buffer_size = page.stored_bytes();
    limits.ifd_value_size = METADATA_BYTES;
    limits.intermediate_buffer_size = bytes.len();
    let file = page.without_palette(bytes);
    let mut decoder =
        Decoder::new(WantedBytes::new(&file, wanted)).map_err(refusal)?.with_limits(limits);
    let mut stored = DecodingResult::U8(Vec::new());
    decoder.read_image_to_buffer(&mut stored).map_err(refusal)?;
    Ok(stored)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: TiffError) -> DecodeError {
    let format = PictureFormat::Tiff;
    match error {
        TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedCompressionMethod(method)) => {
            format.unsupported(format!("compression {method:?} is not supported"))
        }
        TiffError::UnsupportedError(error) => format.unsupported(error.to_string()),
        TiffError::IoError(_) => {
            format.malformed("it ends early, or its compressed data are broken")
        }
        other => format.malformed(other.to_string()),
    }
}
