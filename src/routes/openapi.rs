//! `GET /openapi.json`: the interface as an OpenAPI 3.1 document.
//!
//! Parameters, formats and refusals come from the same tables that the service works by, so that
//! the document cannot say anything else. A copy is checked in as `openapi/openapi.json`.

mod examples;
mod jobs;
mod parts;

use super::comparisons;
use super::index::Index;
use super::jobs::document::{Job, JobEvent};
use super::jobs::list::Jobs;
use super::methods::Methods;
use crate::problem::Kind;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use bytes::Bytes;
use parts::{
    KEY, any, bytes, content, example, form, mesh, object, query_parameter, refusal, text,
    with_or_without_key,
};
use pixmesh_engine::params::TABLE;
#[cfg(test)]
use serde_json::{Value, json};
use std::sync::LazyLock;
use utoipa::ToSchema;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::path::{
    HttpMethod, Operation, OperationBuilder, ParameterBuilder, ParameterIn, PathItem, PathsBuilder,
};
use utoipa::openapi::request_body::{RequestBody, RequestBodyBuilder};
use utoipa::openapi::schema::{ArrayBuilder, ObjectBuilder, Ref, Schema, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{
    ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, RefOr, Required,
    ResponseBuilder,
};

const ABOUT: &str = "Pictures to triangle meshes. Every refusal is a problem document (RFC 9457) \
                     whose type is a reference below /problems/. Every answer has the id of its \
                     request in X-Request-ID: the one that was sent, when it is 1 to 64 letters, \
                     digits, - and _.";

/// Answers with the document.
pub async fn show() -> impl IntoResponse {
    /// Made once: its examples are meshes that the kernels make.
    static DOCUMENT: LazyLock<Bytes> = LazyLock::new(|| document_text().into());
    ([(CONTENT_TYPE, "application/json")], DOCUMENT.clone())
}

/// The document as indented JSON, with a line feed at its end.
#[must_use]
pub fn document_text() -> String {
    let text = document().to_pretty_json();
    text.map_or_else(|_| String::from("{}\n"), |text| text + "\n")
}

/// The document.
fn document() -> OpenApi {
    let license = LicenseBuilder::new().name(env!("CARGO_PKG_LICENSE")).build();
    let info = InfoBuilder::new()
        .title("pixmesh")
        .version(env!("CARGO_PKG_VERSION"))
        .description(Some(ABOUT))
        .license(Some(license))
        .build();
    let paths = PathsBuilder::new()
        .path("/", studio())
        .path("/v1/meshes", PathItem::new(HttpMethod::Post, create_mesh()))
        .path("/v1/methods", list_methods())
        .path("/problems/{slug}", problem_type())
        .path("/openapi.json", get("openapi", "This document", object().build()))
        .path("/docs", docs());
    let paths = jobs::paths(paths).build();
    let key = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some("A key that the operator has given out. Where none are, none is needed."))
        .build();
    let components = ComponentsBuilder::new()
        .schema("Problem", problem())
        .schemas_from_iter(schemas())
        .security_scheme(KEY, SecurityScheme::Http(key))
        .build();
    OpenApiBuilder::new().info(info).paths(paths).components(Some(components)).build()
}

/// The schemas of the answers, and of what they consist of.
fn schemas() -> Vec<(String, RefOr<Schema>)> {
    fn add<T: ToSchema>(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((T::name().into_owned(), T::schema()));
        T::schemas(schemas);
    }
    let mut schemas = Vec::new();
    add::<Index>(&mut schemas);
    add::<Methods>(&mut schemas);
    add::<Job>(&mut schemas);
    add::<Jobs>(&mut schemas);
    add::<JobEvent>(&mut schemas);
    add::<comparisons::Figures>(&mut schemas);
    schemas
}

/// A resource that answers GET with JSON.
fn get(id: &str, summary: &str, answer: impl Into<RefOr<Schema>>) -> PathItem {
    let answer = ContentBuilder::new().schema(Some(answer)).build();
    let response =
        ResponseBuilder::new().description(summary).content("application/json", answer).build();
    let operation = OperationBuilder::new()
        .operation_id(Some(id))
        .summary(Some(summary))
        .response("200", response)
        .build();
    PathItem::new(HttpMethod::Get, operation)
}

fn list_methods() -> PathItem {
    let summary = "Every method, policy, parameter and format";
    let mut item = get("methods", summary, Ref::from_schema_name("Methods"));
    if let Some(operation) = &mut item.get {
        for status in [401, 429] {
            operation.responses.responses.insert(status.to_string(), RefOr::T(refusal(status)));
        }
        operation.security = Some(with_or_without_key().into());
    }
    item
}

