//! `GET /livez` and `GET /readyz`: whether the process lives, and whether it takes requests.

use crate::lifecycle::Stage;
use crate::problem::{Kind, Problem};
use crate::service::Operations;
use axum::extract::State;

/// Answers as long as there is a process to answer.
pub async fn live() -> &'static str {
    "alive\n"
}

/// Answers 200 when requests are taken, and says so if these may not be jobs.
///
/// # Errors
/// `overloaded` while starting or while the public listener does not run, `storage-unavailable`
/// while jobs cannot be kept, `shutting-down` while stopping.
pub async fn ready(State(operations): State<Operations>) -> Result<String, Problem> {
    match operations.lifecycle.stage() {
        Stage::Starting => Err(Problem::new(Kind::Overloaded, "the service is starting")),
        Stage::Ready if !operations.lifecycle.is_alive() => {
            Err(Problem::new(Kind::Overloaded, "the public listener does not respond"))
        }
        Stage::Ready if !operations.jobs.is_healthy() => {
            Err(Problem::new(Kind::StorageUnavailable, "jobs cannot be stored"))
        }
        Stage::Ready => Ok(match operations.jobs.check_intake() {
            Ok(()) => "ready\n".into(),
            Err(error) => format!("ready, but no jobs are accepted: {error}\n"),
        }),
        Stage::Stopping => Err(Problem::new(Kind::ShuttingDown, "the service is stopping")),
    }
}
