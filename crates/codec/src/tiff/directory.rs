//! The first directory of a TIFF, as far as it tells the picture's shape.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::orientation::Orientation;
use std::borrow::Cow;

/// Bytes of one field.
const FIELD_BYTES: usize = 12;

/// The longest side of a tile that is allowed beyond the picture's own.
const MAX_TILE_SIDE: u32 = 4096;

/// The most samples of a stored pixel: CMYK and alpha.
const MAX_SAMPLES: u32 = 5;

const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;
const BITS_PER_SAMPLE: u16 = 258;
const PHOTOMETRIC: u16 = 262;
const ORIENTATION: u16 = 274;
const SAMPLES_PER_PIXEL: u16 = 277;
const PLANAR: u16 = 284;
const PREDICTOR: u16 = 317;
const COLOUR_MAP: u16 = 320;
const TILE_WIDTH: u16 = 322;
const TILE_HEIGHT: u16 = 323;
const EXTRA_SAMPLES: u16 = 338;
const SAMPLE_FORMAT: u16 = 339;

/// What the stored samples of a pixel mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// They are the image's, so many.
    Plain(usize),
    /// They are indices of colours.
    Indexed,
    /// Cyan, magenta, yellow and black, 255 for full ink.
    Cmyk,
}

/// A directory's fields.
pub(super) struct Directory<'a> {
    bytes: &'a [u8],
    little_endian: bool,
    /// Offset of the first field.
    first: usize,
    field_count: usize,
    pub(super) width: u32,
    pub(super) height: u32,
    /// Bits per stored sample: 1, 2, 4, 8 or 16.
    pub(super) depth: u8,
    /// Stored samples per pixel.
    pub(super) sample_count: usize,
    /// Components lie one after the other.
    pub(super) planar: bool,
    pub(super) meaning: Meaning,
    pub(super) orientation: Orientation,
    /// Samples are stored as differences to those of the pixel on their left, from the left end of
    /// each row on; not known of what is stored in tiles.
    pub(super) differences: bool,
}

