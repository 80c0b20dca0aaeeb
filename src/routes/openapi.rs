//! `GET /openapi.json`: the interface as an OpenAPI 3.1 document.
//!
//! Parameters, formats and refusals come from the same tables that the service works by, so that
//! the document cannot say anything else. A copy is checked in as `openapi/openapi.json`.

mod jobs;

use crate::extract::accept::OFFERED;
use crate::extract::params::{Parameter as Row, TABLE, Takes};
use crate::problem::Kind;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
#[cfg(test)]
use serde_json::{Value, json};
use utoipa::openapi::content::{Content, ContentBuilder};
use utoipa::openapi::header::{Header, HeaderBuilder};
use utoipa::openapi::path::{
    HttpMethod, Operation, OperationBuilder, Parameter, ParameterBuilder, ParameterIn, PathItem,
    PathsBuilder,
};
use utoipa::openapi::request_body::{RequestBody, RequestBodyBuilder};
use utoipa::openapi::schema::{
    KnownFormat, Object, ObjectBuilder, Ref, Schema, SchemaFormat, Type,
};
use utoipa::openapi::{
    ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, RefOr, Required,
    Response, ResponseBuilder,
};

/// Answers with the document.
pub async fn show() -> impl IntoResponse {
    ([(CONTENT_TYPE, "application/json")], document_text())
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
        .description(Some("Pictures to triangle meshes."))
        .license(Some(license))
        .build();
    let paths = PathsBuilder::new()
        .path("/", get("index", "What there is", object()))
        .path("/v1/meshes", PathItem::new(HttpMethod::Post, create_mesh()))
        .path("/v1/methods", get("methods", "Every method, policy, parameter and format", object()))
        .path("/problems/{slug}", problem_type())
        .path("/openapi.json", get("openapi", "This document", object()));
    let paths = jobs::paths(paths).build();
    let components = ComponentsBuilder::new().schema("Problem", problem());
    let components = components.schemas_from_iter(jobs::schemas()).build();
    OpenApiBuilder::new().info(info).paths(paths).components(Some(components)).build()
}

/// A resource that answers GET with JSON.
fn get(id: &str, summary: &str, answer: ObjectBuilder) -> PathItem {
    let response = ResponseBuilder::new()
        .description(summary)
        .content("application/json", content(answer.build()))
        .build();
    let operation = OperationBuilder::new()
        .operation_id(Some(id))
        .summary(Some(summary))
        .response("200", response)
        .build();
    PathItem::new(HttpMethod::Get, operation)
}

fn problem_type() -> PathItem {
    let mut item = get("problem", "What the type of a problem refers to", object());
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
             part `image` and the parameters as fields or as one JSON part `params`. A parameter \
             may be given once in all. What the image is, its content decides. With the header \
             Prefer the answer may be a job.",
        ))
        .request_body(Some(image_or_form()))
        .response("200", mesh())
        .response("202", jobs::accepted());
    for row in &TABLE {
        operation = operation.parameter(query_parameter(row));
    }
    operation = jobs::with_parameters(operation, [jobs::prefer(), jobs::idempotency_key()]);
    for status in [400, 406, 408, 413, 414, 415, 422, 429, 500, 503, 507] {
        operation = operation.response(status.to_string(), refusal(status));
    }
    operation.build()
}

fn query_parameter(row: &Row) -> Parameter {
    ParameterBuilder::new()
        .name(row.name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(Some(row.about))
        .schema(Some(values(row)))
        .build()
}

/// The schema of a parameter's values.
fn values(row: &Row) -> Object {
    let object = ObjectBuilder::new();
    match row.takes {
        Takes::Decimal { least, most } => {
            object.schema_type(Type::Number).minimum(Some(least)).maximum(Some(most))
        }
        Takes::Whole { least, most } => object
            .schema_type(Type::Integer)
            .minimum(usize::try_from(least).ok())
            .maximum(usize::try_from(most).ok()),
        Takes::Flag => object.schema_type(Type::Boolean),
        Takes::Word(allowed) => {
            object.schema_type(Type::String).enum_values(Some(allowed.iter().copied()))
        }
    }
    .build()
}

fn image_or_form() -> RequestBody {
    RequestBodyBuilder::new()
        .description(Some("A PNG, JPEG or PNM image, or a form with one."))
        .required(Some(Required::True))
        .content("image/*", content(bytes()))
        .content("application/octet-stream", content(bytes()))
        .content("multipart/form-data", content(form()))
        .build()
}

/// The fields of a form.
fn form() -> Object {
    let fields = ObjectBuilder::new().property("image", bytes()).required("image");
    let params = TABLE.iter().fold(object(), |object, row| object.property(row.name, values(row)));
    let fields = fields.property("params", params);
    TABLE.iter().fold(fields, |fields, row| fields.property(row.name, values(row))).build()
}

/// The answer with a mesh.
fn mesh() -> Response {
    let mut response = ResponseBuilder::new()
        .description("The mesh, or the picture rebuilt from it, in the format asked for")
        .header("Mesh-Vertices", header(Type::Integer, "Vertices of the mesh"))
        .header("Mesh-Faces", header(Type::Integer, "Faces of the mesh"))
        .header("Mesh-Psnr", header(Type::String, "PSNR in decibels, or inf for a perfect copy"))
        .header("Mesh-Mse", header(Type::Number, "Mean squared error"))
        .header("Mesh-Parameters", header(Type::String, "What was run, as a query"))
        .header("Server-Timing", header(Type::String, "Milliseconds of each stage"))
        .header("ETag", header(Type::String, "SHA-256 of the body: same request, same tag"));
    for offer in OFFERED {
        let schema = if offer.media_type.starts_with("text/") { text() } else { bytes() };
        response = response.content(offer.media_type, content(schema));
    }
    response.build()
}

/// A refusal with this status, and the types of problem that it may be.
fn refusal(status: u16) -> Response {
    let kinds = Kind::ALL.iter().filter(|kind| kind.status().as_u16() == status);
    let slugs: Vec<_> = kinds.map(|kind| kind.slug()).collect();
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    ResponseBuilder::new()
        .description(format!("Refused: {}", slugs.join(", ")))
        .content("application/problem+json", problem)
        .build()
}

/// The schema of every problem document (RFC 9457).
fn problem() -> Schema {
    let number_or_text = || ObjectBuilder::new().schema_type(Type::String);
    let types = Kind::ALL.iter().map(|kind| kind.reference());
    let kind = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(types));
    let strings = utoipa::openapi::schema::ArrayBuilder::new().items(text());
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

fn header(kind: Type, about: &str) -> Header {
    let schema = ObjectBuilder::new().schema_type(kind).build();
    HeaderBuilder::new().schema(Some(schema)).description(Some(about)).build()
}

fn content(schema: Object) -> Content {
    ContentBuilder::new().schema(Some(schema)).build()
}

fn object() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(Type::Object)
}

fn any() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(utoipa::openapi::schema::SchemaType::AnyValue)
}

fn text() -> Object {
    ObjectBuilder::new().schema_type(Type::String).build()
}

fn bytes() -> Object {
    let format = SchemaFormat::KnownFormat(KnownFormat::Binary);
    ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()
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
