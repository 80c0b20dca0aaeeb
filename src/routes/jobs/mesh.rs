//! `GET /v1/jobs/{id}/mesh`: what became of the image, in any format and any size.
//!
//! The service stores the mesh as MODEL, and sends the stored bytes for that format. It converts the
//! mesh to every other format on each request, as a task of the scheduler. Meshes of fewer vertices
//! are made from the order of the vertices, which is stored behind the MODEL; each costs a
//! triangulation. The same version makes the same bytes, so the entity tag of another representation
//! is the digest of what is stored with the parameters of the request and the version.

use super::found;
use crate::extract::accept;
use crate::extract::fields::{CONVERSION, Few};
use crate::problem::{Kind, Problem};
use crate::routes::answer::{self, Figures, MeshError};
use crate::routes::conversions;
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
use pixmesh_codec::{Format, MeshHeader};
use pixmesh_engine::MeshOptions;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::params::{Output, WRITING, whole_between};
use pixmesh_engine::pipeline::{Conversion, Shown};
use pixmesh_engine::task::Cost;
use pixmesh_jobs::blobs::chunks::ChunkedBlob;
use pixmesh_jobs::record::{MeshFigures, PictureShape, Record, State as JobState};
use pixmesh_meshing::Shape;
use pixmesh_meshing::parameters::MIN_SIZE;
use std::sync::Arc;
use std::time::Instant;

/// Answers with the mesh, or a part of it.
///
/// # Errors
/// `not-found`, `gone`, `job-unfinished`, `job-without-mesh`, `job-without-order`,
/// `parameter-out-of-range`, `precondition-failed`, `range-not-satisfiable`, and every refusal of
/// admission.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/mesh", operation_id = "getJobMesh",
    summary = "The mesh of a completed job, in any format and size",
    description = "The service stores the mesh once, and writes it in the format of the query, of \
                   Accept, or of the job's parameters, in this order. Parameters of writing \
                   take precedence over those of the job. With a size: the mesh of that \
                   many vertices that removal passes through on its way down from the job's mesh. \
                   That needs a method that ends with removal, or a job with format=progression. The \
                   format progression has all of these meshes at once, with their squared errors.",
    params(JobPath, KeptMeshParameters),
    responses(
        Mesh, MeshPart,
        (status = 304, description = "The client has it already"),
        Problems, ProblemsOf::<404>, ProblemsOf::<406>, ProblemsOf::<409>, ProblemsOf::<410>,
        ProblemsOf::<412>, ProblemsOf::<416>, ProblemsOf::<422>,
    ),
    security((), ("key" = [])),
)]
pub async fn show(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let parameters = Few::of_query(&CONVERSION, request.uri().query())?;
    let record = found::find(&service, &owner, path).await?;
    of(&service, &record, &parameters, request.headers()).await
}

/// The response with a job's mesh, by parameters of [`PARAMETERS`].
pub(super) async fn of(
    service: &Service,
    record: &Record,
    parameters: &Few,
    request: &HeaderMap,
) -> Result<Response, Problem> {
    let mesh = mesh_of(record)?;
    let size = smaller_size(mesh, parameters.get("size"))?;
    let format = parameters.get("format").map(str::parse).transpose()?;
    let stored = MeshOptions::of_stored(&record.options)?;
    let representation = accept::choose_rather(stored.format, format, request)?;
    let format = representation.format;
    let writing = || parameters.pairs().filter(|(name, _)| WRITING.contains(name));
    let mut options = stored.written_by(writing())?;
    options.output.check(shape_of(record))?;
    if options.output.shows_image(format) && mesh.texture.is_none() {
        return Err(without_texture());
    }
    let own = options.parameters.reconstruction;
    let reconstruction = parameters.get("reconstruction").map(str::parse).transpose()?;
    options.output.reconstruction = reconstruction.filter(|&asked| asked != own);
    let is_rebuilt_otherwise = options.output.reconstruction.is_some();
    if (size.is_some() || format == Format::Progression) && mesh.progression.is_none() {
        return Err(without_order());
    }
    let mut variant: String = writing().map(|(name, text)| format!("{name}={text}&")).collect();
    if is_rebuilt_otherwise {
        variant += "reconstruction";
    }
    let tag = tag(mesh, size, format, &variant);
    let mut headers = answer::headers_of(representation, &tag)?;
    answer::refuse_other(request, &tag)?;
    if answer::is_known(request, &tag) {
        return Ok(answer::not_modified(headers));
    }
    let ran = options.query();
    let is_flat = is_rebuilt_otherwise || options.parameters.is_flat();
    let job = Finished { service, record, mesh, output: options.output, is_flat };
    let is_stored =
        format == Format::Progression || format == Format::Model && !is_rebuilt_otherwise;
    if size.is_none() && is_stored {
        headers.extend(answer::figures_of(&figures(mesh, ran))?);
        return job.stored(format, headers, request, &tag).await;
    }
    let (bytes, figures) = job.converted(size, format, figures(mesh, ran)).await?;
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
    let detail = "this job's mesh has one size only, because the order of its vertices is not \
                  stored: submit a job whose method ends with removal, or with format=progression, \
                  and without connectivity=free, values=fitted or reconstruction=flat";
    Problem::new(Kind::JobWithoutOrder, detail).param("size")
}

