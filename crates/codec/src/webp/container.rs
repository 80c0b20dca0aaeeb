//! The chunks of a WebP file, and the picture's size in each place that tells it.

use super::lossless::{self, Bits};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::orientation::Orientation;
use crate::wanted::Wanted;

/// Bytes before the first chunk: `RIFF`, the length of what follows, `WEBP`.
const FILE_HEADER_BYTES: usize = 12;

/// Bytes of a chunk before its data: kind and length.
const CHUNK_HEADER_BYTES: usize = 8;

/// Bytes of an animation's frame before its chunks.
const FRAME_HEADER_BYTES: usize = 16;

/// Bits of a lossless picture before its stream: signature, both sides, alpha and version.
const LOSSLESS_HEADER_BITS: usize = 40;

/// The most bytes that the tables of a picture's prefix codes may take. Encoders stay far below:
/// they make some hundreds of groups of codes at the most.
pub(crate) const CODE_BYTES: usize = 32 << 20;

/// Alpha in the flags of an extended file.
const ALPHA_FLAG: u8 = 0x10;

/// Animation in the flags of an extended file.
const ANIMATION_FLAG: u8 = 0x02;

/// What is known of a file before its pixels.
pub(super) struct Container<'a> {
    /// Columns as stored, of the canvas where there is one.
    pub(super) width: u32,
    /// Rows as stored.
    pub(super) height: u32,
    /// The decoded picture has alpha.
    pub(super) has_alpha: bool,
    /// What makes the picture upright.
    pub(super) orientation: Orientation,
    /// The chunks that hold the still picture, or the animation's first frame.
    picture: Picture<'a>,
    /// The chunk with a still picture's alpha.
    alpha: Option<Chunk<'a>>,
}

/// Where the pixels are.
#[derive(Clone, Copy)]
enum Picture<'a> {
    /// In a chunk of the file.
    Still(Chunk<'a>),
    /// In the chunks of a frame, after its header.
    Frame(&'a [u8]),
}

/// A chunk with its data.
#[derive(Clone, Copy)]
struct Chunk<'a> {
    kind: &'a [u8],
    data: &'a [u8],
}

impl<'a> Container<'a> {
    /// Walks through the chunks.
    ///
    /// # Errors
    /// When the file ends within one, or has no picture.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let length = bytes.get(4..8).and_then(|length| length.try_into().ok());
        let length = u32::from_le_bytes(length.ok_or_else(ends_early)?) as usize;
        let chunks = length.checked_add(8).and_then(|end| bytes.get(FILE_HEADER_BYTES..end));
        let mut rest = chunks.ok_or_else(ends_early)?;
        let first = next_chunk(&mut rest)?.ok_or_else(|| malformed("it has no picture"))?;
        match first.kind {
            b"VP8X" => Self::extended(first.data, rest),
            _ => {
                let [width, height] = first.size()?;
                let has_alpha = first.has_alpha();
                let (orientation, picture) = (Orientation::default(), Picture::Still(first));
                Ok(Self { width, height, has_alpha, orientation, picture, alpha: None })
            }
        }
    }

    /// Reads an extended file: the header of its canvas, and the chunks that follow it.
    fn extended(header: &[u8], mut rest: &'a [u8]) -> Result<Self, DecodeError> {
        let &[flags, _, _, _, w0, w1, w2, h0, h1, h2, ..] = header else {
            return Err(malformed("the extended header ends early"));
        };
        let side = |a, b, c| u32::from_le_bytes([a, b, c, 0]) + 1;
        let (width, height) = (side(w0, w1, w2), side(h0, h1, h2));
        let (mut picture, mut alpha, mut orientation) = (None, None, None);
        while let Some(chunk) = next_chunk(&mut rest)? {
            match chunk.kind {
                b"ANMF" if flags & ANIMATION_FLAG != 0 => {
                    picture = picture.or(Some(Picture::Frame(chunk.data)));
                }
                b"VP8 " | b"VP8L" if flags & ANIMATION_FLAG == 0 => {
                    picture = picture.or(Some(Picture::Still(chunk)));
                }
                b"ALPH" => alpha = alpha.or(Some(chunk)),
                b"EXIF" => {
                    let exif = chunk.data.strip_prefix(b"Exif\0\0").unwrap_or(chunk.data);
                    orientation = orientation.or(Some(Orientation::from_exif(exif)));
                }
                _ => {}
            }
        }
        let picture = picture.ok_or_else(|| malformed("it has no picture"))?;
        let (has_alpha, orientation) = (flags & ALPHA_FLAG != 0, orientation.unwrap_or_default());
        Ok(Self { width, height, has_alpha, orientation, picture, alpha })
    }

    /// Checks that the picture has the size that the container claims for it, and that its codes do
    /// not take much more memory than its pixels.
    pub(super) fn check_picture(&self, wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        match self.picture {
            Picture::Still(chunk) => {
                let size = [self.width, self.height];
                self.alpha.map_or(Ok(()), |alpha| alpha.check_codes(size, wanted))?;
                chunk.check(size, wanted)
            }
            Picture::Frame(data) => self.check_frame(data, wanted),
        }
    }

    /// Checks the first frame of an animation.
    fn check_frame(&self, data: &[u8], wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        let (header, mut rest) =
            data.split_at_checked(FRAME_HEADER_BYTES).ok_or_else(ends_early)?;
        let &[x0, x1, x2, y0, y1, y2, w0, w1, w2, h0, h1, h2, ..] = header else {
            return Err(ends_early());
        };
        let number = |a, b, c| u32::from_le_bytes([a, b, c, 0]);
        let (left, top) = (2 * number(x0, x1, x2), 2 * number(y0, y1, y2));
        let size = [number(w0, w1, w2) + 1, number(h0, h1, h2) + 1];
        if left + size[0] > self.width || top + size[1] > self.height {
            return Err(malformed("the first frame does not lie on the canvas"));
        }
        while let Some(chunk) = next_chunk(&mut rest)? {
            match chunk.kind {
                b"ALPH" => chunk.check_codes(size, wanted)?,
                b"VP8 " | b"VP8L" => return chunk.check(size, wanted),
                _ => {}
            }
        }
        Err(malformed("the first frame has no picture"))
    }
}