fn studio() -> PathItem {
    let summary = "The studio, a page to try the service in; what there is, for who asks for JSON";
    let mut item = get("index", summary, Ref::from_schema_name("Index"));
    let response = item.get.as_mut().and_then(|get| get.responses.responses.get_mut("200"));
    if let Some(RefOr::T(response)) = response {
        response.content.insert("text/html".to_owned(), RefOr::T(content(text())));
    }
    item
}

fn docs() -> PathItem {
    let summary = "A page for this document";
    let response =
        ResponseBuilder::new().description(summary).content("text/html", content(text())).build();
    let operation = OperationBuilder::new()
        .operation_id(Some("docs"))
        .summary(Some(summary))
        .response("200", response);
    PathItem::new(HttpMethod::Get, operation.build())
}

fn problem_type() -> PathItem {
    let mut item = get("problem", "What the type of a problem refers to", object().build());
    if let Some(operation) = &mut item.get {
        let slugs = Kind::ALL.iter().map(|kind| kind.slug());
        let slug = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(slugs));
        let parameter = ParameterBuilder::new()
            .name("slug")
            .parameter_in(ParameterIn::Path)
            .required(Required::True)
            .schema(Some(slug));
        operation.parameters = Some(vec![RefOr::T(parameter.build())]);
        operation.responses.responses.insert("404".into(), RefOr::T(refusal(404)));
    }
    item
}

/// `POST /v1/meshes`.
fn create_mesh() -> Operation {
    let mut operation = OperationBuilder::new()
        .operation_id(Some("createMesh"))
        .summary(Some("An image in, its mesh out"))
        .description(Some(
            "The body is the image itself, with the parameters in the query, or a form with one \
             part `image` and the parameters as fields or as one JSON part `params`, and with a \
             second picture `weights` if some pixels matter more. A parameter may be given once in \
             all. What the image is, its content decides. With the header \
             Prefer the answer may be a job.",
        ))
        .request_body(Some(image_or_form()))
        .response("200", mesh())
        .response("202", jobs::accepted());
    for row in &TABLE {
        operation = operation.parameter(query_parameter(row));
    }
    operation = jobs::with_parameters(operation, [jobs::prefer(), jobs::idempotency_key()]);
    for status in [400, 401, 406, 408, 413, 414, 415, 422, 429, 431, 500, 503, 507] {
        operation = operation.response(status.to_string(), refusal(status));
    }
    operation.securities(Some(with_or_without_key())).build()
}

fn image_or_form() -> RequestBody {
    RequestBodyBuilder::new()
        .description(Some("A PNG, JPEG, WebP, GIF, TIFF, BMP or PNM image, or a form with one."))
        .required(Some(Required::True))
        .content("image/*", example(bytes(), examples::PICTURE))
        .content("application/octet-stream", content(bytes()))
        .content("multipart/form-data", content(form()))
        .build()
}

/// The schema of every problem document (RFC 9457).
fn problem() -> Schema {
    let number_or_text = || ObjectBuilder::new().schema_type(Type::String);
    let types = Kind::ALL.iter().map(|kind| kind.reference());
    let kind = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(types));
    let strings = ArrayBuilder::new().items(text());
    let status = ObjectBuilder::new().schema_type(Type::Integer);
    let described = |about: &str| any().description(Some(about)).build();
    ObjectBuilder::new()
        .property("type", kind)
        .property("title", text())
        .property("status", status)
        .property("detail", text())
        .property("param", number_or_text().description(Some("The parameter or part at fault")))
        .property("limit", described("What is allowed"))
        .property("actual", described("What was found"))
        .property("minimum", described("The least value allowed"))
        .property("maximum", described("The largest value allowed"))
        .property("allowed", strings)
        .property("nearest", number_or_text().description(Some("The most similar known name")))
        .property(
            "setting",
            number_or_text().description(Some("The operator's flag for the limit")),
        )
        .property("retry_after_s", ObjectBuilder::new().schema_type(Type::Integer))
        .property("request_id", text())
        .required("type")
        .required("title")
        .required("status")
        .required("detail")
        .build()
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_is_of_openapi_3_1_and_names_every_parameter() {
        let document: Value = serde_json::from_str(&document_text()).unwrap();
        assert!(document["openapi"].as_str().unwrap().starts_with("3.1"));
        let parameters = &document["paths"]["/v1/meshes"]["post"]["parameters"];
        let in_query = parameters.as_array().unwrap().iter().filter(|p| p["in"] == "query");
        let names: Vec<_> = in_query.map(|p| p["name"].clone()).collect();
        assert_eq!(names, TABLE.iter().map(|row| json!(row.name)).collect::<Vec<_>>());
    }
}
