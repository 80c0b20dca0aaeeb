//! `GET /metrics`: the counts, in Prometheus' text format.

use crate::service::Operations;
use crate::telemetry;
use crate::telemetry::names::PROCESS_CPU;
use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;

/// Answers with every metric.
pub async fn show(State(operations): State<Operations>) -> impl IntoResponse {
    telemetry::process();
    operations.metrics.run_upkeep();
    let content_type = "text/plain; version=0.0.4; charset=utf-8";
    // Counters of the recorder are whole numbers, so that a gauge holds these seconds.
    let [gauge, counter] = ["gauge", "counter"].map(|kind| format!("# TYPE {PROCESS_CPU} {kind}"));
    ([(CONTENT_TYPE, content_type)], operations.metrics.render().replacen(&gauge, &counter, 1))
}
