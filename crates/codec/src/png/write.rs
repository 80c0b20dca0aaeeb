//! The PNG writer.
//!
//! One to four components make gray, gray with alpha, RGB and RGBA. Gray keeps a precision of 1, 2,
//! 4, 8 or 16 bits, the others one of 8 or 16. A precision that PNG lacks is raised to the next that
//! it has: `v` becomes `v (2^to - 1) / (2^from - 1)`, rounded to the nearest integer, so that black
//! and white stay what they are, and an sBIT chunk tells the true precision.

use crate::choices::PngCompression;
use crate::error::EncodeError;
use crate::interleave::interleave_row;
use crate::wanted::{Wanted, always};
use pixmesh_meshing::Image;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, chunk};
use std::io::{self, Write};

/// Bytes of compressed pixels that go into one chunk.
const CHUNK_BYTES: usize = 1 << 16;

/// Writes an image as PNG, fast.
///
/// # Errors
/// As [`write_png_with`].
pub fn write_png(image: &Image, out: &mut impl Write) -> Result<(), EncodeError> {
    write_png_with(image, PngCompression::Fast, out)
}

/// Writes an image as PNG, fast or small.
///
/// Rows are filtered and compressed one by one, so that no second copy of the image is made.
///
/// # Errors
/// [`EncodeError::ComponentCount`] for more than four components, and whatever `out` fails with.
pub fn write_png_with(
    image: &Image,
    compression: PngCompression,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    write_png_while(image, compression, out, &always)
}

/// Writes an image as PNG, as [`write_png_with`] does, for as long as it is wanted.
///
/// # Errors
/// As [`write_png_with`], and [`EncodeError::Cancelled`] when it is no longer wanted.
pub fn write_png_while(
    image: &Image,
    compression: PngCompression,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let component_count = image.component_count();
    let color = color_type(component_count)?;
    let depth = bit_depth(component_count, image.precision());
    let scale = Scale::new(image.precision(), depth as u8);
    let mut encoder = Encoder::new(out, image.width() as u32, image.height() as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(match compression {
        PngCompression::Fast => Compression::Fastest,
        PngCompression::Small => Compression::Balanced,
    });
    let mut writer = encoder.write_header().map_err(io_error)?;
    if scale.from != scale.to {
        let bits = vec![image.precision(); component_count];
        writer.write_chunk(chunk::sBIT, &bits).map_err(io_error)?;
    }
    let mut rows = writer.stream_writer_with_size(CHUNK_BYTES).map_err(io_error)?;
    let mut packed = Vec::new();
    for y in (0..image.height()).rev() {
        wanted()?;
        pack_row(image, y, &scale, &mut packed);
        rows.write_all(&packed)?;
    }
    rows.finish().map_err(io_error)?;
    writer.finish().map_err(io_error)?;
    Ok(())
}

/// The kind of PNG that stores so many components.
fn color_type(component_count: usize) -> Result<ColorType, EncodeError> {
    match component_count {
        1 => Ok(ColorType::Grayscale),
        2 => Ok(ColorType::GrayscaleAlpha),
        3 => Ok(ColorType::Rgb),
        4 => Ok(ColorType::Rgba),
        actual => Err(EncodeError::ComponentCount { format: "PNG", actual, maximum: 4 }),
    }
}

/// The smallest depth that PNG has for samples of so many bits.
fn bit_depth(component_count: usize, precision: u8) -> BitDepth {
    match precision {
        1 if component_count == 1 => BitDepth::One,
        2 if component_count == 1 => BitDepth::Two,
        3..=4 if component_count == 1 => BitDepth::Four,
        0..=8 => BitDepth::Eight,
        _ => BitDepth::Sixteen,
    }
}

/// The change of samples from one number of bits to another.
struct Scale {
    from: u8,
    to: u8,
    /// What each sample becomes; empty when nothing changes.
    table: Vec<u16>,
}

impl Scale {
    fn new(from: u8, to: u8) -> Self {
        let largest = |bits: u8| (1_u64 << bits) - 1;
        let (from_max, to_max) = (largest(from), largest(to));
        let table = if from == to {
            Vec::new()
        } else {
            (0..=from_max).map(|v| ((2 * v * to_max + from_max) / (2 * from_max)) as u16).collect()
        };
        Self { from, to, table }
    }

    /// The sample at the new number of bits.
    fn apply(&self, sample: u16) -> u16 {
        self.table.get(usize::from(sample)).copied().unwrap_or(sample)
    }
}

/// Replaces `packed` with the bytes of row `y`.
fn pack_row(image: &Image, y: usize, scale: &Scale, packed: &mut Vec<u8>) {
    if scale.to < 8 {
        let per_byte = 8 / usize::from(scale.to);
        packed.clear();
        packed.extend(image.row(0, y).chunks(per_byte).map(|samples| pack_byte(samples, scale)));
    } else {
        let bytes_per_sample = usize::from(scale.to / 8);
        interleave_row(image, y, bytes_per_sample, |sample| scale.apply(sample), packed);
    }
}

/// Samples of less than 8 bits in one byte, the first in the most significant bits.
fn pack_byte(samples: &[u16], scale: &Scale) -> u8 {
    let shifts = (0..8).step_by(usize::from(scale.to)).rev();
    let bits = samples.iter().zip(shifts).map(|(&sample, shift)| scale.apply(sample) << shift);
    bits.fold(0, |byte, bits| byte | bits as u8)
}

/// The encoder's error: only writing can fail here.
fn io_error(error: EncodingError) -> EncodeError {
    EncodeError::Io(io::Error::from(error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaling_keeps_black_and_white_and_rounds_to_the_nearest() {
        let three_to_four = Scale::new(3, 4);
        let scaled: Vec<u16> = (0..8).map(|v| three_to_four.apply(v)).collect();
        assert_eq!(scaled, [0, 2, 4, 6, 9, 11, 13, 15]);
        for (from, to) in [(1, 8), (5, 8), (9, 16), (12, 16), (15, 16)] {
            let scale = Scale::new(from, to);
            let largest = |bits: u8| u16::MAX >> (16 - bits);
            assert_eq!(scale.apply(0), 0);
            assert_eq!(scale.apply(largest(from)), largest(to));
        }
        assert_eq!(Scale::new(16, 16).apply(12345), 12345);
    }
}
