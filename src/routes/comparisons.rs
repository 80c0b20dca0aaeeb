//! `POST /v1/comparisons`: a picture, and a picture or mesh that approximates it, in; how close
//! they are out.

use super::openapi::answers::{Problems, UploadProblems};
use super::openapi::bodies::ComparisonForm;
use crate::extract::fields::Few;
use crate::extract::upload::{COMPARED, Upload};
use crate::problem::{Kind, Problem};
use crate::service::Service;
use axum::Extension;
use axum::Json;
use axum::extract::{Request, State};
use pixmesh_codec::{DecodeError, Header, Limits, MeshHeader, PictureFormat, is_pmesh, probe_mesh};
use pixmesh_engine::Owner;
use pixmesh_engine::pipeline::{self, Comparison, HeightErrors, Pair};
use pixmesh_engine::task::{Compared, Cost};
use pixmesh_meshing::Shape;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;
use utoipa::ToSchema;

/// Answers with the figures.
///
/// # Errors
/// Every refusal of upload, admission and work.
#[utoipa::path(
    post, path = "/v1/comparisons", operation_id = "createComparison",
    summary = "How close a picture, or a mesh, is to a picture",
    description = "A form with the parts `image` and `approximation`; the latter is a picture or a \
                   mesh, as MODEL or pmesh, of the same width, height, components and precision. The service recognises \
                   it by its content. Of an elevation model the heights are compared, in their units and \
                   not rounded: with those of a mesh of it, or of another elevation model.",
    request_body(content = inline(ComparisonForm), content_type = "multipart/form-data"),
    responses(
        (status = 200, description = "The figures", body = Figures),
        Problems, UploadProblems,
    ),
    security((), ("key" = [])),
)]
pub(super) async fn create(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Json<Figures>, Problem> {
    compare(&service, &owner, request).await
}

async fn compare(
    service: &Service,
    owner: &Owner,
    request: Request,
) -> Result<Json<Figures>, Problem> {
    let (head, body) = request.into_parts();
    let mut parameters = Few::of_query(&[], head.uri.query())?;
    let receiving = service.intake.receive(owner, &COMPARED, &head.headers, body, &mut parameters);
    let [picture, approximation] = receiving.await?;
    let header = pixmesh_codec::probe(&picture.bytes, &service.pictures)?;
    let other = probe(&approximation.bytes, &service.pictures).map_err(of_approximation)?;
    let mut shape = other.shape();
    if header.format == PictureFormat::Tiff {
        // Elevation models are compared by their heights, whatever their samples: the work refuses
        // others.
        let Shape { component_count, precision, .. } = header.shape();
        shape = Shape { component_count, precision, ..shape };
    }
    refuse_other_shape(header.shape(), shape)?;
    let comparison = run(service, owner, picture, approximation, &header, other).await?;
    Ok(Json(Figures::new(&header, comparison)))
}

/// What a picture is compared with, by its content.
enum Other {
    Picture(Header),
    Mesh(MeshHeader),
}

impl Other {
    fn shape(&self) -> Shape {
        match self {
            Self::Picture(header) => header.shape(),
            Self::Mesh(header) => header.shape,
        }
    }
}

/// Reads the header of a picture, or else of a mesh: a pmesh, or a MODEL, which begins with a digit
/// or a comment.
fn probe(bytes: &[u8], limits: &Limits) -> Result<Other, Problem> {
    match pixmesh_codec::probe(bytes, limits) {
        Ok(header) => Ok(Other::Picture(header)),
        Err(DecodeError::UnknownFormat) if is_pmesh(bytes) || could_be_model(bytes) => {
            Ok(Other::Mesh(probe_mesh(bytes, limits).map_err(Problem::from)?))
        }
        Err(error) => Err(error.into()),
    }
}

fn could_be_model(bytes: &[u8]) -> bool {
    let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace());
    first.is_some_and(|byte| byte.is_ascii_digit() || *byte == b'#')
}

