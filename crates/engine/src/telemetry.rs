//! What the engine counts, under the names of the [`METRICS`].
//!
//! The counts go to the recorder that the program around the engine has installed, if there is one.

use metrics::{counter, gauge, histogram};
use std::time::Duration;

/// What kind of numbers a metric has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Only grows, until the process ends.
    Counter,
    /// Goes up and down.
    Gauge,
    /// Counts values by size.
    Histogram,
}

/// One metric.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Its name, with its unit.
    pub name: &'static str,
    /// Its kind.
    pub kind: Kind,
    /// The names of its labels.
    pub labels: &'static [&'static str],
    /// What it means.
    pub meaning: &'static str,
}

/// Declares constants for the names of metrics, and the table of all of them.
#[macro_export]
macro_rules! declare_metrics {
    ($($id:ident: $kind:ident $name:literal $labels:tt $meaning:literal;)*) => {
        $(#[doc = $meaning] pub const $id: &str = $name;)*
        /// All of them.
        pub const METRICS: &[$crate::telemetry::Metric] = &[$($crate::telemetry::Metric {
            name: $name,
            kind: $crate::telemetry::Kind::$kind,
            labels: &$labels,
            meaning: $meaning,
        },)*];
    };
}

declare_metrics! {
    STAGE_DURATION: Histogram "pixmesh_stage_duration_seconds" ["stage"]
        "Seconds of each stage of a task";
    TASKS_IN_PROGRESS: Gauge "pixmesh_jobs_in_progress" [] "Running tasks, of requests and of jobs";
    QUEUE_DEPTH: Gauge "pixmesh_queue_depth" [] "Requests queued for a worker or for memory";
    QUEUE_WAIT: Histogram "pixmesh_queue_wait_seconds" [] "Seconds from admission of a task to its start";
    REQUESTS_SHED: Counter "pixmesh_requests_shed_total" ["reason"]
        "Requests refused because of load or quotas, by reason";
    MEMORY_PERMITS: Gauge "pixmesh_memory_permits_mib" ["state"]
        "MiB of memory for tasks and their responses: used, and the limit";
    INPUT_PIXELS: Histogram "pixmesh_input_pixels" [] "Pixels of meshed images";
    MESH_VERTICES: Histogram "pixmesh_mesh_vertices" [] "Vertices of generated meshes";
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
    /// Jobs keep as many bytes as they may.
    Storage,
}

/// Sets to zero what a scrape shall find before the first task.
pub fn start() {
    tasks_in_progress(0.0);
    queue_depth(0);
}

/// Counts a request turned away.
pub fn shed(reason: Shed) {
    let reason = match reason {
        Shed::QueueFull => "queue_full",
        Shed::Memory => "memory",
        Shed::Deadline => "deadline",
        Shed::Quota => "quota",
        Shed::Storage => "storage",
    };
    counter!(REQUESTS_SHED, "reason" => reason).increment(1);
}

/// Counts the time that a stage took.
pub(crate) fn stage(name: &'static str, duration: Duration) {
    histogram!(STAGE_DURATION, "stage" => name).record(duration);
}

/// Counts the time that a task waited.
pub(crate) fn queue_wait(duration: Duration) {
    histogram!(QUEUE_WAIT).record(duration);
}

/// Counts a mesh made.
pub(crate) fn meshed(pixels: usize, vertices: usize) {
    histogram!(INPUT_PIXELS).record(pixels as f64);
    histogram!(MESH_VERTICES).record(vertices as f64);
}

/// One task more (1) or less (-1).
pub(crate) fn tasks_in_progress(change: f64) {
    gauge!(TASKS_IN_PROGRESS).increment(change);
}

/// So many requests wait.
pub(crate) fn queue_depth(depth: usize) {
    gauge!(QUEUE_DEPTH).set(depth as f64);
}

/// So much memory there is for work.
pub(crate) fn memory_total_mib(total: usize) {
    gauge!(MEMORY_PERMITS, "state" => "total").set(total as f64);
    memory_used_mib(0.0);
}

/// So much more memory is used for work, or less when negative.
pub(crate) fn memory_used_mib(change: f64) {
    gauge!(MEMORY_PERMITS, "state" => "used").increment(change);
}
