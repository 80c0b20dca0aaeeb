//! The problem documents of requests that the HTTP library refuses by itself.
//!
//! What it cannot read never reaches the routes: it answers with a bare status and closes the
//! connection. These answers are known by their form, which none of ours has, and written out as
//! every other refusal is.

use crate::extract::request_id::RequestId;
use crate::problem::{Kind, Problem};
use crate::telemetry;
use std::time::Duration;

/// The first lines of the library's own refusals, with what they are called here.
const REFUSALS: [(&[u8], Kind, &str); 3] = [
    (
        b"HTTP/1.1 400 ",
        Kind::BadRequest,
        "the request's first line or its header is not that of HTTP/1.1",
    ),
    (b"HTTP/1.1 414 ", Kind::UriTooLong, "the request's target is too long"),
    (b"HTTP/1.1 431 ", Kind::HeadersTooLarge, "the request's header is too large"),
];

/// What a body is called that is longer than can be counted.
const COUNTLESS: (Kind, &str) =
    (Kind::BodyTooLarge, "the body is announced to be longer than any that is accepted");

/// What is sent in place of these bytes, if they are a refusal of the library's own. To it a body that it
/// cannot count is a defect of the header.
pub(super) fn in_place_of(bytes: &[u8], is_countless: bool) -> Option<Vec<u8>> {
    let (_, kind, detail) = REFUSALS.into_iter().find(|(start, ..)| bytes.starts_with(start))?;
    let (kind, detail) = if is_countless { COUNTLESS } else { (kind, detail) };
    is_bare(bytes).then(|| {
        let id = RequestId::random();
        tracing::info!(id = id.as_str(), code = kind.status().as_u16(), "unreadable");
        telemetry::answered(
            telemetry::UNKNOWN_ROUTE,
            "OTHER",
            kind.status().as_u16(),
            Duration::ZERO,
        );
        answer(kind, &Problem::new(kind, detail).document(Some(&id)), &id).into_bytes()
    })
}

/// Whether these bytes are a whole head, of an answer that has neither a body nor a type.
fn is_bare(bytes: &[u8]) -> bool {
    let head = str::from_utf8(bytes).unwrap_or_default().to_ascii_lowercase();
    head.find("\r\n\r\n") == head.len().checked_sub(4)
        && head.contains("\r\ncontent-length: 0\r\n")
        && !head.contains("\r\ncontent-type:")
}

fn answer(kind: Kind, document: &str, id: &RequestId) -> String {
    format!(
        "HTTP/1.1 {}\r\ncontent-type: application/problem+json\r\ncontent-length: {}\r\n\
         x-request-id: {}\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n{document}",
        kind.status(),
        document.len(),
        id.as_str()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_bare_refusal_is_replaced() {
        let bare = "HTTP/1.1 431 Request Header Fields Too Large\r\ncontent-length: 0\r\n\r\n";
        let answer = String::from_utf8(in_place_of(bare.as_bytes(), false).unwrap()).unwrap();
        assert!(answer.starts_with("HTTP/1.1 431 Request Header Fields Too Large\r\n"));
        assert!(answer.contains("/problems/headers-too-large"));
        let answer = String::from_utf8(in_place_of(bare.as_bytes(), true).unwrap()).unwrap();
        assert!(answer.starts_with("HTTP/1.1 413 "));
        assert!(answer.contains("/problems/body-too-large"));
        for other in [
            "HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n",
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 0\r\n\r\nHTTP",
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 7\r\n\r\n",
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 0\r\n",
            "HTTP/1.1 400 Bad Request\r\ncontent-type: a\r\ncontent-length: 0\r\n\r\n",
            "HTTP/1.1 400 ",
        ] {
            assert_eq!(in_place_of(other.as_bytes(), true), None, "{other}");
        }
    }
}
