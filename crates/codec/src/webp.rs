//! WebP, in: still pictures and the first frame of animations, lossy and lossless.
//!
//! Samples become RGB or RGBA of 8 bits; the orientation in EXIF data is applied, colour profiles
//! are ignored. The decoder has no limits of its own: the module `guard` first checks what it would
//! take memory for.
//!
//! Literature: P. Zern, P. Massimino and J. Alakuijala, "WebP Image Format" (RFC 9649), 2024.

mod guard;
mod lossless;

use crate::canvas::Canvas;
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::raster::Raster;
use crate::wanted::{Wanted, WantedBytes, always};
use guard::Guard;
use image::codecs::webp::WebPDecoder;

pub(crate) use lossless::CODE_BYTES;

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    let (file, _) = Guard::check(bytes, limits)?;
    guarded(PictureFormat::WebP, &always, |wanted| Ok(open(file, limits, wanted)?.header))
}

/// Decodes the picture, see [`decode`](crate::decode()).
pub(crate) fn decode(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let limits = &options.limits;
    let (file, streams) = Guard::check(bytes, limits)?;
    for stream in &streams {
        lossless::check_codes(stream, wanted)?;
    }
    guarded(PictureFormat::WebP, wanted, |wanted| {
        open(file, limits, wanted)?.decode(options, wanted)
    })
}

fn open<'a>(
    file: &'a [u8],
    limits: &Limits,
    wanted: &'a Wanted<'a>,
) -> Result<Raster<WebPDecoder<WantedBytes<'a>>>, DecodeError> {
    let decoder = WebPDecoder::new(WantedBytes::new(file, wanted));
    Raster::new(PictureFormat::WebP, decoder, limits)
}

fn ends_early() -> DecodeError {
    PictureFormat::WebP.malformed("it ends early")
}
