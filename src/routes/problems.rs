//! `GET /problems/{slug}`: what the `type` of a problem document refers to.

use super::openapi::answers::ProblemsOf;
use super::openapi::bodies::AnyObject;
use super::openapi::parameters::ProblemPath;
use crate::problem::{Kind, Problem};
use axum::Json;
use axum::extract::Path;
use serde_json::{Map, Value};

/// Answers with the row of the table of problems.
///
/// # Errors
/// `not-found` for a slug that is in no row.
#[utoipa::path(
    get, path = "/problems/{slug}", operation_id = "problem",
    summary = "The meaning of a problem's type",
    description = "The type of every problem document is a reference to this resource.",
    params(ProblemPath),
    responses(
        (status = 200, description = "The type, status and title", body = inline(AnyObject)),
        ProblemsOf::<404>,
    ),
)]
pub async fn show(Path(slug): Path<String>) -> Result<Json<Map<String, Value>>, Problem> {
    let kind = Kind::ALL.iter().find(|kind| kind.slug() == slug);
    let unknown = || Problem::new(Kind::NotFound, "there is no such type of problem");
    kind.map(|kind| Json(kind.document())).ok_or_else(unknown)
}
