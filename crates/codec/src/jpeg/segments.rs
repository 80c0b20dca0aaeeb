//! The segments of a JPEG, one marker after the other.

use crate::error::DecodeError;
use crate::format::PictureFormat;

/// Start of image.
pub(super) const SOI: u8 = 0xD8;
/// End of image.
pub(super) const EOI: u8 = 0xD9;
/// Start of scan; entropy-coded data follow its segment.
pub(super) const SOS: u8 = 0xDA;
/// Define number of lines, for a frame whose height is 0.
pub(super) const DNL: u8 = 0xDC;
/// Application data: the JFIF header.
pub(super) const APP0: u8 = 0xE0;
/// Application data: EXIF and XMP.
pub(super) const APP1: u8 = 0xE1;
/// Application data: Adobe's colour transform.
pub(super) const APP14: u8 = 0xEE;
/// The last of the application data's markers.
pub(super) const APP15: u8 = 0xEF;
/// Comment.
pub(super) const COM: u8 = 0xFE;

/// A marker with what belongs to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment<'a> {
    /// The marker's second byte.
    pub(super) marker: u8,
    /// Offset of the marker's first byte in the file.
    pub(super) at: usize,
    /// The bytes after its length field; none for a marker that stands alone.
    pub(super) payload: &'a [u8],
}

/// Walks through a file from marker to marker.
pub(super) struct Segments<'a> {
    bytes: &'a [u8],
    /// Offset of the next byte to look at.
    position: usize,
}

impl<'a> Segments<'a> {
    /// Starts after the start-of-image marker.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 2 }
    }

    /// The next segment; bytes between segments, which do not belong there, are skipped.
    ///
    /// # Errors
    /// When the file ends before or within it.
    pub(super) fn next(&mut self) -> Result<Segment<'a>, DecodeError> {
        let (at, marker) = self.skip_to_marker().ok_or_else(|| self.ends_early())?;
        let body = self.bytes.get(at + 2..).unwrap_or_default();
        if stands_alone(marker) {
            self.position = at + 2;
            return Ok(Segment { marker, at, payload: &[] });
        }
        let [high, low, ..] = *body else { return Err(self.ends_early()) };
        let length = usize::from(u16::from_be_bytes([high, low]));
        if length < 2 {
            let reason = format!("the segment at byte {at} has the length {length}");
            return Err(PictureFormat::Jpeg.malformed(reason));
        }
        let payload = body.get(2..length).ok_or_else(|| self.ends_early())?;
        self.position = at + 2 + length;
        Ok(Segment { marker, at, payload })
    }

    /// Skips the entropy-coded data of a scan, restart markers within it included.
    ///
    /// # Errors
    /// When the file ends before the next marker.
    pub(super) fn skip_entropy_coded(&mut self) -> Result<&'a [u8], DecodeError> {
        let start = self.position;
        loop {
            let (at, marker) = self.skip_to_marker().ok_or_else(|| self.ends_early())?;
            if !(0xD0..=0xD7).contains(&marker) {
                self.position = at;
                return Ok(self.bytes.get(start..at).unwrap_or_default());
            }
            self.position = at + 2;
        }
    }

    /// As [`Self::skip_entropy_coded`], up to the end of the file where no marker follows.
    pub(super) fn take_entropy_coded(&mut self) -> &'a [u8] {
        let start = self.position;
        self.skip_entropy_coded().unwrap_or_else(|_| {
            self.position = self.bytes.len();
            self.bytes.get(start..).unwrap_or_default()
        })
    }

    /// Offset and second byte of the next marker. Of several fill bytes 0xFF the last belongs to
    /// the marker; 0xFF before a zero is data.
    fn skip_to_marker(&self) -> Option<(usize, u8)> {
        let mut at = self.position;
        loop {
            at += self.bytes.get(at..)?.iter().position(|&byte| byte == 0xFF)?;
            match *self.bytes.get(at + 1)? {
                0x00 => at += 2,
                0xFF => at += 1,
                marker => return Some((at, marker)),
            }
        }
    }

    fn ends_early(&self) -> DecodeError {
        let length = self.bytes.len();
        PictureFormat::Jpeg.malformed(format!("it ends early, at byte {length}"))
    }
}

/// Tells whether a marker has no length field.
fn stands_alone(marker: u8) -> bool {
    matches!(marker, 0x01 | 0xD0..=0xD9)
}
