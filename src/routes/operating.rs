//! What operators do to the jobs of all owners, on the listener for operations.
//!
//! | call | what |
//! |---|---|
//! | `GET /v1/jobs` | the jobs, newest first |
//! | `POST /v1/jobs/retry`, `/cancel`, `/delete` | changes jobs |
//! | `GET /v1/paused` | what is paused |
//! | `PUT`, `DELETE /v1/paused/{intake or work}` | pauses and resumes it |
//!
//! The query chooses jobs by [`FILTERS`]. Where there are keys, each call needs that of an operator;
//! without keys, they are answered on loopback alone.

use super::jobs::document::Job;
use super::jobs::list::{cursor, state_named};
use super::origin;
use crate::access::KeyRing;
use crate::config::{ByteSize, Period, Visitors};
use crate::extract::auth::{IsOperator, authenticate};
use crate::extract::fields::Few;
use crate::problem::{Kind, Problem};
use crate::routes::openapi::parameters::{DEFAULT_JOBS, MOST_JOBS};
use axum::extract::{Path, RawQuery, Request, State};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post, put};
use axum::{Extension, Json, Router};
use pixmesh_engine::Owner;
use pixmesh_engine::params::{nearest_name, whole_between};
use pixmesh_jobs::queue::{Change, Search};
use pixmesh_jobs::record::{JobId, Moment, Record};
use pixmesh_jobs::{Jobs, Paused};
use serde::Serialize;
use serde_json::{Value, json};
use std::str::FromStr;
use std::sync::Arc;

/// What chooses jobs: one by its name, the others all that apply.
const FILTERS: [&str; 7] = ["id", "owner", "state", "problem", "min_age", "max_age", "min_size"];
const LISTING: &[&str] =
    &["id", "owner", "state", "problem", "min_age", "max_age", "min_size", "limit", "cursor"];
const CHANGING: &[&str] =
    &["id", "owner", "state", "problem", "min_age", "max_age", "min_size", "all", "cursor"];

/// Who may operate.
#[derive(Clone, Debug)]
pub struct Operators {
    /// The keys, if requests need one.
    pub keys: Option<Arc<KeyRing>>,
    /// Which pages' requests are taken, and under which names.
    pub visitors: Arc<Visitors>,
    /// Whether only this machine reaches the listener.
    pub is_private: bool,
}

/// A job with its owner.
#[derive(Serialize)]
struct OwnedJob {
    owner: String,
    #[serde(flatten)]
    job: Job,
}

/// The routes.
pub(super) fn routes(jobs: Jobs, operators: Operators) -> Router {
    let Operators { keys, visitors, .. } = operators.clone();
    Router::new()
        .route("/v1/jobs", get(list))
        .route("/v1/jobs/{change}", post(change))
        .route("/v1/paused", get(show_paused))
        .route("/v1/paused/{what}", put(pause).delete(resume))
        .route_layer(from_fn_with_state(operators, operators_only))
        .route_layer(from_fn_with_state(keys, authenticate))
        .route_layer(from_fn_with_state(visitors, origin::admit))
        .with_state(jobs)
}

/// The layer that refuses whoever is no operator.
async fn operators_only(
    State(operators): State<Operators>,
    request: Request,
    next: Next,
) -> Response {
    let is_operator = match request.extensions().get::<IsOperator>() {
        Some(IsOperator(is_operator)) => *is_operator,
        None => operators.keys.is_none() && operators.is_private,
    };
    if is_operator {
        return next.run(request).await;
    }
    let detail = match operators.keys {
        Some(_) => "the key is not an operator's",
        None => "without keys, only a listener on loopback answers this: name a --keys-file",
    };
    Problem::new(Kind::OperatorOnly, detail).into_response()
}

async fn list(State(jobs): State<Jobs>, RawQuery(query): RawQuery) -> Result<Json<Value>, Problem> {
    let given = Few::of_query(LISTING, query.as_deref())?;
    let limit = given.get("limit").map(|text| whole_between("limit", text, 1, MOST_JOBS));
    let limit = limit.transpose()?.unwrap_or(DEFAULT_JOBS) as usize;
    let page = jobs.search(search_of(&given)?, limit).await?;
    let owned = |record: &Record| OwnedJob {
        owner: record.owner.as_str().to_owned(),
        job: Job::from(record),
    };
    let cursor = page.next.map(|id| id.to_string());
    Ok(Json(json!({
        "jobs": page.jobs.iter().map(owned).collect::<Vec<_>>(),
        "damaged": page.damaged.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "cursor": cursor,
    })))
}

