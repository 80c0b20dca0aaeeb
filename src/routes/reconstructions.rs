//! `POST /v1/reconstructions`: a MODEL in, the picture rebuilt from it out.

use super::answer;
use super::openapi::answers::{Picture, Problems, ProblemsOf, UploadProblems};
use super::openapi::bodies::{Binary, ModelForm, Text};
use super::openapi::parameters::PictureParameters;
use crate::extract::accept::{self, Representation};
use crate::extract::fields::Few;
use crate::extract::upload::{MODEL, Upload};
use crate::problem::{Kind, Problem};
use crate::service::Service;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::CONTENT_LENGTH;
use axum::response::{IntoResponse, Response};
use pixmesh_codec::Format;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::params::Output;
use pixmesh_engine::pipeline;
use pixmesh_engine::{scheduler::Memory, task::Cost};
use std::sync::Arc;
use std::time::Instant;

/// The parameters.
pub(super) const PARAMETERS: &[&str] = &["format"];

/// Answers with the picture.
///
/// # Errors
/// Every refusal of upload, parameters, admission and work.
#[utoipa::path(
    post, path = "/v1/reconstructions", operation_id = "createReconstruction",
    summary = "A MODEL in, the picture rebuilt from it out",
    description = "The body is the MODEL text, or a form with one part `model`.",
    params(PictureParameters),
    request_body(
        description = "A mesh as MODEL text, or a form with one.",
        content(
            (inline(Text) = "text/plain"),
            (inline(Text) = "application/vnd.pixmesh.model"),
            (inline(Binary) = "application/octet-stream"),
            (inline(ModelForm) = "multipart/form-data"),
        ),
    ),
    responses(Picture, Problems, UploadProblems, ProblemsOf::<406>),
    security((), ("key" = [])),
)]
pub async fn create(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Response, Problem> {
    rebuild(&service, &owner, request).await
}

async fn rebuild(service: &Service, owner: &Owner, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let mut parameters = Few::of_query(PARAMETERS, head.uri.query())?;
    let receiving = service.intake.receive(owner, &MODEL, &head.headers, body, &mut parameters);
    let [upload] = receiving.await?;
    let format = parameters.get("format").map(picture_format).transpose()?;
    let representation = accept::choose_among(accept::pictures(), format, &head.headers)?;
    let (bytes, digest, memory) = run(service, owner, upload, representation).await?;
    let mut headers = answer::headers_of(representation, &answer::tag(digest))?;
    headers.insert(CONTENT_LENGTH, bytes.len().into());
    Ok((headers, Body::from(answer::held(bytes, memory))).into_response())
}

/// The format of this name, when it is that of a picture.
fn picture_format(name: &str) -> Result<Format, Problem> {
    let names = accept::pictures().map(|picture| picture.format.name()).collect::<Vec<_>>();
    let found = Format::ALL.iter().find(|format| format.is_picture() && format.name() == name);
    found.copied().ok_or_else(|| {
        let detail = format!("format must be one of {}", names.join(", "));
        Problem::new(Kind::UnknownValue, detail).param("format").allowed(&names)
    })
}

/// Checks the MODEL's header, waits for a ticket, and does the work.
async fn run(
    service: &Service,
    owner: &Owner,
    upload: Upload,
    representation: Representation,
) -> Result<(Vec<u8>, Digest, Memory), Problem> {
    let (limits, format) = (service.pictures, representation.format);
    if upload.bytes.is_empty() {
        return Err(Problem::new(Kind::EmptyFile, "the file is empty"));
    }
    let shape = pixmesh_codec::probe_model(&upload.bytes, &limits)?;
    let cost = Cost::of_conversion(shape, 0, upload.bytes.len() as u64, format, false);
    let deadline = Instant::now() + service.deadline;
    let ticket = service.scheduler.admit(owner, cost, deadline).await?;
    let done = service
        .workers
        .run(ticket, deadline, move |watch, ticket| {
            let bytes =
                pipeline::convert(upload, None, format, &Output::default(), &limits, watch)?;
            let digest = Digest::of_while(&bytes, || watch.check())?;
            let _ = watch.finish();
            let memory = ticket.keep(bytes.len());
            Ok((bytes, digest, memory))
        })
        .await?;
    Ok(done)
}
