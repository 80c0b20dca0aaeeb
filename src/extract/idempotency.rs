//! `Idempotency-Key`: the client's key of a submission; a repeated key returns the same job.

use crate::problem::{Kind, Problem};
use axum::http::HeaderMap;

/// The header.
pub const IDEMPOTENCY_KEY: &str = "idempotency-key";

/// The longest key.
const MAX_LENGTH: usize = 255;

/// The key of a request, if it has one: 1 to 255 visible ASCII characters.
///
/// # Errors
/// `duplicate-parameter` when it is there twice, `parameter-malformed` when it is none.
pub fn key_of(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let mut given = headers.get_all(IDEMPOTENCY_KEY).iter();
    let Some(word) = given.next() else { return Ok(None) };
    if given.next().is_some() {
        let detail = "Idempotency-Key is given more than once";
        return Err(Problem::new(Kind::DuplicateParameter, detail).param("Idempotency-Key"));
    }
    let bytes = word.as_bytes();
    let is_word = bytes.iter().all(u8::is_ascii_graphic) && (1..=MAX_LENGTH).contains(&bytes.len());
    if !is_word {
        let detail = format!(
            "Idempotency-Key must be 1 to {MAX_LENGTH} visible ASCII characters, such as a UUID"
        );
        return Err(Problem::new(Kind::ParameterMalformed, detail).param("Idempotency-Key"));
    }
    Ok(Some(bytes.iter().map(|&byte| char::from(byte)).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(values: &[&'static str]) -> Result<Option<String>, Kind> {
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append(IDEMPOTENCY_KEY, value.parse().unwrap());
        }
        key_of(&headers).map_err(|problem| problem.kind())
    }

    #[test]
    fn a_word_is_visible_and_given_once() {
        assert_eq!(key(&[]), Ok(None));
        assert_eq!(key(&["\"8e03978e\""]), Ok(Some("\"8e03978e\"".into())));
        assert_eq!(key(&["a", "b"]), Err(Kind::DuplicateParameter));
        for wrong in ["", "a b", "a\tb", "é"] {
            assert_eq!(key(&[wrong]), Err(Kind::ParameterMalformed), "{wrong:?}");
        }
        assert_eq!(key(&[&*"a".repeat(256).leak()]), Err(Kind::ParameterMalformed));
    }
}
