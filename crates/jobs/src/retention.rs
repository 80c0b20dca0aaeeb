//! Periodic maintenance: sweeps of the queue, and the deletion of blobs that no job uses.

use crate::Jobs;
use crate::queue::{DELETION_TIME, QueueError, Swept};
use crate::record::State;
use crate::telemetry;
use pixmesh_engine::digest::Digest;
use std::error::Error;
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;
use tokio_util::sync::CancellationToken;

/// The interval of sweeps. Another worker has a job whose worker is gone within its lease and 5 s:
/// this leaves 2 s for a busy machine.
const PERIOD: Duration = Duration::from_secs(3);

/// Deletes the blobs of the last process that no job uses. In a store that nodes share, the queue
/// knows these blobs.
///
/// # Errors
/// When the blobs or the queue cannot be read.
pub async fn clean_up(jobs: &Jobs) -> Result<(), Box<dyn Error + Send + Sync>> {
    if jobs.blobs.is_shared() {
        return Ok(());
    }
    let collector = jobs.blobs.collector().await;
    let blobs = jobs.blobs.clone();
    let stored = spawn_blocking(move || blobs.all()).await??;
    let used = jobs.queue.referenced(stored.clone()).await?;
    for digest in stored.into_iter().filter(|digest| !used.contains(digest)) {
        collector.delete(digest).await?;
    }
    Ok(())
}

/// Sweeps periodically until `stop`.
pub async fn run(jobs: Jobs, stop: CancellationToken) {
    let mut ticks = tokio::time::interval(PERIOD);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = stop.cancelled() => return,
        }
        jobs.blobs.probe().await;
        if let Err(error) = sweep(&jobs).await {
            tracing::warn!(%error, "sweep of the jobs failed");
        }
    }
}

async fn sweep(jobs: &Jobs) -> Result<(), QueueError> {
    let Swept { requeued, exhausted, expired, orphans } = jobs.queue.sweep().await?;
    if requeued + exhausted + expired > 0 {
        tracing::info!(requeued, exhausted, expired, "jobs swept");
    }
    for _ in 0..exhausted {
        telemetry::job_ended(State::Failed);
    }
    if !orphans.is_empty() {
        delete(jobs, orphans).await?;
    }
    let mean_s = jobs.queue.mean_duration_s(jobs.durations.mean_s()).await?;
    telemetry::jobs(&jobs.queue.stats().await?, mean_s);
    Ok(())
}

/// Deletes those of the blobs that no job uses.
async fn delete(jobs: &Jobs, blobs: Vec<Digest>) -> Result<(), QueueError> {
    let began = Instant::now();
    let collector = jobs.blobs.collector().await;
    let used = jobs.queue.referenced(blobs.clone()).await?;
    let mut deleted = Vec::new();
    for blob in blobs.into_iter().filter(|blob| !used.contains(blob)) {
        // Later, another node may store the blob again.
        if began.elapsed() < DELETION_TIME {
            collector.delete(blob).await?;
            deleted.push(blob);
        }
    }
    jobs.queue.forget(deleted).await
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::JobId;
    use crate::testing::{jobs, put, submit_picture, terms};
    use pixmesh_engine::Owner;

    async fn cancel(jobs: &Jobs, id: JobId) {
        jobs.queue.cancel(&Owner::Anonymous, id).await.unwrap();
    }

    #[tokio::test]
    async fn new_process_deletes_unused_blobs() {
        let (jobs, _folder) = jobs(terms());
        let (_, used) = submit_picture(&jobs, "of a job").await;
        put(&jobs.blobs, b"of no job").await;
        assert_eq!(jobs.blobs.all().unwrap().len(), 2);
        clean_up(&jobs).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [used]);
    }

    #[tokio::test]
    async fn picture_is_deleted_after_its_last_job() {
        let (jobs, _folder) = jobs(terms());
        let ((first, alone), (second, shared)) =
            (submit_picture(&jobs, "alone").await, submit_picture(&jobs, "shared").await);
        let (third, _) = submit_picture(&jobs, "shared").await;
        cancel(&jobs, first).await;
        cancel(&jobs, second).await;
        assert!(jobs.blobs.all().unwrap().contains(&alone));
        sweep(&jobs).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [shared]);
        cancel(&jobs, third).await;
        // A blob that is deleted already is not an error.
        delete(&jobs, vec![alone]).await.unwrap();
        sweep(&jobs).await.unwrap();
        assert!(jobs.blobs.all().unwrap().is_empty());
        assert!(jobs.queue.sweep().await.unwrap().orphans.is_empty());
    }

    #[tokio::test]
    async fn used_blob_is_not_deleted() {
        let (jobs, _folder) = jobs(terms());
        let (_, digest) = submit_picture(&jobs, "again").await;
        delete(&jobs, vec![digest]).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [digest]);
    }

    #[tokio::test]
    async fn sweeps_run_until_stopped() {
        let (jobs, _folder) = jobs(terms());
        let (id, _) = submit_picture(&jobs, "for a moment").await;
        cancel(&jobs, id).await;
        let stop = CancellationToken::new();
        let running = tokio::spawn(run(jobs.clone(), stop.clone()));
        let deleted = async {
            while !jobs.blobs.all().unwrap().is_empty() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(20), deleted).await.unwrap();
        assert!(!running.is_finished());
        stop.cancel();
        tokio::time::timeout(Duration::from_secs(20), running).await.unwrap().unwrap();
    }
}
