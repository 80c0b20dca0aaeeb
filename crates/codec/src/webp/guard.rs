//! Checks of the sizes that the decoder allocates before it compares them with the file: those of
//! chunks and pictures.

use super::ends_early;
use super::lossless::Stream;
use crate::decode::METADATA_BYTES;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::limits::Limits;

/// Bytes before the first chunk: `RIFF`, the length of what follows, `WEBP`.
const FILE_HEADER_BYTES: usize = 12;

/// Bits of a lossless picture before its stream: signature, both sides, alpha and version.
const LOSSLESS_HEADER_BITS: usize = 40;

/// Bits of compressed alpha before its stream: the method.
const ALPHA_HEADER_BITS: usize = 8;

/// The chunks that a file has, and the limits on them.
pub(super) struct Guard<'a> {
    limits: &'a Limits,
    /// Columns and rows of the first header: no other picture is larger.
    canvas: Option<[u32; 2]>,
    /// The lossless streams that the decoder may read.
    streams: Vec<Stream<'a>>,
}

impl<'a> Guard<'a> {
    /// Checks that the chunks run up to the end of the file and that no picture in them is larger
    /// than the limits and the canvas. Returns the file up to its end, and its lossless streams.
    pub(super) fn check(
        bytes: &'a [u8],
        limits: &'a Limits,
    ) -> Result<(&'a [u8], Vec<Stream<'a>>), DecodeError> {
        let length = bytes.get(4..).and_then(|rest| rest.first_chunk()).ok_or_else(ends_early)?;
        let end = 8_usize.saturating_add(u32::from_le_bytes(*length) as usize);
        let file = bytes.get(..end).ok_or_else(ends_early)?;
        let mut guard = Self { limits, canvas: None, streams: Vec::new() };
        let chunks = file.get(FILE_HEADER_BYTES..).unwrap_or_default();
        if let Some(&[_, _, _, _, _, _, w0, w1, w2, h0, h1, h2, _, _, _, _, ref chunks @ ..]) =
            guard.check_chunks(chunks, None)?
        {
            let frame = [number(w0, w1, w2) + 1, number(h0, h1, h2) + 1];
            guard.check_size(frame)?;
            guard.check_chunks(chunks, Some(frame))?;
        }
        Ok((file, guard.streams))
    }

    /// Checks the chunks of the file, or of a frame of this size; returns the first frame.
    fn check_chunks(
        &mut self,
        mut rest: &'a [u8],
        frame: Option<[u32; 2]>,
    ) -> Result<Option<&'a [u8]>, DecodeError> {
        let (mut first_frame, mut picture, mut alpha) = (None, None, None);
        while !rest.is_empty() {
            match next_chunk(&mut rest)? {
                (b"VP8X", &[_, _, _, _, w0, w1, w2, h0, h1, h2, ..]) => {
                    self.check_size([number(w0, w1, w2) + 1, number(h0, h1, h2) + 1])?;
                }
                (b"ANMF", data) => first_frame = first_frame.or(Some(data)),
                (b"EXIF", data) if data.len() > METADATA_BYTES => {
                    let (format, limit) = (PictureFormat::WebP, METADATA_BYTES);
                    return Err(DecodeError::MetadataTooLarge { format, limit });
                }
                (b"VP8 ", &[_, _, _, _, _, _, w0, w1, h0, h1, ..]) => {
                    self.check_size([number(w0, w1 & 0x3F, 0), number(h0, h1 & 0x3F, 0)])?;
                }
                (b"VP8L", data @ &[_, a, b, c, d, ..]) => {
                    let bits = u32::from_le_bytes([a, b, c, d]);
                    let size = [(bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1];
                    self.check_size(size)?;
                    picture.get_or_insert(Stream { data, start: LOSSLESS_HEADER_BITS, size });
                }
                (b"ALPH", data @ &[method, ..]) if alpha.is_none() => {
                    let size = frame.or(self.canvas).filter(|_| method & 3 == 1);
                    alpha = Some(size.map(|size| Stream { data, start: ALPHA_HEADER_BITS, size }));
                }
                _ => {}
            }
        }
        self.streams.extend(picture.into_iter().chain(alpha.flatten()));
        Ok(first_frame)
    }

    /// Checks the size of a picture; the first is that of the canvas.
    fn check_size(&mut self, [width, height]: [u32; 2]) -> Result<(), DecodeError> {
        let [most_columns, most_rows] = *self.canvas.get_or_insert([width, height]);
        if width > most_columns || height > most_rows {
            return Err(PictureFormat::WebP.malformed(format!(
                "a picture of {width}x{height} lies on a canvas of {most_columns}x{most_rows}"
            )));
        }
        self.limits.check(most_columns.into(), most_rows.into()).map(|_| ())
    }
}

/// A number of 24 bits.
fn number(a: u8, b: u8, c: u8) -> u32 {
    u32::from_le_bytes([a, b, c, 0])
}

/// Kind and data of the next chunk. The byte that fills up odd lengths may be missing at the end.
fn next_chunk<'a>(rest: &mut &'a [u8]) -> Result<(&'a [u8; 4], &'a [u8]), DecodeError> {
    let (kind, following) = rest.split_first_chunk().ok_or_else(ends_early)?;
    let (&length, following) = following.split_first_chunk().ok_or_else(ends_early)?;
    let length = u32::from_le_bytes(length) as usize;
    let data = following.get(..length).ok_or_else(ends_early)?;
    *rest = following.get(length + length % 2..).unwrap_or_default();
    Ok((kind, data))
}
