//! GIF, in: the first frame on its screen.
//!
//! The palette becomes RGB of 8 bits. There is an alpha component when the frame has a transparent
//! colour or does not cover the screen; what it does not cover is transparent, as browsers show it.
//! The decoder is that of `gif`, since `image` makes RGBA of every frame and takes no file that ends
//! early.
//!
//! Literature: CompuServe, "Graphics Interchange Format, Version 89a", 1990.

use crate::budget::Budget;
use crate::canvas::{Canvas, Row};
use crate::decode::{DecodeOptions, METADATA_BYTES};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use crate::wanted::{Wanted, WantedBytes, always};
use gif::{ColorOutput, Decoder, DecodingError, Frame, MemoryLimit};
use std::num::NonZeroU64;

/// Where the size of the screen ends, the header's last four bytes that far.
const SIZE_END: usize = 10;

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    guarded(
        PictureFormat::Gif,
        &always,
        |wanted| Ok(Animation::open(bytes, limits, wanted)?.header),
    )
}

/// Decodes the first frame, see [`decode`](crate::decode()).
pub(crate) fn decode(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    guarded(PictureFormat::Gif, wanted, |wanted| {
        let mut animation = Animation::open(bytes, &options.limits, wanted)?;
        let budget = Budget::of_decoder(&animation.header, options)?;
        let indices = animation.read_frame(options.lenient)?;
        animation.paint(&indices, budget, wanted)
    })
}

/// A file that is open up to the pixels of its first frame.
struct Animation<'a> {
    decoder: Decoder<WantedBytes<'a>>,
    frame: Frame<'static>,
    header: Header,
}

impl<'a> Animation<'a> {
    fn open(bytes: &'a [u8], limits: &Limits, wanted: &'a Wanted<'a>) -> Result<Self, DecodeError> {
        let &[.., w0, w1, h0, h1] =
            bytes.get(..SIZE_END).ok_or_else(|| malformed("it ends early"))?
        else {
            return Err(malformed("it ends early"));
        };
        let side = |low, high| u16::from_le_bytes([low, high]).into();
        let (width, height) = limits.check(side(w0, w1), side(h0, h1))?;
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(ColorOutput::Indexed);
        options.check_frame_consistency(true);
        options.allow_unknown_blocks(true);
        // All that the decoder would keep of itself is metadata: the pixels' buffer is ours.
        options.set_memory_limit(MemoryLimit::Bytes(
            NonZeroU64::new(METADATA_BYTES as u64).unwrap_or(NonZeroU64::MIN),
        ));
        let mut decoder = options.read_info(WantedBytes::new(bytes, wanted)).map_err(refusal)?;
        let frame = decoder.next_frame_info().map_err(refusal)?;
        let frame = frame.ok_or_else(|| malformed("it has no frame"))?.clone();
        let covers = usize::from(frame.width) == width && usize::from(frame.height) == height;
        let opaque = covers && frame.transparent.is_none();
        let component_count = if opaque { 3 } else { 4 };
        let format = PictureFormat::Gif;
        let header = Header { format, width, height, component_count, precision: 8 };
        Ok(Self { decoder, frame, header })
    }

    /// The frame's indices of colours, row by row from the top; those that are missing are 0.
    fn read_frame(&mut self, lenient: bool) -> Result<Vec<u8>, DecodeError> {
        let mut indices = vec![0; usize::from(self.frame.width) * usize::from(self.frame.height)];
        match self.decoder.read_into_buffer(&mut indices) {
            Err(DecodingError::UnexpectedEof) if lenient => {}
            result => result.map_err(refusal)?,
        }
        Ok(indices)
    }

    /// Puts the frame's colours onto the screen.
    fn paint(
        &self,
        indices: &[u8],
        budget: Budget,
        wanted: &Wanted<'_>,
    ) -> Result<Canvas, DecodeError> {
        let palette = self.decoder.palette().map_err(refusal)?;
        let frame = &self.frame;
        let mut canvas = Canvas::new(self.header, Orientation::default(), budget, wanted)?;
        let mut samples = Vec::new();
        for (y, row) in indices.chunks_exact(usize::from(frame.width).max(1)).enumerate() {
            wanted()?;
            samples.clear();
            for &index in row {
                let first = 3 * usize::from(index);
                let colour = palette.get(first..first + 3).ok_or_else(|| {
                    let count = palette.len() / 3;
                    malformed(&format!("a pixel has colour {index} of a palette of {count}"))
                })?;
                samples.extend_from_slice(colour);
                if self.header.component_count == 4 {
                    samples.push(if frame.transparent == Some(index) { 0 } else { 255 });
                }
            }
            let y = usize::from(frame.top) + y;
            canvas.put_row(Row { y, first: frame.left.into(), step: 1 }, &samples);
        }
        Ok(canvas)
    }
}

fn malformed(reason: &str) -> DecodeError {
    PictureFormat::Gif.malformed(reason)
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
