//! SHA-256 of bytes: the name of a blob, and the entity tag of an answer.

use pixmesh_meshing::Cancelled;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fmt;
use std::str::FromStr;

/// The SHA-256 of some bytes, written as 64 hexadecimal digits in lower case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Digest([u8; 32]);

/// Bytes that are digested from one question to the next whether the digest is still wanted.
const ASKED_EVERY_BYTES: usize = 1 << 18;

/// A text that is no digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no SHA-256 in 64 hexadecimal digits in lower case")]
pub struct NoDigest;

impl Digest {
    /// That of the bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// That of the bytes, as long as it is wanted.
    ///
    /// # Errors
    /// When it is no longer wanted; the question is asked every few hundred thousand bytes.
    pub fn of_while(
        bytes: &[u8],
        wanted: impl Fn() -> Result<(), Cancelled>,
    ) -> Result<Self, Cancelled> {
        let mut hash = Sha256::new();
        for piece in bytes.chunks(ASKED_EVERY_BYTES) {
            wanted()?;
            hash.update(piece);
        }
        Ok(Self::of_pieces(hash))
    }

    /// That of bytes that come piece by piece.
    #[must_use]
    pub fn of_pieces(hash: Sha256) -> Self {
        Self(hash.finalize().into())
    }

    /// Its bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// That of several texts, none of which can run into the next.
    #[must_use]
    pub fn of_texts(texts: &[&str]) -> Self {
        let mut hash = Sha256::new();
        for text in texts {
            hash.update((text.len() as u64).to_be_bytes());
            hash.update(text);
        }
        Self(hash.finalize().into())
    }
}

impl From<[u8; 32]> for Digest {
    fn from(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(formatter, "{byte:02x}"))
    }
}

impl From<Digest> for String {
    fn from(digest: Digest) -> Self {
        digest.to_string()
    }
}

impl TryFrom<String> for Digest {
    type Error = NoDigest;

    fn try_from(text: String) -> Result<Self, NoDigest> {
        text.parse()
    }
}

impl FromStr for Digest {
    type Err = NoDigest;

    fn from_str(text: &str) -> Result<Self, NoDigest> {
        let digit = |letter: u8| match letter {
            b'0'..=b'9' => Ok(letter - b'0'),
            b'a'..=b'f' => Ok(letter - b'a' + 10),
            _ => Err(NoDigest),
        };
        let mut bytes = [0; 32];
        if text.len() != 2 * bytes.len() {
            return Err(NoDigest);
        }
        for (byte, pair) in bytes.iter_mut().zip(text.as_bytes().chunks_exact(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Ok(Self(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_reads_back_as_it_is_written_and_nothing_else_does() {
        let digest = Digest::of(b"abc");
        let text = digest.to_string();
        assert!(text.starts_with("ba7816bf8f01cfea") && text.ends_with("f20015ad"));
        assert_eq!(text.parse(), Ok(digest));
        for wrong in ["", "../../etc/passwd", &text[1..], &text.to_uppercase(), &"é".repeat(32)] {
            assert_eq!(wrong.parse::<Digest>(), Err(NoDigest), "{wrong}");
        }
    }

    #[test]
    fn a_digest_piece_by_piece_is_that_of_the_whole_and_stops_at_any_piece() {
        let bytes = vec![7; 5 * ASKED_EVERY_BYTES / 2];
        let asked = std::cell::Cell::new(0);
        let of_while = |most: usize| {
            asked.set(0);
            Digest::of_while(&bytes, || {
                asked.set(asked.get() + 1);
                if asked.get() > most { Err(Cancelled) } else { Ok(()) }
            })
        };
        assert_eq!((of_while(3), asked.get()), (Ok(Digest::of(&bytes)), 3));
        for most in 0..3 {
            assert_eq!((of_while(most), asked.get()), (Err(Cancelled), most + 1));
        }
        assert_eq!(Digest::of_while(&[], || Err(Cancelled)), Ok(Digest::of(b"")));
    }

    #[test]
    fn texts_do_not_run_into_each_other() {
        assert_ne!(Digest::of_texts(&["ab", "c"]), Digest::of_texts(&["a", "bc"]));
    }
}
