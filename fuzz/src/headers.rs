//! Header values: the first line is an `Accept`, the second an `Idempotency-Key`, the third a
//! `Prefer`.

use axum::http::{HeaderMap, HeaderValue, header::ACCEPT};
use pixmesh::extract::accept::{choose, offered};
use pixmesh::extract::idempotency;
use pixmesh::extract::prefer::Preference;

/// Reads the values as those of a request.
pub fn run(bytes: &[u8]) {
    let names = ["accept", "idempotency-key", "prefer"];
    let mut headers = HeaderMap::new();
    for (name, line) in names.into_iter().zip(bytes.split(|&byte| byte == b'\n')) {
        if let Ok(value) = HeaderValue::from_bytes(line) {
            headers.append(name, value);
        }
    }
    match choose(None, &headers) {
        Ok(chosen) => assert!(offered().any(|known| known == chosen)),
        Err(_) => assert!(headers.contains_key(ACCEPT)),
    }
    if let Ok(Some(word)) = idempotency::key_of(&headers) {
        assert!((1..=255).contains(&word.len()));
    }
    let preference = Preference::of(&headers);
    let _ = (preference.is_for_job(), preference.applied());
}
