//! The segments of a JPEG, one marker after the other.

use crate::error::DecodeError;
use crate::format::PictureFormat;

/// A marker with what belongs to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment<'a> {
    /// The marker's second byte.
    pub(super) marker: u8,
    /// Offset of the marker's first byte in the file.
    pub(super) at: usize,
    /// All bytes, those of the marker and of its length too.
    pub(super) bytes: &'a [u8],
}

impl<'a> Segment<'a> {
    /// The bytes after the length field; none for a marker that stands alone.
    pub(super) fn payload(&self) -> &'a [u8] {
        self.bytes.get(4..).unwrap_or_default()
    }
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

    /// Bytes that are not read yet.
    pub(super) fn remaining(&self) -> usize {
        self.bytes.len() - self.position
    }

    /// The next segment; bytes between segments, which do not belong there, are skipped.
    ///
    /// # Errors
    /// When the file ends before or within it.
    pub(super) fn next(&mut self) -> Result<Segment<'a>, DecodeError> {
        let (at, marker) = self.next_marker(self.position).ok_or_else(|| self.ends_early())?;
        let length = match (marker, self.bytes.get(at + 2..)) {
            // These have no length field.
            (0x01 | 0xD0..=0xD9, _) => 2,
            (_, Some(&[high, low, ..])) => 2 + usize::from(u16::from_be_bytes([high, low])),
            _ => return Err(self.ends_early()),
        };
        if length < 4 && !matches!(marker, 0x01 | 0xD0..=0xD9) {
            let reason = format!("the segment at byte {at} has the length {}", length - 2);
            return Err(PictureFormat::Jpeg.malformed(reason));
        }
        self.position = at + length;
        let bytes = self.bytes.get(at..self.position).ok_or_else(|| self.ends_early())?;
        Ok(Segment { marker, at, bytes })
    }

    /// The entropy-coded data of a scan, restart markers within it included; where no marker follows
    /// and the file may end early, up to its end.
    ///
    /// # Errors
    /// When the file ends before the next marker.
    pub(super) fn entropy_coded(&mut self, may_end: bool) -> Result<&'a [u8], DecodeError> {
        let start = self.position;
        let mut next = self.next_marker(start);
        while let Some((at, 0xD0..=0xD7)) = next {
            next = self.next_marker(at + 2);
        }
        self.position = match next {
            Some((at, _)) => at,
            None if may_end => self.bytes.len(),
            None => return Err(self.ends_early()),
        };
        Ok(self.bytes.get(start..self.position).unwrap_or_default())
    }

    /// Offset and second byte of the next marker. Of several fill bytes 0xFF the last belongs to
    /// the marker; 0xFF before a zero is data.
    fn next_marker(&self, mut at: usize) -> Option<(usize, u8)> {
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
