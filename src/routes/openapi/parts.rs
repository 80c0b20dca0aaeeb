//! The parts that several operations share: parameters, bodies, answers and refusals.

use super::examples;
use crate::extract::accept::offered;
use crate::problem::Kind;
use pixmesh_engine::params::{Parameter as Row, TABLE, Takes};
use serde_json::Value;
use utoipa::openapi::content::{Content, ContentBuilder};
use utoipa::openapi::example::ExampleBuilder;
use utoipa::openapi::header::{Header, HeaderBuilder};
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{
    KnownFormat, Object, ObjectBuilder, Ref, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::security::SecurityRequirement;
use utoipa::openapi::{Required, Response, ResponseBuilder};

/// The name of the scheme by which a request shows its key.
pub(super) const KEY: &str = "key";

pub(super) fn query_parameter(row: &Row) -> Parameter {
    ParameterBuilder::new()
        .name(row.name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(Some(row.about))
        .schema(Some(values(row)))
        .example(examples::value(row))
        .build()
}

/// The schema of a parameter's values.
pub(super) fn values(row: &Row) -> Object {
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
        Takes::Pattern(pattern) => object.schema_type(Type::String).pattern(Some(pattern)),
    }
    .build()
}

/// The fields of a form.
pub(super) fn form() -> Object {
    let weights = ObjectBuilder::from(bytes()).description(Some(
        "A picture of the image's size: how much each pixel matters, black not at all",
    ));
    let fields = ObjectBuilder::new().property("image", bytes()).required("image");
    let fields = fields.property("weights", weights);
    let params = TABLE.iter().fold(object(), |object, row| object.property(row.name, values(row)));
    let fields = fields.property("params", params);
    TABLE.iter().fold(fields, |fields, row| fields.property(row.name, values(row))).build()
}

/// The answer with a mesh.
pub(super) fn mesh() -> Response {
    let mut response = ResponseBuilder::new()
        .description("The mesh, or the picture rebuilt from it, in the format asked for")
        .header("Mesh-Vertices", header(Type::Integer, "Vertices of the mesh"))
        .header("Mesh-Faces", header(Type::Integer, "Faces of the mesh"))
        .header("Mesh-Psnr", header(Type::String, "PSNR in decibels, or inf for a perfect copy"))
        .header("Mesh-Mse", header(Type::Number, "Mean squared error"))
        .header("Mesh-Parameters", header(Type::String, "What was run, as a query"))
        .header("Server-Timing", header(Type::String, "Milliseconds of each stage"))
        .header("ETag", header(Type::String, "SHA-256 of the body: same request, same tag"));
    for offer in offered() {
        let content = match offer.media_type {
            "text/plain" => example(text(), examples::model()),
            other if other.starts_with("text/") => content(text()),
            _ => content(bytes()),
        };
        response = response.content(offer.media_type, content);
    }
    response.build()
}

/// A refusal with this status, and the types of problem that it may be.
pub(super) fn refusal(status: u16) -> Response {
    let kinds = Kind::ALL.iter().filter(|kind| kind.status().as_u16() == status);
    let slugs: Vec<_> = kinds.clone().map(|kind| kind.slug()).collect();
    let examples = kinds.map(|&kind| {
        let example = ExampleBuilder::new().summary(kind.title());
        (kind.slug(), example.value(Some(examples::problem(kind))).build())
    });
    let problem = ContentBuilder::new()
        .schema(Some(Ref::from_schema_name("Problem")))
        .examples_from_iter(examples)
        .build();
    let mut response = ResponseBuilder::new()
        .description(format!("Refused: {}", slugs.join(", ")))
        .content("application/problem+json", problem);
    if [429, 503].contains(&status) {
        response = response.header("Retry-After", header(Type::Integer, "Seconds to wait"));
    }
    if status == 401 {
        response = response.header("WWW-Authenticate", header(Type::String, "Bearer"));
    }
    if status == 429 {
        response = response
            .header("RateLimit-Policy", header(Type::String, "Requests (q) per window (w, s)"))
            .header("RateLimit", header(Type::String, "Requests left (r), until more (t, s)"));
    }
    response.build()
}

pub(super) fn header(kind: Type, about: &str) -> Header {
    let schema = ObjectBuilder::new().schema_type(kind).build();
    HeaderBuilder::new().schema(Some(schema)).description(Some(about)).build()
}

pub(super) fn content(schema: Object) -> Content {
    ContentBuilder::new().schema(Some(schema)).build()
}

pub(super) fn example(schema: Object, example: impl Into<Value>) -> Content {
    ContentBuilder::new().schema(Some(schema)).example(Some(example.into())).build()
}

pub(super) fn object() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(Type::Object)
}

pub(super) fn any() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(SchemaType::AnyValue)
}

pub(super) fn text() -> Object {
    ObjectBuilder::new().schema_type(Type::String).build()
}

pub(super) fn bytes() -> Object {
    let format = SchemaFormat::KnownFormat(KnownFormat::Binary);
    ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()
}

/// A request below /v1/ needs a key where there are any.
pub(super) fn with_or_without_key() -> [SecurityRequirement; 2] {
    [SecurityRequirement::default(), SecurityRequirement::new(KEY, [""; 0])]
}
