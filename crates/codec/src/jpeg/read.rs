//! The JPEG reader: gray stays gray, all else becomes RGB, the EXIF orientation is applied.

use super::frame::Frame;
use crate::canvas::{Canvas, Row};
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use image::codecs::jpeg::JpegDecoder;
use image::error::ImageError as DecoderError;
use image::{ColorType, ImageDecoder};
use std::io::Cursor;

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    Ok(header(&Frame::read(bytes, limits)?))
}

/// Decodes the picture, see [`decode`](crate::decode()).
pub(crate) fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Canvas, DecodeError> {
    let (frame, essence) = Frame::read_all(bytes, options)?;
    let header = header(&frame);
    let pixels =
        guarded(PictureFormat::Jpeg, || decode_stored(&frame, header.component_count, essence))?;
    let mut canvas = Canvas::new(header, frame.orientation);
    for (y, row) in pixels.chunks_exact(frame.width * header.component_count).enumerate() {
        canvas.put_row(Row::whole(y), row);
    }
    Ok(canvas)
}

/// A copy of a JPEG without its metadata, where readers that know no orientation and no inks show
/// the same picture.
pub(crate) fn plain_copy(bytes: &[u8]) -> Option<Vec<u8>> {
    if PictureFormat::sniff(bytes) != Ok(PictureFormat::Jpeg) {
        return None;
    }
    let any_size = Limits { max_pixels: u64::MAX, max_side: usize::MAX };
    let options = DecodeOptions { limits: any_size, ..DecodeOptions::default() };
    let (frame, essence) = Frame::read_all(bytes, &options).ok()?;
    let plain = frame.orientation == Orientation::default() && frame.components.len() < 4;
    plain.then_some(essence)
}

/// What the frame header means for the decoded image.
fn header(frame: &Frame) -> Header {
    let (width, height) = frame.orientation.upright(frame.width, frame.height);
    let component_count = if frame.components.len() == 1 { 1 } else { 3 };
    Header { format: PictureFormat::Jpeg, width, height, component_count, precision: 8 }
}

/// Decodes what the walk through the segments has left of the file: the pixels as stored, their
/// components side by side, rows from the top.
///
/// The decoder enforces no limit of memory itself: the buffer is ours, and is only made when the
/// decoder has understood the same size as the walk.
fn decode_stored(
    frame: &Frame,
    component_count: usize,
    essence: Vec<u8>,
) -> Result<Vec<u8>, DecodeError> {
    let mut decoder = JpegDecoder::new(Cursor::new(essence)).map_err(refusal)?;
    let (width, height) = (frame.width as u32, frame.height as u32);
    let color_type = if component_count == 1 { ColorType::L8 } else { ColorType::Rgb8 };
    if decoder.dimensions() != (width, height) || decoder.color_type() != color_type {
        return Err(PictureFormat::Jpeg.malformed("its headers contradict each other"));
    }
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width), Some(height));
    decoder.set_limits(limits).map_err(refusal)?;
    let mut pixels = vec![0; frame.width * frame.height * component_count];
    decoder.read_image(&mut pixels).map_err(refusal)?;
    Ok(pixels)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecoderError) -> DecodeError {
    let format = PictureFormat::Jpeg;
    match error {
        DecoderError::Unsupported(error) => format.unsupported(error.to_string()),
        other => format.malformed(other.to_string()),
    }
}
