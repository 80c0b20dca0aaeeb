//! Pictures of 8 bits that the decoders of `image` read: WebP and BMP.

use crate::canvas::Canvas;
use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::orientation::{Orientation, from_exif, upright};
use crate::wanted::Wanted;
use image::ImageDecoder;
use image::error::ImageError;

/// Takes a decoder that has read the file's header, and checks the size against the limits. `check`
/// runs before the pixels are decoded.
pub(crate) fn open<'a>(
    format: PictureFormat,
    decoder: Result<impl ImageDecoder + 'a, ImageError>,
    check: impl FnOnce() -> Result<(), DecodeError> + 'a,
    options: &DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let refusal = move |error| match error {
        ImageError::Unsupported(error) => format.unsupported(error.to_string()),
        other => format.malformed(other.to_string()),
    };
    let mut decoder = decoder.map_err(refusal)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = options.limits.check(width.into(), height.into())?;
    let exif = decoder.exif_metadata().map_err(refusal)?;
    let orientation = exif.as_deref().map_or(Orientation::NoTransforms, from_exif);
    let (width, height) = upright(orientation, width, height);
    let component_count = decoder.color_type().channel_count().into();
    let header = Header { format, width, height, component_count, precision: 8 };
    Ok(Opened::new(header, move || {
        check()?;
        let mut limits = image::Limits::no_limits();
        limits.max_alloc = Some(header.decoder_bytes());
        decoder.set_limits(limits).map_err(refusal)?;
        let mut pixels = vec![0; width * height * component_count];
        decoder.read_image(&mut pixels).map_err(refusal)?;
        let mut canvas = Canvas::new(header, orientation, wanted)?;
        canvas.put_rows(&pixels, wanted)?;
        Ok(canvas)
    }))
}
