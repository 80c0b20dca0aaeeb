//! The formats that are recognized only to be refused: which they are, and what converts them.

use crate::error::DecodeError;

/// A format that is not read.
struct Unread {
    name: &'static str,
    /// The command that converts such a file.
    conversion: &'static str,
    begins: fn(&[u8]) -> bool,
}

/// The rows. The first that fits a file is its format.
const UNREAD: [Unread; 14] = [
    Unread {
        name: "AVIF",
        conversion: "magick photo.avif photo.png",
        begins: |bytes| has_brand(bytes, &[b"avif", b"avis"]),
    },
    Unread {
        name: "HEIC",
        conversion: "magick photo.heic photo.png",
        begins: |bytes| {
            has_brand(
                bytes,
                &[
                    b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs",
                    b"mif1", b"msf1",
                ],
            )
        },
    },
    Unread {
        name: "JPEG XL",
        conversion: "djxl photo.jxl photo.png",
        begins: |bytes| {
            bytes.starts_with(b"\xFF\x0A") || bytes.starts_with(b"\0\0\0\x0CJXL \r\n\x87\n")
        },
    },
    Unread {
        name: "JPEG 2000",
        conversion: "opj_decompress -i photo.jp2 -o photo.png",
        begins: |bytes| {
            bytes.starts_with(b"\0\0\0\x0CjP  \r\n\x87\n") || bytes.starts_with(b"\xFF\x4F\xFF\x51")
        },
    },
    Unread {
        name: "SVG",
        conversion: "rsvg-convert --output drawing.png drawing.svg",
        begins: is_svg,
    },
    Unread {
        name: "PDF",
        conversion: "pdftoppm -png document.pdf page",
        begins: |bytes| bytes.starts_with(b"%PDF-"),
    },
    Unread {
        name: "CR2",
        conversion: "darktable-cli photo.cr2 photo.png",
        begins: |bytes| Tiff::of(bytes).is_some() && bytes.get(8..10) == Some(b"CR"),
    },
    Unread {
        name: "CR3",
        conversion: "darktable-cli photo.cr3 photo.png",
        begins: |bytes| has_brand(bytes, &[b"crx "]),
    },
    Unread {
        name: "DNG",
        conversion: "darktable-cli photo.dng photo.png",
        begins: |bytes| Tiff::of(bytes).is_some_and(|tiff| tiff.field(DNG_VERSION).is_some()),
    },
    Unread {
        name: "NEF",
        conversion: "darktable-cli photo.nef photo.png",
        begins: |bytes| Tiff::of(bytes).is_some_and(|tiff| tiff.is_raw_of(b"NIKON")),
    },
    Unread {
        name: "ARW",
        conversion: "darktable-cli photo.arw photo.png",
        begins: |bytes| Tiff::of(bytes).is_some_and(|tiff| tiff.is_raw_of(b"SONY")),
    },
    Unread {
        name: "RAF",
        conversion: "darktable-cli photo.raf photo.png",
        begins: |bytes| bytes.starts_with(b"FUJIFILMCCD-RAW"),
    },
    Unread {
        name: "ORF",
        conversion: "darktable-cli photo.orf photo.png",
        begins: |bytes| {
            matches!(bytes, [b'I', b'I', b'R', b'O' | b'S', ..] | [b'M', b'M', b'O', b'R', ..])
        },
    },
    Unread {
        name: "RW2",
        conversion: "darktable-cli photo.rw2 photo.png",
        begins: |bytes| bytes.starts_with(b"IIU\0"),
    },
];

/// The refusal of a file whose format is known but not read.
pub(crate) fn refusal(bytes: &[u8]) -> Option<DecodeError> {
    let &Unread { name, conversion, .. } = UNREAD.iter().find(|unread| (unread.begins)(bytes))?;
    Some(DecodeError::Unread { name, conversion })
}

/// Bytes of a file's beginning in which an SVG has its first element.
const SVG_BEGINNING: usize = 4096;

/// Whether a text is markup that has an element `svg`, perhaps after a declaration and comments.
fn is_svg(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    let beginning = &text[..text.len().min(SVG_BEGINNING)];
    beginning.starts_with(b"<") && beginning.windows(4).any(|tag| tag == b"<svg")
}

/// Whether a file of boxes (ISO 14496-12) has one of these brands in its first box.
fn has_brand(bytes: &[u8], brands: &[&[u8; 4]]) -> bool {
    let [a, b, c, d, b'f', b't', b'y', b'p', rest @ ..] = bytes else { return false };
    let length = u32::from_be_bytes([*a, *b, *c, *d]) as usize;
    let listed = &rest[..rest.len().min(length.saturating_sub(8))];
    // The second word is the version of the first brand.
    let (words, _) = listed.as_chunks::<4>();
    let of_file = words.iter().enumerate().filter(|(index, _)| *index != 1);
    of_file.map(|(_, word)| word).any(|word| brands.contains(&word))
}

// Tags of TIFF.
const NEW_SUBFILE_TYPE: u16 = 254;
const MAKE: u16 = 271;
const SUB_IFDS: u16 = 330;
const DNG_VERSION: u16 = 0xC612;

/// The first directory of a TIFF. Most raw files are TIFFs whose first picture is a thumbnail.
struct Tiff<'a> {
    bytes: &'a [u8],
    is_little_endian: bool,
    directory: usize,
}

