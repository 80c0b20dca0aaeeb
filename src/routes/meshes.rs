//! `POST /v1/meshes`: an image in, its mesh out; or a job, where the client prefers one.

use super::answer::{self, Figures, MeshError};
use super::jobs;
use super::jobs::source;
use super::openapi::answers::{Accepted, Mesh, Problems, ProblemsOf, UploadProblems};
use super::openapi::bodies::{Binary, MeshForm};
use super::openapi::examples::PICTURE;
use super::openapi::parameters::{IdempotencyKey, ImageOf, MeshParameters, Prefer};
use crate::extract::accept::{self, Representation};
use crate::extract::prefer::Preference;
use crate::extract::upload::{IMAGE, Upload};
use crate::problem::Problem;
use crate::service::Service;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_LENGTH;
use axum::response::{IntoResponse, Response};
use pixmesh_engine::Owner;
use pixmesh_engine::Weighed;
use pixmesh_engine::params::MeshOptions;
use pixmesh_engine::pipeline::{self, Answer};
use pixmesh_engine::{MeshTask, scheduler::Memory};
use std::sync::Arc;
use std::time::Instant;

/// Bytes of a body that is received even when its request will be refused, so that the connection
/// stays open.
const LONG_BODY: u64 = 256 << 10;

/// Answers with the mesh, or says at once what is wrong.
///
/// # Errors
/// Every refusal of upload, parameters, admission and work.
#[utoipa::path(
    post, path = "/v1/meshes", operation_id = "createMesh",
    summary = "An image in, its mesh out",
    description = "The body is the image itself, with the parameters in the query, or a form with one \
                   part `image` and the parameters as fields or as one JSON part `params`, and with a \
                   second picture `weights` if some pixels matter more. A parameter may be given once \
                   in all. The service recognises the image's format by its content. With the header \
                   Prefer the answer may be a job.",
    params(MeshParameters, ImageOf, Prefer, IdempotencyKey),
    request_body(
        description = "A PNG, JPEG, WebP, GIF, TIFF, BMP or PNM image, or a form with one.",
        content(
            (inline(Binary) = "image/*", example = json!(PICTURE)),
            (inline(Binary) = "application/octet-stream"),
            (inline(MeshForm) = "multipart/form-data"),
        ),
    ),
    responses(
        Mesh, Accepted, Problems, UploadProblems, ProblemsOf::<404>, ProblemsOf::<406>,
        ProblemsOf::<409>, ProblemsOf::<410>, ProblemsOf::<507>,
    ),
    security((), ("key" = [])),
)]
pub async fn create(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Response, Problem> {
    make(&service, owner, request).await
}

async fn make(service: &Service, owner: Owner, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let preference = Preference::of(&head.headers);
    if is_long(&head.headers) && !preference.is_for_job() {
        service.scheduler.refuse_crowd(&owner)?;
    }
    let (upload, order) = source::receive(service, &owner, &IMAGE, &head, body).await?;
    let representation = accept::choose_rather(order.usual_format, order.format, &head.headers)?;
    if preference.is_for_job() {
        return jobs::prefer(service, owner, &head.headers, upload, &order, preference).await;
    }
    let ran = order.query();
    let (answer, memory) = run(service, &owner, upload, order, representation).await?;
    respond(answer, memory, representation, ran)
}

/// Whether a body is so long, or may be, that it is worth the connection to refuse it unread.
fn is_long(headers: &HeaderMap) -> bool {
    let length = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse().ok());
    length.is_none_or(|length: u64| length > LONG_BODY)
}

/// Checks the order against the image's header, waits for a ticket, and does the work; the answer
/// comes with the memory that it holds.
async fn run(
    service: &Service,
    owner: &Owner,
    upload: Weighed<Upload>,
    order: MeshOptions,
    representation: Representation,
) -> Result<(Answer, Memory), Problem> {
    let limits = service.pictures;
    let format = representation.format;
    let cost = MeshTask::for_response(upload.as_bytes(), &order, format, &limits)?.cost;
    let deadline = Instant::now() + service.deadline;
    let ticket = service.scheduler.admit(owner, cost, deadline).await?;
    let done = service
        .workers
        .run(ticket, deadline, move |watch, ticket| {
            let answer = pipeline::mesh(upload, &order, format, &limits, watch)?;
            let memory = ticket.keep(answer.bytes.len());
            Ok((answer, memory))
        })
        .await?;
    Ok(done)
}

/// The answer with its headers.
fn respond(
    answer: Answer,
    memory: Memory,
    representation: Representation,
    ran: String,
) -> Result<Response, Problem> {
    let mut headers: HeaderMap = answer::headers_of(representation, &answer::tag(answer.digest))?;
    headers.extend(answer::figures_of(&Figures {
        vertices: answer.vertices,
        faces: answer.faces,
        error: Some(MeshError { psnr_db: answer.psnr_db, mse: answer.mse }),
        parameters: ran,
        timing: answer.server_timing(),
    })?);
    headers.insert(CONTENT_LENGTH, answer.bytes.len().into());
    let bytes = answer::held(answer.bytes, memory);
    Ok((headers, Body::from(bytes)).into_response())
}
