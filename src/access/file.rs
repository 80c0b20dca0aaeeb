//! The file of keys: one line for each, with a name, the digest of the key, and perhaps a quota, an
//! operator's rights and the time when the key expires.
//!
//! ```text
//! # a comment
//! studio 9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08
//! batch  60303ae22b998861bce3b28f33eec1be758a213c86c93c076dbe9f558c11c752 requests-per-minute=60
//! admin  fd61a03af4f77d870fc21e05e7e80678095c92d808cfb3b5c279ee04c74aca13 operator expires=2027-01-31T00:00:00Z
//! ```
//!
//! Two lines of the same name are two keys of the same owner, which is how one replaces another.

use super::Digest;
use pixmesh_engine::Owner;
use pixmesh_jobs::record::Moment;
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
    /// Whether it may operate the jobs of all owners.
    pub is_operator: bool,
    /// From when on it is good no longer.
    pub expires: Option<Moment>,
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
    let (owner, requests_per_minute, expires) = (Owner::named(name), None, None);
    let mut key = KeyLine { owner, digest, requests_per_minute, is_operator: false, expires };
    for word in words {
        let is_read = match word.split_once('=') {
            Some(("requests-per-minute", number)) if key.requests_per_minute.is_none() => {
                key.requests_per_minute = number.parse().ok();
                key.requests_per_minute.is_some()
            }
            Some(("expires", time)) if key.expires.is_none() => {
                key.expires = Moment::parse(time);
                key.expires.is_some()
            }
            None if word == "operator" => !std::mem::replace(&mut key.is_operator, true),
            _ => false,
        };
        if !is_read {
            return Err("only requests-per-minute=N, operator and expires=TIME, such as \
                        expires=2027-01-31T00:00:00Z, may follow the digest, each once"
                .into());
        }
    }
    Ok(key)
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
        let text = format!("a {DIGEST} expires=2001-09-09T01:46:40Z operator");
        let [key] = &parse(&text).unwrap()[..] else { panic!("one key") };
        assert_eq!((key.is_operator, key.expires), (true, Some(Moment(1_000_000_000_000))));
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
            &format!("a {DIGEST} operator operator"),
            &format!("a {DIGEST} expires=tomorrow"),
            &format!("a {DIGEST}\na {DIGEST} requests-per-minute=9"),
        ] {
            let error = parse(&format!("# first\n{line}")).unwrap_err();
            assert!(error.starts_with("line ") && !error.contains("secret"), "{error}");
        }
    }
}
