//! The queue in an SQLite database of this process.
//!
//! All writes go through one [`writer`] thread, which commits what has arrived within two
//! milliseconds together and syncs it (`synchronous=FULL`); readers have connections of their own
//! and see what was committed. The folder belongs to one process, so that a job that a new process
//! finds running has lost its worker, and waits again at once. Leases are measured by the process's
//! own clock, which no change of the system's time moves.

mod claim;
mod finish;
mod read;
mod readers;
mod row;
mod schema;
mod submit;
mod sweep;
pub(crate) mod watchers;
mod writer;

use super::folder::DataFolder;
use super::queue::{
    Cancellation, Claim, Finish, Lease, Lookup, Outcome, Page, PageRequest, Queue, QueueError,
    Renewal, Stats, Submitted, Swept, Terms,
};
use super::record::{Event, JobId, NewJob, Progress};
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use readers::Readers;
use std::collections::HashSet;
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;
use watchers::Watchers;
use writer::Writer;

/// The name of the database in its folder.
const DATABASE: &str = "jobs.sqlite3";

/// The queue, and the folder that it is in.
#[derive(Debug)]
pub struct Embedded {
    terms: Terms,
    writer: Writer,
    readers: Readers,
    watchers: Arc<Watchers>,
    /// What leases are measured from.
    began: Instant,
    _folder: Arc<DataFolder>,
}

impl Embedded {
    /// Opens the queue in a folder, makes it where there is none, and lets jobs wait again that
    /// were running when the last process ended.
    ///
    /// # Errors
    /// When the database cannot be opened or written to.
    pub fn open(folder: Arc<DataFolder>, terms: Terms) -> Result<Self, Box<dyn Error>> {
        let path = folder.path().join(DATABASE);
        let connection = schema::open(&path).map_err(|error| {
            format!("the database of jobs {} cannot be used: {error}", path.display())
        })?;
        sweep::recover(&connection, terms.result_ttl)?;
        let watchers = Arc::new(Watchers::default());
        let writer = Writer::start(connection, Arc::clone(&watchers))?;
        let (readers, began) = (Readers::new(path), Instant::now());
        Ok(Self { terms, writer, readers, watchers, began, _folder: folder })
    }

    /// The end of a lease that begins now.
    fn lease_end_ms(&self) -> i64 {
        self.now_ms() + self.terms.lease.as_millis() as i64
    }

    /// Milliseconds of the process's own clock.
    fn now_ms(&self) -> i64 {
        self.began.elapsed().as_millis() as i64
    }
}

#[async_trait]
impl Queue for Embedded {
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError> {
        let terms = self.terms;
        self.writer.write(move |write| submit::submit(write, &job, &terms)).await
    }

    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        let owner = owner.clone();
        self.readers.read(move |connection| read::get(connection, &owner, id)).await
    }

    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError> {
        let owner = owner.clone();
        self.readers.read(move |connection| read::list(connection, &owner, request)).await
    }

    async fn work(&self) {
        let _ = tokio::time::timeout(self.terms.look_again, self.watchers.work()).await;
    }

    async fn claim(&self) -> Result<Option<Claim>, QueueError> {
        let (caps, ttl, lease_end_ms) =
            (self.terms.caps, self.terms.result_ttl, self.lease_end_ms());
        self.writer.write(move |write| claim::claim(write, &caps, ttl, lease_end_ms)).await
    }

    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError> {
        let lease_end_ms = self.lease_end_ms();
        self.writer
            .write(move |write| claim::renew(write, lease, progress.as_ref(), lease_end_ms))
            .await
    }

    async fn interruption(&self, lease: Lease) -> Renewal {
        let mut changes = self.watchers.subscribe(lease.job);
        loop {
            let standing = self.readers.read(move |connection| read::standing(connection, lease));
            match standing.await {
                Ok(Renewal::Ok) => changes.changed().await,
                Ok(interruption) => return interruption,
                Err(error) => {
                    tracing::warn!(%error, "whether a job goes on cannot be read");
                    tokio::time::sleep(self.terms.look_again).await;
                }
            }
        }
    }

    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError> {
        let ttl = self.terms.result_ttl;
        self.writer.write(move |write| finish::finish(write, lease, &outcome, ttl)).await
    }

    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError> {
        let (owner, ttl) = (owner.clone(), self.terms.result_ttl);
        self.writer.write(move |write| finish::cancel(write, &owner, id, ttl)).await
    }

    async fn events(&self, owner: &Owner, id: JobId, after: u64) -> Result<Vec<Event>, QueueError> {
        let mut changes = self.watchers.subscribe(id);
        loop {
            let owner = owner.clone();
            let read =
                self.readers.read(move |connection| read::events(connection, &owner, id, after));
            let (events, more_may_come) = read.await?;
            if !events.is_empty() || !more_may_come {
                return Ok(events);
            }
            changes.changed().await;
        }
    }

    async fn stats(&self) -> Result<Stats, QueueError> {
        self.readers.read(read::stats).await
    }

    async fn sweep(&self) -> Result<Swept, QueueError> {
        let (terms, now_ms) = (self.terms, self.now_ms());
        self.writer.write(move |write| sweep::sweep(write, &terms, now_ms)).await
    }

    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError> {
        self.readers.read(move |connection| read::referenced(connection, blobs)).await
    }

    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError> {
        self.writer.write(move |write| sweep::forget(write, &blobs)).await
    }

    fn is_healthy(&self) -> bool {
        self.writer.is_healthy()
    }
}

#[cfg(test)]
mod tests;
