//! Text compressed with gzip for clients that accept it.
//!
//! `tower_http` compresses while a response is sent, on the threads that serve requests. So only
//! [`MOST`] responses are compressed at a time; the others are sent as they are.

use axum::body::Body;
use axum::extract::Request;
use axum::http::header::{ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_TYPE, ETAG, VARY};
use axum::http::{Extensions, HeaderMap, HeaderValue, StatusCode, Version};
use axum::middleware::Next;
use axum::response::Response;
use http_body::Body as _;
use http_body_util::BodyExt;
use std::sync::{Arc, LazyLock};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;

/// The most responses that are compressed at a time; each takes a third of a MiB.
const MOST: usize = 64;
/// The shortest response that is compressed, in bytes.
const SHORTEST: u64 = 1024;
/// The media types that are compressed, beside text.
const TYPES: [&str; 4] =
    ["application/json", "application/problem+json", "image/svg+xml", "model/gltf+json"];

static PERMITS: LazyLock<Arc<Semaphore>> = LazyLock::new(|| Arc::new(Semaphore::new(MOST)));

/// A response that may be compressed, with the permit for it.
#[derive(Clone)]
struct Marked(Arc<OwnedSemaphorePermit>);

type IsMarked = fn(StatusCode, Version, &HeaderMap, &Extensions) -> bool;

/// The layer that compresses what [`mark`] has marked.
pub(super) fn layer() -> CompressionLayer<IsMarked> {
    let is_marked: IsMarked = |_, _, _, extensions| extensions.get::<Marked>().is_some();
    CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(is_marked)
}

/// The layer for the small files of a page, which compresses them further. The layers around it leave
/// their bytes as they are.
pub(super) fn of_assets() -> CompressionLayer {
    CompressionLayer::new()
}

/// The layer below it that marks text while few responses are being compressed.
pub(super) async fn mark(request: Request, next: Next) -> Response {
    let accepts = request.headers().contains_key(ACCEPT_ENCODING);
    let mut response = next.run(request).await;
    let is_text = is_text(response.headers());
    let is_compressed = response.headers().contains_key(CONTENT_ENCODING);
    if is_text && !is_compressed || response.status() == StatusCode::NOT_MODIFIED {
        response.headers_mut().append(VARY, HeaderValue::from_static("Accept-Encoding"));
    }
    let is_short = response.body().size_hint().upper().is_some_and(|length| length < SHORTEST);
    if !accepts || !is_text || is_short {
        return response;
    }
    let Ok(permit) = Arc::clone(&PERMITS).try_acquire_owned() else { return response };
    response.extensions_mut().insert(Marked(Arc::new(permit)));
    response
}

/// The layer above it, for what was compressed: the response holds the permit until it is sent, and
/// its entity tag is weak, since its bytes are others.
pub(super) async fn finish(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let marked = response.extensions_mut().remove::<Marked>();
    let is_compressed = response.headers().contains_key(CONTENT_ENCODING);
    let Some(Marked(permit)) = marked.filter(|_| is_compressed) else { return response };
    if let Some(tag) = response.headers().get(ETAG)
        && let Ok(weak) = HeaderValue::try_from([b"W/", tag.as_bytes()].concat())
    {
        response.headers_mut().insert(ETAG, weak);
    }
    response.map(|body| {
        Body::new(body.map_frame(move |frame| {
            let _held = &permit;
            frame
        }))
    })
}

fn is_text(headers: &HeaderMap) -> bool {
    let value = headers.get(CONTENT_TYPE).and_then(|value| value.to_str().ok());
    let essence = value.and_then(|value| value.split(';').next()).map_or("", str::trim);
    // Events are sent one by one.
    TYPES.contains(&essence) || essence.starts_with("text/") && essence != "text/event-stream"
}