impl Chunk<'_> {
    /// Columns and rows of the picture that the chunk holds.
    fn size(&self) -> Result<[u32; 2], DecodeError> {
        match (self.kind, self.data) {
            (b"VP8 ", &[_, _, _, 0x9D, 0x01, 0x2A, w0, w1, h0, h1, ..]) => {
                let side = |low, high| u32::from(u16::from_le_bytes([low, high]) & 0x3FFF);
                Ok([side(w0, w1), side(h0, h1)])
            }
            (b"VP8L", &[0x2F, a, b, c, d, ..]) => {
                let bits = u32::from_le_bytes([a, b, c, d]);
                Ok([(bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1])
            }
            (kind, _) => {
                let kind = kind.escape_ascii();
                Err(malformed(&format!("the chunk '{kind}' does not hold a picture")))
            }
        }
    }

    /// Alpha in a lossless picture.
    fn has_alpha(&self) -> bool {
        self.kind == b"VP8L" && self.data.get(4).is_some_and(|bits| bits >> 4 & 1 == 1)
    }

    /// Checks that the picture has a size.
    fn check(&self, expected: [u32; 2], wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        let size = self.size()?;
        if size == expected {
            return self.check_codes(size, wanted);
        }
        let ([w, h], [width, height]) = (size, expected);
        Err(malformed(&format!("a picture of {w}x{h} stands where one of {width}x{height} should")))
    }
}

impl Chunk<'_> {
    /// Checks the codes of a picture without loss, or of alpha compressed like one.
    fn check_codes(&self, size: [u32; 2], wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        let start = match (self.kind, self.data) {
            (b"VP8L", _) => LOSSLESS_HEADER_BITS,
            (b"ALPH", &[method, ..]) if method & 3 == 1 => 8,
            _ => return Ok(()),
        };
        if lossless::table_bytes(Bits::new(self.data, start, wanted), size, CODE_BYTES)?
            <= CODE_BYTES
        {
            return Ok(());
        }
        let (format, limit) = (PictureFormat::WebP, CODE_BYTES);
        Err(DecodeError::MetadataTooLarge { format, limit })
    }
}

/// The next chunk; `None` at the end. The byte that fills up odd lengths may be missing there.
fn next_chunk<'a>(rest: &mut &'a [u8]) -> Result<Option<Chunk<'a>>, DecodeError> {
    if rest.is_empty() {
        return Ok(None);
    }
    let (header, following) = rest.split_at_checked(CHUNK_HEADER_BYTES).ok_or_else(ends_early)?;
    let &[.., a, b, c, d] = header else { return Err(ends_early()) };
    let length = u32::from_le_bytes([a, b, c, d]) as usize;
    let data = following.get(..length).ok_or_else(ends_early)?;
    *rest = following.get(length + length % 2..).unwrap_or_default();
    Ok(Some(Chunk { kind: header.get(..4).unwrap_or_default(), data }))
}

pub(super) fn ends_early() -> DecodeError {
    malformed("it ends early")
}

pub(super) fn malformed(reason: &str) -> DecodeError {
    PictureFormat::WebP.malformed(reason)
}