fn without_texture() -> Problem {
    let detail = "the service does not keep the picture of this job: submit the job with \
                  texture=embed, or send its mesh and the picture to /v1/conversions";
    Problem::new(Kind::JobWithoutTexture, detail).param("texture")
}

/// The mesh of a job that has one.
fn mesh_of(record: &Record) -> Result<&MeshFigures, Problem> {
    let without = |detail: &str| Problem::new(Kind::JobWithoutMesh, detail);
    match record.state {
        JobState::Queued | JobState::Running => {
            let detail =
                format!("the job is {}: poll it until it is completed", record.state.name());
            Err(Problem::new(Kind::JobUnfinished, detail).retry_after_s(found::POLL_AFTER_S))
        }
        JobState::Completed => {
            record.mesh.as_ref().ok_or_else(|| without("the job has no stored mesh"))
        }
        JobState::Failed => Err(without("the job failed: its 'error' says why")),
        JobState::Cancelled => Err(without("the job was cancelled")),
    }
}

/// The entity tag; `variant` names the parameters of writing in the request.
fn tag(mesh: &MeshFigures, size: Option<usize>, format: Format, variant: &str) -> String {
    let (model, version) = (mesh.model_digest(), env!("CARGO_PKG_VERSION"));
    match (size, format) {
        _ if !variant.is_empty() => {
            let (size, name) = (size.unwrap_or(mesh.vertices), format.name());
            let request = Digest::of(format!("{size}.{name}.{variant}.{version}").as_bytes());
            answer::tag(format_args!("{}.{request}", mesh.digest))
        }
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
        error: Some(MeshError { psnr_db: mesh.psnr_db.unwrap_or(f64::INFINITY), mse: mesh.mse }),
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
    /// The stored MODEL or order, read as fast as the client takes it.
    async fn stored(
        &self,
        format: Format,
        headers: HeaderMap,
        request: &HeaderMap,
        tag: &str,
    ) -> Result<Response, Problem> {
        let within = match format {
            Format::Progression => self.mesh.place_of_progression(),
            _ => 0..self.mesh.bytes,
        };
        let length = within.end - within.start;
        let part = answer::part(request, tag, length)?;
        let range = part.clone().unwrap_or(0..length);
        let range = within.start + range.start..within.start + range.end;
        let pieces = self.service.jobs.blobs.read(self.blob()?, range).await?;
        Ok(answer::respond(headers, part.as_ref(), length, Body::from_stream(pieces)))
    }

    /// The mesh in another format or of fewer vertices, with what is known of it.
    async fn converted(
        &self,
        size: Option<usize>,
        format: Format,
        known: Figures,
    ) -> Result<(Bytes, Figures), Problem> {
        let Self { service, record, mesh, output, is_flat } = *self;
        let shape = shape_of(record);
        let (stored, place) = match size {
            Some(_) => (Format::Progression, mesh.place_of_progression()),
            None => (Format::Model, 0..mesh.bytes),
        };
        let vertices = mesh.vertices;
        let header = MeshHeader { format: stored, shape, vertices, is_flat, terrain: None };
        let size_written = size.unwrap_or(mesh.vertices);
        let texture = if output.shows_image(format) { mesh.place_of_texture() } else { 0..0 };
        let held = place.end - place.start + 2 * (texture.end - texture.start);
        let cost = Cost::of_conversion(&header, held, size_written, format);
        let deadline = Instant::now() + service.deadline;
        let ticket = service.scheduler.admit(&record.owner, cost, deadline).await?;
        let file = service.jobs.blobs.get_part(self.blob()?, place).await?;
        let shown = match texture.is_empty() {
            true => None,
            false => Some(service.jobs.blobs.get_part(self.blob()?, texture).await?),
        };
        let conversion = Conversion {
            file,
            shown: shown.map(Shown::Texture),
            size,
            format,
            output,
            mse: Some(mesh.mse),
        };
        let (made, memory, timing) =
            conversions::run(service, ticket, deadline, conversion).await?;
        let error = made.fidelity.as_ref().map(MeshError::from);
        let figures = match size {
            None => Figures { error, ..known },
            Some(_) => {
                Figures { vertices: made.vertices, faces: made.faces, error, timing, ..known }
            }
        };
        Ok((answer::held(made.bytes, memory), figures))
    }

    fn blob(&self) -> Result<ChunkedBlob, Problem> {
        self.mesh.blob().ok_or_else(|| {
            Problem::new(
                Kind::StorageDamaged,
                "the stored mesh of this job is damaged: submit the picture again",
            )
        })
    }
}

/// The shape of a job's image.
fn shape_of(record: &Record) -> Shape {
    let PictureShape { width, height, components, precision, .. } = record.picture.shape;
    Shape { width, height, component_count: components, precision }
}
