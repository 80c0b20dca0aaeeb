//! What is counted of jobs.

use crate::queue::Stats;
use crate::record::State;
use metrics::{counter, gauge, histogram};
use pixmesh_engine::declare_metrics;
use std::time::Duration;

declare_metrics! {
    JOBS: Counter "pixmesh_jobs_total" ["state"] "Durable jobs that came to this state";
    JOB_ATTEMPTS: Counter "pixmesh_job_attempts_total" [] "Attempts at durable jobs";
    JOBS_WAITING: Gauge "pixmesh_jobs_queued" [] "Durable jobs that wait for a worker";
    JOBS_RUNNING: Gauge "pixmesh_jobs_running" [] "Durable jobs that workers have, on all nodes";
    JOBS_WORK: Gauge "pixmesh_jobs_queued_work_seconds" []
        "Seconds of one worker's time that the durable jobs waiting will take, as long as jobs took \
         of late on the node that did the last";
    JOB_DURATION: Histogram "pixmesh_job_duration_seconds" []
        "Seconds that an attempt at a durable job took";
    JOBS_OLDEST: Gauge "pixmesh_jobs_oldest_queued_age_seconds" []
        "Seconds that the oldest durable job waiting has waited";
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

/// So many durable jobs wait, for so long; those that were done of late took so long on average, if
/// there were any: how much work waits is not known before, and none is not said of it.
pub fn jobs(stats: &Stats, mean_duration_s: Option<f64>) {
    gauge!(JOBS_WAITING).set(stats.queued as f64);
    gauge!(JOBS_RUNNING).set(stats.running as f64);
    gauge!(JOBS_OLDEST).set(stats.oldest_queued_s);
    if let Some(mean_s) = mean_duration_s {
        gauge!(JOBS_WORK).set(stats.queued as f64 * mean_s);
    }
}

/// Counts the time that an attempt at a durable job took.
pub fn job_duration(duration: Duration) {
    histogram!(JOB_DURATION).record(duration);
}