async fn change(
    State(jobs): State<Jobs>,
    Extension(operator): Extension<Owner>,
    Path(name): Path<String>,
    RawQuery(query): RawQuery,
) -> Result<Json<Value>, Problem> {
    let change = match name.as_str() {
        "retry" => Change::Retry,
        "cancel" => Change::Cancel,
        "delete" => Change::Delete,
        _ => return Err(Problem::new(Kind::NotFound, "jobs can be retried, cancelled or deleted")),
    };
    let given = Few::of_query(CHANGING, query.as_deref())?;
    let is_filtered = FILTERS.iter().any(|filter| given.get(filter).is_some());
    if !is_filtered && given.get("all") != Some("true") {
        let detail =
            "this would change jobs of all owners: choose some by a filter, or say all=true";
        return Err(Problem::new(Kind::UnknownValue, detail).param("all").allowed(&["true"]));
    }
    let changed = jobs.change(search_of(&given)?, change).await?;
    let (count, filter) = (changed.jobs, given.query());
    tracing::warn!(%operator, change = name, filter, count, "an operator changed jobs");
    Ok(Json(json!({
        "changed": count,
        "without_picture": changed.without_picture,
        "cursor": changed.next.map(|id| id.to_string()),
    })))
}

async fn show_paused(State(jobs): State<Jobs>) -> Result<Json<Value>, Problem> {
    Ok(document(jobs.queue.paused().await?))
}

async fn pause(
    State(jobs): State<Jobs>,
    Extension(operator): Extension<Owner>,
    Path(what): Path<String>,
) -> Result<Json<Value>, Problem> {
    set_paused(&jobs, &operator, &what, true).await
}

async fn resume(
    State(jobs): State<Jobs>,
    Extension(operator): Extension<Owner>,
    Path(what): Path<String>,
) -> Result<Json<Value>, Problem> {
    set_paused(&jobs, &operator, &what, false).await
}

async fn set_paused(
    jobs: &Jobs,
    operator: &Owner,
    what: &str,
    is_paused: bool,
) -> Result<Json<Value>, Problem> {
    let mut paused = jobs.queue.paused().await?;
    match what {
        "intake" => paused.intake = is_paused,
        "work" => paused.work = is_paused,
        _ => return Err(Problem::new(Kind::NotFound, "intake or work can be paused")),
    }
    jobs.pause(paused).await?;
    tracing::warn!(%operator, what, is_paused, "an operator paused or resumed jobs");
    Ok(document(paused))
}

fn document(paused: Paused) -> Json<Value> {
    Json(json!({ "intake": paused.intake, "work": paused.work }))
}

/// The search that the filters and the cursor ask for.
fn search_of(given: &Few) -> Result<Search, Problem> {
    let age = |name| {
        let age = given.get(name).map(|text| read::<Period>(name, text)).transpose()?;
        Ok::<_, Problem>(age.map(|Period(age)| JobId::first_at(Moment::now().before(age))))
    };
    let mut search = Search {
        owner: given.get("owner").map(Owner::of_stored),
        state: given.get("state").map(state_named).transpose()?,
        problem: given.get("problem").map(problem_named).transpose()?,
        least_bytes: given
            .get("min_size")
            .map_or(Ok(0), |text| read::<ByteSize>("min_size", text).map(|size| size.0))?,
        from: age("max_age")?,
        before: age("min_age")?,
    };
    if let Some(id) = given.get("id") {
        let id = JobId::parse(id).ok_or_else(|| malformed("id", "id must be that of a job"))?;
        (search.from, search.before) = (Some(id), Some(id.following()));
    }
    if let Some(cursor) = given.get("cursor").map(cursor).transpose()? {
        search.before = Some(search.before.map_or(cursor, |before| before.min(cursor)));
    }
    Ok(search)
}

/// A size or a period.
fn read<T: FromStr<Err = String>>(name: &'static str, text: &str) -> Result<T, Problem> {
    text.parse().map_err(|error: String| malformed(name, &error))
}

fn malformed(name: &'static str, detail: &str) -> Problem {
    Problem::new(Kind::ParameterMalformed, detail).param(name)
}

/// The type of a problem, which is given as such or by its name alone.
fn problem_named(text: &str) -> Result<String, Problem> {
    let slug = text.strip_prefix("/problems/").unwrap_or(text);
    if let Some(kind) = Kind::ALL.iter().find(|kind| kind.slug() == slug) {
        return Ok(kind.reference());
    }
    let problem = Problem::new(Kind::UnknownValue, "there is no such type of problem");
    let nearest = nearest_name(slug, Kind::ALL.iter().map(|kind| kind.slug()));
    Err(nearest.into_iter().fold(problem.param("problem"), Problem::nearest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;
    use axum::http::StatusCode;
    use tower::ServiceExt;

    #[tokio::test]
    async fn without_keys_only_loopback_operates() {
        for (is_private, status) in [(true, StatusCode::OK), (false, StatusCode::FORBIDDEN)] {
            let visitors = Arc::new(Visitors { origins: Vec::new(), hosts: None });
            let operators = Operators { keys: None, visitors, is_private };
            let routes = Router::new()
                .route("/v1/jobs", get(|| async {}))
                .route_layer(from_fn_with_state(operators, operators_only));
            let request = Request::builder().uri("/v1/jobs").body(Body::empty()).unwrap();
            assert_eq!(routes.oneshot(request).await.unwrap().status(), status);
        }
    }
}
