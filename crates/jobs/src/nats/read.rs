//! What clients ask of jobs, and how they end them.

use super::Nats;
use super::records::Step;
use super::stored::StoredJob;
use super::streams::{gone_name, job_of_name, owner_word, record_name, work_name};
use super::table::{Expected, Versioned};
use crate::queue::{Cancellation, Lookup, Outcome, Page, PageRequest, QueueError};
use crate::record::{Event, JobId, Moment, Record, State};
use futures_util::{StreamExt, TryStreamExt, stream};
use pixmesh_engine::Owner;
use serde::{Deserialize, Serialize};
use std::time::Duration;
use tokio::time::timeout;

/// How many records are read at the same time for a list.
const READ_AHEAD: usize = 16;

/// That there was a job.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct StoredEnd {
    until_ms: i64,
}

impl StoredEnd {
    /// It is remembered for so long.
    pub(super) fn after(ttl: Duration) -> Self {
        let kept_ms = i64::try_from(ttl.as_millis()).unwrap_or(i64::MAX);
        Self { until_ms: Moment::now().0.saturating_add(kept_ms) }
    }
}

impl Nats {
    /// An owner's job.
    pub(super) async fn look_up(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        match self.record(owner, id).await? {
            Some(found) if found.value.is_over() => Ok(Lookup::Gone),
            Some(found) => match found.value.record(id) {
                Some(record) => Ok(Lookup::Found(Box::new(record))),
                None => Err(unreadable(id)),
            },
            None if self.was_there(owner, id).await? => Ok(Lookup::Gone),
            None => Ok(Lookup::Unknown),
        }
    }

    async fn was_there(&self, owner: &Owner, id: JobId) -> Result<bool, QueueError> {
        let end = self.streams.gone.get_readable::<StoredEnd>(&gone_name(owner, id)).await?;
        // One that cannot be read is of a job that there was, too.
        let is_known = |end: StoredEnd| end.until_ms > Moment::now().0;
        Ok(end.is_some_and(|end| end.value.is_none_or(is_known)))
    }

    /// An owner's jobs, newest first; what cannot be read is left out.
    pub(super) async fn page(
        &self,
        owner: &Owner,
        request: PageRequest,
    ) -> Result<Page, QueueError> {
        let names = self.streams.jobs.names(&format!("job.{}.*", owner_word(owner))).await?;
        let ids = names.iter().filter_map(|name| job_of_name(name)).map(|(_, id)| id);
        let mut ids: Vec<JobId> =
            ids.filter(|id| request.before.is_none_or(|before| *id < before)).collect();
        ids.sort_unstable_by(|a, b| b.cmp(a));
        let mut records = stream::iter(ids)
            .map(|id| async move { Ok((id, self.readable_record(owner, id).await?)) })
            .buffered(READ_AHEAD);
        let mut jobs: Vec<Record> = Vec::new();
        while let Some((id, found)) = records.try_next().await? {
            let kept = found.map(|found| found.value).filter(|job| !job.is_over());
            let Some(record) = kept.and_then(|job| job.record(id)) else { continue };
            if request.state.is_some_and(|state| state != record.state) {
                continue;
            }
            if jobs.len() == request.limit {
                let next = jobs.last().map(|job| job.id);
                return Ok(Page { jobs, next });
            }
            jobs.push(record);
        }
        Ok(Page { jobs, next: None })
    }

    /// What happened to a job after a revision; waits until something has.
    pub(super) async fn events_after(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<Vec<Event>, QueueError> {
        let mut changes = self.follow(id).await?;
        loop {
            let Some(Versioned { value, .. }) = self.record(owner, id).await? else {
                return Ok(Vec::new());
            };
            if value.is_over() {
                return Ok(Vec::new());
            }
            let events = value.events(after);
            if !events.is_empty() || value.is_final() {
                return Ok(events);
            }
            let _ = timeout(self.terms.look_again, changes.next()).await;
        }
    }

    /// Cancels an owner's job, or deletes it where it has come to its end or cannot be read.
    pub(super) async fn cancel_job(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Cancellation, QueueError> {
        let ttl = self.terms.result_ttl;
        let changed = self
            .change(owner, id, None, |job| match job.state() {
                _ if job.is_over() => Step::Leave(Cancellation::Gone),
                Some(State::Queued) => {
                    job.end(&Outcome::Cancelled, ttl);
                    Step::Store(Cancellation::Cancelled)
                }
                Some(State::Running) if job.is_cancel_requested() => {
                    Step::Leave(Cancellation::Requested)
                }
                Some(State::Running) => {
                    job.request_cancellation();
                    Step::Store(Cancellation::Requested)
                }
                _ => Step::Leave(Cancellation::Deleted),
            })
            .await;
        if let Err(QueueError::Damaged(_)) = changed {
            self.delete_damaged(owner, id).await?;
            self.announce(id).await;
            return Ok(Cancellation::Deleted);
        }
        let Some((cancellation, record)) = changed? else {
            let is_gone = self.was_there(owner, id).await?;
            return Ok(if is_gone { Cancellation::Gone } else { Cancellation::Unknown });
        };
        match cancellation {
            Cancellation::Cancelled => {
                self.let_go(id, &record.value).await?;
                self.streams.work.take_away(&work_name(owner, id)).await?;
            }
            Cancellation::Deleted => self.delete(owner, id, &record.value).await?,
            _ => {}
        }
        self.announce(id).await;
        Ok(cancellation)
    }

    /// Leaves nothing of a job that has ended but the blobs that are given up.
    pub(super) async fn delete(
        &self,
        owner: &Owner,
        id: JobId,
        job: &StoredJob,
    ) -> Result<(), QueueError> {
        // The word first: one that is there without its job is a submission to be completed.
        if let Some(word) = job.word() {
            self.streams.words.remove(word).await?;
        }
        self.streams.jobs.remove(&record_name(owner, id)).await?;
        for blob in job.blobs() {
            self.release(blob, id).await?;
        }
        Ok(())
    }

    /// Keeps of a job past its time nothing but that it was.
    pub(super) async fn expire(
        &self,
        owner: &Owner,
        id: JobId,
        job: &StoredJob,
    ) -> Result<(), QueueError> {
        let end = StoredEnd::after(self.terms.gone_ttl);
        self.streams.gone.put(&gone_name(owner, id), &end, Expected::Anything).await?;
        self.delete(owner, id, job).await?;
        self.announce(id).await;
        Ok(())
    }
}

/// The error of a record that says what no job can have.
pub(super) fn unreadable(id: JobId) -> QueueError {
    QueueError::Damaged(format!("the record of job {id}"))
}
