//! The orientation of a picture in its EXIF data, and where it puts each pixel.
//!
//! Literature: CIPA DC-008, "Exchangeable image file format for digital still cameras: Exif"; the
//! tag `Orientation` (0x0112) of the first image file directory holds 1 to 8.

/// The tag of the orientation.
const ORIENTATION_TAG: u16 = 0x0112;

/// The type of a field of 16-bit integers.
const SHORT: u16 = 3;

/// Bytes of one field of a directory.
const FIELD_SIZE: usize = 12;

/// How a file's pixels are turned to make the picture upright: first mirrored, then transposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Orientation {
    /// Columns change their order.
    pub(crate) mirror_columns: bool,
    /// Rows change their order.
    pub(crate) mirror_rows: bool,
    /// Columns become rows, after the mirroring.
    pub(crate) transpose: bool,
}

impl Orientation {
    /// The orientation of a value of the tag; values other than 1 to 8 mean 1, upright.
    pub(crate) fn from_tag(value: u16) -> Self {
        let (mirror_columns, mirror_rows, transpose) = match value {
            2 => (true, false, false),
            3 => (true, true, false),
            4 => (false, true, false),
            5 => (false, false, true),
            6 => (false, true, true),
            7 => (true, true, true),
            8 => (true, false, true),
            _ => (false, false, false),
        };
        Self { mirror_columns, mirror_rows, transpose }
    }

    /// The orientation that EXIF data, from their TIFF header on, hold; upright when they hold none
    /// or are broken.
    pub(crate) fn from_exif(tiff: &[u8]) -> Self {
        orientation_tag(tiff).map_or_else(Self::default, Self::from_tag)
    }

    /// Columns and rows of the upright picture.
    pub(crate) fn upright(self, width: usize, height: usize) -> (usize, usize) {
        if self.transpose { (height, width) } else { (width, height) }
    }
}

/// The value of the orientation tag in the first directory.
fn orientation_tag(tiff: &[u8]) -> Option<u16> {
    let little_endian = match tiff.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let short = |at: usize| {
        let pair: [u8; 2] = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if little_endian { u16::from_le_bytes(pair) } else { u16::from_be_bytes(pair) })
    };
    let word: [u8; 4] = tiff.get(4..8)?.try_into().ok()?;
    let directory =
        if little_endian { u32::from_le_bytes(word) } else { u32::from_be_bytes(word) } as usize;
    let field_count = usize::from(short(directory)?);
    let first = directory.checked_add(2)?;
    let field = (0..field_count)
        .map(|i| first.saturating_add(i * FIELD_SIZE))
        .take_while(|&field| field < tiff.len())
        .find(|&field| short(field) == Some(ORIENTATION_TAG))?;
    if short(field + 2)? != SHORT { None } else { short(field + 8) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// EXIF data with one other field before that of the orientation.
    fn exif(little_endian: bool, tag: u16, kind: u16, value: u16) -> Vec<u8> {
        let short = |v: u16| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
        let word = |v: u32| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
        let mut bytes = if little_endian { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
        bytes.extend(word(8));
        bytes.extend(short(2));
        for (tag, kind, value) in [(0x0100, 3, 77), (tag, kind, value)] {
            bytes.extend([short(tag), short(kind)].concat());
            bytes.extend(word(1));
            bytes.extend([short(value), short(0)].concat());
        }
        bytes
    }

    #[test]
    fn both_byte_orders_are_read() {
        for little_endian in [false, true] {
            for value in 1..=8 {
                let found = Orientation::from_exif(&exif(little_endian, 0x0112, 3, value));
                assert_eq!(found, Orientation::from_tag(value));
            }
        }
    }

    #[test]
    fn anything_else_means_upright() {
        let upright = Orientation::default();
        for value in [0, 1, 9, 65535] {
            assert_eq!(Orientation::from_exif(&exif(true, 0x0112, 3, value)), upright);
        }
        assert_eq!(Orientation::from_exif(&exif(true, 0x0113, 3, 6)), upright);
        assert_eq!(Orientation::from_exif(&exif(true, 0x0112, 2, 6)), upright);
        assert_eq!(Orientation::from_exif(b"II*\0\xFF\xFF\xFF\xFF"), upright);
        assert_eq!(Orientation::from_exif(b""), upright);
    }

    #[test]
    fn exif_data_may_end_anywhere() {
        let whole = exif(false, 0x0112, 3, 6);
        for end in 0..whole.len() - 2 {
            assert_eq!(Orientation::from_exif(&whole[..end]), Orientation::default());
        }
    }
}
