//! `GET /v1/jobs/{id}/mesh`: what became of the image, in any format and any size.
//!
//! The mesh is kept as MODEL and sent as it lies there; what is asked for in another format is made
//! anew each time, through the gate that all work passes. So are the meshes of fewer vertices, from
//! the order of vertices that is kept behind the MODEL; they cost a triangulation. The same version
//! makes the same bytes, and so the entity tag of another format is the digest of the MODEL with the
//! format's name and the version, and that of another size the digest of both with the size too.

use super::found;
use crate::extract::accept;
use crate::extract::fields::Few;
use crate::problem::{Kind, Problem};
use crate::routes::answer::{self, Figures};
use crate::routes::openapi::answers::{Mesh, MeshPart, Problems, ProblemsOf};
use crate::routes::openapi::parameters::{JobPath, KeptMeshParameters};
use crate::service::Service;
use axum::Extension;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use pixmesh_codec::Format;
use pixmesh_engine::MeshOptions;
use pixmesh_engine::Owner;
use pixmesh_engine::params::{Output, whole_between};
use pixmesh_engine::pipeline;
use pixmesh_engine::task::{Cost, Kept};
use pixmesh_jobs::blobs::chunks::ChunkedBlob;
use pixmesh_jobs::record::{MeshFigures, PictureShape, Record, State as JobState};
use pixmesh_meshing::parameters::MIN_SIZE;
use pixmesh_meshing::{Fidelity, Shape};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// The parameters.
pub(in crate::routes) const PARAMETERS: &[&str] = &["format", "size"];

/// What a request may ask for of a job's mesh.
#[derive(Clone, Debug, Default)]
pub(super) struct Wish {
    /// The format, by its name.
    pub(super) format: Option<Format>,
    /// The number of vertices, as it is written.
    pub(super) size: Option<String>,
}

/// Answers with the mesh, or a part of it.
///
/// # Errors
/// `not-found`, `gone`, `job-unfinished`, `job-without-mesh`, `job-without-order`,
/// `parameter-out-of-range`, `range-not-satisfiable`, and every refusal of admission.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/mesh", operation_id = "getJobMesh",
    summary = "The mesh of a completed job, in any format and size",
    description = "The service stores the mesh once, and writes it in the format of the query, of \
                   Accept, or of the job's parameters, in this order. With a size: the mesh of that \
                   many vertices that removal passes through on its way down from the job's mesh. \
                   That needs a method that ends with removal, or a job with format=progression. The \
                   format progression has all of these meshes at once, with their squared errors.",
    params(JobPath, KeptMeshParameters),
    responses(
        Mesh, MeshPart,
        (status = 304, description = "The client has it already"),
        Problems, ProblemsOf::<404>, ProblemsOf::<406>, ProblemsOf::<409>, ProblemsOf::<410>,
        ProblemsOf::<416>, ProblemsOf::<422>,
    ),
    security((), ("key" = [])),
)]
pub async fn show(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let parameters = Few::of_query(PARAMETERS, request.uri().query())?;
    let record = found::find(&service, &owner, path).await?;
    let format = parameters.get("format").map(str::parse).transpose()?;
    let wish = Wish { format, size: parameters.get("size").map(str::to_owned) };
    of(&service, &record, wish, request.headers()).await
}

