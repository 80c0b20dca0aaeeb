//! Periodic maintenance: sweeps of the queue, and the deletion of blobs that no job uses.

use crate::Jobs;
use crate::queue::{DELETION_TIME, QueueError, Swept};
use crate::record::State;
use crate::telemetry;
use futures_util::{StreamExt, TryStreamExt, stream};
use pixmesh_engine::digest::Digest;
use std::error::Error;
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;
use tokio_util::sync::CancellationToken;

/// The interval of sweeps. Another worker has a job whose worker is gone within its lease and 5 s:
/// this leaves 2 s for a busy machine.
const PERIOD: Duration = Duration::from_secs(3);

/// Blobs that are deleted at the same time.
const DELETIONS: usize = 8;

/// Deletes the blobs of the last process that no job uses, or sets them aside if jobs were lost. In a
/// store that nodes share, the queue knows these blobs.
///
/// # Errors
/// When the blobs or the queue cannot be read.
pub async fn clean_up(jobs: &Jobs) -> Result<(), Box<dyn Error + Send + Sync>> {
    if jobs.blobs.is_shared() {
        return Ok(());
    }
    let Some(collector) = jobs.blobs.collector().await else { return Ok(()) };
    let blobs = jobs.blobs.clone();
    let stored = spawn_blocking(move || blobs.all()).await??;
    let used = jobs.queue.referenced(stored.clone()).await?;
    for digest in stored.into_iter().filter(|digest| !used.contains(digest)) {
        match jobs.queue.set_aside() {
            Some(aside) => collector.set_aside(digest, aside)?,
            None => collector.delete(digest).await?,
        }
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
        let swept = tokio::select! {
            swept = sweep(&jobs) => swept,
            () = stop.cancelled() => return,
        };
        if let Err(error) = swept {
            tracing::warn!(%error, "sweep of the jobs failed");
        }
    }
}

/// Sweeps in batches until there is nothing left to do: jobs may expire as fast as they came, and
/// each batch is short, because submissions wait for it.
async fn sweep(jobs: &Jobs) -> Result<(), QueueError> {
    jobs.learn_paused().await?;
    loop {
        let Swept { requeued, exhausted, expired, orphans } = jobs.queue.sweep().await?;
        if requeued + exhausted + expired > 0 {
            tracing::info!(requeued, exhausted, expired, "jobs swept");
        }
        for _ in 0..exhausted {
            telemetry::job_ended(State::Failed);
        }
        let deleted = if orphans.is_empty() { 0 } else { delete(jobs, orphans).await? };
        if expired + deleted == 0 {
            break;
        }
    }
    jobs.stored.count(&*jobs.queue).await?;
    let mean_s = jobs.queue.mean_duration_s(jobs.durations.mean_s()).await?;
    telemetry::jobs(&jobs.queue.stats().await?, mean_s);
    Ok(())
}

/// Deletes those of the blobs that no job uses, and returns their number: none during a backup.
async fn delete(jobs: &Jobs, blobs: Vec<Digest>) -> Result<usize, QueueError> {
    let began = Instant::now();
    let Some(collector) = jobs.blobs.collector().await else { return Ok(0) };
    let used = jobs.queue.referenced(blobs.clone()).await?;
    let unused = blobs.into_iter().filter(|blob| !used.contains(blob));
    // Later, another node may store a blob again.
    let in_time = unused.take_while(|_| began.elapsed() < DELETION_TIME);
    let deleting =
        stream::iter(in_time).map(async |blob| collector.delete(blob).await.map(|()| blob));
    let deleted: Vec<Digest> = deleting.buffer_unordered(DELETIONS).try_collect().await?;
    let count = deleted.len();
    jobs.queue.forget(deleted).await?;
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queue::Terms;
    use crate::record::JobId;
    use crate::testing::{jobs, jobs_in, put, submit_picture, terms};
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
    async fn pictures_of_jobs_in_a_damaged_log_are_set_aside() {
        let (jobs, folder) = jobs(terms());
        let (_, first) = submit_picture(&jobs, "first").await;
        let log = folder.path().join("jobs.sqlite3-wal");
        let whole_before = std::fs::read(&log).unwrap().len();
        let (_, second) = submit_picture(&jobs, "second").await;
        // As a process that is killed leaves the files.
        let killed = tempfile::tempdir().unwrap();
        let copied = killed.path();
        for name in ["jobs.sqlite3", "jobs.sqlite3-wal"] {
            std::fs::copy(folder.path().join(name), copied.join(name)).unwrap();
        }
        std::fs::rename(folder.path().join("blobs"), copied.join("blobs")).unwrap();
        let mut bytes = std::fs::read(&log).unwrap();
        bytes[whole_before + 100] ^= 1;
        std::fs::write(copied.join("jobs.sqlite3-wal"), &bytes).unwrap();
        let jobs = jobs_in(copied, terms());
        clean_up(&jobs).await.unwrap();
        assert_eq!(jobs.blobs.all().unwrap(), [first]);
        let aside = jobs.queue.set_aside().unwrap();
        assert!(std::fs::read(aside.join("jobs.sqlite3-wal")).unwrap() == bytes);
        assert_eq!(std::fs::read(aside.join(second.to_string())).unwrap(), b"second");
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
    async fn one_sweep_removes_all_that_has_expired() {
        const COUNT: usize = 1500;
        let (jobs, _folder) = jobs(Terms { result_ttl: Duration::ZERO, ..terms() });
        let cancelled = (0..COUNT).map(|number| {
            let (jobs, text) = (&jobs, Box::leak(format!("picture {number}").into_boxed_str()));
            async move { cancel(jobs, submit_picture(jobs, text).await.0).await }
        });
        futures_util::future::join_all(cancelled).await;
        assert_eq!(jobs.blobs.all().unwrap().len(), COUNT);
        let began = Instant::now();
        sweep(&jobs).await.unwrap();
        println!("{:.0} jobs per second", COUNT as f64 / began.elapsed().as_secs_f64());
        assert!(jobs.blobs.all().unwrap().is_empty());
        let swept = jobs.queue.sweep().await.unwrap();
        assert_eq!((swept.expired, swept.orphans.len()), (0, 0));
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
