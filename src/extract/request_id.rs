//! The request's id: that of the client if it is valid, otherwise a new one.
//!
//! `tower_http::request_id` keeps any id that a client sends; this one is written to the log, so it is
//! checked.

use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::Response;
use uuid::Uuid;

/// The header that carries the id, both ways.
pub static REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// An id of 1 to 64 letters, digits, `-` and `_`, under which the log has everything about the
/// request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestId(HeaderValue);

impl RequestId {
    /// The id in a request's header, if it is there once and valid; otherwise a new one.
    fn of(request: &Request) -> Self {
        let mut given = request.headers().get_all(&REQUEST_ID).iter();
        match (given.next(), given.next()) {
            (Some(id), None) if is_harmless(id.as_bytes()) => Self(id.clone()),
            _ => Self::random(),
        }
    }

    /// A new id.
    #[must_use]
    pub fn random() -> Self {
        let id = Uuid::now_v7().to_string();
        Self(HeaderValue::try_from(id).unwrap_or(HeaderValue::from_static("unknown")))
    }

    /// The id as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        self.0.to_str().unwrap_or_default()
    }
}

/// The layer that gives every request its id, and sends it back.
pub async fn identify(mut request: Request, next: Next) -> Response {
    let id = RequestId::of(&request);
    request.extensions_mut().insert(id.clone());
    let mut response = next.run(request).await;
    response.headers_mut().insert(REQUEST_ID.clone(), id.0);
    response
}

fn is_harmless(id: &[u8]) -> bool {
    let allowed = |letter: &u8| letter.is_ascii_alphanumeric() || b"-_".contains(letter);
    (1..=64).contains(&id.len()) && id.iter().all(allowed)
}