/// The answer with a job's mesh.
pub(super) async fn of(
    service: &Service,
    record: &Record,
    wish: Wish,
    request: &HeaderMap,
) -> Result<Response, Problem> {
    let mesh = mesh_of(record)?;
    let size = smaller_size(mesh, wish.size.as_deref())?;
    let options = MeshOptions::of_stored(&record.options)?;
    let representation = accept::choose_rather(options.format, wish.format, request)?;
    let format = representation.format;
    if (size.is_some() || format == Format::Progression) && mesh.progression.is_none() {
        return Err(without_order());
    }
    let tag = tag(mesh, size, format);
    let mut headers = answer::headers_of(representation, &tag)?;
    if answer::is_known(request, &tag) {
        return Ok(answer::not_modified(headers));
    }
    let ran = options.query();
    let is_flat = options.parameters.is_flat();
    let job = Finished { service, record, mesh, output: options.output, is_flat };
    let (bytes, figures) = match (size, format) {
        (None, Format::Model | Format::Progression) => {
            headers.extend(answer::figures_of(&figures(mesh, ran))?);
            return job.stored(format, headers, request, &tag).await;
        }
        (None, format) => (job.converted(format).await?, figures(mesh, ran)),
        (Some(size), format) => job.resized(size, format, ran).await?,
    };
    headers.extend(answer::figures_of(&figures)?);
    let length = bytes.len() as u64;
    let part = answer::part(request, &tag, length)?;
    let sent = match &part {
        Some(range) => bytes.slice(range.start as usize..range.end as usize),
        None => bytes,
    };
    Ok(answer::respond(headers, part.as_ref(), length, Body::from(sent)))
}

/// The number of vertices asked for, where it is less than the mesh has.
fn smaller_size(mesh: &MeshFigures, text: Option<&str>) -> Result<Option<usize>, Problem> {
    let Some(text) = text else { return Ok(None) };
    let (least, most) = (MIN_SIZE as u64, mesh.vertices as u64);
    let size = whole_between("size", text, least, most)? as usize;
    Ok((size < mesh.vertices).then_some(size))
}

fn without_order() -> Problem {
    let detail = "this job keeps no order of its mesh's vertices, of which smaller meshes are made: \
                  it is kept where removal ends the method, or format=progression is submitted, and \
                  not of connectivity=free, values=fitted or reconstruction=flat";
    Problem::new(Kind::JobWithoutOrder, detail).param("size")
}

/// The mesh of a job that has one.
fn mesh_of(record: &Record) -> Result<&MeshFigures, Problem> {
    let without = |detail: &str| Problem::new(Kind::JobWithoutMesh, detail);
    match record.state {
        JobState::Queued | JobState::Running => {
            let detail = format!("the job is {}", record.state.name());
            Err(Problem::new(Kind::JobUnfinished, detail).retry_after_s(found::LOOK_AGAIN_S))
        }
        JobState::Completed => record.mesh.as_ref().ok_or_else(|| without("the mesh is not there")),
        JobState::Failed => Err(without("the job failed: its 'error' says why")),
        JobState::Cancelled => Err(without("the job was cancelled")),
    }
}

fn tag(mesh: &MeshFigures, size: Option<usize>, format: Format) -> String {
    let (model, version) = (mesh.model_digest(), env!("CARGO_PKG_VERSION"));
    match (size, format) {
        (None, Format::Model) => answer::tag(model),
        // The order is another one where the image is.
        (None, Format::Progression) => {
            answer::tag(format_args!("{}.progression.{version}", mesh.digest))
        }
        (None, format) => answer::tag(format_args!("{model}.{}.{version}", format.name())),
        (Some(size), format) => {
            answer::tag(format_args!("{}.{size}.{}.{version}", mesh.digest, format.name()))
        }
    }
}

fn figures(mesh: &MeshFigures, ran: String) -> Figures {
    let timing = |(stage, took): &(String, f64)| format!("{stage};dur={took:.3}");
    Figures {
        vertices: mesh.vertices,
        faces: mesh.faces,
        psnr_db: mesh.psnr_db.unwrap_or(f64::INFINITY),
        mse: mesh.mse,
        parameters: ran,
        timing: mesh.timings_ms.iter().map(timing).collect::<Vec<_>>().join(", "),
    }
}

/// A job that has its mesh.
struct Finished<'a> {
    service: &'a Service,
    record: &'a Record,
    mesh: &'a MeshFigures,
    /// How the mesh is written.
    output: Output,
    /// Whether the faces have colours.
    is_flat: bool,
}