impl<'a> Tiff<'a> {
    fn of(bytes: &'a [u8]) -> Option<Self> {
        let is_little_endian = match bytes {
            [b'I', b'I', b'*', 0, ..] => true,
            [b'M', b'M', 0, b'*', ..] => false,
            _ => return None,
        };
        let header = Self { bytes, is_little_endian, directory: 0 };
        Some(Self { directory: header.word(4)? as usize, ..header })
    }

    fn half(&self, offset: usize) -> Option<u16> {
        let bytes = *self.bytes.get(offset..)?.first_chunk()?;
        let big = u16::from_be_bytes(bytes);
        Some(if self.is_little_endian { big.swap_bytes() } else { big })
    }

    fn word(&self, offset: usize) -> Option<u32> {
        let bytes = *self.bytes.get(offset..)?.first_chunk()?;
        let big = u32::from_be_bytes(bytes);
        Some(if self.is_little_endian { big.swap_bytes() } else { big })
    }

    /// The last four bytes of a field: its value, or the value's offset.
    fn field(&self, tag: u16) -> Option<u32> {
        let count = usize::from(self.half(self.directory)?);
        let mut fields = (0..count).map(|index| self.directory + 2 + 12 * index);
        let field = fields.find(|&field| self.half(field) == Some(tag))?;
        self.word(field + 8)
    }

    /// Whether the first picture is a thumbnail of others, made by a camera of this maker.
    fn is_raw_of(&self, maker: &[u8]) -> bool {
        let make = self.field(MAKE).and_then(|offset| self.bytes.get(offset as usize..));
        make.is_some_and(|make| make.starts_with(maker))
            && self.field(NEW_SUBFILE_TYPE) == Some(1)
            && self.field(SUB_IFDS).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A TIFF of one directory with these fields, and a maker's name at its end.
    fn tiff(is_little_endian: bool, fields: &[(u16, u32)], maker: &[u8]) -> Vec<u8> {
        let half = |value: u16| {
            if is_little_endian { value.to_le_bytes() } else { value.to_be_bytes() }
        };
        let word = |value: u32| {
            if is_little_endian { value.to_le_bytes() } else { value.to_be_bytes() }
        };
        let mut bytes = if is_little_endian { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
        bytes.extend(word(8));
        bytes.extend(half(fields.len() as u16 + 1));
        let end = (8 + 2 + 12 * (fields.len() + 1) + 4) as u32;
        for &(tag, value) in fields.iter().chain(&[(MAKE, end)]) {
            bytes.extend([&half(tag)[..], &half(4), &word(1), &word(value)].concat());
        }
        bytes.extend(word(0));
        bytes.extend(maker);
        bytes
    }

    fn name(bytes: &[u8]) -> Option<&'static str> {
        match refusal(bytes)? {
            DecodeError::Unread { name, conversion } => {
                assert!(conversion.contains(' '));
                Some(name)
            }
            other => panic!("{other}"),
        }
    }

    #[test]
    fn each_format_is_told_by_its_beginning() {
        let raw = [(NEW_SUBFILE_TYPE, 1), (SUB_IFDS, 200)];
        for (bytes, expected) in [
            (&b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"[..], "HEIC"),
            (b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic", "HEIC"),
            (b"\0\0\0\x1Cftypavif\0\0\0\0mif1avifmiaf", "AVIF"),
            (b"\0\0\0\x1Cftypmif1\0\0\0\0mif1avifmiaf", "AVIF"),
            (b"\0\0\0\x18ftypcrx \0\0\0\x01crx isom", "CR3"),
            (b"\xFF\x0A\xFA\x1F", "JPEG XL"),
            (b"\0\0\0\x0CJXL \r\n\x87\n\0\0\0\x14ftypjxl ", "JPEG XL"),
            (b"\0\0\0\x0CjP  \r\n\x87\n\0\0\0\x14ftypjp2 ", "JPEG 2000"),
            (b"<svg xmlns=\"http://www.w3.org/2000/svg\"/>", "SVG"),
            (b"\xEF\xBB\xBF<?xml version=\"1.0\"?>\n<!-- made --><svg>", "SVG"),
            (b"%PDF-1.7\n", "PDF"),
            (b"II*\0\x10\0\0\0CR\x02\0", "CR2"),
            (b"FUJIFILMCCD-RAW 0201", "RAF"),
            (b"IIRO\x08\0\0\0", "ORF"),
            (b"MMOR\0\0\0\x08", "ORF"),
            (b"IIU\0\x18\0\0\0", "RW2"),
            (&tiff(true, &[(DNG_VERSION, 0x0401)], b"Leica"), "DNG"),
            (&tiff(false, &raw, b"NIKON CORPORATION\0"), "NEF"),
            (&tiff(true, &raw, b"SONY\0"), "ARW"),
        ] {
            assert_eq!(name(bytes), Some(expected), "{}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn pictures_of_other_formats_are_none_of_them() {
        let raw = [(NEW_SUBFILE_TYPE, 1), (SUB_IFDS, 200)];
        for bytes in [
            &b""[..],
            b"\xFF\xD8\xFF",
            b"<html><body>",
            b"\0\0\0\x18ftypisom\0\0\0\0mp42",
            b"\0\0\0\x0Cftypmp42heic",
            &tiff(true, &raw, b"Canon\0"),
            &tiff(true, &[], b"NIKON CORPORATION\0"),
            b"II*\0\xFF\xFF\xFF\xFF",
            b"II*\0",
        ] {
            assert_eq!(name(bytes), None, "{}", String::from_utf8_lossy(bytes));
        }
    }
}
