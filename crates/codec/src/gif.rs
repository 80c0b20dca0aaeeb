//! GIF, in: the first frame on its screen.
//!
//! The palette becomes RGB of 8 bits. There is an alpha component when the frame has a transparent
//! colour or does not cover the screen; what it does not cover is transparent, as browsers show it.
//! The decoder is that of `gif`, since `image` makes RGBA of every frame and takes no file that ends
//! early.
//!
//! Literature: CompuServe, "Graphics Interchange Format, Version 89a", 1990.

use crate::canvas::{Canvas, Row};
use crate::decode::{DecodeOptions, METADATA_BYTES, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::orientation::Orientation;
use crate::wanted::{Wanted, WantedBytes};
use gif::{ColorOutput, DecodingError, Frame, MemoryLimit};
use std::num::NonZeroU64;

/// End of the screen's columns and rows, which are the last four bytes before it.
const SIZE_END: usize = 10;

/// Reads everything before the pixels of the first frame.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let Some(&[.., w0, w1, h0, h1]) = bytes.get(..SIZE_END) else {
        return Err(PictureFormat::Gif.malformed("it ends early"));
    };
    let side = |low, high| u16::from_le_bytes([low, high]).into();
    let (width, height) = options.limits.check(side(w0, w1), side(h0, h1))?;
    let mut reading = gif::DecodeOptions::new();
    reading.set_color_output(ColorOutput::Indexed);
    reading.check_frame_consistency(true);
    reading.allow_unknown_blocks(true);
    // The pixels' buffer is ours, so that the decoder allocates for metadata only.
    let most = NonZeroU64::new(METADATA_BYTES as u64).unwrap_or(NonZeroU64::MIN);
    reading.set_memory_limit(MemoryLimit::Bytes(most));
    let mut decoder = reading.read_info(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
    let frame = decoder.next_frame_info().map_err(refusal)?;
    let frame = frame.ok_or_else(|| PictureFormat::Gif.malformed("it has no frame"))?.clone();
    let covers = usize::from(frame.width) == width && usize::from(frame.height) == height;
    let opaque = covers && frame.transparent.is_none();
    let component_count = if opaque { 3 } else { 4 };
    let format = PictureFormat::Gif;
    let header = Header { format, width, height, component_count, precision: 8 };
    Ok(Opened::new(header, move || {
        // Pixels that are missing keep the first colour.
        let mut indices = vec![0; usize::from(frame.width) * usize::from(frame.height)];
        match decoder.read_into_buffer(&mut indices) {
            Err(DecodingError::UnexpectedEof) if options.lenient => {}
            result => result.map_err(refusal)?,
        }
        paint(&frame, &indices, decoder.palette().map_err(refusal)?, header, wanted)
    }))
}

/// The frame's colours on the screen.
fn paint(
    frame: &Frame<'_>,
    indices: &[u8],
    palette: &[u8],
    header: Header,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let mut canvas = Canvas::new(header, Orientation::NoTransforms, wanted)?;
    let mut samples = Vec::new();
    for (y, row) in indices.chunks_exact(usize::from(frame.width).max(1)).enumerate() {
        wanted()?;
        samples.clear();
        for &index in row {
            let first = 3 * usize::from(index);
            let colour = palette.get(first..first + 3).ok_or_else(|| {
                let count = palette.len() / 3;
                PictureFormat::Gif
                    .malformed(format!("a pixel has colour {index} of a palette of {count}"))
            })?;
            samples.extend_from_slice(colour);
            if header.component_count == 4 {
                samples.push(if frame.transparent == Some(index) { 0 } else { 255 });
            }
        }
        let y = usize::from(frame.top) + y;
        canvas.put_row(Row { y, first: frame.left.into(), step: 1 }, &samples);
    }
    Ok(canvas)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecodingError) -> DecodeError {
    let format = PictureFormat::Gif;
    match error {
        DecodingError::UnexpectedEof => format.malformed("it ends early"),
        DecodingError::MemoryLimit => {
            DecodeError::MetadataTooLarge { format, limit: METADATA_BYTES }
        }
        other => format.malformed(other.to_string()),
    }
}
