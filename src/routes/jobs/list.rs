//! `GET /v1/jobs`: the caller's jobs, newest first.

use super::document::Job;
use crate::extract::fields::Few;
use crate::problem::{Kind, Problem};
use crate::routes::openapi::answers::{Problems, ProblemsOf};
use crate::routes::openapi::parameters::{DEFAULT_JOBS, MOST_JOBS, PageParameters};
use crate::service::Service;
use axum::Extension;
use axum::Json;
use axum::extract::{Request, State};
use pixmesh_engine::Owner;
use pixmesh_engine::params::whole_between;
use pixmesh_jobs::queue::PageRequest;
use pixmesh_jobs::record::{JobId, State as JobState};
use serde::Serialize;
use std::sync::Arc;
use utoipa::ToSchema;

const PARAMETERS: &[&str] = &["state", "limit", "cursor"];

/// Some of the caller's jobs, newest first.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct Jobs {
    jobs: Vec<Job>,
    /// Asks for the next page; null on the last one.
    #[schema(required)]
    cursor: Option<String>,
    links: PageLinks,
}

/// The next page.
#[derive(Serialize, ToSchema)]
pub(in crate::routes) struct PageLinks {
    next: Option<String>,
}

/// Answers with some of the jobs, and the cursor of the next page.
///
/// # Errors
/// Every refusal of parameters.
#[utoipa::path(
    get, path = "/v1/jobs", operation_id = "listJobs",
    summary = "The caller's jobs, newest first",
    description = "The cursor of a page, which is null on the last one, asks for the next.",
    params(PageParameters),
    responses(
        (status = 200, description = "Some of the jobs", body = Jobs),
        Problems, ProblemsOf::<422>,
    ),
    security((), ("key" = [])),
)]
pub(in crate::routes) async fn list(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    request: Request,
) -> Result<Json<Jobs>, Problem> {
    let parameters = Few::of_query(PARAMETERS, request.uri().query())?;
    let state = parameters.get("state").map(state_named).transpose()?;
    let before = parameters.get("cursor").map(cursor).transpose()?;
    let limit = parameters.get("limit").map(|text| whole_between("limit", text, 1, MOST_JOBS));
    let limit = limit.transpose()?.unwrap_or(DEFAULT_JOBS) as usize;
    let page = service.jobs.queue.list(&owner, PageRequest { state, before, limit }).await?;
    let next = page.next.map(|id| next_page(id, limit, state));
    Ok(Json(Jobs {
        jobs: page.jobs.iter().map(Job::from).collect(),
        cursor: page.next.map(|id| id.to_string()),
        links: PageLinks { next },
    }))
}

fn next_page(id: JobId, limit: usize, state: Option<JobState>) -> String {
    let state = state.map_or_else(String::new, |state| format!("&state={}", state.name()));
    format!("/v1/jobs?limit={limit}{state}&cursor={id}")
}

pub(in crate::routes) fn state_named(name: &str) -> Result<JobState, Problem> {
    JobState::named(name).ok_or_else(|| {
        let detail = format!("state must be one of {}", JobState::NAMES.join(", "));
        Problem::new(Kind::UnknownValue, detail).param("state").allowed(JobState::NAMES)
    })
}

/// The job after which a page begins.
pub(in crate::routes) fn cursor(text: &str) -> Result<JobId, Problem> {
    JobId::parse(text).ok_or_else(|| {
        let detail = "cursor must be the cursor of an earlier page";
        Problem::new(Kind::ParameterMalformed, detail).param("cursor")
    })
}
