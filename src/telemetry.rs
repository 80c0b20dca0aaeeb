//! The log, and every metric by name.
//!
//! Metrics are in base units, and their names begin with `pixmesh_`, but for the usual `process_`. A label never holds what a
//! client sent: a route is one of the route table or `UNKNOWN`, a method one of HTTP's or `OTHER`.

mod log;
#[cfg(feature = "otlp")]
mod otlp;

pub use log::{Log, adopt, start_log};

use crate::jobs::queue::Stats;
use crate::jobs::record::State;
use metrics::{counter, gauge, histogram};
use metrics_exporter_prometheus::{BuildError, Matcher, PrometheusBuilder, PrometheusHandle};
use std::time::Duration;

/// The route label of a request that matches none.
pub const UNKNOWN_ROUTE: &str = "UNKNOWN";

const HTTP_REQUESTS: &str = "pixmesh_http_requests_total";
const HTTP_DURATION: &str = "pixmesh_http_request_duration_seconds";
const STAGE_DURATION: &str = "pixmesh_stage_duration_seconds";
const REQUESTS_IN_PROGRESS: &str = "pixmesh_requests_in_progress";
const JOBS_IN_PROGRESS: &str = "pixmesh_jobs_in_progress";
const QUEUE_DEPTH: &str = "pixmesh_queue_depth";
const QUEUE_WAIT: &str = "pixmesh_queue_wait_seconds";
const REQUESTS_SHED: &str = "pixmesh_requests_shed_total";
const MEMORY_PERMITS: &str = "pixmesh_memory_permits_mib";
const WORKERS: &str = "pixmesh_workers";
const INPUT_PIXELS: &str = "pixmesh_input_pixels";
const MESH_VERTICES: &str = "pixmesh_mesh_vertices";
const JOBS: &str = "pixmesh_jobs_total";
const JOB_ATTEMPTS: &str = "pixmesh_job_attempts_total";
const JOBS_WAITING: &str = "pixmesh_jobs_queued";
const JOBS_OLDEST: &str = "pixmesh_jobs_oldest_queued_age_seconds";
const PANICS: &str = "pixmesh_panics_total";
const PROCESS_RESIDENT: &str = "process_resident_memory_bytes";
const PROCESS_CPU: &str = "process_cpu_seconds_total";
const PROCESS_FDS: &str = "process_open_fds";
const BUILD_INFO: &str = "pixmesh_build_info";

const DURATION_BUCKETS_S: [f64; 13] =
    [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 30.0];
const SIZE_BUCKETS: [f64; 7] = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8];