impl<'a> Directory<'a> {
    /// Reads the fields, and checks what can be known without the limits.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let little_endian = bytes.starts_with(b"II");
        if bytes.get(2..4).is_some_and(|version| version.contains(&b'+')) {
            return Err(unsupported("BigTIFF is not supported"));
        }
        let mut directory = Self {
            bytes,
            little_endian,
            first: 0,
            field_count: 0,
            width: 0,
            height: 0,
            depth: 0,
            sample_count: 0,
            planar: false,
            meaning: Meaning::Plain(1),
            orientation: Orientation::default(),
            differences: false,
        };
        let at = directory.long(4).ok_or_else(ends_early)? as usize;
        directory.field_count = directory.short(at).ok_or_else(ends_early)?.into();
        directory.first = at + 2;
        let end = directory.first + directory.field_count * FIELD_BYTES;
        bytes.get(directory.first..end).ok_or_else(ends_early)?;
        directory.read_shape()?;
        Ok(directory)
    }

    /// Reads what the picture's shape is made of.
    fn read_shape(&mut self) -> Result<(), DecodeError> {
        self.width = self.value(WIDTH).ok_or_else(|| malformed("it has no width"))?;
        self.height = self.value(HEIGHT).ok_or_else(|| malformed("it has no height"))?;
        self.planar = self.value(PLANAR) == Some(2);
        let orientation = self.value(ORIENTATION).and_then(|tag| u16::try_from(tag).ok());
        self.orientation = orientation.map_or_else(Orientation::default, Orientation::from_tag);
        let sample_count = self.value(SAMPLES_PER_PIXEL).unwrap_or(1);
        if !(1..=MAX_SAMPLES).contains(&sample_count) {
            return Err(unsupported(&format!(
                "{sample_count} samples per pixel are not supported"
            )));
        }
        self.sample_count = sample_count as usize;
        let depth = self.value(BITS_PER_SAMPLE).unwrap_or(1);
        let kind = self.value(SAMPLE_FORMAT).unwrap_or(1);
        if kind != 1 {
            return Err(unsupported("only samples that are integers without a sign are supported"));
        }
        self.depth = match depth {
            1 | 2 | 4 if sample_count == 1 => depth as u8,
            8 | 16 => depth as u8,
            _ => {
                let reason = format!("{sample_count} samples of {depth} bits are not supported");
                return Err(unsupported(&reason));
            }
        };
        self.meaning = self.read_meaning()?;
        self.differences =
            self.depth >= 8 && self.value(PREDICTOR) == Some(2) && self.field(TILE_WIDTH).is_none();
        Ok(())
    }

    /// Reads what the samples mean. Components beyond the colours are taken as alpha when the file
    /// says so, and left out otherwise.
    fn read_meaning(&self) -> Result<Meaning, DecodeError> {
        let photometric = self.value(PHOTOMETRIC);
        let has_alpha = matches!(self.value(EXTRA_SAMPLES), Some(1 | 2));
        match (photometric, self.sample_count) {
            (Some(0 | 1), 1) => Ok(Meaning::Plain(1)),
            (Some(1), 2) => Ok(Meaning::Plain(2)),
            (Some(2), 4) if has_alpha || self.value(EXTRA_SAMPLES).is_none() => {
                Ok(Meaning::Plain(4))
            }
            (Some(2), 3 | 4) => Ok(Meaning::Plain(3)),
            (Some(3), 1) if self.depth <= 8 => Ok(Meaning::Indexed),
            (Some(5), 4) => Ok(Meaning::Cmyk),
            (photometric, count) => {
                let kind = photometric.map_or_else(|| "none".to_owned(), |kind| kind.to_string());
                Err(unsupported(&format!(
                    "photometric interpretation {kind} with {count} samples is not supported"
                )))
            }
        }
    }

    /// Components and bits per sample of the decoded image.
    pub(super) fn shape(&self) -> Result<(usize, u8), DecodeError> {
        match self.meaning {
            Meaning::Plain(component_count) => Ok((component_count, self.depth)),
            Meaning::Indexed => self.palette().map(|_| (3, 16)),
            Meaning::Cmyk => Ok((3, self.depth)),
        }
    }

    /// The palette's samples: all reds, then all greens, then all blues.
    pub(super) fn palette(&self) -> Result<Vec<u16>, DecodeError> {
        let count = 3 << self.depth;
        let field = self.field(COLOUR_MAP).ok_or_else(|| malformed("it has no palette"))?;
        let at = self.long(field + 8).ok_or_else(ends_early)? as usize;
        if self.long(field + 4) != Some(count) {
            return Err(malformed("its palette has a wrong number of colours"));
        }
        (0..count as usize).map(|i| self.short(at + 2 * i).ok_or_else(ends_early)).collect()
    }

    /// Checks that tiles are not much larger than the picture: whatever lies beyond it would be
    /// decompressed in vain.
    pub(super) fn check_chunks(&self) -> Result<(), DecodeError> {
        for (tag, side) in [(TILE_WIDTH, self.width), (TILE_HEIGHT, self.height)] {
            let tile = self.value(tag).unwrap_or(0);
            if tile > side.next_multiple_of(16).max(MAX_TILE_SIDE) {
                return Err(malformed(&format!("a tile has a side of {tile}")));
            }
        }
        Ok(())
    }

    /// Bytes of all stored samples, rows filled up to whole bytes.
    pub(super) fn stored_bytes(&self) -> usize {
        let row_bits = self.width as usize * self.sample_count * usize::from(self.depth);
        row_bits.div_ceil(8).max(self.width as usize) * self.height as usize
    }

    /// The file as its decoder shall take it, a copy where it has to be told something else.
    ///
    /// It knows no palettes: it gets told that the indices are gray. Differences it would add up in
    /// one go for a strip, which may be the whole picture, and could not be stopped: it gets told that
    /// they are samples.
    pub(super) fn retold(&self) -> Cow<'a, [u8]> {
        let mut file = Cow::Borrowed(self.bytes);
        if self.meaning == Meaning::Indexed {
            self.set_to_one(PHOTOMETRIC, file.to_mut());
        }
        if self.differences {
            self.set_to_one(PREDICTOR, file.to_mut());
        }
        file
    }

    /// Changes the value of a field to 1.
    fn set_to_one(&self, tag: u16, copy: &mut [u8]) {
        let Some(field) = self.field(tag) else { return };
        let length = match self.short(field + 2) {
            Some(1) => 1,
            Some(3) => 2,
            _ => 4,
        };
        let Some(value) = copy.get_mut(field + 8..field + 8 + length) else { return };
        value.fill(0);
        let least = if self.little_endian { value.first_mut() } else { value.last_mut() };
        if let Some(least) = least {
            *least = 1;
        }
    }

    /// Offset of a field.
    fn field(&self, tag: u16) -> Option<usize> {
        let fields = (0..self.field_count).map(|i| self.first + i * FIELD_BYTES);
        fields.into_iter().find(|&field| self.short(field) == Some(tag))
    }

    /// The first value of a field of bytes, 16- or 32-bit integers.
    fn value(&self, tag: u16) -> Option<u32> {
        let field = self.field(tag)?;
        let count = self.long(field + 4)?;
        match (self.short(field + 2)?, count) {
            (_, 0) => None,
            (1, _) => self.bytes.get(field + 8).map(|&byte| byte.into()),
            (3, 1 | 2) => self.short(field + 8).map(u32::from),
            (3, _) => self.short(self.long(field + 8)? as usize).map(u32::from),
            (4, 1) => self.long(field + 8),
            _ => None,
        }
    }

    fn short(&self, at: usize) -> Option<u16> {
        let pair: [u8; 2] = self.bytes.get(at..at.checked_add(2)?)?.try_into().ok()?;
        let little = self.little_endian;
        Some(if little { u16::from_le_bytes(pair) } else { u16::from_be_bytes(pair) })
    }

    fn long(&self, at: usize) -> Option<u32> {
        let word: [u8; 4] = self.bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        let little = self.little_endian;
        Some(if little { u32::from_le_bytes(word) } else { u32::from_be_bytes(word) })
    }
}

