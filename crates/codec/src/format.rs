//! The picture formats that are read, detected by their first bytes.

use crate::error::DecodeError;
use crate::unread;
use pixmesh_meshing::named_values;

named_values! {
    /// A picture format that [`decode`](crate::decode()) reads.
    #[non_exhaustive]
    "format" PictureFormat {
        /// Portable Network Graphics.
        Png = "PNG",
        /// JPEG, baseline or progressive.
        Jpeg = "JPEG",
        /// The portable anymaps: PBM, PGM and PPM, plain and raw, and PAM.
        Pnm = "PNM",
        /// WebP, lossy or lossless.
        WebP = "WebP",
        /// Graphics Interchange Format.
        Gif = "GIF",
        /// Tagged Image File Format.
        Tiff = "TIFF",
        /// Windows bitmap.
        Bmp = "BMP",
    }
}

impl PictureFormat {
    /// Detects the format of a file by its first bytes.
    ///
    /// # Errors
    /// [`DecodeError::Empty`] without any byte, [`DecodeError::Unread`] for a known format that is
    /// not read, [`DecodeError::UnknownFormat`] for bytes that no format starts with.
    pub fn sniff(bytes: &[u8]) -> Result<Self, DecodeError> {
        if let Some(refusal) = unread::refusal(bytes) {
            return Err(refusal);
        }
        match bytes {
            [] => Err(DecodeError::Empty),
            [0x89, b'P', b'N', b'G', ..] => Ok(Self::Png),
            [0xFF, 0xD8, ..] => Ok(Self::Jpeg),
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Ok(Self::WebP),
            [b'G', b'I', b'F', b'8', b'7' | b'9', b'a', ..] => Ok(Self::Gif),
            // A plus sign instead of an asterisk is that of BigTIFF.
            [b'I', b'I', b'*' | b'+', 0, ..] | [b'M', b'M', 0, b'*' | b'+', ..] => Ok(Self::Tiff),
            [b'B', b'M', ..] => Ok(Self::Bmp),
            [b'P', b'1'..=b'7', b' ' | b'\t' | b'\r' | b'\n' | b'#', ..] => Ok(Self::Pnm),
            _ => Err(DecodeError::UnknownFormat),
        }
    }

    /// The error for a file of this format that breaks its rules.
    pub(crate) fn malformed(self, reason: impl Into<String>) -> DecodeError {
        DecodeError::Malformed { format: self, reason: reason.into() }
    }

    /// The error for a file of this format that uses what is not read here.
    pub(crate) fn unsupported(self, reason: impl Into<String>) -> DecodeError {
        DecodeError::Unsupported { format: self, reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_bytes_decide_and_nothing_else() {
        assert_eq!(PictureFormat::sniff(b"\x89PNG\r\n\x1a\n"), Ok(PictureFormat::Png));
        assert_eq!(PictureFormat::sniff(b"\xFF\xD8<html>"), Ok(PictureFormat::Jpeg));
        assert_eq!(PictureFormat::sniff(b"P5\n2 2"), Ok(PictureFormat::Pnm));
        assert_eq!(PictureFormat::sniff(b"P1#c"), Ok(PictureFormat::Pnm));
        assert_eq!(PictureFormat::sniff(b"RIFF\x10\0\0\0WEBPVP8 "), Ok(PictureFormat::WebP));
        assert_eq!(PictureFormat::sniff(b"GIF87a"), Ok(PictureFormat::Gif));
        assert_eq!(PictureFormat::sniff(b"GIF89a"), Ok(PictureFormat::Gif));
        assert_eq!(PictureFormat::sniff(b"II*\0"), Ok(PictureFormat::Tiff));
        assert_eq!(PictureFormat::sniff(b"MM\0*"), Ok(PictureFormat::Tiff));
        assert_eq!(PictureFormat::sniff(b"BM"), Ok(PictureFormat::Bmp));
        assert_eq!(PictureFormat::sniff(b""), Err(DecodeError::Empty));
        for other in [&b"\x89"[..], b"P", b"P5", b"P8 ", b"Pax ", b"GIF88a", b"RIFF\x10\0\0\0WAVE"]
        {
            assert_eq!(PictureFormat::sniff(other), Err(DecodeError::UnknownFormat));
        }
    }
}
