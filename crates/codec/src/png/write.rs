//! The PNG writer.
//!
//! One to four components make gray, gray with alpha, RGB and RGBA. Gray keeps a precision of 1, 2,
//! 4, 8 or 16 bits, the others one of 8 or 16. A precision that PNG lacks is raised to the next that
//! it has: `v` becomes `v (2^to - 1) / (2^from - 1)`, rounded to the nearest integer, so that black
//! and white stay what they are, and an sBIT chunk states the true precision.

use crate::choices::PngCompression;
use crate::error::EncodeError;
use crate::interleave::interleave_row;
use crate::rounding::rounded_quotient;
use crate::wanted::{Wanted, always};
use pixmesh_meshing::Image;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, chunk};
use std::io::{self, Write};

/// Bytes of compressed pixels that go into one chunk.
const CHUNK_BYTES: usize = 1 << 16;

/// Writes an image as PNG, fast.
///
/// # Errors
/// As [`write_png_while`].
pub fn write_png(image: &Image, out: &mut impl Write) -> Result<(), EncodeError> {
    write_png_while(image, PngCompression::Fast, out, &always)
}

/// Writes an image as PNG, fast or small, for as long as it is wanted.
///
/// Rows are filtered and compressed one by one, so that no second copy of the image is made.
///
/// # Errors
/// [`EncodeError::ComponentCount`] for more than four components, [`EncodeError::Cancelled`] when
/// the file is no longer wanted, and whatever `out` fails with.
pub fn write_png_while(
    image: &Image,
    compression: PngCompression,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let (component_count, precision) = (image.component_count(), image.precision());
    let depth = match precision {
        1 if component_count == 1 => BitDepth::One,
        2 if component_count == 1 => BitDepth::Two,
        3..=4 if component_count == 1 => BitDepth::Four,
        0..=8 => BitDepth::Eight,
        _ => BitDepth::Sixteen,
    };
    let significant = Some(precision).filter(|&bits| bits != depth as u8);
    let samples = Samples { component_count, depth, significant };
    write_rows(image, &samples, compression, out, wanted)
}

/// How a PNG stores an image's samples.
pub(crate) struct Samples {
    /// How many components are written, from the first on.
    pub(crate) component_count: usize,
    /// Bits of a stored sample.
    pub(crate) depth: BitDepth,
    /// The bits of a sample that an sBIT chunk states.
    pub(crate) significant: Option<u8>,
}

/// Writes an image's samples, raised or lowered to the depth of the file.
pub(crate) fn write_rows(
    image: &Image,
    &Samples { component_count, depth, significant }: &Samples,
    compression: PngCompression,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let mut encoder = Encoder::new(out, image.width() as u32, image.height() as u32);
    encoder.set_color(match component_count {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        4 => ColorType::Rgba,
        actual => return Err(EncodeError::ComponentCount { format: "PNG", actual, maximum: 4 }),
    });
    encoder.set_depth(depth);
    encoder.set_compression(match compression {
        PngCompression::Fast => Compression::Fastest,
        PngCompression::Small => Compression::Balanced,
    });
    let mut writer = encoder.write_header().map_err(io_error)?;
    if let Some(bits) = significant {
        writer.write_chunk(chunk::sBIT, &vec![bits; component_count]).map_err(io_error)?;
    }
    let mut rows = writer.stream_writer_with_size(CHUNK_BYTES).map_err(io_error)?;
    let table = scaled(image.precision(), depth as u8);
    let mut packed = Vec::new();
    for y in (0..image.height()).rev() {
        wanted()?;
        pack_row(image, y, component_count, depth as u8, &table, &mut packed);
        rows.write_all(&packed)?;
    }
    rows.finish().map_err(io_error)?;
    writer.finish().map_err(io_error)?;
    Ok(())
}

/// What each sample of `from` bits becomes at `to` bits; empty when nothing changes.
fn scaled(from: u8, to: u8) -> Vec<u16> {
    let largest = |bits: u8| (1_u64 << bits) - 1;
    let samples = if from == to { 0..0 } else { 0..1 << from };
    samples.map(|sample| rounded_quotient(sample * largest(to), largest(from)) as u16).collect()
}

/// Replaces `packed` with the bytes of row `y`.
fn pack_row(
    image: &Image,
    y: usize,
    component_count: usize,
    depth: u8,
    table: &[u16],
    packed: &mut Vec<u8>,
) {
    let scale = |sample: u16| table.get(usize::from(sample)).copied().unwrap_or(sample);
    if depth >= 8 {
        let bytes_per_sample = usize::from(depth / 8);
        return interleave_row(image, y, component_count, bytes_per_sample, scale, packed);
    }
    // The first sample goes into the most significant bits.
    let shifts = || (0..8).step_by(usize::from(depth)).rev();
    let pack = |samples: &[u16]| {
        let bits = samples.iter().zip(shifts()).map(|(&sample, shift)| scale(sample) << shift);
        bits.fold(0, |byte, bits| byte | bits as u8)
    };
    packed.clear();
    packed.extend(image.row(0, y).chunks(8 / usize::from(depth)).map(pack));
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
        assert_eq!(scaled(3, 4), [0, 2, 4, 6, 9, 11, 13, 15]);
        for (from, to) in [(1, 8), (5, 8), (9, 16), (12, 16), (15, 16), (16, 8)] {
            let table = scaled(from, to);
            assert_eq!(table.len(), 1 << from);
            assert_eq!((table[0], table[table.len() - 1]), (0, u16::MAX >> (16 - to)));
        }
        assert_eq!(scaled(16, 16), [0; 0]);
    }
}
