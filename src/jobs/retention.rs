//! Deletes what is no longer kept, and takes jobs from workers that fell silent.

use super::Jobs;
use super::queue::{QueueError, Swept};
use super::record::State;
use crate::telemetry;
use std::collections::HashSet;
use std::error::Error;
use std::time::Duration;
use tokio::task::spawn_blocking;
use tokio_util::sync::CancellationToken;

/// How often it is looked for what is due.
const PERIOD: Duration = Duration::from_secs(5);

/// Deletes blobs that the last process stored for no job; in a store that nodes share, the queue
/// knows of them.
///
/// # Errors
/// When the blobs or the queue cannot be read.
pub async fn clean_up(jobs: &Jobs) -> Result<(), Box<dyn Error + Send + Sync>> {
    if jobs.blobs.is_shared() {
        return Ok(());
    }
    let clearing = jobs.blobs.clear().await;
    let blobs = jobs.blobs.clone();
    let stored = spawn_blocking(move || blobs.all()).await??;
    let kept = jobs.queue.referenced(stored.clone()).await?;
    for digest in stored.into_iter().filter(|digest| !kept.contains(digest)) {
        clearing.delete(digest).await?;
    }
    Ok(())
}

/// Sweeps again and again until `stop`.
pub async fn keep(jobs: Jobs, stop: CancellationToken) {
    let mut ticks = tokio::time::interval(PERIOD);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = stop.cancelled() => return,
        }
        jobs.blobs.probe().await;
        if let Err(error) = sweep(&jobs).await {
            tracing::warn!(%error, "jobs could not be swept");
        }
    }
}

/// Does what is due.
async fn sweep(jobs: &Jobs) -> Result<(), QueueError> {
    let Swept { requeued, exhausted, expired, given_up } = jobs.queue.sweep().await?;
    if requeued + exhausted + expired > 0 {
        tracing::info!(requeued, exhausted, expired, "swept jobs");
    }
    for _ in 0..exhausted {
        telemetry::job_ended(State::Failed);
    }
    if !given_up.is_empty() {
        delete(jobs, given_up).await?;
    }
    let mean_s = jobs.queue.mean_duration_s(jobs.durations.mean_s()).await?;
    telemetry::jobs(&jobs.queue.stats().await?, mean_s);
    Ok(())
}

/// Deletes those of the blobs that no job has.
async fn delete(jobs: &Jobs, blobs: Vec<crate::digest::Digest>) -> Result<(), QueueError> {
    let clearing = jobs.blobs.clear().await;
    let kept: HashSet<_> = jobs.queue.referenced(blobs.clone()).await?;
    let unused: Vec<_> = blobs.into_iter().filter(|blob| !kept.contains(blob)).collect();
    let mut seen_to = Vec::new();
    for blob in unused {
        if clearing.delete(blob).await? {
            seen_to.push(blob);
        }
    }
    jobs.queue.forget(seen_to).await
}
