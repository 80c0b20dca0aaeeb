//! Windows bitmaps, in.
//!
//! Samples of 1, 4, 8, 16, 24 and 32 bits a pixel become RGB of 8 bits, or RGBA where the header
//! has a mask for alpha; runs and palettes are expanded; rows may be stored from the top or
//! from the bottom.
//!
//! Literature: Microsoft, "Bitmap Storage" and "BITMAPV5HEADER structure", Windows GDI reference.

use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::raster;
use crate::wanted::{Wanted, WantedBytes};
use image::codecs::bmp::BmpDecoder;

/// Where the length of the second header stands.
const HEADER_LENGTH_AT: usize = 14;

/// Where columns and rows stand, in numbers of 16 bits after a core header's length, else of 32.
const SIZE_AT: usize = 18;

/// Bytes of the oldest header.
const CORE_HEADER_BYTES: i32 = 12;

/// Reads headers and palette. The size is checked first: the decoder reports a size of 0 as a feature
/// that it does not support.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    if let Some((width, height)) = claimed_size(bytes) {
        options.limits.check(width, height)?;
    }
    let decoder = BmpDecoder::new(WantedBytes::new(bytes, wanted));
    raster::open(PictureFormat::Bmp, decoder, || Ok(()), options, wanted)
}

/// The columns and rows that the header claims, if the file is long enough to claim any.
fn claimed_size(bytes: &[u8]) -> Option<(u64, u64)> {
    let number = |at: usize| bytes.get(at..)?.first_chunk().map(|&four| i32::from_le_bytes(four));
    let short = |at: usize| bytes.get(at..)?.first_chunk().map(|&two| u16::from_le_bytes(two));
    if number(HEADER_LENGTH_AT)? == CORE_HEADER_BYTES {
        return Some((short(SIZE_AT)?.into(), short(SIZE_AT + 2)?.into()));
    }
    // A negative height means rows from the top; a negative width is an error.
    let width = u64::try_from(number(SIZE_AT)?).ok()?;
    Some((width, number(SIZE_AT + 4)?.unsigned_abs().into()))
}
