//! Which pages of other origins may use the service: those that the settings name, and no other.

use crate::extract::request_id::REQUEST_ID;
use axum::http::header::{
    ACCEPT, AUTHORIZATION, CONTENT_DISPOSITION, CONTENT_TYPE, ETAG, IF_NONE_MATCH, LOCATION, RANGE,
    RETRY_AFTER,
};
use axum::http::{HeaderName, HeaderValue, Method};
use std::time::Duration;
use tower_http::cors::{AllowOrigin, CorsLayer};

/// How long a browser may remember what it was allowed.
const MAX_AGE: Duration = Duration::from_secs(3600);

/// The layer that lets pages of these origins in; none where there are none.
pub(super) fn layer(origins: &[String]) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> =
        origins.iter().filter_map(|origin| HeaderValue::try_from(origin).ok()).collect();
    (!origins.is_empty()).then(|| {
        CorsLayer::new()
            .allow_origin(AllowOrigin::list(origins))
            .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::DELETE])
            .allow_headers(sent())
            .expose_headers(answered())
            .max_age(MAX_AGE)
    })
}

/// The headers that a page may send.
fn sent() -> Vec<HeaderName> {
    let known = [ACCEPT, AUTHORIZATION, CONTENT_TYPE, IF_NONE_MATCH, RANGE];
    let own = ["idempotency-key", "last-event-id", "prefer"].map(HeaderName::from_static);
    known.into_iter().chain(own).chain([REQUEST_ID.clone()]).collect()
}

/// The headers of an answer that a page may read, beside those that it always may.
fn answered() -> Vec<HeaderName> {
    let known = [CONTENT_DISPOSITION, ETAG, LOCATION, RETRY_AFTER];
    let own = [
        "mesh-faces",
        "mesh-mse",
        "mesh-parameters",
        "mesh-psnr",
        "mesh-vertices",
        "preference-applied",
        "ratelimit",
        "ratelimit-policy",
        "server-timing",
    ];
    let own = own.map(HeaderName::from_static);
    known.into_iter().chain(own).chain([REQUEST_ID.clone()]).collect()
}
