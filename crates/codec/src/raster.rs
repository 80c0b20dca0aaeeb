//! Pictures that the decoders of `image` read: WebP and BMP, both of 8 bits.

use crate::budget::{Budget, decoder_bytes};
use crate::canvas::Canvas;
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use crate::wanted::Wanted;
use image::ImageDecoder;
use image::error::ImageError;

/// A file that is open up to its pixels.
pub(crate) struct Raster<D> {
    pub(crate) header: Header,
    orientation: Orientation,
    decoder: D,
}

impl<D: ImageDecoder> Raster<D> {
    /// Takes a decoder that has read the file's header, and checks the size against the limits.
    pub(crate) fn new(
        format: PictureFormat,
        opened: Result<D, ImageError>,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let mut decoder = opened.map_err(|error| refusal(format, error))?;
        let (width, height) = decoder.dimensions();
        let (width, height) = limits.check(width.into(), height.into())?;
        let exif = decoder.exif_metadata().map_err(|error| refusal(format, error))?;
        let orientation = exif.as_deref().map_or_else(Orientation::default, Orientation::from_exif);
        let (width, height) = orientation.upright(width, height);
        let component_count = decoder.color_type().channel_count().into();
        let header = Header { format, width, height, component_count, precision: 8 };
        Ok(Self { header, orientation, decoder })
    }

    /// Decodes the pixels; the decoder may take what the budget has for it.
    pub(crate) fn decode(
        self,
        options: &DecodeOptions,
        wanted: &Wanted<'_>,
    ) -> Result<Canvas, DecodeError> {
        let Self { header, orientation, mut decoder } = self;
        let budget = Budget::of_decoder(&header, options)?;
        let mut limits = image::Limits::no_limits();
        limits.max_alloc = Some(decoder_bytes(&header));
        decoder.set_limits(limits).map_err(|error| refusal(header.format, error))?;
        let mut pixels = vec![0; header.width * header.height * header.component_count];
        decoder.read_image(&mut pixels).map_err(|error| refusal(header.format, error))?;
        let mut canvas = Canvas::new(header, orientation, budget, wanted)?;
        canvas.put_rows(&pixels, wanted)?;
        Ok(canvas)
    }
}

/// The decoder's error in the terms of this crate.
fn refusal(format: PictureFormat, error: ImageError) -> DecodeError {
    match error {
        ImageError::Unsupported(error) => format.unsupported(error.to_string()),
        other => format.malformed(other.to_string()),
    }
}
