//! What the first directory of a TIFF says of its picture.

use super::refusal;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::{Orientation, upright};
use crate::wanted::WantedBytes;
use std::borrow::Cow;
use tiff::decoder::{ChunkType, Decoder};
use tiff::tags::Tag;

/// The longest side of a tile that is allowed beyond the picture's own.
const MAX_TILE_SIDE: u32 = 4096;

/// Bytes of a field of the directory.
const FIELD_BYTES: usize = 12;

/// What the stored samples of a pixel mean.
pub(super) enum Meaning {
    /// They are the image's; their number.
    Plain(usize),
    /// They are indices of a palette: all reds, then all greens, then all blues.
    Indexed(Vec<u16>),
    /// Cyan, magenta, yellow and black, 255 for full ink.
    Cmyk,
}

/// The shape of a page.
pub(super) struct Page {
    /// Columns as stored.
    pub(super) width: usize,
    /// Rows as stored.
    pub(super) height: usize,
    /// Bits per stored sample: 1, 2, 4, 8 or 16.
    pub(super) depth: u8,
    /// Stored samples per pixel.
    sample_count: u32,
    /// Components lie one after the other.
    pub(super) planar: bool,
    pub(super) meaning: Meaning,
    /// Whether the colours are premultiplied by their alpha.
    pub(super) is_premultiplied: bool,
    pub(super) orientation: Orientation,
    /// Offset of the directory.
    directory: u64,
}

impl Page {
    /// Reads the shape, and checks what can be known without the limits.
    pub(super) fn read(decoder: &mut Decoder<WantedBytes<'_>>) -> Result<Self, DecodeError> {
        let (width, height) = decoder.dimensions().map_err(refusal)?;
        let mut value = |tag| -> Result<Option<u32>, DecodeError> {
            let values = decoder.find_tag_unsigned_vec(tag).map_err(refusal)?;
            Ok(values.and_then(|values| values.first().copied()))
        };
        let sample_count = value(Tag::SamplesPerPixel)?.unwrap_or(1);
        if value(Tag::SampleFormat)?.unwrap_or(1) != 1 {
            return Err(PictureFormat::Tiff
                .unsupported("only samples that are integers without a sign are supported"));
        }
        let depth = match value(Tag::BitsPerSample)?.unwrap_or(1) {
            depth @ (1 | 2 | 4) if sample_count == 1 => depth as u8,
            depth @ (8 | 16) => depth as u8,
            depth => {
                let reason = format!("{sample_count} samples of {depth} bits are not supported");
                return Err(PictureFormat::Tiff.unsupported(reason));
            }
        };
        let orientation = value(Tag::Orientation)?.and_then(|tag| u8::try_from(tag).ok());
        let orientation = orientation.and_then(Orientation::from_exif);
        let orientation = orientation.unwrap_or(Orientation::NoTransforms);
        let planar = value(Tag::PlanarConfiguration)? == Some(2);
        let photometric = value(Tag::PhotometricInterpretation)?.unwrap_or(0);
        // Components beyond the colours are alpha when the file says so, and left out otherwise.
        let extra = value(Tag::ExtraSamples)?;
        let meaning = match (photometric, sample_count) {
            (0 | 1, 1) => Meaning::Plain(1),
            (1, 2) => Meaning::Plain(2),
            (2, 4) if matches!(extra, None | Some(1 | 2)) => Meaning::Plain(4),
            (2, 3 | 4) => Meaning::Plain(3),
            (3, 1) if depth <= 8 => Meaning::Indexed(palette(decoder, depth)?),
            (5, 4) => Meaning::Cmyk,
            _ => {
                return Err(PictureFormat::Tiff.unsupported(format!(
                    "photometric interpretation {photometric} with {sample_count} samples is not \
                     supported"
                )));
            }
        };
        check_tiles(decoder, [width, height])?;
        let directory = decoder.ifd_pointer().map_or(0, |pointer| pointer.0);
        let (width, height) = (width as usize, height as usize);
        // 1 is associated alpha, which the colours are multiplied by.
        let is_premultiplied = extra == Some(1);
        Ok(Self {
            width,
            height,
            depth,
            sample_count,
            planar,
            meaning,
            is_premultiplied,
            orientation,
            directory,
        })
    }

    /// What the directory means for the decoded image.
    pub(super) fn header(&self, limits: &Limits) -> Result<Header, DecodeError> {
        let (width, height) = limits.check(self.width as u64, self.height as u64)?;
        let (width, height) = upright(self.orientation, width, height);
        let (component_count, precision) = match self.meaning {
            Meaning::Plain(component_count) => (component_count, self.depth),
            Meaning::Indexed(_) => (3, 16),
            Meaning::Cmyk => (3, self.depth),
        };
        Ok(Header { format: PictureFormat::Tiff, width, height, component_count, precision })
    }

    /// Whether its samples are indices of a palette.
    pub(super) fn is_indexed(&self) -> bool {
        matches!(self.meaning, Meaning::Indexed(_))
    }

    /// Bytes of all stored samples, rows filled up to whole bytes.
    pub(super) fn stored_bytes(&self) -> usize {
        let row_bits = self.width * self.sample_count as usize * usize::from(self.depth);
        row_bits.div_ceil(8).max(self.width) * self.height
    }

    /// The file as its decoder takes it: one that knows no palettes gets a copy that says that
    /// indices are gray.
    pub(super) fn without_palette<'a>(&self, bytes: &'a [u8]) -> Cow<'a, [u8]> {
        if !self.is_indexed() {
            return Cow::Borrowed(bytes);
        }
        let (photometric, gray) = match bytes {
            [b'I', ..] => (Tag::PhotometricInterpretation.to_u16().to_le_bytes(), [1, 0]),
            _ => (Tag::PhotometricInterpretation.to_u16().to_be_bytes(), [0, 1]),
        };
        let mut copy = bytes.to_vec();
        let fields = copy.get_mut(self.directory as usize + 2..).unwrap_or_default();
        for field in fields.chunks_exact_mut(FIELD_BYTES) {
            if let ([a, b, _, _, _, _, _, _, value @ ..], _) = field.split_at_mut(10)
                && [*a, *b] == photometric
            {
                value.copy_from_slice(&gray);
                break;
            }
        }
        Cow::Owned(copy)
    }
}

/// The palette's samples.
fn palette(decoder: &mut Decoder<WantedBytes<'_>>, depth: u8) -> Result<Vec<u16>, DecodeError> {
    let palette = decoder.find_tag_unsigned_vec(Tag::ColorMap).map_err(refusal)?;
    let palette = palette.ok_or_else(|| PictureFormat::Tiff.malformed("it has no palette"))?;
    if palette.len() == 3 << depth {
        return Ok(palette);
    }
    Err(PictureFormat::Tiff.malformed("its palette has a wrong number of colours"))
}

/// Checks that tiles are not much larger than the picture: what lies beyond it would be decompressed
/// for nothing.
fn check_tiles(
    decoder: &Decoder<WantedBytes<'_>>,
    [width, height]: [u32; 2],
) -> Result<(), DecodeError> {
    let (tile_width, tile_height) = decoder.chunk_dimensions();
    for (tile, side) in [(tile_width, width), (tile_height, height)] {
        if decoder.get_chunk_type() == ChunkType::Tile
            && tile > side.max(MAX_TILE_SIDE).saturating_add(15)
        {
            return Err(PictureFormat::Tiff.malformed(format!("a tile has a side of {tile}")));
        }
    }
    Ok(())
}
