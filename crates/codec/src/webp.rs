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
    let container = Container::read(bytes)?;
    let header = header(&container, &options.limits)?;
    container.check_picture(wanted)?;
    let row_samples = container.width as usize * header.component_count;
    let pixels = guarded(PictureFormat::WebP, wanted, |wanted| {
        let mut decoder =
            WebPDecoder::new(WantedBytes::new(bytes, wanted)).map_err(|e| refusal(&e))?;
        decoder.set_memory_limit(METADATA_BYTES);
        let mut pixels = vec![0; row_samples * container.height as usize];
        decoder.read_image(&mut pixels).map_err(|e| refusal(&e))?;
        Ok(pixels)
    })?;
    let mut canvas = Canvas::new_while(header, container.orientation, wanted)?;
    canvas.put_rows(&pixels, wanted)?;
    Ok(canvas)
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
