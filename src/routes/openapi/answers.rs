//! The answers that several operations share: meshes, accepted jobs, and problems.

use super::bodies::{binary, text};
use super::examples;
use crate::extract::accept::{Representation, offered, pictures};
use crate::problem::Kind;
use std::collections::BTreeMap;
use utoipa::IntoResponses;
use utoipa::openapi::content::{Content, ContentBuilder};
use utoipa::openapi::example::ExampleBuilder;
use utoipa::openapi::header::{Header, HeaderBuilder};
use utoipa::openapi::schema::{ObjectBuilder, Ref, Type};
use utoipa::openapi::{RefOr, Response, ResponseBuilder};

type Responses = BTreeMap<String, RefOr<Response>>;

/// 200 with a mesh.
pub(in crate::routes) struct Mesh;

/// 206 with a part of a mesh.
pub(in crate::routes) struct MeshPart;

/// 200 with a picture.
pub(in crate::routes) struct Picture;

/// 202 with a job.
pub(in crate::routes) struct Accepted;

/// The problems that any request below `/v1/` may have.
pub(in crate::routes) struct Problems;

/// The problems of a request with an upload, without [`Problems`].
pub(in crate::routes) struct UploadProblems;

/// The problems of one status.
pub(in crate::routes) struct ProblemsOf<const STATUS: u16>;

impl IntoResponses for Mesh {
    fn responses() -> Responses {
        one("200", mesh("The mesh, or the picture rebuilt from it, in the format asked for"))
    }
}

impl IntoResponses for MeshPart {
    fn responses() -> Responses {
        one("206", mesh("A part of the mesh"))
    }
}

impl IntoResponses for Picture {
    fn responses() -> Responses {
        one("200", with_files(ResponseBuilder::new().description("The picture"), pictures()))
    }
}

impl IntoResponses for Accepted {
    fn responses() -> Responses {
        let job = ContentBuilder::new().schema(Some(Ref::from_schema_name("Job"))).build();
        let response = ResponseBuilder::new()
            .description("A job, on stable storage")
            .header("Location", header(Type::String, "The path of the job"))
            .header("Retry-After", header(Type::Integer, "Seconds until the next poll"))
            .content("application/json", job);
        one("202", response)
    }
}

impl IntoResponses for Problems {
    fn responses() -> Responses {
        [400, 401, 403, 414, 421, 429, 431, 500, 503].into_iter().map(problems).collect()
    }
}

impl IntoResponses for UploadProblems {
    fn responses() -> Responses {
        [408, 413, 415, 422].into_iter().map(problems).collect()
    }
}

impl<const STATUS: u16> IntoResponses for ProblemsOf<STATUS> {
    fn responses() -> Responses {
        [problems(STATUS)].into()
    }
}

fn one(status: &str, response: ResponseBuilder) -> Responses {
    [(status.to_owned(), RefOr::T(response.build()))].into()
}

fn mesh(about: &str) -> ResponseBuilder {
    let response = ResponseBuilder::new()
        .description(about)
        .header("Mesh-Vertices", header(Type::Integer, "Vertices of the mesh"))
        .header("Mesh-Faces", header(Type::Integer, "Faces of the mesh"))
        .header("Mesh-Psnr", header(Type::String, "PSNR in decibels, or inf for a perfect copy"))
        .header("Mesh-Mse", header(Type::Number, "Mean squared error"))
        .header("Mesh-Parameters", header(Type::String, "The parameters used, as a query"))
        .header("Server-Timing", header(Type::String, "Milliseconds of each stage"))
        .header("ETag", header(Type::String, "SHA-256 of the body: same request, same tag"));
    with_files(response, offered())
}

/// A response whose body may be of several media types.
fn with_files(
    response: ResponseBuilder,
    offers: impl Iterator<Item = Representation>,
) -> ResponseBuilder {
    offers.fold(response, |response, Representation { media_type, .. }| {
        let content = ContentBuilder::new();
        let content = match media_type {
            "text/plain" => content.schema(Some(text())).example(Some(examples::model().into())),
            other if other.starts_with("text/") => content.schema(Some(text())),
            _ => content.schema(Some(binary())),
        };
        response.content(media_type, content.build())
    })
}

/// The status and the response for its problems, with an example of each.
fn problems(status: u16) -> (String, RefOr<Response>) {
    // The listener for operations is not described.
    let public = Kind::ALL.iter().filter(|kind| **kind != Kind::OperatorOnly);
    let kinds = public.filter(|kind| kind.status().as_u16() == status);
    let slugs: Vec<_> = kinds.clone().map(|kind| kind.slug()).collect();
    let examples = kinds.map(|&kind| {
        let example = ExampleBuilder::new().summary(kind.title());
        (kind.slug(), example.value(Some(examples::problem(kind))).build())
    });
    let problem: Content = ContentBuilder::new()
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
    (status.to_string(), RefOr::T(response.build()))
}

fn header(kind: Type, about: &str) -> Header {
    let schema = ObjectBuilder::new().schema_type(kind).build();
    HeaderBuilder::new().schema(Some(schema)).description(Some(about)).build()
}
