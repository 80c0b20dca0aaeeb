//! A job as JSON.

use crate::problem::Problem;
use pixmesh_engine::MeshOptions;
use pixmesh_jobs::queue::MAX_ATTEMPTS;
use pixmesh_jobs::record::{
    Event, JobId, MeshFigures, Moment, Picture, Progress as Progressed, Record, State,
    StoredWeights,
};
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

/// A job.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct Job {
    #[schema(format = "uuid")]
    id: String,
    #[schema(schema_with = state)]
    state: &'static str,
    /// How many times a worker took the job, this time included.
    attempt: u32,
    max_attempts: u32,
    #[schema(format = "date-time")]
    created_at: String,
    #[schema(format = "date-time")]
    started_at: Option<String>,
    #[schema(format = "date-time")]
    finished_at: Option<String>,
    /// When the job and its mesh are deleted.
    #[schema(format = "date-time")]
    expires_at: Option<String>,
    /// Every parameter that plays a part, each value of its type.
    parameters: Option<Map<String, Value>>,
    image: JobImage,
    progress: Option<JobProgress>,
    mesh: Option<JobMesh>,
    /// Milliseconds of each stage.
    #[schema(value_type = Option<std::collections::HashMap<String, f64>>)]
    timings_ms: Option<Map<String, Value>>,
    /// The problem document of a job that failed.
    #[schema(value_type = Option<Object>)]
    error: Option<Value>,
    links: JobLinks,
}

/// The image of a job.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobImage {
    width: usize,
    height: usize,
    /// Components, alpha included.
    components: usize,
    /// Bits per sample.
    precision: u8,
    bytes: u64,
    #[schema(pattern = "^[0-9a-f]{64}$")]
    sha256: String,
    weights: Option<JobWeights>,
}

/// The weights of a job's image.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobWeights {
    bytes: u64,
    #[schema(pattern = "^[0-9a-f]{64}$")]
    sha256: String,
}

/// How far a running job is.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobProgress {
    stage: String,
    /// How much of the stage is done.
    #[schema(minimum = 0, maximum = 1)]
    fraction: f64,
    /// How much of the job is done.
    #[schema(minimum = 0, maximum = 1)]
    overall_fraction: f64,
    /// About how many seconds the rest takes; null while that cannot be told.
    #[schema(minimum = 0)]
    remaining_s: Option<f64>,
}

/// The mesh of a completed job.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobMesh {
    vertices: usize,
    faces: usize,
    /// Mean squared error.
    mse: f64,
    /// PSNR in decibels; null for a perfect copy.
    psnr_db: Option<f64>,
    model_bytes: u64,
    #[schema(pattern = "^[0-9a-f]{64}$")]
    model_sha256: String,
    /// Length of the progression; null where the order of the vertices is not kept.
    progression_bytes: Option<u64>,
}

/// Where there is more of a job.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobLinks {
    #[serde(rename = "self")]
    job: String,
    events: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    mesh: Option<String>,
    /// Every size of the mesh, where the order of the vertices is kept.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    progression: Option<String>,
}

/// One change of a job's state or progress.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct JobEvent {
    #[schema(format = "uuid")]
    id: String,
    #[schema(schema_with = state)]
    state: &'static str,
    attempt: u32,
    #[schema(format = "date-time")]
    at: String,
    progress: Option<JobProgress>,
    links: JobLinks,
}

/// The schema of a state.
fn state() -> utoipa::openapi::schema::Object {
    utoipa::openapi::ObjectBuilder::new()
        .schema_type(utoipa::openapi::Type::String)
        .enum_values(Some(State::NAMES.iter().copied()))
        .build()
}

impl From<&Record> for Job {
    fn from(record: &Record) -> Self {
        let mut links = JobLinks::of(record.id, record.state);
        if record.mesh.as_ref().is_some_and(|mesh| mesh.progression.is_some()) {
            links.progression = Some(format!("{}/mesh?format=progression", path(record.id)));
        }
        Self {
            id: record.id.to_string(),
            state: record.state.name(),
            attempt: record.attempt,
            max_attempts: MAX_ATTEMPTS,
            created_at: record.created.to_string(),
            started_at: moment(record.started),
            finished_at: moment(record.finished),
            expires_at: moment(record.expires),
            parameters: MeshOptions::of_stored(&record.options)
                .ok()
                .map(|options| options.object()),
            image: JobImage::from(&record.picture),
            progress: JobProgress::of(record.state, record.progress.as_ref()),
            mesh: record.mesh.as_ref().map(JobMesh::from),
            timings_ms: record.mesh.as_ref().map(timings),
            error: record.problem.as_ref().map(problem),
            links,
        }
    }
}

impl JobEvent {
    /// A change of the job of this name.
    pub(super) fn new(id: JobId, event: &Event) -> Self {
        Self {
            id: id.to_string(),
            state: event.state.name(),
            attempt: event.attempt,
            at: event.at.to_string(),
            progress: JobProgress::of(event.state, event.progress.as_ref()),
            links: JobLinks::of(id, event.state),
        }
    }
}

impl JobLinks {
    fn of(id: JobId, state: State) -> Self {
        let job = path(id);
        let mesh = (state == State::Completed).then(|| format!("{job}/mesh"));
        Self { events: format!("{job}/events"), job, mesh, progression: None }
    }
}

impl From<&Picture> for JobImage {
    fn from(picture: &Picture) -> Self {
        let shape = &picture.shape;
        Self {
            width: shape.width,
            height: shape.height,
            components: shape.components,
            precision: shape.precision,
            bytes: picture.bytes,
            sha256: picture.file_digest().to_string(),
            weights: shape.weights.map(|StoredWeights { bytes, digest, .. }| JobWeights {
                bytes,
                sha256: digest.to_string(),
            }),
        }
    }
}

impl JobProgress {
    /// Only running work has a progress.
    fn of(state: State, progress: Option<&Progressed>) -> Option<Self> {
        let progress = progress.filter(|_| state == State::Running)?;
        Some(Self {
            stage: progress.stage.clone(),
            fraction: progress.fraction,
            overall_fraction: progress.overall_fraction,
            remaining_s: progress.remaining_s,
        })
    }
}

impl From<&MeshFigures> for JobMesh {
    fn from(figures: &MeshFigures) -> Self {
        Self {
            vertices: figures.vertices,
            faces: figures.faces,
            mse: figures.mse,
            psnr_db: figures.psnr_db,
            model_bytes: figures.bytes,
            model_sha256: figures.model_digest().to_owned(),
            progression_bytes: figures.progression.as_ref().map(|kept| kept.bytes),
        }
    }
}

/// Where a job is.
pub(super) fn path(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

fn moment(moment: Option<Moment>) -> Option<String> {
    moment.map(|moment| moment.to_string())
}

/// The whole problem document, of which less may be stored.
fn problem(stored: &Value) -> Value {
    Problem::of_value(stored).map_or_else(|| stored.clone(), |problem| problem.value())
}

fn timings(figures: &MeshFigures) -> Map<String, Value> {
    let rounded = |took_ms: &f64| ((took_ms * 1e3).round() / 1e3).into();
    figures.timings_ms.iter().map(|(stage, took)| (stage.clone(), rounded(took))).collect()
}
