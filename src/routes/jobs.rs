//! The jobs: submitted, looked at, followed, cancelled, and their meshes.
//!
//! | call | where |
//! |---|---|
//! | `POST /v1/jobs`, and `Prefer` of `POST /v1/meshes` | [`submit`] |
//! | `GET /v1/jobs` | [`list`] |
//! | `GET`, `DELETE /v1/jobs/{id}` | [`show`], [`cancel`] |
//! | `GET /v1/jobs/{id}/events` | [`events`] |
//! | `GET /v1/jobs/{id}/mesh` | [`mesh`] |

pub(super) mod document;
pub mod events;
pub mod list;
pub mod mesh;
mod submit;

pub use submit::create;
pub(super) use submit::prefer;

use super::Service;
use crate::extract::fields::Few;
use crate::problem::{Kind, Problem};
use axum::Extension;
use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::header::{CACHE_CONTROL, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use document::Job;
use pixmesh_engine::Owner;
use pixmesh_jobs::queue::{Cancellation, Lookup};
use pixmesh_jobs::record::{JobId, Record, State as JobState};
use std::sync::Arc;

/// Seconds after which a client may look again at a job that has not ended.
const LOOK_AGAIN_S: u64 = 1;

/// Answers with the job.
///
/// # Errors
/// `not-found`, or `gone` when it is no longer kept.
pub async fn show(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    Few::of_query(&[], request.uri().query())?;
    let record = find(&service, &owner, path).await?;
    Ok(answer(StatusCode::OK, &record))
}

/// Cancels the job, or deletes it where it has come to its end.
///
/// # Errors
/// `not-found`, or `gone` when it is no longer kept.
pub async fn cancel(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    Few::of_query(&[], request.uri().query())?;
    let id = id_of(path)?;
    let cancellation = service.jobs.queue.cancel(&owner, id).await?;
    if cancellation == Cancellation::Cancelled {
        pixmesh_jobs::telemetry::job_ended(JobState::Cancelled);
    }
    match cancellation {
        Cancellation::Cancelled | Cancellation::Requested => {
            let record = found(service.jobs.queue.get(&owner, id).await?)?;
            Ok(answer(StatusCode::ACCEPTED, &record))
        }
        Cancellation::Deleted => Ok(StatusCode::NO_CONTENT.into_response()),
        Cancellation::Unknown => Err(unknown()),
        Cancellation::Gone => Err(gone()),
    }
}

/// The owner's job of the path.
async fn find(
    service: &Service,
    owner: &Owner,
    path: Result<Path<String>, PathRejection>,
) -> Result<Record, Problem> {
    found(service.jobs.queue.get(owner, id_of(path)?).await?)
}

/// The job that was looked for.
fn found(lookup: Lookup) -> Result<Record, Problem> {
    match lookup {
        Lookup::Found(record) => Ok(*record),
        Lookup::Gone => Err(gone()),
        Lookup::Unknown => Err(unknown()),
    }
}

/// The name in the path; what cannot be one is as unknown as one that nobody has.
fn id_of(path: Result<Path<String>, PathRejection>) -> Result<JobId, Problem> {
    path.ok().and_then(|Path(text)| JobId::parse(&text)).ok_or_else(unknown)
}

fn unknown() -> Problem {
    Problem::new(Kind::NotFound, "there is no such job")
}

fn gone() -> Problem {
    Problem::new(Kind::Gone, "the job is no longer kept").setting("--result-ttl")
}

/// The answer with a job.
fn answer(status: StatusCode, record: &Record) -> Response {
    let mut response = (status, Json(Job::from(record))).into_response();
    let headers = response.headers_mut();
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if !record.state.is_final() {
        headers.insert(RETRY_AFTER, LOOK_AGAIN_S.into());
    }
    response
}