fn of_approximation(problem: Problem) -> Problem {
    problem.param("approximation")
}

/// Refuses before admission what cannot be compared.
fn refuse_other_shape(first: Shape, second: Shape) -> Result<(), Problem> {
    if first == second {
        return Ok(());
    }
    let written = |shape: Shape| {
        let Shape { width, height, component_count, precision } = shape;
        format!("{width}x{height} with {component_count} components of {precision} bits")
    };
    let detail = format!(
        "pictures of different shape cannot be compared: {} and {}",
        written(first),
        written(second)
    );
    Err(Problem::new(Kind::ShapeMismatch, detail).param("approximation"))
}

async fn run(
    service: &Service,
    owner: &Owner,
    picture: Upload,
    approximation: Upload,
    header: &Header,
    other: Other,
) -> Result<Comparison, Problem> {
    let (limits, is_mesh) = (service.pictures, matches!(other, Other::Mesh(_)));
    let compared = match &other {
        Other::Picture(header) => Compared::Picture(header),
        Other::Mesh(header) => Compared::Mesh(header, approximation.bytes.len() as u64),
    };
    let cost = Cost::of_comparison(header, compared);
    let deadline = Instant::now() + service.deadline;
    let ticket = service.scheduler.admit(owner, cost, deadline).await?;
    let done = service
        .workers
        .run(ticket, deadline, move |watch, _| {
            let compared =
                pipeline::compare(Pair { picture, approximation, is_mesh }, &limits, watch);
            let _ = watch.finish();
            compared
        })
        .await?;
    Ok(done)
}

/// Figures over all pixels and components.
#[derive(Serialize, ToSchema)]
#[schema(as = Comparison)]
pub(super) struct Figures {
    width: usize,
    height: usize,
    components: usize,
    /// Bits per sample.
    precision: u8,
    identical: bool,
    /// Mean squared error; of heights in the square of their units.
    #[schema(minimum = 0)]
    mse: f64,
    /// PSNR in decibels; null for equal pictures. Of heights the peak is the difference between the
    /// highest and the lowest.
    psnr_db: Option<f64>,
    /// Mean structural similarity; null for pictures with a side under 11, and for elevation models.
    #[schema(minimum = -1, maximum = 1)]
    ssim: Option<f64>,
    /// The errors of the heights of an elevation model.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    elevation: Option<Elevation>,
}

/// Errors of heights, in their units.
#[derive(Serialize, ToSchema)]
#[schema(as = ComparedElevation)]
struct Elevation {
    /// The largest difference of a height.
    #[schema(minimum = 0)]
    max_error: f64,
    /// Root mean squared difference.
    #[schema(minimum = 0)]
    rmse: f64,
    /// The step that the heights of the mesh are multiples of; null for elevation models.
    step: Option<f64>,
    /// The largest difference that rounding to the step made; null for elevation models.
    rounding: Option<f64>,
    /// Pixels that have a height in both.
    compared: u64,
    /// Pixels that have a height in one of them only.
    unmatched: u64,
}

impl From<HeightErrors> for Elevation {
    fn from(errors: HeightErrors) -> Self {
        let HeightErrors { max_error, rmse, steps, compared, unmatched } = errors;
        let (step, rounding) = steps.unzip();
        Self { max_error, rmse, step, rounding, compared, unmatched }
    }
}

impl Figures {
    fn new(header: &Header, comparison: Comparison) -> Self {
        let Comparison { mse, psnr_db, ssim, heights } = comparison;
        let is_matched = heights.is_none_or(|heights| heights.unmatched == 0);
        Self {
            width: header.width,
            height: header.height,
            components: if heights.is_some() { 1 } else { header.component_count },
            precision: header.precision,
            identical: mse == 0.0 && is_matched,
            mse,
            psnr_db: Some(psnr_db).filter(|psnr| psnr.is_finite()),
            ssim,
            elevation: heights.map(Elevation::from),
        }
    }
}
