//! Limits that hold for every request, and headers that every response has.

use crate::problem::{Kind, Problem};
use axum::extract::Request;
use axum::http::header::{
    CONNECTION, CONTENT_SECURITY_POLICY, HOST, REFERRER_POLICY, TRANSFER_ENCODING,
    X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri, Version};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// The longest request target in bytes.
const MAX_TARGET: usize = 8192;
/// The most bytes of names and values in a request's header.
const MAX_HEADER: usize = 16 * 1024;
/// The most lines of a request's header.
const MAX_HEADER_LINES: usize = 100;

/// Headers of every response: no guessing of types, no frames, no referrer, no devices, and no other
/// page that holds a window of ours.
const ALWAYS: [(HeaderName, &str); 6] = [
    (HeaderName::from_static("permissions-policy"), "camera=(), geolocation=(), microphone=()"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (X_FRAME_OPTIONS, "DENY"),
    (REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];
/// The policy of a response that is no page of ours: a browser that shows it runs nothing in it.
const NO_CONTENT_LOADED: &str = "default-src 'none'; frame-ancestors 'none'";

/// The layer that refuses oversized requests and those without one host, and sets the headers that
/// restrict what browsers do with a response.
///
/// The connection ends with a request that has `Transfer-Encoding`: bytes after its body are never
/// taken for a request (RFC 9112, section 6.1). Where `Content-Length` is there too, hyper reads the
/// body by `Transfer-Encoding` and closes the connection as well.
pub(super) async fn guard(request: Request, next: Next) -> Response {
    let is_last = request.headers().contains_key(TRANSFER_ENCODING) || !names_its_host(&request);
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
    if !names_its_host(request) {
        let detail = "send exactly one Host header; HTTP/1.1 requires it";
        return Some(Problem::new(Kind::BadRequest, detail));
    }
    let mut codings = request.headers().get_all(TRANSFER_ENCODING).iter();
    if codings.any(|coding| !coding.as_bytes().eq_ignore_ascii_case(b"chunked")) {
        let detail = "the only supported transfer coding is chunked";
        return Some(Problem::new(Kind::BadRequest, detail).param("Transfer-Encoding"));
    }
    let target = length_of(request.uri());
    if target > MAX_TARGET {
        let detail = format!(
            "the path and query are longer than {MAX_TARGET} bytes: send parameters as a form"
        );
        return Some(Problem::new(Kind::UriTooLong, detail).limit(MAX_TARGET, target));
    }
    oversized(request.headers())
}

/// Whether a request names one host, as HTTP/1.1 requires (RFC 9112, section 3.2).
fn names_its_host(request: &Request) -> bool {
    request.version() != Version::HTTP_11 || request.headers().get_all(HOST).iter().count() == 1
}

fn length_of(target: &Uri) -> usize {
    target.path_and_query().map_or(0, |target| target.as_str().len())
}

/// The refusal of too long a header.
fn oversized(headers: &HeaderMap) -> Option<Problem> {
    let lines = headers.len();
    if lines > MAX_HEADER_LINES {
        let detail =
            format!("the request has more than {MAX_HEADER_LINES} header lines: send fewer");
        return Some(Problem::new(Kind::HeadersTooLarge, detail).limit(MAX_HEADER_LINES, lines));
    }
    let length: usize = headers.iter().map(|(name, value)| name.as_str().len() + value.len()).sum();
    (length > MAX_HEADER).then(|| {
        let detail =
            format!("the request's header lines have more than {MAX_HEADER} bytes: send less");
        Problem::new(Kind::HeadersTooLarge, detail).limit(MAX_HEADER, length)
    })
}
