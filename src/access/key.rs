//! Keys: 256 random bits, of which only a digest is kept.
//!
//! A digest without salt or stretching is enough, because nobody can search 2^256 keys; what makes
//! them necessary for passwords is that people choose these.

use sha2::{Digest as _, Sha256};
use std::fmt::{self, Write};
use subtle::ConstantTimeEq;

/// What every key begins with, so that tools that look for leaked secrets recognise one.
const PREFIX: &str = "pixmesh_";
/// Random bytes of a key.
const RANDOM_BYTES: usize = 32;
/// Bytes of a digest.
const DIGEST_BYTES: usize = 32;

/// A key in clear text.
pub struct Key(String);

/// The SHA-256 of a key.
#[derive(Clone, PartialEq, Eq)]
pub struct Digest([u8; DIGEST_BYTES]);

impl Key {
    /// A new key from the system's random source.
    ///
    /// # Errors
    /// When the system has none.
    pub fn random() -> Result<Self, getrandom::Error> {
        let mut bytes = [0; RANDOM_BYTES];
        getrandom::fill(&mut bytes)?;
        Ok(Self(format!("{PREFIX}{}", hexadecimal(&bytes))))
    }

    /// Its text, which is shown once.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Its digest.
    #[must_use]
    pub fn digest(&self) -> Digest {
        Digest::of(&self.0)
    }
}

impl Digest {
    /// The digest of a key.
    #[must_use]
    pub fn of(key: &str) -> Self {
        Self(Sha256::digest(key.as_bytes()).into())
    }

    /// A digest written as 64 hexadecimal digits.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut bytes = [0; DIGEST_BYTES];
        if text.len() != 2 * DIGEST_BYTES || !text.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        for (byte, start) in bytes.iter_mut().zip((0..).step_by(2)) {
            *byte = u8::from_str_radix(&text[start..start + 2], 16).ok()?;
        }
        Some(Self(bytes))
    }

    /// Whether both are the same, in a time that does not depend on where they differ.
    #[must_use]
    pub fn matches(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&hexadecimal(&self.0))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Digest")
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_reads_back_and_matches_its_key_only() {
        let [key, other] = [Key::random().unwrap(), Key::random().unwrap()];
        assert_ne!(key.reveal(), other.reveal());
        let digest = Digest::parse(&key.digest().to_string()).unwrap();
        assert!(digest.matches(&Digest::of(key.reveal())));
        assert!(!digest.matches(&other.digest()));
        assert_eq!(format!("{digest:?}"), "Digest", "no log shows one");
    }

    #[test]
    fn what_is_no_digest_is_none() {
        for text in ["", "ab", &"g".repeat(64), &"a".repeat(63), &"é".repeat(32)] {
            assert!(Digest::parse(text).is_none(), "{text}");
        }
    }
}
