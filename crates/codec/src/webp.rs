//! WebP, in: still pictures and the first frame of animations, lossy and lossless.
//!
//! Samples become RGB or RGBA of 8 bits; the orientation in EXIF data is applied, colour profiles
//! are ignored. The decoder limits its memory for metadata only: the module `guard` first checks what
//! it would allocate.
//!
//! Literature: P. Zern, P. Massimino and J. Alakuijala, "WebP Image Format" (RFC 9649), 2024.

mod guard;
mod lossless;

use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::raster;
use crate::wanted::{Wanted, WantedBytes};
use guard::Guard;
use image::codecs::webp::WebPDecoder;

pub(crate) use lossless::CODE_BYTES;

/// Reads the header.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let (file, streams) = Guard::check(bytes, &options.limits)?;
    let check = move || streams.iter().try_for_each(|stream| lossless::check_codes(stream, wanted));
    let decoder = WebPDecoder::new(WantedBytes::new(file, wanted));
    raster::open(PictureFormat::WebP, decoder, check, options, wanted)
}

fn ends_early() -> DecodeError {
    PictureFormat::WebP.malformed("it ends early")
}
