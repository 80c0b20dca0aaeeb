//! What the process that decodes a picture answers, as bytes.
//!
//! A mark says what it is, and eight bytes, the least first, a number: how many samples of 8 bits
//! follow, rows from the top as the file stores them; or how many bytes of text that say what is wrong;
//! or the limit that the file's metadata exceeds.

use pixmesh_codec::{Assembly, DecodeError, PictureFormat, Wanted};
use pixmesh_meshing::Image;
use std::io::{self, Write};

const SAMPLES: u8 = b'S';
const MALFORMED: u8 = b'M';
const UNSUPPORTED: u8 = b'U';
const METADATA: u8 = b'L';
/// Bytes of the mark and the number.
const HEAD_BYTES: usize = 9;
/// The most bytes of a text.
const MAX_TEXT_BYTES: u64 = 1 << 16;

/// Writes what came of decoding.
pub(super) fn write(
    decoded: &Result<Vec<u8>, DecodeError>,
    out: &mut impl Write,
) -> io::Result<()> {
    let (mark, number, rest) = match decoded {
        Ok(samples) => (SAMPLES, samples.len(), samples.as_slice()),
        Err(DecodeError::Malformed { reason, .. }) => (MALFORMED, reason.len(), reason.as_bytes()),
        Err(DecodeError::Unsupported { reason, .. }) => {
            (UNSUPPORTED, reason.len(), reason.as_bytes())
        }
        Err(DecodeError::MetadataTooLarge { limit, .. }) => (METADATA, *limit, &[][..]),
        // Of nothing else is there a file that was probed before.
        Err(error) => return write_malformed(&error.to_string(), out),
    };
    write_head(mark, number, out)?;
    out.write_all(rest)
}

fn write_malformed(reason: &str, out: &mut impl Write) -> io::Result<()> {
    write_head(MALFORMED, reason.len(), out)?;
    out.write_all(reason.as_bytes())
}

fn write_head(mark: u8, number: usize, out: &mut impl Write) -> io::Result<()> {
    let mut head = vec![mark];
    head.extend((number as u64).to_le_bytes());
    out.write_all(&head)
}

/// Why an answer is not taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Broken {
    /// It is none.
    Garbled,
    /// There is no image to put the samples on, or it is no longer wanted.
    Picture(DecodeError),
}

impl From<DecodeError> for Broken {
    fn from(error: DecodeError) -> Self {
        Self::Picture(error)
    }
}

/// An answer as it comes in.
pub(super) struct Reply<F> {
    format: PictureFormat,
    /// Makes the image that the samples go into, once there are any: it takes much memory.
    assemble: F,
    assembly: Option<Assembly>,
    head: Vec<u8>,
    /// Bytes still to come behind the head.
    missing: u64,
    text: Vec<u8>,
}

impl<F: Fn() -> Result<Assembly, DecodeError>> Reply<F> {
    /// One for a file of this format, whose samples go into what `assemble` makes.
    pub(super) fn new(format: PictureFormat, assemble: F) -> Self {
        let (head, text) = (Vec::new(), Vec::new());
        Self { format, assemble, assembly: None, head, missing: 0, text }
    }

    /// Takes the next bytes.
    pub(super) fn take(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        let needed = HEAD_BYTES - self.head.len();
        let (head, rest) = bytes.split_at(needed.min(bytes.len()));
        if !head.is_empty() {
            self.head.extend_from_slice(head);
            if self.head.len() == HEAD_BYTES {
                self.missing = self.announced()?;
            }
        }
        self.missing = self.missing.checked_sub(rest.len() as u64).ok_or(Broken::Garbled)?;
        match &mut self.assembly {
            Some(assembly) => assembly.put(rest),
            None => self.text.extend_from_slice(rest),
        }
        Ok(())
    }

    /// Bytes that a whole head announces behind it.
    fn announced(&mut self) -> Result<u64, Broken> {
        match (self.head.first(), self.number()) {
            (Some(&SAMPLES), count) => {
                let assembly = self.assembly.insert((self.assemble)()?);
                if count == assembly.missing() as u64 { Ok(count) } else { Err(Broken::Garbled) }
            }
            (Some(&(MALFORMED | UNSUPPORTED)), length) if length <= MAX_TEXT_BYTES => Ok(length),
            (Some(&METADATA), _) => Ok(0),
            _ => Err(Broken::Garbled),
        }
    }

    fn number(&self) -> u64 {
        let bytes = self.head.get(1..).and_then(|bytes| bytes.try_into().ok());
        bytes.map_or(0, u64::from_le_bytes)
    }

    /// Whether all of it has come.
    pub(super) fn is_whole(&self) -> bool {
        self.head.len() == HEAD_BYTES && self.missing == 0
    }

    /// The image, or why there is none.
    pub(super) fn into_image(self, wanted: &Wanted<'_>) -> Result<Image, DecodeError> {
        let (format, number) = (self.format, self.number());
        let reason = String::from_utf8_lossy(&self.text).into_owned();
        match self.head.first() {
            Some(&SAMPLES) => match self.assembly {
                Some(assembly) => assembly.finish(wanted),
                None => Err(DecodeError::Malformed { format, reason }),
            },
            Some(&UNSUPPORTED) => Err(DecodeError::Unsupported { format, reason }),
            Some(&METADATA) => {
                Err(DecodeError::MetadataTooLarge { format, limit: number as usize })
            }
            _ => Err(DecodeError::Malformed { format, reason }),
        }
    }
}

#[cfg(test)]
mod tests;
