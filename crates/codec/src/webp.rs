//! WebP, in: still pictures and the first frame of animations, lossy and lossless.
//!
//! The container is first walked here, chunk by chunk: it must run up to its end, and the picture
//! within must have the size that the container claims, because the decoder would make room for it
//! before it compares them. Samples become RGB or RGBA of 8 bits; the orientation in EXIF data is
//! applied, colour profiles are ignored.
//!
//! Literature: P. Zern, P. Massimino and J. Alakuijala, "WebP Image Format" (RFC 9649), 2024.

mod container;
mod lossless;

use crate::canvas::Canvas;
use crate::decode::{DecodeOptions, METADATA_BYTES};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::wanted::{Wanted, WantedBytes};
pub(crate) use container::CODE_BYTES;

use container::Container;
use image_webp::{DecodingError, WebPDecoder};

/// The pixels of a picture without loss, and of one with loss, that were measured to take half a tenth
/// of a second without reading.
const LOSSLESS_PIXELS_IN_TIME: usize = 6_000_000;
const LOSSY_PIXELS_IN_TIME: usize = 3_000_000;

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    let container = Container::read(bytes)?;
    header(&container, limits)
}

/// Decodes the picture, see [`decode`](crate::decode()).
pub(crate) fn decode(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let pixels = decode_stored(bytes, options, wanted)?;
    let mut canvas = canvas(bytes, &options.limits, wanted)?;
    canvas.put_rows(&pixels, wanted)?;
    Ok(canvas)
}

/// The first half of [`decode`]: the pixels as stored, their components side by side, rows from the
/// top.
pub(crate) fn decode_stored(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Vec<u8>, DecodeError> {
    let container = Container::read(bytes)?;
    let header = header(&container, &options.limits)?;
    container.check_picture(wanted)?;
    let row_samples = container.width as usize * header.component_count;
    guarded(PictureFormat::WebP, || {
        let mut decoder =
            WebPDecoder::new(WantedBytes::new(bytes, wanted)).map_err(|e| refusal(&e))?;
        decoder.set_memory_limit(METADATA_BYTES);
        let mut pixels = vec![0; row_samples * container.height as usize];
        decoder.read_image(&mut pixels).map_err(|e| refusal(&e))?;
        Ok(pixels)
    })
}

/// What the second half of [`decode`] puts the pixels on.
pub(crate) fn canvas(
    bytes: &[u8],
    limits: &Limits,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let container = Container::read(bytes)?;
    let header = header(&container, limits)?;
    Ok(Canvas::new_while(header, container.orientation, wanted)?)
}

/// Whether the decoder may go on for long after the last time that it reads: it decodes a lossy
/// picture from a copy of its chunk, and turns the numbers of a lossless one into pixels at the end.
pub(crate) fn may_stop_late(bytes: &[u8], limits: &Limits) -> bool {
    let Ok(container) = Container::read(bytes) else { return false };
    let in_time =
        if container.is_lossless() { LOSSLESS_PIXELS_IN_TIME } else { LOSSY_PIXELS_IN_TIME };
    header(&container, limits).is_ok_and(|header| header.width * header.height > in_time)
}

/// What the container means for the decoded image.
fn header(container: &Container<'_>, limits: &Limits) -> Result<Header, DecodeError> {
    let (width, height) = limits.check(container.width.into(), container.height.into())?;
    let (width, height) = container.orientation.upright(width, height);
    let component_count = if container.has_alpha { 4 } else { 3 };
    Ok(Header { format: PictureFormat::WebP, width, height, component_count, precision: 8 })
}

/// The decoder's error in the terms of this crate.
fn refusal(error: &DecodingError) -> DecodeError {
    PictureFormat::WebP.malformed(error.to_string())
}
