//! Windows bitmaps, in.
//!
//! Samples of 1, 4, 8, 16, 24 and 32 bits a pixel become RGB of 8 bits, or RGBA where the header
//! has a mask for alpha; runs and palettes are expanded, files stored from the top are told from
//! those stored from the bottom.
//!
//! Literature: Microsoft, "Bitmap Storage" and "BITMAPV5HEADER structure", Windows GDI reference.

use crate::canvas::Canvas;
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use crate::wanted::{Wanted, WantedBytes, always};
use image::codecs::bmp::BmpDecoder;
use image::error::ImageError as DecoderError;
use image::{ColorType, ImageDecoder};

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    guarded(PictureFormat::Bmp, || Ok(open(bytes, limits, &always)?.0))
}

/// Decodes the picture, see [`decode`](crate::decode()).
pub(crate) fn decode(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let limits = options.limits;
    let (header, pixels) = guarded(PictureFormat::Bmp, || {
        let (header, decoder) = open(bytes, &limits, wanted)?;
        let mut pixels = vec![0; header.width * header.height * header.component_count];
        decoder.read_image(&mut pixels).map_err(refusal)?;
        Ok((header, pixels))
    })?;
    let mut canvas = Canvas::new(header, Orientation::default());
    canvas.put_rows(&pixels, wanted)?;
    Ok(canvas)
}

/// A file that is open up to its pixels.
type Source<'a> = (Header, BmpDecoder<WantedBytes<'a>>);

/// Reads headers and palette.
fn open<'a>(
    bytes: &'a [u8],
    limits: &Limits,
    wanted: &'a Wanted<'a>,
) -> Result<Source<'a>, DecodeError> {
    let decoder = BmpDecoder::new(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = limits.check(width.into(), height.into())?;
    let component_count = if decoder.color_type() == ColorType::Rgba8 { 4 } else { 3 };
    let format = PictureFormat::Bmp;
    Ok((Header { format, width, height, component_count, precision: 8 }, decoder))
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecoderError) -> DecodeError {
    let format = PictureFormat::Bmp;
    match error {
        DecoderError::Unsupported(error) => format.unsupported(error.to_string()),
        other => format.malformed(other.to_string()),
    }
}
