//! `GET /v1/jobs/{id}/mesh`: what became of the image, in any format.
//!
//! The mesh is kept as MODEL and sent as it lies there; what is asked for in another format is made
//! anew each time, through the gate that all work passes. The same version makes the same bytes, and
//! so the entity tag of another format is the digest of the MODEL with the format's name and the
//! version.

use crate::admission::Cost;
use crate::extract::accept::{self, Format, Representation};
use crate::extract::fields::Few;
use crate::extract::owner::Owner;
use crate::extract::params::{Output, ParameterSet};
use crate::jobs::record::{MeshFigures, Record, State as JobState};
use crate::pipeline;
use crate::pool;
use crate::problem::{Kind, Problem, internal};
use crate::routes::Service;
use crate::routes::answer::{self, Figures};
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use pixmesh_meshing::Shape;
use std::sync::Arc;
use std::time::Instant;

/// The parameters.
pub(in crate::routes) const PARAMETERS: &[&str] = &["format"];

/// Answers with the mesh, or a part of it.
///
/// # Errors
/// `not-found`, `gone`, `job-unfinished`, `job-without-mesh`, `range-not-satisfiable`, and every
/// refusal of admission.
pub async fn show(
    State(service): State<Arc<Service>>,
    owner: Owner,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let parameters = Few::of_query(PARAMETERS, request.uri().query())?;
    let record = super::find(&service, &owner, path).await?;
    let format = parameters.get("format").map(str::parse).transpose()?;
    let cut = service.cut.clone();
    tokio::select! {
        answer = of(&service, &record, format, request.headers()) => answer,
        () = cut.cancelled() => Err(Problem::new(Kind::ShuttingDown, "the service is stopping")),
    }
}

/// The answer with a job's mesh.
pub(super) async fn of(
    service: &Service,
    record: &Record,
    format: Option<Format>,
    request: &HeaderMap,
) -> Result<Response, Problem> {
    let mesh = mesh_of(record)?;
    let order = ParameterSet::of_query(Some(&record.order))?.finish()?;
    let representation = accept::choose_rather(order.format, format, request)?;
    let tag = tag(mesh, representation);
    let mut headers = answer::headers_of(representation, &tag)?;
    if answer::is_known(request, &tag) {
        return Ok(answer::not_modified(headers));
    }
    headers.extend(answer::figures_of(&figures(record, mesh))?);
    match representation.format {
        Format::Model => stored(service, mesh, headers, request, &tag).await,
        format => {
            let bytes = converted(service, record, mesh, format, order.output).await?;
            let length = bytes.len() as u64;
            let part = answer::part(request, &tag, length)?;
            let sent = match &part {
                Some(range) => bytes.slice(range.start as usize..range.end as usize),
                None => bytes,
            };
            Ok(answer::respond(headers, part.as_ref(), length, Body::from(sent)))
        }
    }
}

/// The mesh of a job that has one.
fn mesh_of(record: &Record) -> Result<&MeshFigures, Problem> {
    let without = |detail: &str| Problem::new(Kind::JobWithoutMesh, detail);
    match record.state {
        JobState::Queued | JobState::Running => {
            let detail = format!("the job is {}", record.state.name());
            Err(Problem::new(Kind::JobUnfinished, detail).retry_after_s(super::LOOK_AGAIN_S))
        }
        JobState::Completed => record.mesh.as_ref().ok_or_else(|| without("the mesh is not there")),
        JobState::Failed => Err(without("the job failed: its 'error' says why")),
        JobState::Cancelled => Err(without("the job was cancelled")),
    }
}

fn tag(mesh: &MeshFigures, representation: Representation) -> String {
    match representation.format {
        Format::Model => answer::tag(&mesh.digest),
        format => {
            let version = env!("CARGO_PKG_VERSION");
            answer::tag(format_args!("{}.{}.{version}", mesh.digest, format.name()))
        }
    }
}

fn figures(record: &Record, mesh: &MeshFigures) -> Figures {
    let timing = |(stage, took): &(String, f64)| format!("{stage};dur={took:.3}");
    Figures {
        vertices: mesh.vertices,
        faces: mesh.faces,
        psnr_db: mesh.psnr_db.unwrap_or(f64::INFINITY),
        mse: mesh.mse,
        parameters: record.order.clone(),
        timing: mesh.timings_ms.iter().map(timing).collect::<Vec<_>>().join(", "),
    }
}

/// The MODEL as it lies there, read as fast as the client takes it.
async fn stored(
    service: &Service,
    mesh: &MeshFigures,
    headers: HeaderMap,
    request: &HeaderMap,
    tag: &str,
) -> Result<Response, Problem> {
    let part = answer::part(request, tag, mesh.bytes)?;
    let range = part.clone().unwrap_or(0..mesh.bytes);
    let digest = mesh.digest.parse().map_err(|e| internal("a mesh's digest is damaged", &e))?;
    let pieces = service.jobs.blobs.read(digest, range).await?;
    Ok(answer::respond(headers, part.as_ref(), mesh.bytes, Body::from_stream(pieces)))
}

/// The mesh in another format.
async fn converted(
    service: &Service,
    record: &Record,
    mesh: &MeshFigures,
    format: Format,
    output: Output,
) -> Result<Bytes, Problem> {
    let picture = record.picture.shape;
    let shape = Shape {
        width: picture.width,
        height: picture.height,
        component_count: picture.components,
        precision: picture.precision,
    };
    let cost = Cost::of_conversion(shape, mesh.vertices, mesh.bytes, format);
    let deadline = Instant::now() + service.deadline;
    let ticket = service.admission.admit(&record.owner, cost, deadline).await?;
    let digest = mesh.digest.parse().map_err(|e| internal("a mesh's digest is damaged", &e))?;
    let model = service.jobs.blobs.get(digest).await?;
    let limits = service.pictures;
    let (bytes, memory) = pool::run(ticket, deadline, move |watch, ticket| {
        let bytes = pipeline::convert(model, format, &output, &limits, watch)?;
        let _ = watch.finish();
        let memory = ticket.keep(bytes.len());
        Ok((bytes, memory))
    })
    .await?;
    Ok(answer::held(bytes, memory))
}
