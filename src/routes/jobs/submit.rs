//! `POST /v1/jobs`: an image in, a job out; and the jobs that `POST /v1/meshes` makes of requests
//! whose clients prefer one.

use super::{document, found, mesh, source};
use crate::extract::fields::{CONVERSION, Few, Fields};
use crate::extract::idempotency;
use crate::extract::prefer::Preference;
use crate::extract::upload::{IMAGE_OF_JOB, Upload};
use crate::problem::{Kind, Problem, internal};
use crate::routes::openapi::answers::{Accepted, Problems, ProblemsOf, UploadProblems};
use crate::routes::openapi::bodies::{Binary, MeshForm, MeshObject};
use crate::routes::openapi::parameters::{IdempotencyKey, ImageOf, MeshParameters};
use crate::service::Service;
use axum::Extension;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_LOCATION, LOCATION, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use pixmesh_codec::Format;
use pixmesh_engine::MeshTask;
use pixmesh_engine::Owner;
use pixmesh_engine::Weighed;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::params::MeshOptions;
use pixmesh_engine::telemetry::{Shed, shed};
use pixmesh_jobs::queue::{Lookup, Submitted};
use pixmesh_jobs::record::{
    JobId, NewJob, Picture, PictureShape, Record, State as JobState, StoredWeights,
};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;
use tokio::time::timeout_at;

/// Says that the job was there already.
static REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");
/// Says what was done of the client's preferences.
static PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");

