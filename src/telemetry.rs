//! The log, and what is counted under the [names] of the metrics.
//!
//! Metrics are in base units, and their names begin with `pixmesh_`, but for the usual `process_`. A label never holds what a
//! client sent: a route is one of the route table or `UNKNOWN`, a method one of HTTP's or `OTHER`.

mod log;
pub mod names;
#[cfg(feature = "otlp")]
mod otlp;

pub use log::{Log, adopt, set_level, start_log};

use metrics::{counter, gauge, histogram};
use metrics_exporter_prometheus::{BuildError, Matcher, PrometheusBuilder, PrometheusHandle};
use names::*;
use pixmesh_engine::telemetry::{INPUT_PIXELS, Kind, MESH_VERTICES};
use rustix::process::{Resource, getrlimit};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The route label of a request that matches none.
pub const UNKNOWN_ROUTE: &str = "UNKNOWN";

const DURATION_BUCKETS_S: [f64; 13] =
    [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 30.0];
const SIZE_BUCKETS: [f64; 7] = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8];

/// Logs and counts panics. A panic of a decoder from another crate is the file's fault: the client
/// gets 422 and the alert for defects stays silent.
fn log_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if pixmesh_codec::in_guarded_decoder() {
            counter!(DECODER_PANICS).increment(1);
            tracing::warn!(message = %panic, "decoder panicked");
            return;
        }
        counter!(PANICS).increment(1);
        tracing::error!(message = %panic, "panicked");
    }));
}

/// Starts counting, and returns what writes the counts out.
///
/// # Errors
/// When this process counts already.
pub fn start_metrics(workers: usize) -> Result<PrometheusHandle, BuildError> {
    let handle = PrometheusBuilder::new()
        .set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &DURATION_BUCKETS_S)?
        .set_buckets_for_metric(Matcher::Full(INPUT_PIXELS.into()), &SIZE_BUCKETS)?
        .set_buckets_for_metric(Matcher::Full(MESH_VERTICES.into()), &SIZE_BUCKETS)?
        .install_recorder()?;
    describe();
    counter!(PANICS).absolute(0);
    counter!(DECODER_PANICS).absolute(0);
    gauge!(WORKERS).set(workers as f64);
    let started = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    gauge!(PROCESS_START).set(started.as_secs_f64());
    let commit = option_env!("PIXMESH_COMMIT").unwrap_or("unknown");
    gauge!(BUILD_INFO, "version" => env!("CARGO_PKG_VERSION"), "commit" => commit).set(1.0);
    requests_in_progress(0.0);
    drop((Open::connection(), Open::event_stream()));
    for reason in ["total", "address"] {
        counter!(CONNECTIONS_REFUSED, "reason" => reason).absolute(0);
    }
    pixmesh_engine::telemetry::start();
    Ok(handle)
}

fn describe() {
    use metrics::{describe_counter, describe_gauge, describe_histogram};
    for metric in all() {
        match metric.kind {
            Kind::Counter => describe_counter!(metric.name, metric.meaning),
            Kind::Gauge => describe_gauge!(metric.name, metric.meaning),
            Kind::Histogram => describe_histogram!(metric.name, metric.meaning),
        }
    }
}

/// Counts an answered request.
pub fn answered(route: &str, method: &'static str, code: u16, duration: Duration) {
    let (route, code) = (route.to_owned(), code.to_string());
    histogram!(HTTP_DURATION, "route" => route.clone()).record(duration);
    counter!(HTTP_REQUESTS, "route" => route, "method" => method, "code" => code).increment(1);
}

/// One request more (1) or less (-1).
pub fn requests_in_progress(change: f64) {
    gauge!(REQUESTS_IN_PROGRESS).increment(change);
}

/// Adds 1 to a gauge until it is dropped.
#[derive(Debug)]
pub struct Open(&'static str);

impl Open {
    /// One connection of the public listener.
    #[must_use]
    pub fn connection() -> Self {
        Self::begin(CONNECTIONS)
    }

    /// One stream of events.
    #[must_use]
    pub fn event_stream() -> Self {
        Self::begin(EVENT_STREAMS)
    }

    fn begin(gauge: &'static str) -> Self {
        gauge!(gauge).increment(1.0);
        Self(gauge)
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        gauge!(self.0).decrement(1.0);
    }
}

/// Counts a connection that was refused.
pub fn connection_refused(reason: &'static str) {
    counter!(CONNECTIONS_REFUSED, "reason" => reason).increment(1);
}

/// Sets the metrics of the process: resident memory, CPU time and open files.
pub fn process() {
    counter!(LOG_LINES_DROPPED).absolute(log::dropped_lines() as u64);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let resident_kib = resident.and_then(|value| value.trim().strip_suffix(" kB"));
    if let Some(kib) = resident_kib.and_then(|kib| kib.trim().parse::<f64>().ok()) {
        gauge!(PROCESS_RESIDENT).set(kib * 1024.0);
    }
    let cpu = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    gauge!(PROCESS_CPU).set(cpu.tv_sec as f64 + cpu.tv_nsec as f64 / 1e9);
    if let Ok(open) = std::fs::read_dir("/proc/self/fd") {
        gauge!(PROCESS_FDS).set(open.count() as f64);
    }
    let limit = getrlimit(Resource::Nofile).current;
    gauge!(PROCESS_MAX_FDS).set(limit.map_or(f64::INFINITY, |limit| limit as f64));
}
