//! The orientation of a picture in its EXIF data, and where it puts each pixel.
//!
//! Literature: CIPA DC-008, "Exchangeable image file format for digital still cameras: Exif"; the
//! tag `Orientation` (0x0112) of the first image file directory holds 1 to 8.

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

    /// The orientation that EXIF data hold, with or without the six bytes before their TIFF header;
    /// upright when they hold none or are broken.
    pub(crate) fn from_exif(exif: &[u8]) -> Self {
        let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
        let orientation = image::metadata::Orientation::from_exif_chunk(tiff);
        orientation.map_or_else(Self::default, |found| Self::from_tag(found.to_exif().into()))
    }

    /// Columns and rows of the upright picture.
    pub(crate) fn upright(self, width: usize, height: usize) -> (usize, usize) {
        if self.transpose { (height, width) } else { (width, height) }
    }
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
