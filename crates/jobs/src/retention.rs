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

/// The interval of sweeps. Another worker has a job whose worker is gone within its lease and 5 s: this
/// leaves 2 s for a busy machine.
const PERIOD: Duration = Duration::from_secs(3);

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
async fn delete(jobs: &Jobs, blobs: Vec<pixmesh_engine::digest::Digest>) -> Result<(), QueueError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blobs::Blobs;
    use crate::embedded::Embedded;
    use crate::fairness::Caps;
    use crate::folder::DataFolder;
    use crate::folder_for_test;
    use crate::queue::Terms;
    use crate::record::{JobId, NewJob, Picture};
    use bytes::Bytes;
    use pixmesh_engine::Owner;
    use pixmesh_engine::digest::Digest;
    use std::sync::Arc;

    /// Jobs in a folder of their own.
    fn jobs(name: &str) -> Jobs {
        let path = folder_for_test(name);
        let hour = Duration::from_hours(1);
        let caps = Caps { queued: 9, queued_per_owner: 9, running_per_owner: 9 };
        let terms = Terms {
            caps,
            lease: hour,
            result_ttl: hour,
            idempotency_ttl: hour,
            gone_ttl: hour,
            look_again: hour,
        };
        let blobs = Blobs::in_folder(&path.join("blobs")).unwrap();
        let folder = Arc::new(DataFolder::take(&path).unwrap());
        let queue = Arc::new(Embedded::open(folder, terms).unwrap());
        Jobs { queue, blobs, durations: Arc::default() }
    }

    /// A new job with this picture.
    async fn submit(jobs: &Jobs, picture: &'static str) -> (JobId, Digest) {
        let picture = Bytes::from_static(picture.as_bytes());
        let job = NewJob {
            id: JobId::new(),
            owner: Owner::Anonymous,
            order: "density=2".into(),
            picture: Picture::of_bytes(&picture),
            idempotency_key: None,
        };
        let (id, digest) = (job.id, job.picture.digest);
        jobs.submit(job, picture).await.unwrap();
        (id, digest)
    }

    async fn cancel(jobs: &Jobs, id: JobId) {
        jobs.queue.cancel(&Owner::Anonymous, id).await.unwrap();
    }

    #[tokio::test]
    async fn a_new_process_deletes_the_blobs_that_no_job_has() {
        let jobs = jobs("clean");
        let (_, kept) = submit(&jobs, "of a job").await;
        let bytes = Bytes::from_static(b"of none");
        let hold = jobs.blobs.hold().await;
        jobs.blobs.put(&hold, Digest::of(&bytes), bytes).await.unwrap();
        drop(hold);
        assert_eq!(jobs.blobs.all().unwrap().len(), 2);
        clean_up(&jobs).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [kept]);
    }

    #[tokio::test]
    async fn a_picture_is_deleted_when_the_last_job_that_has_it_no_longer_needs_it() {
        let jobs = jobs("sweep");
        let ((first, alone), (second, shared)) =
            (submit(&jobs, "alone").await, submit(&jobs, "shared").await);
        let (third, _) = submit(&jobs, "shared").await;
        cancel(&jobs, first).await;
        cancel(&jobs, second).await;
        assert!(jobs.blobs.all().unwrap().contains(&alone));
        sweep(&jobs).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [shared]);
        cancel(&jobs, third).await;
        // One that is already gone is none that is in the way.
        delete(&jobs, vec![alone]).await.unwrap();
        sweep(&jobs).await.unwrap();
        assert!(jobs.blobs.all().unwrap().is_empty());
        assert!(jobs.queue.sweep().await.unwrap().given_up.is_empty());
    }

    #[tokio::test]
    async fn a_blob_that_a_job_has_again_is_not_deleted() {
        let jobs = jobs("again");
        let (_, digest) = submit(&jobs, "again").await;
        delete(&jobs, vec![digest]).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [digest]);
    }

    #[tokio::test]
    async fn jobs_are_swept_until_that_is_stopped() {
        let jobs = jobs("keep");
        let (id, _) = submit(&jobs, "for a moment").await;
        cancel(&jobs, id).await;
        let stop = CancellationToken::new();
        let kept = tokio::spawn(keep(jobs.clone(), stop.clone()));
        let deleted = async {
            while !jobs.blobs.all().unwrap().is_empty() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(20), deleted).await.unwrap();
        assert!(!kept.is_finished());
        stop.cancel();
        tokio::time::timeout(Duration::from_secs(20), kept).await.unwrap().unwrap();
    }
}