/// Sends panics to the log, and counts them.
fn log_panics() {
    std::panic::set_hook(Box::new(|panic| {
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
    gauge!(WORKERS).set(workers as f64);
    let commit = option_env!("PIXMESH_COMMIT").unwrap_or("unknown");
    gauge!(BUILD_INFO, "version" => env!("CARGO_PKG_VERSION"), "commit" => commit).set(1.0);
    requests_in_progress(0.0);
    jobs_in_progress(0.0);
    queue_depth(0);
    Ok(handle)
}

fn describe() {
    use metrics::{describe_counter, describe_gauge, describe_histogram};
    describe_counter!(HTTP_REQUESTS, "Requests answered, by route, method and status");
    describe_histogram!(HTTP_DURATION, "Seconds from a request's header to its answer");
    describe_histogram!(STAGE_DURATION, "Seconds that a stage of the work took");
    describe_gauge!(REQUESTS_IN_PROGRESS, "Requests being received, waiting or worked on");
    describe_gauge!(JOBS_IN_PROGRESS, "Meshes being made");
    describe_gauge!(QUEUE_DEPTH, "Requests that wait for a worker or memory");
    describe_histogram!(QUEUE_WAIT, "Seconds that work waited");
    describe_counter!(REQUESTS_SHED, "Requests turned away because of load, by reason");
    describe_gauge!(MEMORY_PERMITS, "Memory for work and its answers, used and in all, in MiB");
    describe_gauge!(WORKERS, "Meshes that can be made at the same time");
    describe_histogram!(INPUT_PIXELS, "Pixels of the images meshed");
    describe_histogram!(MESH_VERTICES, "Vertices of the meshes made");
    describe_counter!(JOBS, "Durable jobs that came to this state");
    describe_counter!(JOB_ATTEMPTS, "Attempts at durable jobs");
    describe_gauge!(JOBS_WAITING, "Durable jobs that wait for a worker");
    describe_gauge!(JOBS_OLDEST, "Seconds that the oldest durable job waiting has waited");
    describe_counter!(PANICS, "Panics, each a defect");
    describe_gauge!(PROCESS_RESIDENT, "Resident memory of the process in bytes");
    describe_gauge!(PROCESS_FDS, "Files and connections the process has open");
    describe_gauge!(PROCESS_CPU, "Seconds of processor time, of all threads");
    describe_gauge!(BUILD_INFO, "Version of the service, and the commit it was built from");
}

/// Why a request was turned away.
#[derive(Clone, Copy, Debug)]
pub enum Shed {
    /// The queue holds as many seconds of work as it may.
    QueueFull,
    /// Bodies take all of their memory.
    Memory,
    /// The work's deadline passed.
    Deadline,
    /// The key's quota is used up.
    Quota,
}

/// Counts a request turned away.
pub fn shed(reason: Shed) {
    let reason = match reason {
        Shed::QueueFull => "queue_full",
        Shed::Memory => "memory",
        Shed::Deadline => "deadline",
        Shed::Quota => "quota",
    };
    counter!(REQUESTS_SHED, "reason" => reason).increment(1);
}

/// Counts an answered request.
pub fn answered(route: &str, method: &'static str, code: u16, duration: Duration) {
    let (route, code) = (route.to_owned(), code.to_string());
    histogram!(HTTP_DURATION, "route" => route.clone()).record(duration);
    counter!(HTTP_REQUESTS, "route" => route, "method" => method, "code" => code).increment(1);
}

/// Counts the time that a stage took.
pub fn stage(name: &'static str, duration: Duration) {
    histogram!(STAGE_DURATION, "stage" => name).record(duration);
}

/// Counts the time that work waited.
pub fn queue_wait(duration: Duration) {
    histogram!(QUEUE_WAIT).record(duration);
}

/// Counts a mesh made.
pub fn meshed(pixels: usize, vertices: usize) {
    histogram!(INPUT_PIXELS).record(pixels as f64);
    histogram!(MESH_VERTICES).record(vertices as f64);
}

/// One request more (1) or less (-1).
pub fn requests_in_progress(change: f64) {
    gauge!(REQUESTS_IN_PROGRESS).increment(change);
}

/// One piece of work more (1) or less (-1).
pub fn jobs_in_progress(change: f64) {
    gauge!(JOBS_IN_PROGRESS).increment(change);
}

/// So many requests wait.
pub fn queue_depth(depth: usize) {
    gauge!(QUEUE_DEPTH).set(depth as f64);
}

/// Counts a durable job that was submitted.
pub fn job_submitted() {
    counter!(JOBS, "state" => State::Queued.name()).increment(1);
}

/// Counts a durable job that came to an end, or back to those that wait.
pub fn job_ended(state: State) {
    counter!(JOBS, "state" => state.name()).increment(1);
}

/// Counts an attempt at a durable job.
pub fn job_attempt() {
    counter!(JOB_ATTEMPTS).increment(1);
}

/// So many durable jobs wait, for so long.
pub fn jobs(stats: &Stats) {
    gauge!(JOBS_WAITING).set(stats.queued as f64);
    gauge!(JOBS_OLDEST).set(stats.oldest_queued_s);
}

/// What the system knows of this process: resident memory, processor time and open files.
pub fn process() {
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
}

/// So much memory there is for work.
pub fn memory_total_mib(total: usize) {
    gauge!(MEMORY_PERMITS, "state" => "total").set(total as f64);
    memory_used_mib(0.0);
}

/// So much more memory is used for work, or less when negative.
pub fn memory_used_mib(change: f64) {
    gauge!(MEMORY_PERMITS, "state" => "used").increment(change);
}