impl Finished<'_> {
    /// The MODEL, or the order, as it lies there, read as fast as the client takes it.
    async fn stored(
        &self,
        format: Format,
        headers: HeaderMap,
        request: &HeaderMap,
        tag: &str,
    ) -> Result<Response, Problem> {
        let within = match format {
            Format::Progression => self.place_of_order(),
            _ => 0..self.mesh.bytes,
        };
        let length = within.end - within.start;
        let part = answer::part(request, tag, length)?;
        let range = part.clone().unwrap_or(0..length);
        let range = within.start + range.start..within.start + range.end;
        let pieces = self.service.jobs.blobs.read(self.blob()?, range).await?;
        Ok(answer::respond(headers, part.as_ref(), length, Body::from_stream(pieces)))
    }

    /// The mesh in another format.
    async fn converted(&self, format: Format) -> Result<Bytes, Problem> {
        let Self { service, record, mesh, output, .. } = *self;
        let (shape, is_flat) = (self.shape(), self.is_flat);
        let cost = Cost::of_conversion(shape, mesh.vertices, mesh.bytes, format, is_flat);
        let fidelity = Some(Fidelity::of_mse(mesh.mse, shape));
        let deadline = Instant::now() + service.deadline;
        let ticket = service.scheduler.admit(&record.owner, cost, deadline).await?;
        let model = service.jobs.blobs.get_part(self.blob()?, 0..mesh.bytes).await?;
        let limits = service.pictures;
        let (bytes, memory) = service
            .workers
            .run(ticket, deadline, move |watch, ticket| {
                let bytes = pipeline::convert(model, fidelity, format, &output, &limits, watch)?;
                let _ = watch.finish();
                let memory = ticket.keep(bytes.len());
                Ok((bytes, memory))
            })
            .await?;
        Ok(answer::held(bytes, memory))
    }

    /// The mesh of fewer vertices in any format, with what is known of it.
    async fn resized(
        &self,
        size: usize,
        format: Format,
        parameters: String,
    ) -> Result<(Bytes, Figures), Problem> {
        let Self { service, record, mesh, output, .. } = *self;
        let place = self.place_of_order();
        let (shape, vertices) = (self.shape(), mesh.vertices as u64);
        let kept = Kept { shape, vertices, bytes: place.end - place.start };
        let cost = Cost::of_resizing(kept, size, format);
        let deadline = Instant::now() + service.deadline;
        let ticket = service.scheduler.admit(&record.owner, cost, deadline).await?;
        let pmesh = service.jobs.blobs.get_part(self.blob()?, place).await?;
        let limits = service.pictures;
        let (resized, timing, memory) = service
            .workers
            .run(ticket, deadline, move |watch, ticket| {
                let resized = pipeline::resize(pmesh, size, format, &output, &limits, watch)?;
                let timing = pipeline::server_timing(&watch.finish());
                let memory = ticket.keep(resized.bytes.len());
                Ok((resized, timing, memory))
            })
            .await?;
        let figures = Figures {
            vertices: size,
            faces: resized.faces,
            psnr_db: resized.fidelity.psnr_db(),
            mse: resized.fidelity.mse(),
            parameters,
            timing,
        };
        Ok((answer::held(resized.bytes, memory), figures))
    }

    fn blob(&self) -> Result<ChunkedBlob, Problem> {
        self.mesh.blob().ok_or_else(|| {
            Problem::new(Kind::StorageDamaged, "what was stored of this job is damaged")
        })
    }

    /// Where the order lies in the blob.
    fn place_of_order(&self) -> Range<u64> {
        let bytes = self.mesh.progression.as_ref().map_or(0, |kept| kept.bytes);
        self.mesh.bytes..self.mesh.bytes + bytes
    }

    /// The shape of the image.
    fn shape(&self) -> Shape {
        let PictureShape { width, height, components, precision, .. } = self.record.picture.shape;
        Shape { width, height, component_count: components, precision }
    }
}
