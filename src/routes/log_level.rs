//! `PUT /log-level/{level}`: what is logged from now on.

use crate::config::LogLevel;
use crate::problem::{Kind, Problem};
use crate::telemetry;
use axum::extract::Path;
use axum::http::StatusCode;
use clap::ValueEnum;

/// Changes the level until the process ends.
///
/// # Errors
/// `unknown-value` for a word that is no level.
pub async fn change(Path(level): Path<String>) -> Result<StatusCode, Problem> {
    let level = LogLevel::from_str(&level, false).map_err(|_| {
        let allowed = ["error", "warn", "info", "debug"];
        let detail = format!("the level must be one of {}", allowed.join(", "));
        Problem::new(Kind::UnknownValue, detail).param("level").allowed(&allowed)
    })?;
    telemetry::set_level(level);
    tracing::warn!(%level, "log level changed");
    Ok(StatusCode::NO_CONTENT)
}
