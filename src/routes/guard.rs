//! What no request may be like, whatever its route, and what every answer says.

use crate::problem::{Kind, Problem};
use crate::server::{Framing, HeadDefect};
use axum::extract::Request;
use axum::http::header::{
    CONNECTION, CONTENT_SECURITY_POLICY, REFERRER_POLICY, TRANSFER_ENCODING,
    X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// The longest request target in bytes.
const MAX_TARGET: usize = 8192;
/// The most bytes of names and values in a request's header.
const MAX_HEADER: usize = 16 * 1024;
/// The most lines of a request's header.
const MAX_HEADER_LINES: usize = 100;

/// What every answer says: no guessing of types, no other site's frames, no word to other sites
/// about the page one came from.
const ALWAYS: [(HeaderName, &str); 4] = [
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (X_FRAME_OPTIONS, "DENY"),
    (REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];
/// What is said of an answer that is no page of ours: a browser that shows it runs nothing in it.
const NO_CONTENT_LOADED: &str = "default-src 'none'; frame-ancestors 'none'";

/// The layer that refuses ambiguous and oversized requests, and says what browsers may do with answers.
///
/// A request with `Transfer-Encoding` is the last one of its connection, so that nothing that
/// follows its body can be taken for a request (RFC 9112, section 6.1), and so is an ambiguous one.
pub(super) async fn guard(request: Request, next: Next) -> Response {
    let is_last = request.headers().contains_key(TRANSFER_ENCODING) || defect(&request).is_some();
    let mut response = match refusal(&request) {
        Some(problem) => problem.into_response(),
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    for (name, value) in ALWAYS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(CONTENT_SECURITY_POLICY) {
        headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(NO_CONTENT_LOADED));
    }
    if is_last {
        headers.insert(CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

fn refusal(request: &Request) -> Option<Problem> {
    if let Some(defect) = defect(request) {
        return Some(ambiguous(defect));
    }
    let target = length_of(request.uri());
    if target > MAX_TARGET {
        let detail = format!("the request's target is longer than {MAX_TARGET} bytes");
        return Some(Problem::new(Kind::UriTooLong, detail).limit(MAX_TARGET, target));
    }
    oversized(request.headers())
}

/// What was seen to be wrong with the request's head.
fn defect(request: &Request) -> Option<HeadDefect> {
    request.extensions().get::<Framing>()?.defect()
}

fn ambiguous(defect: HeadDefect) -> Problem {
    match defect {
        HeadDefect::Length => {
            let detail = "Content-Length together with Transfer-Encoding, or a line without CR LF";
            Problem::new(Kind::AmbiguousLength, detail)
        }
        HeadDefect::Host => {
            Problem::new(Kind::BadRequest, "a request of HTTP/1.1 must have one header Host")
        }
    }
}

fn length_of(target: &Uri) -> usize {
    target.path_and_query().map_or(0, |target| target.as_str().len())
}

/// The refusal of too long a header.
fn oversized(headers: &HeaderMap) -> Option<Problem> {
    let lines = headers.len();
    if lines > MAX_HEADER_LINES {
        let detail = format!("the request's header has more than {MAX_HEADER_LINES} lines");
        return Some(Problem::new(Kind::HeadersTooLarge, detail).limit(MAX_HEADER_LINES, lines));
    }
    let length: usize = headers.iter().map(|(name, value)| name.as_str().len() + value.len()).sum();
    (length > MAX_HEADER).then(|| {
        let detail = format!("the request's header is longer than {MAX_HEADER} bytes");
        Problem::new(Kind::HeadersTooLarge, detail).limit(MAX_HEADER, length)
    })
}
