//! A job as JSON.

use crate::problem::Problem;
use pixmesh_engine::MeshOptions;
use pixmesh_jobs::queue::MAX_ATTEMPTS;
use pixmesh_jobs::record::{Event, JobId, MeshFigures, Moment, Picture, Progress, Record, State};
use serde_json::{Map, Value, json};

/// The whole of a job.
pub(in crate::routes) fn of(record: &Record) -> Value {
    json!({
        "id": record.id.to_string(),
        "state": record.state.name(),
        "attempt": record.attempt,
        "max_attempts": MAX_ATTEMPTS,
        "created_at": record.created.to_string(),
        "started_at": moment(record.started),
        "finished_at": moment(record.finished),
        "expires_at": moment(record.expires),
        "parameters": parameters(&record.order),
        "image": image(&record.picture),
        "progress": progress(record.state, record.progress.as_ref()),
        "mesh": record.mesh.as_ref().map(mesh),
        "timings_ms": record.mesh.as_ref().map(timings),
        "error": record.problem.as_ref().map(problem),
        "links": links_of(record),
    })
}

/// One change of a job.
pub(super) fn of_event(id: JobId, event: &Event) -> Value {
    json!({
        "id": id.to_string(),
        "state": event.state.name(),
        "attempt": event.attempt,
        "at": event.at.to_string(),
        "progress": progress(event.state, event.progress.as_ref()),
        "links": links(id, event.state),
    })
}

/// Where a job is.
pub(super) fn path(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

/// Where there is more of a job, also every size of its mesh where the order of vertices is kept.
fn links_of(record: &Record) -> Value {
    let mut links = links(record.id, record.state);
    if record.mesh.as_ref().is_some_and(|mesh| mesh.progression.is_some()) {
        links["progression"] = format!("{}/mesh?format=progression", path(record.id)).into();
    }
    links
}

fn links(id: JobId, state: State) -> Value {
    let path = path(id);
    let mut links = json!({ "self": path, "events": format!("{path}/events") });
    if state == State::Completed {
        links["mesh"] = format!("{path}/mesh").into();
    }
    links
}

fn moment(moment: Option<Moment>) -> Option<String> {
    moment.map(|moment| moment.to_string())
}

/// What was ordered, each value of its type.
fn parameters(order: &str) -> Value {
    MeshOptions::of_stored(order).map_or(Value::Null, |options| Value::Object(options.object()))
}

fn image(picture: &Picture) -> Value {
    json!({
        "width": picture.shape.width,
        "height": picture.shape.height,
        "components": picture.shape.components,
        "precision": picture.shape.precision,
        "bytes": picture.bytes,
        "sha256": picture.file_digest(),
        "weights": picture.shape.weights.map(|weights| {
            json!({ "bytes": weights.bytes, "sha256": weights.digest })
        }),
    })
}

/// The whole problem document, of which less may be stored.
fn problem(stored: &Value) -> Value {
    Problem::of_value(stored).map_or_else(|| stored.clone(), |problem| problem.value())
}

/// Only running work has a progress.
fn progress(state: State, progress: Option<&Progress>) -> Value {
    match progress {
        Some(Progress { stage, fraction }) if state == State::Running => {
            json!({ "stage": stage, "fraction": fraction })
        }
        _ => Value::Null,
    }
}

fn mesh(figures: &MeshFigures) -> Value {
    json!({
        "vertices": figures.vertices,
        "faces": figures.faces,
        "mse": figures.mse,
        "psnr_db": figures.psnr_db,
        "model_bytes": figures.bytes,
        "model_sha256": figures.model_digest(),
        "progression_bytes": figures.progression.as_ref().map(|kept| kept.bytes),
    })
}

fn timings(figures: &MeshFigures) -> Map<String, Value> {
    let rounded = |took_ms: &f64| json!((took_ms * 1e3).round() / 1e3);
    figures.timings_ms.iter().map(|(stage, took)| (stage.clone(), rounded(took))).collect()
}
