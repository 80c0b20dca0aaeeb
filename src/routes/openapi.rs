//! `GET /openapi.json`: the interface as an OpenAPI 3.1 document.
//!
//! Each handler describes its operation. The parts that operations share come from the tables that
//! the service works by. A copy of the document is `openapi/openapi.json`.

pub(super) mod answers;
pub(super) mod bodies;
pub(super) mod examples;
pub(super) mod parameters;

use axum::Extension;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use bodies::AnyObject;
use bytes::Bytes;
use utoipa::PartialSchema as _;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder};

const ABOUT: &str = "Pictures to triangle meshes. Every refusal is a problem document (RFC 9457) \
                     whose type is a reference below /problems/. Every answer has the id of its \
                     request in X-Request-ID: the one that was sent, when it is 1 to 64 letters, \
                     digits, - and _.";

/// The text of the document.
#[derive(Clone)]
pub(super) struct DocumentText(Bytes);

impl DocumentText {
    /// The document as indented JSON, with a line feed at its end.
    pub(super) fn of(document: &OpenApi) -> Self {
        let text = document.to_pretty_json();
        Self(text.map_or_else(|_| String::from("{}\n"), |text| text + "\n").into())
    }

    pub(super) fn into_string(self) -> String {
        String::from_utf8_lossy(&self.0).into_owned()
    }
}

/// Answers with the document.
#[utoipa::path(
    get, path = "/openapi.json", operation_id = "openapi", summary = "This document",
    description = "The source of the service has the same document as openapi/openapi.json.",
    responses((status = 200, description = "This document", body = inline(AnyObject))),
)]
pub(super) async fn show(Extension(document): Extension<DocumentText>) -> impl IntoResponse {
    ([(CONTENT_TYPE, "application/json")], document.0)
}

/// The document without operations, with the schema of events, which are not JSON documents.
pub(super) fn base<Event: utoipa::ToSchema>() -> OpenApi {
    let license = LicenseBuilder::new().name(env!("CARGO_PKG_LICENSE")).build();
    let info = InfoBuilder::new()
        .title("pixmesh")
        .version(env!("CARGO_PKG_VERSION"))
        .description(Some(ABOUT))
        .license(Some(license))
        .build();
    let key = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some("A key from the operator; a service without keys needs none."))
        .build();
    let components = ComponentsBuilder::new()
        .schema("Problem", bodies::Problem::schema())
        .schema(Event::name(), Event::schema())
        .security_scheme("key", SecurityScheme::Http(key))
        .build();
    OpenApiBuilder::new().info(info).components(Some(components)).build()
}
