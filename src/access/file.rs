//! The file of keys: one line for each, with a name, the digest of the key, and perhaps a quota.
//!
//! ```text
//! # a comment
//! studio 9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08
//! batch  60303ae22b998861bce3b28f33eec1be758a213c86c93c076dbe9f558c11c752 requests-per-minute=60
//! ```
//!
//! Two lines of the same name are two keys of the same owner, which is how one replaces another.

use super::Digest;
use pixmesh_engine::Owner;
use std::num::NonZeroU32;

/// The longest name.
const MAX_NAME: usize = 64;

/// One key of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeyLine {
    /// Its owner.
    pub owner: Owner,
    /// Of the key.
    pub digest: Digest,
    /// The quota of its name, where it is not that of the settings.
    pub requests_per_minute: Option<NonZeroU32>,
}

/// Reads a file of keys.
///
/// # Errors
/// The number of the first invalid line, without its content.
pub fn parse(text: &str) -> Result<Vec<KeyLine>, String> {
    let mut keys: Vec<KeyLine> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let key = key_line(line).map_err(|error| format!("line {}: {error}", index + 1))?;
        let mut same_name = keys.iter().filter(|known| known.owner == key.owner);
        if same_name.any(|known| known.requests_per_minute != key.requests_per_minute) {
            return Err(format!("line {}: another quota than {} has above", index + 1, key.owner));
        }
        keys.push(key);
    }
    Ok(keys)
}

fn key_line(line: &str) -> Result<KeyLine, String> {
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    check_name(name)?;
    let digest = words.next().and_then(Digest::parse);
    let digest = digest.ok_or("no SHA-256 of a key, in 64 hexadecimal digits, after the name")?;
    let quota = words.next().map(requests_per_minute).transpose()?;
    match words.next() {
        Some(_) => Err("more than a name, a digest and a quota".into()),
        None => Ok(KeyLine { owner: Owner::named(name), digest, requests_per_minute: quota }),
    }
}

fn requests_per_minute(word: &str) -> Result<NonZeroU32, String> {
    let number = word.strip_prefix("requests-per-minute=").and_then(|number| number.parse().ok());
    number.ok_or_else(|| "only requests-per-minute=N, of 1 or more, may follow the digest".into())
}

/// Checks a name: 1 to 64 letters, digits, `-`, `_` and `.`.
///
/// # Errors
/// What it may be, when it is not that.
pub(super) fn check_name(name: &str) -> Result<(), String> {
    let allowed = |letter: u8| letter.is_ascii_alphanumeric() || b"-_.".contains(&letter);
    if (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(allowed) {
        return Ok(());
    }
    Err(format!("a name has 1 to {MAX_NAME} letters, digits, '-', '_' and '.'"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIGEST: &str = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08";

    #[test]
    fn lines_are_keys_and_comments_are_not() {
        let text = format!("# all\n\n a {DIGEST}\nb\t{DIGEST} requests-per-minute=7\r\na {DIGEST}");
        let keys = parse(&text).unwrap();
        let names: Vec<_> = keys.iter().map(|key| key.owner.as_str()).collect();
        assert_eq!(names, ["a", "b", "a"]);
        assert_eq!(keys[1].requests_per_minute, NonZeroU32::new(7));
    }

    #[test]
    fn a_line_that_is_no_key_is_named_and_not_shown() {
        for line in [
            "secret-without-digest",
            "a pixmesh_secret",
            &format!("{} {DIGEST}", "n".repeat(65)),
            &format!("caf\u{e9} {DIGEST}"),
            &format!("a {DIGEST} requests-per-minute=0"),
            &format!("a {DIGEST} per-minute=9"),
            &format!("a {DIGEST} requests-per-minute=9 more"),
            &format!("a {DIGEST}\na {DIGEST} requests-per-minute=9"),
        ] {
            let error = parse(&format!("# first\n{line}")).unwrap_err();
            assert!(error.starts_with("line ") && !error.contains("secret"), "{error}");
        }
    }
}
