//! The metrics of jobs.

use crate::queue::{Paused, Stats};
use crate::record::State;
use metrics::{counter, gauge, histogram};
use pixmesh_engine::declare_metrics;
use std::time::Duration;

declare_metrics! {
    JOBS: Counter "pixmesh_jobs_total" ["state"] "Durable jobs that entered this state";
    JOB_ATTEMPTS: Counter "pixmesh_job_attempts_total" [] "Attempts at durable jobs";
    JOBS_WAITING: Gauge "pixmesh_jobs_queued" [] "Queued durable jobs";
    JOBS_RUNNING: Gauge "pixmesh_jobs_running" [] "Running durable jobs, on all nodes";
    JOBS_WORK: Gauge "pixmesh_jobs_queued_work_seconds" []
        "Estimated seconds of one worker's time for the queued durable jobs, by the recent mean \
         duration of attempts";
    JOB_DURATION: Histogram "pixmesh_job_duration_seconds" []
        "Seconds of an attempt at a durable job";
    JOBS_OLDEST: Gauge "pixmesh_jobs_oldest_queued_age_seconds" []
        "Age of the oldest queued durable job in seconds";
    STORED_BYTES: Gauge "pixmesh_stored_bytes" ["state"]
        "Bytes of the pictures and meshes of durable jobs: those in use, and the limit if there is one";
    DISK_FREE_BYTES: Gauge "pixmesh_disk_free_bytes" ["state"]
        "Bytes of the disk with the data folder: those that are free, and those that new jobs leave \
         free";
    PAUSED: Gauge "pixmesh_jobs_paused" ["what"]
        "1 while an operator has paused the 'intake' of durable jobs, or 'work' on them";
    TRANSACTIONS_LOST: Gauge "pixmesh_transactions_lost" []
        "Transactions of jobs that the last start found damaged in the write-ahead log";
    DATABASE_CONNECTIONS: Gauge "pixmesh_database_connections" ["state"]
        "Connections of this process to the database: those in use, and the limit";
    DATABASE_COMMIT: Gauge "pixmesh_database_commit_seconds" []
        "Seconds that the write of the last sweep took, commit included";
    DATABASE_LAG: Gauge "pixmesh_database_replication_lag_seconds" []
        "Seconds that the slowest standby of the database is behind; 0 if none can be seen";
}

/// Counts a durable job that was submitted.
pub fn job_submitted() {
    counter!(JOBS, "state" => State::Queued.name()).increment(1);
}

/// Counts a durable job that ended, or was queued again.
pub fn job_ended(state: State) {
    counter!(JOBS, "state" => state.name()).increment(1);
}

/// Counts an attempt at a durable job.
pub fn job_attempt() {
    counter!(JOB_ATTEMPTS).increment(1);
}

/// Sets the gauges of the queue. The queued work in seconds is set once a mean duration is known.
pub fn jobs(stats: &Stats, mean_duration_s: Option<f64>) {
    gauge!(JOBS_WAITING).set(stats.queued as f64);
    gauge!(JOBS_RUNNING).set(stats.running as f64);
    gauge!(JOBS_OLDEST).set(stats.oldest_queued_s);
    if let Some(mean_s) = mean_duration_s {
        gauge!(JOBS_WORK).set(stats.queued as f64 * mean_s);
    }
}

/// Sets the gauge of stored bytes.
pub(crate) fn stored_bytes(used: u64, limit: u64) {
    gauge!(STORED_BYTES, "state" => "used").set(used as f64);
    if limit < u64::MAX {
        gauge!(STORED_BYTES, "state" => "limit").set(limit as f64);
    }
}

/// Sets the gauges of what is paused.
pub(crate) fn paused(paused: Paused) {
    for (what, is_paused) in [("intake", paused.intake), ("work", paused.work)] {
        gauge!(PAUSED, "what" => what).set(f64::from(u8::from(is_paused)));
    }
}

/// Sets the gauge of transactions that a start lost.
pub(crate) fn transactions_lost(transactions: usize) {
    gauge!(TRANSACTIONS_LOST).set(transactions as f64);
}

/// Sets the gauge of free space.
pub(crate) fn disk(free: u64, least: u64) {
    gauge!(DISK_FREE_BYTES, "state" => "free").set(free as f64);
    gauge!(DISK_FREE_BYTES, "state" => "least").set(least as f64);
}

/// Sets the gauges of the shared database.
pub(crate) fn database(used: usize, limit: u32, commit: Duration, lag_s: f64) {
    gauge!(DATABASE_CONNECTIONS, "state" => "used").set(used as f64);
    gauge!(DATABASE_CONNECTIONS, "state" => "limit").set(f64::from(limit));
    gauge!(DATABASE_COMMIT).set(commit.as_secs_f64());
    gauge!(DATABASE_LAG).set(lag_s);
}

/// Records the duration of an attempt at a durable job.
pub fn job_duration(duration: Duration) {
    histogram!(JOB_DURATION).record(duration);
}
