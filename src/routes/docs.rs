//! `GET /docs`: a page for the OpenAPI document, with its assets from the program itself.

use super::openapi::bodies::Text;
use crate::problem::{Kind, Problem, internal};
use axum::extract::Path;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use std::io;
use std::sync::Arc;
use utoipa_swagger_ui::{Config, serve};

/// The page may load what is from here, and ask the service; its pictures and styles may be inline.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data:; font-src 'self' data:; connect-src 'self'; \
                      form-action 'none'; base-uri 'none'; frame-ancestors 'none'";

/// Answers with the page.
///
/// # Errors
/// `internal` when the page is not there.
#[utoipa::path(
    get, path = "/docs", operation_id = "docs",
    summary = "A page for this document",
    description = "Swagger UI, with all of its files from the service itself.",
    responses((
        status = 200, description = "The page", body = inline(Text), content_type = "text/html",
    )),
)]
pub async fn show() -> Result<Response, Problem> {
    file("index.html")
}

/// Answers with an asset of the page.
///
/// # Errors
/// `not-found` for what is none.
pub async fn asset(Path(name): Path<String>) -> Result<Response, Problem> {
    file(&name)
}

fn file(name: &str) -> Result<Response, Problem> {
    let config = Arc::new(Config::from("/openapi.json"));
    let found = serve(name, config).map_err(|error| {
        internal("the page of the documentation failed", &io::Error::other(error.to_string()))
    })?;
    let file = found.ok_or_else(|| Problem::new(Kind::NotFound, "the page has no such asset"))?;
    let headers = [
        (CONTENT_TYPE, file.content_type),
        (CONTENT_SECURITY_POLICY, POLICY.to_owned()),
        (CACHE_CONTROL, "no-cache".to_owned()),
    ];
    let bytes = if name == "index.html" { rooted(&file.bytes) } else { file.bytes.into_owned() };
    Ok((headers, bytes).into_response())
}

/// The page with links that hold with or without a slash at the end of its address.
fn rooted(page: &[u8]) -> Vec<u8> {
    let page = String::from_utf8_lossy(page).replace("=\"./", "=\"/docs/");
    page.replace("=\"index.css", "=\"/docs/index.css").into_bytes()
}
