//! `GET /`: the studio, a page to try the service in, with its assets from the program itself.
//!
//! The page is what stands in `studio/page`: modules, styles and markup as browsers read them,
//! without a step that builds them. A debug build reads them from the checkout each time.

use super::index;
use super::index::Index;
use super::openapi::bodies::Text;
use crate::extract::accept;
use crate::problem::{Kind, Problem, internal};
use crate::routes::answer;
use axum::body::Body;
use axum::extract::Path;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG,
    VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use pixmesh_engine::digest::Digest;
use rust_embed::{EmbeddedFile, RustEmbed};
use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::{LazyLock, Mutex, PoisonError};

/// The page may load what is from here, and ask the service; no script or style is inline, and
/// pictures may also be those that the page makes.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src 'self' blob: data:; connect-src 'self'; worker-src 'self'; \
                      form-action 'none'; base-uri 'none'; frame-ancestors 'none'";
/// The file that the page begins with.
const PAGE: &str = "index.html";

/// The files of the page.
#[derive(RustEmbed)]
#[folder = "studio/page"]
struct Files;

/// The files as they are sent compressed, by the digest of what they hold.
static COMPRESSED: LazyLock<Mutex<HashMap<[u8; 32], Bytes>>> = LazyLock::new(Mutex::default);

/// Answers with the page, or with links to the resources where a client would rather have JSON.
///
/// # Errors
/// `internal` when the page cannot be compressed.
#[utoipa::path(
    get, path = "/", operation_id = "index",
    summary = "The studio, a page to try the service in; links to the resources as JSON",
    description = "A browser gets the page; a client that prefers application/json gets the links.",
    responses((status = 200, description = "The page, or the links", content(
        (Index = "application/json"), (inline(Text) = "text/html"),
    ))),
)]
pub async fn show(request: HeaderMap) -> Result<Response, Problem> {
    let mut response = if accept::prefers_json_to_html(&request) {
        index::show().await.into_response()
    } else {
        file(PAGE, &request)?
    };
    response.headers_mut().append(VARY, HeaderValue::from_static("Accept"));
    Ok(response)
}

/// Answers with an asset of the page.
///
/// # Errors
/// `not-found` for what is none.
pub async fn asset(Path(name): Path<String>, request: HeaderMap) -> Result<Response, Problem> {
    file(&name, &request)
}

fn file(name: &str, request: &HeaderMap) -> Result<Response, Problem> {
    let missing = || Problem::new(Kind::NotFound, "the studio has no such asset");
    let content_type = content_type(name).ok_or_else(missing)?;
    let file = Files::get(name).ok_or_else(missing)?;
    let compresses = accepts_gzip(request);
    let suffix = if compresses { ".gzip" } else { "" };
    let tag = answer::tag(format_args!("{}{suffix}", Digest::from(file.metadata.sha256_hash())));
    let headers = [
        (CONTENT_SECURITY_POLICY, POLICY),
        (CACHE_CONTROL, "no-cache"),
        (VARY, "Accept-Encoding"),
        (ETAG, tag.as_str()),
    ];
    if answer::is_known(request, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let kind = [(CONTENT_TYPE, content_type)];
    if !compresses {
        return Ok((headers, kind, Body::from(file.data.into_owned())).into_response());
    }
    let body = compressed(&file)
        .map_err(|error| internal("an asset of the studio cannot be compressed", &error))?;
    Ok((headers, kind, [(CONTENT_ENCODING, "gzip")], body).into_response())
}

/// The type of a file by its name; `None` for what is not of the page.
fn content_type(name: &str) -> Option<&'static str> {
    match name.rsplit_once('.')?.1 {
        "html" => Some("text/html; charset=utf-8"),
        "css" => Some("text/css; charset=utf-8"),
        "js" => Some("text/javascript; charset=utf-8"),
        "svg" => Some("image/svg+xml"),
        _ => None,
    }
}

fn accepts_gzip(request: &HeaderMap) -> bool {
    let values = request.get_all(ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|coding| {
        let mut pieces = coding.split(';').map(str::trim);
        let is_gzip = pieces.next().is_some_and(|name| name.eq_ignore_ascii_case("gzip"));
        is_gzip && !pieces.any(|weight| weight.trim_start_matches("q=").parse() == Ok(0.0))
    })
}

/// The file compressed, which is done once for each.
fn compressed(file: &EmbeddedFile) -> io::Result<Bytes> {
    let mut known = COMPRESSED.lock().unwrap_or_else(PoisonError::into_inner);
    let digest = file.metadata.sha256_hash();
    if let Some(bytes) = known.get(&digest) {
        return Ok(bytes.clone());
    }
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&file.data)?;
    let bytes = Bytes::from(encoder.finish()?);
    known.insert(digest, bytes.clone());
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_page_has_a_type() {
        let names: Vec<_> = Files::iter().collect();
        assert!(names.iter().any(|name| name == PAGE));
        for name in names {
            assert!(content_type(&name).is_some(), "{name}");
        }
    }

    #[test]
    fn a_client_says_whether_it_takes_compressed_files() {
        let accepts = |value: &'static str| {
            let headers = [(ACCEPT_ENCODING, HeaderValue::from_static(value))];
            accepts_gzip(&HeaderMap::from_iter(headers))
        };
        assert!(accepts("gzip") && accepts("br, GZIP;q=0.5"));
        assert!(!accepts("") && !accepts("br") && !accepts("gzip;q=0"));
        assert!(!accepts_gzip(&HeaderMap::new()));
    }
}