fn ends_early() -> DecodeError {
    malformed("it ends early")
}

fn malformed(reason: &str) -> DecodeError {
    PictureFormat::Tiff.malformed(reason)
}

fn unsupported(reason: &str) -> DecodeError {
    PictureFormat::Tiff.unsupported(reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gray picture of two by two pixels, of 16 bits, stored as differences, without its pixels.
    fn file(little_endian: bool, predictor_type: u16) -> Vec<u8> {
        let short = |v: u16| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
        let long = |v: u32| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
        let mut bytes = if little_endian { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
        bytes.extend(long(8));
        bytes.extend(short(5));
        let fields = [(WIDTH, 2), (HEIGHT, 2), (BITS_PER_SAMPLE, 16), (PHOTOMETRIC, 1)];
        for (tag, value) in fields {
            bytes.extend([short(tag), short(3)].concat());
            bytes.extend([&long(1)[..], &short(value), &[0; 2]].concat());
        }
        bytes.extend([short(PREDICTOR), short(predictor_type)].concat());
        bytes.extend(long(1));
        bytes.extend(if predictor_type == 4 {
            long(2).to_vec()
        } else {
            [short(2), [0; 2]].concat()
        });
        bytes
    }

    #[test]
    fn the_decoder_is_told_of_no_differences_in_either_byte_order() {
        for (little_endian, predictor_type) in [(true, 3), (false, 3), (true, 4), (false, 4)] {
            let bytes = file(little_endian, predictor_type);
            let directory = Directory::read(&bytes).unwrap();
            assert!(directory.differences);
            let retold = directory.retold();
            let retold = Directory::read(&retold).unwrap();
            assert_eq!(retold.value(PREDICTOR), Some(1), "{little_endian} {predictor_type}");
            assert!(!retold.differences);
            assert!(matches!(retold.retold(), Cow::Borrowed(_)));
        }
    }
}
