//! `POST /v1/conversions`: a mesh file in, the same mesh in another format or of another size out.
//! `POST /v1/reconstructions`: the same where a picture comes out.

use super::answer::{self, Figures, MeshError};
use super::openapi::answers::{Mesh, Picture, Problems, ProblemsOf, UploadProblems};
use super::openapi::bodies::{Binary, MeshFileForm, ModelForm, Text};
use super::openapi::parameters::{ConversionParameters, PictureParameters};
use crate::extract::accept::{self, Representation};
use crate::extract::fields::{CONVERSION, Few, RECONSTRUCTION};
use crate::extract::upload::{MESH, MODEL, Upload, Wanted};
use crate::problem::{Kind, Problem};
use crate::service::Service;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::CONTENT_LENGTH;
use axum::response::{IntoResponse, Response};
use pixmesh_codec::{Format, MeshHeader, PmeshError, probe, probe_mesh};
use pixmesh_engine::digest::Digest;
use pixmesh_engine::params::{WRITING, whole_between};
use pixmesh_engine::pipeline::{self, Conversion, Converted, Shown};
use pixmesh_engine::scheduler::{Memory, Ticket};
use pixmesh_engine::task::Cost;
use pixmesh_engine::{MeshOptions, Owner, ParameterSet};
use pixmesh_meshing::parameters::MIN_SIZE;
use std::sync::Arc;
use std::time::Instant;

/// Answers with the mesh.
///
/// # Errors
/// Every refusal of upload, parameters, admission and work.
#[utoipa::path(
    post, path = "/v1/conversions", operation_id = "createConversion",
    summary = "A mesh file in, the mesh in another format or of another size out",
    description = "The body is a MODEL, a pmesh or a progression, or a form with a part `mesh`. The \
                   service recognises it by its content. With texture=embed the form has a part \
                   `image` too, the picture to show. Meshes of another size need a progression.",
    params(ConversionParameters),
    request_body(
        description = "A mesh, or a form with one.",
        content(
            (inline(Text) = "text/plain"),
            (inline(Text) = "application/vnd.pixmesh.model"),
            (inline(Binary) = "application/vnd.pixmesh.pmesh"),
            (inline(Binary) = "application/octet-stream"),
            (inline(MeshFileForm) = "multipart/form-data"),
        ),
    ),
    responses(Mesh, Problems, UploadProblems, ProblemsOf::<406>),
    security((), ("key" = [])),
)]
pub async fn create(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Response, Problem> {
    let offered: Vec<_> = accept::offered().collect();
    convert(&service, &owner, request, &MESH, &CONVERSION, &offered).await
}

/// Answers with the picture.
///
/// # Errors
/// Every refusal of upload, parameters, admission and work.
#[utoipa::path(
    post, path = "/v1/reconstructions", operation_id = "createReconstruction",
    summary = "A mesh file in, the picture rebuilt from it out",
    description = "The body is a MODEL, a pmesh or a progression, or a form with one part `model`.",
    params(PictureParameters),
    request_body(
        description = "A mesh, or a form with one.",
        content(
            (inline(Text) = "text/plain"),
            (inline(Text) = "application/vnd.pixmesh.model"),
            (inline(Binary) = "application/vnd.pixmesh.pmesh"),
            (inline(Binary) = "application/octet-stream"),
            (inline(ModelForm) = "multipart/form-data"),
        ),
    ),
    responses(Picture, Problems, UploadProblems, ProblemsOf::<406>),
    security((), ("key" = [])),
)]
pub async fn rebuild(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Response, Problem> {
    let offered: Vec<_> = accept::pictures().collect();
    convert(&service, &owner, request, &MODEL, &RECONSTRUCTION, &offered).await
}

async fn convert<const N: usize>(
    service: &Service,
    owner: &Owner,
    request: Request,
    wanted: &Wanted<N>,
    names: &'static [&'static str],
    offered: &[Representation],
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let mut parameters = Few::of_query(names, head.uri.query())?;
    let receiving =
        service.intake.receive_first(owner, wanted, &head.headers, body, &mut parameters);
    let (file, image) = receiving.await?;
    if file.bytes.is_empty() {
        return Err(Problem::new(Kind::EmptyFile, "the file is empty"));
    }
    let format = parameters.get("format").map(|name| named(name, offered)).transpose()?;
    let representation = accept::choose_among(offered.iter().copied(), format, &head.headers)?;
    let options = options_of(&parameters)?;
    let header = probe_mesh(&file.bytes, &service.pictures)?;
    options.output.check(header.shape)?;
    let size = smaller_size(&header, parameters.get("size"))?;
    let shown = shown(image, options.output.shows_image(representation.format))?;
    let format = representation.format;
    let mut cost = Cost::of_conversion(
        &header,
        file.bytes.len() as u64,
        size.unwrap_or(header.vertices),
        format,
    );
    if let Some(Shown::Picture(image)) = &shown {
        let picture = probe(&image.bytes, &service.pictures);
        let picture = picture.map_err(|error| Problem::from(error).param("image"))?;
        cost = cost.with_texture(&picture);
    }
    let deadline = Instant::now() + service.deadline;
    let ticket = service.scheduler.admit(owner, cost, deadline).await?;
    let output = options.output;
    let conversion = Conversion { file, shown, size, format, output, mse: None };
    let (made, memory, timing) = run(service, ticket, deadline, conversion).await?;
    let tag = answer::tag(Digest::of(&made.bytes));
    let mut headers = answer::headers_of(representation, &tag)?;
    headers.extend(answer::figures_of(&Figures {
        vertices: made.vertices,
        faces: made.faces,
        error: made.fidelity.as_ref().map(MeshError::from),
        parameters: parameters.query(),
        timing,
    })?);
    headers.insert(CONTENT_LENGTH, made.bytes.len().into());
    Ok((headers, Body::from(answer::held(made.bytes, memory))).into_response())
}

