//! The PNG reader. It uses the decoder of `png`, because that of `image` raises samples of fewer bits to
//! 8 and gives no rows between which decoding can be cancelled.
//!
//! Samples are taken raw: gray of 1, 2, 4, 8 or 16 bits keeps them, and gAMA, sRGB and cICP change
//! nothing. A palette becomes RGB of 8 bits; transparency, of the palette or of one colour, becomes a
//! component. The orientation in an eXIf chunk is applied when the chunk stands before the pixels.
//! Text and iCCP chunks are skipped and never inflated; all other chunks before the pixels may take
//! 8 MiB together. Checksums of critical chunks are verified, and the file must have its IEND chunk. Of
//! an animated PNG the default image is decoded, which nearly always is the first frame.

use super::interlace::stored_rows;
use super::pixels::Pixels;
use crate::canvas::Canvas;
use crate::decode::{DecodeOptions, METADATA_BYTES, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::orientation::{Orientation, from_exif, upright};
use crate::wanted::{Wanted, WantedBytes};
use png::{Decoder, DecodingError, Reader};
use std::io::ErrorKind;

/// The most bytes of a stored pixel: four samples of 16 bits.
const MAX_PIXEL_BYTES: usize = 8;

/// Reads everything before the pixels.
///
/// The size is checked before any other chunk is read. What stands before the pixels may take
/// [`METADATA_BYTES`], the decoder's rows as much as the longest side allowed.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let row_bytes = options.limits.max_side.saturating_mul(MAX_PIXEL_BYTES);
    let budget = png::Limits { bytes: METADATA_BYTES.saturating_add(row_bytes) };
    let mut decoder = Decoder::new_with_limits(WantedBytes::new(bytes, wanted), budget);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let (width, height) = decoder.read_header_info().map_err(refusal)?.size();
    let (width, height) = options.limits.check(width.into(), height.into())?;
    let reader = decoder.read_info().map_err(refusal)?;
    let pixels = Pixels::new(reader.info())?;
    let exif = reader.info().exif_metadata.as_deref();
    let orientation = exif.map_or(Orientation::NoTransforms, from_exif);
    let (width, height) = upright(orientation, width, height);
    let (component_count, precision) = (pixels.component_count(), pixels.precision());
    let format = PictureFormat::Png;
    let header = Header { format, width, height, component_count, precision };
    Ok(Opened::new(header, move || {
        let canvas = Canvas::new(header, orientation, wanted)?;
        read_rows(reader, pixels, canvas, options.lenient, wanted)
    }))
}

/// Decodes the rows, in a lenient way up to the end of the file.
fn read_rows(
    mut reader: Reader<WantedBytes<'_>>,
    mut pixels: Pixels,
    mut canvas: Canvas,
    lenient: bool,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let (width, height) = reader.info().size();
    let (width, height) = (width as usize, height as usize);
    let mut samples = Vec::new();
    for row in stored_rows(width, height, reader.info().interlaced) {
        wanted()?;
        let stored = match reader.next_row() {
            Err(error) if lenient && is_end(&error) => return Ok(canvas),
            stored => stored.map_err(refusal)?,
        };
        let stored = stored.ok_or_else(|| PictureFormat::Png.malformed("rows are missing"))?;
        let count = (width - row.first).div_ceil(row.step);
        pixels.unpack(stored.data(), count, &mut samples)?;
        canvas.put_row(row, &samples);
    }
    // The rest must be there up to IEND, and the checksums of the pixel data must be right.
    match reader.finish() {
        Err(error) if !lenient => Err(refusal(error)),
        _ => Ok(canvas),
    }
}

/// Tells whether an error is that of a file that ends early.
fn is_end(error: &DecodingError) -> bool {
    matches!(error, DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecodingError) -> DecodeError {
    let format = PictureFormat::Png;
    match error {
        DecodingError::LimitsExceeded => {
            DecodeError::MetadataTooLarge { format, limit: METADATA_BYTES }
        }
        error if is_end(&error) => format.malformed("it ends early"),
        other => format.malformed(other.to_string()),
    }
}
