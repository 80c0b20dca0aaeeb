//! `GET /problems/{slug}`: what the `type` of a problem document refers to.

use crate::problem::{Kind, Problem};
use axum::Json;
use axum::extract::Path;
use serde_json::{Map, Value};

/// Answers with the row of the table of problems.
///
/// # Errors
/// `not-found` for a slug that is in no row.
pub async fn show(Path(slug): Path<String>) -> Result<Json<Map<String, Value>>, Problem> {
    let kind = Kind::ALL.iter().find(|kind| kind.slug() == slug);
    let unknown = || Problem::new(Kind::NotFound, "there is no such type of problem");
    kind.map(|kind| Json(kind.document())).ok_or_else(unknown)
}
