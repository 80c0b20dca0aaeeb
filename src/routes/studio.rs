//! `GET /`: the studio, a page to try the service in, with its assets from the program itself.
//!
//! The page is what stands in `studio/page`: modules, styles and markup as browsers read them,
//! without a step that builds them. A debug build reads them from the checkout each time.

use super::index;
use super::index::Index;
use super::openapi::bodies::Text;
use crate::extract::accept;
use crate::problem::{Kind, Problem};
use crate::routes::answer;
use axum::body::Body;
use axum::extract::Path;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use pixmesh_engine::digest::Digest;
use rust_embed::RustEmbed;

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

/// Answers with the page, or with links to the resources where a client would rather have JSON.
///
/// # Errors
/// `not-found` when the program has no page.
#[utoipa::path(
    get, path = "/", operation_id = "index",
    summary = "The studio, a page to try the service in; links to the resources as JSON",
    description = "A browser gets the page; a client that prefers application/json gets the links.",
    responses((status = 200, description = "The page, or the links", content(
        (Index = "application/json"), (inline(Text) = "text/html"),
    ))),
)]
pub async fn show(request: HeaderMap) -> Result<Response, Problem> {
    let mut response = if accept::prefers(&request, "application/json", "text/html") {
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
    let tag = answer::tag(Digest::from(file.metadata.sha256_hash()));
    let headers =
        [(CONTENT_SECURITY_POLICY, POLICY), (CACHE_CONTROL, "no-cache"), (ETAG, tag.as_str())];
    if answer::is_known(request, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let body = Body::from(file.data.into_owned());
    Ok((headers, [(CONTENT_TYPE, content_type)], body).into_response())
}

/// The type of a file by its name; `None` for what is not of the page.
fn content_type(name: &str) -> Option<&'static str> {
    match name.rsplit_once('.')?.1 {
        "html" => Some("text/html; charset=utf-8"),
        "css" => Some("text/css; charset=utf-8"),
        "js" => Some("text/javascript; charset=utf-8"),
        "svg" => Some("image/svg+xml"),
        "pmesh" => Some("application/vnd.pixmesh.pmesh"),
        _ => None,
    }
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
}
