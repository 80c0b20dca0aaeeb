//! What operators do to the jobs of all owners: search, retry, cancel, delete and pause.

use crate::Jobs;
use crate::queue::{Change, Page, Paused, QueueError, Search};
use crate::record::{JobId, Moment, Record, State};
use crate::telemetry;
use futures_util::{StreamExt, stream};
use std::sync::PoisonError;
use std::time::{Duration, Instant};

/// The jobs that are read together, and changed in one transaction, so that others need not wait long
/// for it.
const BATCH: usize = 200;
/// The most jobs that one search reads.
const MAX_READ: usize = 20_000;
/// How long one change goes on.
const CHANGE_TIME: Duration = Duration::from_secs(5);
/// Pictures that are looked for at the same time.
const LOOKUPS: usize = 16;

/// What came of a change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changed {
    /// Jobs that were changed.
    pub jobs: usize,
    /// Failed jobs that cannot be retried, because their picture is not kept.
    pub without_picture: usize,
    /// The job before which the change goes on; `None` when it is done.
    pub next: Option<JobId>,
}

impl Jobs {
    /// Jobs of all owners, newest first: at most `limit`, and fewer on a page for which many others
    /// were read.
    ///
    /// # Errors
    /// When the queue cannot be read.
    pub async fn search(&self, mut search: Search, limit: usize) -> Result<Page, QueueError> {
        let (mut found, mut read, batch) = (Page::default(), 0, limit.max(BATCH));
        loop {
            let page = self.queue.search(search.clone(), batch).await?;
            let now = Moment::now();
            found.damaged.extend(page.damaged);
            let mut jobs = page.jobs.into_iter().filter(|job| search.accepts(job, now)).peekable();
            while let Some(job) = jobs.next_if(|_| found.jobs.len() < limit) {
                found.jobs.push(job);
            }
            read += batch;
            found.next = match jobs.peek() {
                Some(_) => found.jobs.last().map(|job| job.id),
                None => page.next,
            };
            let is_full = jobs.peek().is_some() || found.jobs.len() >= limit;
            if found.next.is_none() || is_full || read >= MAX_READ {
                return Ok(found);
            }
            search.before = found.next;
        }
    }

    /// Changes all jobs that a search finds, in batches, for some seconds at most.
    ///
    /// # Errors
    /// When the queue or, for a retry, the store of blobs fails.
    pub async fn change(&self, mut search: Search, change: Change) -> Result<Changed, QueueError> {
        let (mut changed, until) = (Changed::default(), Instant::now() + CHANGE_TIME);
        loop {
            let page = self.search(search.clone(), BATCH).await?;
            let mut jobs: Vec<JobId> = page.jobs.iter().map(|job| job.id).collect();
            if change == Change::Retry {
                let without = self.without_pictures(&page.jobs).await?;
                changed.without_picture += without.len();
                jobs.retain(|job| !without.contains(job));
            }
            let states = self.queue.change(jobs, change).await?;
            changed.jobs += states.len();
            let is_end = |state: &&State| change != Change::Delete && **state != State::Running;
            states.iter().filter(is_end).for_each(|state| telemetry::job_ended(*state));
            changed.next = page.next;
            if page.next.is_none() || Instant::now() >= until {
                return Ok(changed);
            }
            search.before = page.next;
        }
    }

    /// The failed jobs whose pictures are not there: earlier versions did not keep them.
    async fn without_pictures(&self, jobs: &[Record]) -> Result<Vec<JobId>, QueueError> {
        let failed = jobs.iter().filter(|job| job.state == State::Failed);
        let lookups = failed
            .map(|job| async move { (job.id, self.blobs.has(job.picture.digest).await) })
            .collect::<Vec<_>>();
        let mut found = stream::iter(lookups).buffer_unordered(LOOKUPS);
        let mut without = Vec::new();
        while let Some((job, is_there)) = found.next().await {
            if !is_there? {
                without.push(job);
            }
        }
        Ok(without)
    }

    /// What is paused, as far as this node knows: others follow within the period of sweeps.
    #[must_use]
    pub fn paused(&self) -> Paused {
        *self.paused.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pauses what is set, and resumes the rest.
    ///
    /// # Errors
    /// When the queue cannot be written to.
    pub async fn pause(&self, paused: Paused) -> Result<(), QueueError> {
        self.queue.pause(paused).await?;
        self.learn_paused().await
    }

    /// Learns what is paused, perhaps by another node.
    pub(crate) async fn learn_paused(&self) -> Result<(), QueueError> {
        let paused = self.queue.paused().await?;
        telemetry::paused(paused);
        *self.paused.lock().unwrap_or_else(PoisonError::into_inner) = paused;
        if !paused.work {
            self.queue.watchers().notify_work();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queue::Outcome;
    use crate::testing::{jobs, submit_picture, terms};
    use pixmesh_engine::Owner;
    use serde_json::json;

    #[tokio::test]
    async fn search_follows_filters_that_no_index_serves() {
        let (jobs, _folder) = jobs(terms());
        let (large, _) = submit_picture(&jobs, "a large picture").await;
        for _ in 0..BATCH + 50 {
            submit_picture(&jobs, "small").await;
        }
        let search = Search { least_bytes: 10, ..Search::default() };
        let page = jobs.search(search, 5).await.unwrap();
        assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [large]);
        assert_eq!(page.next, None);
        let (mut search, mut sizes) = (Search::default(), Vec::new());
        loop {
            let page = jobs.search(search.clone(), 100).await.unwrap();
            sizes.push(page.jobs.len());
            search.before = page.next;
            if page.next.is_none() {
                break;
            }
        }
        assert_eq!(sizes, [100, 100, 51]);
    }

    #[tokio::test]
    async fn change_goes_through_all_batches() {
        let (jobs, _folder) = jobs(terms());
        for _ in 0..2 * BATCH + 1 {
            submit_picture(&jobs, "picture").await;
        }
        let changed = jobs.change(Search::default(), Change::Cancel).await.unwrap();
        assert_eq!(changed, Changed { jobs: 2 * BATCH + 1, ..Changed::default() });
        assert_eq!(jobs.queue.stats().await.unwrap().queued, 0);
    }

    #[tokio::test]
    async fn job_without_its_picture_is_not_retried() {
        let (jobs, _folder) = jobs(terms());
        let (_, digest) = submit_picture(&jobs, "picture").await;
        let lease = jobs.queue.claim().await.unwrap().unwrap().lease;
        jobs.queue.finish(lease, Outcome::Failed(json!({}))).await.unwrap();
        jobs.blobs.collector().await.unwrap().delete(digest).await.unwrap();
        let changed = jobs.change(Search::default(), Change::Retry).await.unwrap();
        assert_eq!((changed.jobs, changed.without_picture), (0, 1));
    }

    #[tokio::test]
    async fn nothing_is_accepted_while_intake_is_paused() {
        let (jobs, _folder) = jobs(terms());
        let job = || crate::testing::job(&Owner::Anonymous, "picture");
        jobs.pause(Paused { intake: true, work: false }).await.unwrap();
        let refused = jobs.submit(job(), "picture".into()).await;
        assert_eq!(refused, Err(QueueError::Paused));
        jobs.pause(Paused::default()).await.unwrap();
        assert!(jobs.submit(job(), "picture".into()).await.is_ok());
    }
}
