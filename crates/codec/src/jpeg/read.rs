//! The JPEG reader: gray stays gray, all else becomes RGB, the EXIF orientation is applied.

use super::frame::{Frame, Jpeg};
use crate::canvas::Canvas;
use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::{Orientation, upright};
use crate::wanted::{Wanted, WantedBytes};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Reads everything before the first scan.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let jpeg = Jpeg::open(bytes, &options.limits)?;
    let frame = jpeg.frame.clone();
    let (width, height) = upright(frame.orientation, frame.width, frame.height);
    let component_count = if frame.samplings.len() == 1 { 1 } else { 3 };
    let format = PictureFormat::Jpeg;
    let header = Header { format, width, height, component_count, precision: 8 };
    Ok(Opened::new(header, move || {
        let stripped = jpeg.strip(options.lenient)?;
        let pixels = decode_stripped(&frame, component_count, WantedBytes::new(&stripped, wanted))?;
        drop(stripped);
        let mut canvas = Canvas::new(header, frame.orientation, wanted)?;
        canvas.put_rows(&pixels, wanted)?;
        Ok(canvas)
    }))
}

/// A copy of a JPEG without its metadata, where readers that know no orientation and no inks show
/// the same picture.
pub(crate) fn plain_copy(bytes: &[u8]) -> Option<Vec<u8>> {
    if PictureFormat::sniff(bytes) != Ok(PictureFormat::Jpeg) {
        return None;
    }
    let any_size = Limits { max_pixels: u64::MAX, max_side: usize::MAX };
    let jpeg = Jpeg::open(bytes, &any_size).ok()?;
    let Frame { orientation, samplings, .. } = &jpeg.frame;
    let plain = *orientation == Orientation::NoTransforms && samplings.len() < 4;
    if plain { jpeg.strip(false).ok() } else { None }
}

/// Decodes what the walk through the segments has left of the file.
///
/// The decoder enforces no limit of memory itself: the buffer is ours, and is only made when the
/// decoder has understood the same size as the walk.
fn decode_stripped(
    frame: &Frame,
    component_count: usize,
    stripped: WantedBytes<'_>,
) -> Result<Vec<u8>, DecodeError> {
    let color = if component_count == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(color)
        .set_strict_mode(false)
        .set_max_width(frame.width)
        .set_max_height(frame.height);
    let mut decoder = JpegDecoder::new_with_options(stripped, options);
    decoder.decode_headers().map_err(refusal)?;
    let is_gray = decoder.input_colorspace() == Some(ColorSpace::Luma);
    if decoder.dimensions() != Some((frame.width, frame.height))
        || is_gray != (component_count == 1)
    {
        return Err(PictureFormat::Jpeg.malformed("its headers contradict each other"));
    }
    let mut pixels = vec![0; frame.width * frame.height * component_count];
    decoder.decode_into(&mut pixels).map_err(refusal)?;
    Ok(pixels)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecodeErrors) -> DecodeError {
    let format = PictureFormat::Jpeg;
    match error {
        DecodeErrors::Unsupported(scheme) => format.unsupported(format!("{scheme:?}")),
        other => format.malformed(other.to_string()),
    }
}
