//! The jobs: submitted, looked at, followed, cancelled, and their meshes.
//!
//! | call | where |
//! |---|---|
//! | `POST /v1/jobs`, and `Prefer` of `POST /v1/meshes` | [`submit`] |
//! | `GET /v1/jobs` | [`list`] |
//! | `GET`, `DELETE /v1/jobs/{id}` | [`show`], [`cancel`] |
//! | `GET /v1/jobs/{id}/events` | [`events`] |
//! | `GET /v1/jobs/{id}/mesh` | [`mesh`] |
//! | `GET /v1/jobs/{id}/image` | [`source`] |

pub(super) mod document;
pub mod events;
mod found;
pub mod list;
pub mod mesh;
pub(super) mod source;
pub(super) mod submit;

pub(super) use submit::prefer;

use super::openapi::answers::{Problems, ProblemsOf};
use super::openapi::parameters::JobPath;
use crate::extract::fields::Few;
use crate::problem::Problem;
use crate::service::Service;
use axum::Extension;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use document::Job;
use found::{answer, find, found, gone, id_of, unknown};
use pixmesh_engine::Owner;
use pixmesh_jobs::queue::Cancellation;
use pixmesh_jobs::record::State as JobState;
use std::sync::Arc;

/// Answers with the job.
///
/// # Errors
/// `not-found`, or `gone` when it is no longer kept.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", operation_id = "getJob",
    summary = "A job", description = "Its state, its progress, and its result.",
    params(JobPath),
    responses(
        (status = 200, description = "The job", body = Job),
        Problems, ProblemsOf::<404>, ProblemsOf::<410>,
    ),
    security((), ("key" = [])),
)]
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
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", operation_id = "cancelJob",
    summary = "Cancels or deletes a job",
    description = "A queued or running job is cancelled; running work stops within moments. An ended \
                   job is deleted, with its mesh.",
    params(JobPath),
    responses(
        (status = 202, description = "It is cancelled, or will be in a moment", body = Job),
        (status = 204, description = "It had ended, and is deleted"),
        Problems, ProblemsOf::<404>, ProblemsOf::<410>, ProblemsOf::<507>,
    ),
    security((), ("key" = [])),
)]
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