/// Converts on a thread of the workers. Returns the memory that the bytes hold, and the times of the
/// stages, too.
pub(super) async fn run<B: AsRef<[u8]> + Send + 'static>(
    service: &Service,
    ticket: Ticket,
    deadline: Instant,
    conversion: Conversion<B>,
) -> Result<(Converted, Memory, String), Problem> {
    let limits = service.pictures;
    let work = service.workers.run(ticket, deadline, move |watch, ticket| {
        let made = pipeline::convert(conversion, &limits, watch)?;
        let timing = pipeline::server_timing(&watch.finish());
        let memory = ticket.keep(made.bytes.len());
        Ok((made, memory, timing))
    });
    Ok(work.await?)
}

/// The format of this name among those offered.
fn named(name: &str, offered: &[Representation]) -> Result<Format, Problem> {
    let found = offered.iter().map(|offer| offer.format).find(|format| format.name() == name);
    found.ok_or_else(|| {
        let mut names: Vec<_> = offered.iter().map(|offer| offer.format.name()).collect();
        names.dedup();
        let detail = format!("format must be one of {}", names.join(", "));
        Problem::new(Kind::UnknownValue, detail).param("format").allowed(&names)
    })
}

/// How the mesh is written.
fn options_of(parameters: &Few) -> Result<MeshOptions, Problem> {
    let writing = parameters.pairs().filter(|(name, _)| WRITING.contains(name));
    let mut options = ParameterSet::default().finish()?.written_by(writing)?;
    options.output.reconstruction = parameters.get("reconstruction").map(str::parse).transpose()?;
    Ok(options)
}

/// The number of vertices asked for, where it is less than the mesh has.
fn smaller_size(header: &MeshHeader, text: Option<&str>) -> Result<Option<usize>, Problem> {
    let Some(text) = text else { return Ok(None) };
    let most = header.vertices;
    let size = whole_between("size", text, MIN_SIZE as u64, most as u64)? as usize;
    if size < most && header.format != Format::Progression {
        return Err(Problem::from(PmeshError::NoOrder).param("size"));
    }
    Ok((size < most).then_some(size))
}

/// The picture to show, which must come where it is shown, and only there.
fn shown(image: Option<Upload>, is_shown: bool) -> Result<Option<Shown<Upload>>, Problem> {
    match image {
        None if is_shown => {
            let detail =
                "texture=embed needs a part 'image': the picture that the mesh was made of";
            Err(Problem::new(Kind::PartMissing, detail).param("image"))
        }
        Some(_) if !is_shown => {
            let detail = "the part 'image' is for texture=embed in glTF: leave it out, or ask for \
                          texture=embed with format=glb or format=gltf";
            Err(Problem::new(Kind::ConflictingParameters, detail).param("image"))
        }
        image => Ok(image.map(Shown::Picture)),
    }
}