/// Answers with the job, once it and its image are on stable storage.
///
/// # Errors
/// Every refusal of upload and parameters, `work-too-large`, `idempotency-key-reused`, `overloaded`
/// or `too-many-jobs` when as many jobs wait as may, and failures of the storage.
#[utoipa::path(
    post, path = "/v1/jobs", operation_id = "createJob",
    summary = "An image in, a job out",
    description = "As createMesh, but always as a job; the answer comes when image and job are on \
                   stable storage. The job becomes completed, failed or cancelled even if the \
                   service restarts. The body may also be a JSON object with the image in base64 and \
                   the parameters as `params`.",
    params(MeshParameters, ImageOf, IdempotencyKey),
    request_body(
        description = "An image, a form with one, or a JSON object with one in base64.",
        content(
            (inline(Binary) = "image/*"),
            (inline(Binary) = "application/octet-stream"),
            (inline(MeshForm) = "multipart/form-data"),
            (inline(MeshObject) = "application/json"),
        ),
    ),
    responses(
        Accepted, Problems, UploadProblems, ProblemsOf::<404>, ProblemsOf::<409>,
        ProblemsOf::<410>, ProblemsOf::<507>,
    ),
    security((), ("key" = [])),
)]
pub(in crate::routes) async fn create(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Response, Problem> {
    accept(&service, owner, request).await
}

async fn accept(service: &Service, owner: Owner, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let (upload, options) = source::receive(service, &owner, &IMAGE_OF_JOB, &head, body).await?;
    let submission = submit(service, owner, &head.headers, upload, &options).await?;
    Ok(submission.accepted())
}

/// Makes a job of a request for a mesh, and waits for it as long as the client prefers.
///
/// # Errors
/// As [`create`], and the problem of a job that failed meanwhile.
pub(in crate::routes) async fn prefer(
    service: &Service,
    owner: Owner,
    headers: &HeaderMap,
    upload: Weighed<Upload>,
    options: &MeshOptions,
    preference: Preference,
) -> Result<Response, Problem> {
    let submission = submit(service, owner.clone(), headers, upload, options).await?;
    let mut response = match preference.wait {
        Some(wait) => {
            let wait = wait.min(service.deadline);
            let record = wait_for_end(service, &owner, submission.record.clone(), wait).await?;
            let submission = Submission { record, ..submission };
            submission.mesh_or_accepted(service, headers, options.format).await?
        }
        None => submission.accepted(),
    };
    let headers = response.headers_mut();
    if let Ok(applied) = HeaderValue::try_from(preference.applied()) {
        headers.insert(PREFERENCE_APPLIED.clone(), applied);
    }
    headers.append(VARY, HeaderValue::from_static("Prefer"));
    Ok(response)
}

/// The problem of a job that failed, as the answer to a request.
fn failure(record: &Record) -> Problem {
    let problem = record.problem.as_ref().and_then(Problem::of_value);
    problem.unwrap_or_else(|| Problem::new(Kind::Internal, "the job failed"))
}

/// A job that was submitted now or before.
struct Submission {
    record: Record,
    was_there: bool,
}

impl Submission {
    /// The mesh, or the problem, of a job that came to its end; else where the job is.
    async fn mesh_or_accepted(
        &self,
        service: &Service,
        headers: &HeaderMap,
        format: Option<Format>,
    ) -> Result<Response, Problem> {
        match self.record.state {
            JobState::Queued | JobState::Running => Ok(self.accepted()),
            JobState::Failed => Err(failure(&self.record)),
            JobState::Completed | JobState::Cancelled => {
                let mut parameters = Few::of(&CONVERSION);
                if let Some(format) = format {
                    parameters.add("format", format.name())?;
                }
                let mut response = mesh::of(service, &self.record, &parameters, headers).await?;
                let path =
                    HeaderValue::try_from(format!("{}/mesh", document::path(self.record.id)));
                let path =
                    path.map_err(|error| internal("the path of a job is no header value", &error))?;
                response.headers_mut().insert(CONTENT_LOCATION, path);
                Ok(response)
            }
        }
    }

    /// 202 and where the job is.
    fn accepted(&self) -> Response {
        let mut response = found::answer(StatusCode::ACCEPTED, &self.record);
        let headers = response.headers_mut();
        if let Ok(path) = HeaderValue::try_from(document::path(self.record.id)) {
            headers.insert(LOCATION, path);
        }
        if self.was_there {
            headers.insert(REPLAYED.clone(), HeaderValue::from_static("true"));
        }
        response
    }
}

/// Checks the options against the image's header and the budget, and puts both on stable storage.
async fn submit(
    service: &Service,
    owner: Owner,
    headers: &HeaderMap,
    upload: Weighed<Upload>,
    options: &MeshOptions,
) -> Result<Submission, Problem> {
    let idempotency_key = idempotency::key_of(headers)?;
    let task = MeshTask::for_job(upload.as_bytes(), options, &service.pictures)?;
    service.scheduler.refuse_too_large(task.cost)?;
    let header = task.header;
    let length = upload.image.bytes.len() as u64;
    let Packed { digest, file: image, weights } = packed(upload).await?;
    let shape = PictureShape { weights, ..PictureShape::from(&header) };
    let picture = Picture { digest, bytes: length, shape };
    let job =
        NewJob { id: JobId::new(), owner, options: options.stored(), picture, idempotency_key };
    match service.jobs.submit(job, image).await? {
        Submitted::Created(record) => {
            pixmesh_jobs::telemetry::job_submitted();
            tracing::info!(job = %record.id, pixels = header.width * header.height, "job submitted");
            Ok(Submission { record, was_there: false })
        }
        Submitted::Existing(record) => Ok(Submission { record, was_there: true }),
        Submitted::KeyReused => Err(key_reused()),
        Submitted::KeyOfGone => Err(key_of_gone()),
        Submitted::QueueFull { limit } => Err(queue_full(limit, service.scheduler.drain_s())),
        Submitted::OwnerFull { limit } => Err(owner_full(limit, service.scheduler.drain_s())),
        Submitted::StoreFull { limit, bytes } => {
            Err(store_full("all jobs", "--max-stored-bytes", limit, bytes))
        }
        Submitted::OwnersStoreFull { limit, bytes } => {
            Err(store_full("the jobs of this client", "--key-stored-bytes", limit, bytes))
        }
    }
}

/// The blob that a job starts from: the image, and its weights behind it.
struct Packed {
    digest: Digest,
    file: Bytes,
    weights: Option<StoredWeights>,
}

/// Packs an upload of any size, whose digests take their time.
async fn packed(upload: Weighed<Upload>) -> Result<Packed, Problem> {
    let pack = || {
        let Weighed { mut image, weights } = upload;
        let kept = weights.as_ref().map(|weights| StoredWeights {
            bytes: weights.bytes.len() as u64,
            digest: Digest::of(&weights.bytes),
            picture_digest: Digest::of(&image.bytes),
        });
        if let Some(weights) = weights {
            image.append(&weights)?;
        }
        let file = Bytes::from_owner(image);
        Ok(Packed { digest: Digest::of(&file), file, weights: kept })
    };
    spawn_blocking(pack)
        .await
        .map_err(|error| internal("an image could not be digested", &error))?
}

fn key_reused() -> Problem {
    let detail = "an earlier request used this Idempotency-Key for another image or other parameters: send a new key";
    Problem::new(Kind::IdempotencyKeyReused, detail).param("Idempotency-Key")
}

fn key_of_gone() -> Problem {
    let detail =
        "the job of this Idempotency-Key expired or was deleted: give another job a new key";
    Problem::new(Kind::Gone, detail).param("Idempotency-Key")
}

fn queue_full(limit: usize, retry_after_s: u64) -> Problem {
    shed(Shed::QueueFull);
    Problem::new(
        Kind::Overloaded,
        format!("the queue has {limit} jobs, which is its limit: try again"),
    )
    .setting("--max-queued-jobs")
    .limit(limit, limit)
    .retry_after_s(retry_after_s)
}

fn owner_full(limit: usize, retry_after_s: u64) -> Problem {
    shed(Shed::QueueFull);
    Problem::new(
        Kind::TooManyJobs,
        format!("this client has {limit} queued jobs, which is its limit: wait or cancel one"),
    )
    .setting("--key-queued-jobs")
    .limit(limit, limit)
    .retry_after_s(retry_after_s)
}

fn store_full(whose: &str, setting: &'static str, limit: u64, bytes: u64) -> Problem {
    shed(Shed::Storage);
    let detail = format!(
        "with this picture, {whose} would keep {bytes} bytes of pictures and meshes, and at most \
         {limit} are kept: delete jobs, or wait until some expire"
    );
    Problem::new(Kind::StorageFull, detail).setting(setting).limit(limit, bytes)
}

/// Waits for a job's end, or until the time is over or the service stops, and returns it as it is.
async fn wait_for_end(
    service: &Service,
    owner: &Owner,
    mut record: Record,
    wait: Duration,
) -> Result<Record, Problem> {
    let until = Instant::now() + wait;
    while !record.state.is_final() {
        let changes = service.jobs.queue.events(owner, record.id, record.revision);
        let changed = tokio::select! {
            changed = timeout_at(until.into(), changes) => changed,
            () = service.shutdown.stop.cancelled() => return Ok(record),
        };
        match changed {
            Ok(changes) => changes?,
            Err(_) => return Ok(record),
        };
        match service.jobs.queue.get(owner, record.id).await? {
            Lookup::Found(found) => record = *found,
            Lookup::Gone | Lookup::Unknown => {
                return Err(Problem::new(Kind::Gone, "the job was deleted before it ended"));
            }
        }
    }
    Ok(record)
}
