//! The orientation of a picture in its EXIF data.
//!
//! Literature: CIPA DC-008, "Exchangeable image file format for digital still cameras: Exif"; the
//! tag `Orientation` (0x0112) of the first image file directory holds 1 to 8.

pub(crate) use image::metadata::Orientation;

/// The orientation in EXIF data, with or without the six bytes before their TIFF header; upright
/// when there is none or the data are broken.
pub(crate) fn from_exif(exif: &[u8]) -> Orientation {
    let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
    Orientation::from_exif_chunk(tiff).unwrap_or(Orientation::NoTransforms)
}

/// Whether making the picture upright exchanges columns and rows.
pub(crate) fn transposes(orientation: Orientation) -> bool {
    matches!(orientation.to_exif(), 5..=8)
}

/// Columns and rows of the upright picture.
pub(crate) fn upright(orientation: Orientation, width: usize, height: usize) -> (usize, usize) {
    if transposes(orientation) { (height, width) } else { (width, height) }
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
                let found = from_exif(&exif(little_endian, 0x0112, 3, value));
                assert_eq!(found.to_exif(), value as u8);
            }
        }
    }

    #[test]
    fn anything_else_means_upright() {
        let upright = Orientation::NoTransforms;
        for value in [0, 1, 9, 65535] {
            assert_eq!(from_exif(&exif(true, 0x0112, 3, value)), upright);
        }
        assert_eq!(from_exif(&exif(true, 0x0113, 3, 6)), upright);
        assert_eq!(from_exif(&exif(true, 0x0112, 2, 6)), upright);
        assert_eq!(from_exif(b"II*\0\xFF\xFF\xFF\xFF"), upright);
        assert_eq!(from_exif(b""), upright);
    }

    #[test]
    fn exif_data_may_end_anywhere() {
        let whole = exif(false, 0x0112, 3, 6);
        for end in 0..whole.len() - 2 {
            assert_eq!(from_exif(&whole[..end]), Orientation::NoTransforms);
        }
    }
}
