//! Finds the job that a request names, and answers with it.

use super::document::Job;
use crate::problem::{Kind, Problem};
use crate::service::Service;
use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::header::{CACHE_CONTROL, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use pixmesh_engine::Owner;
use pixmesh_jobs::queue::Lookup;
use pixmesh_jobs::record::{JobId, Record};

/// Seconds after which a client may look again at a job that has not ended.
pub(super) const POLL_AFTER_S: u64 = 1;

/// The owner's job of the path.
pub(super) async fn find(
    service: &Service,
    owner: &Owner,
    path: Result<Path<String>, PathRejection>,
) -> Result<Record, Problem> {
    found(service.jobs.queue.get(owner, id_of(path)?).await?)
}

/// The job that was looked for.
pub(super) fn found(lookup: Lookup) -> Result<Record, Problem> {
    match lookup {
        Lookup::Found(record) => Ok(*record),
        Lookup::Gone => Err(gone()),
        Lookup::Unknown => Err(unknown()),
    }
}

/// The name in the path; what cannot be one is as unknown as one that nobody has.
pub(super) fn id_of(path: Result<Path<String>, PathRejection>) -> Result<JobId, Problem> {
    path.ok().and_then(|Path(text)| JobId::parse(&text)).ok_or_else(unknown)
}

pub(super) fn unknown() -> Problem {
    Problem::new(Kind::NotFound, "no job of this key has this id")
}

pub(super) fn gone() -> Problem {
    Problem::new(Kind::Gone, "the job has expired: submit the picture again")
        .setting("--result-ttl")
}

/// The answer with a job.
pub(super) fn answer(status: StatusCode, record: &Record) -> Response {
    let mut response = (status, Json(Job::from(record))).into_response();
    let headers = response.headers_mut();
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if !record.state.is_final() {
        headers.insert(RETRY_AFTER, POLL_AFTER_S.into());
    }
    response
}
