//! The queue in an SQLite database of this process.
//!
//! | module | what |
//! |---|---|
//! | [`schema`] | the tables, and the connections to the database |
//! | [`rows`] | columns as values |
//! | [`log_damage`] | whether the write-ahead log is whole, before it is opened |
//! | [`writer`] | the thread that writes, in transactions that commands share |
//! | [`readers`] | connections that read |
//! | [`submit`], [`claim`], [`finish`], [`sweep`], [`read`] | the operations on jobs |
//! | [`backup`] | copies a folder that is in use, and checks one |
//!
//! Every commit is synced (`synchronous=FULL`). The folder belongs to one process: a new process
//! requeues the jobs that it finds running, because their worker is gone. Leases are measured by
//! the process's own clock, which does not follow changes of the system's time.

mod backup;
mod claim;
mod finish;
mod log_damage;
mod read;
mod readers;
mod rows;
mod schema;
mod submit;
mod sweep;
mod writer;

pub use backup::{Findings, back_up, check};

use crate::folder::DataFolder;
use crate::queue::{
    Cancellation, Change, Claim, Finish, Lease, Lookup, Outcome, Page, PageRequest, Paused, Queue,
    QueueError, Renewal, Search, Stats, Submitted, Swept, Terms,
};
use crate::record::{Event, JobId, Moment, NewJob, Progress, State};
use crate::telemetry;
use crate::transition::Status;
use crate::watchers::Watchers;
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use readers::Readers;
use std::collections::HashSet;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use writer::{Write, Writer};

/// The name of the database in its folder.
const DATABASE: &str = "jobs.sqlite3";
/// Notifications within a process are not lost. Polling only repeats reads that failed.
const POLL_PERIOD: Duration = Duration::from_secs(10);

/// The queue in a data folder.
#[derive(Debug)]
pub struct Embedded {
    terms: Terms,
    writer: Writer,
    readers: Readers,
    watchers: Arc<Watchers>,
    /// The owner of the last claim.
    last_owner: Arc<Mutex<String>>,
    /// The zero of the process's own clock.
    started: Instant,
    folder: Arc<DataFolder>,
    /// Where what belongs to lost jobs is kept, if the log was damaged.
    set_aside: Option<PathBuf>,
}

impl Embedded {
    /// Opens the queue in a folder, creates it if there is none, and requeues the jobs that were
    /// running when the last process ended.
    ///
    /// # Errors
    /// When the database cannot be opened or written to.
    pub fn open(folder: Arc<DataFolder>, terms: Terms) -> Result<Self, Box<dyn Error>> {
        let path = folder.path().join(DATABASE);
        let set_aside = set_aside_damaged_log(&folder)?;
        let connection = schema::open(&path).map_err(|error| {
            format!("the database of jobs {} cannot be used: {error}", path.display())
        })?;
        if set_aside.is_some() {
            // What is left of the dropped frames would be found again.
            connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))?;
        }
        sweep::recover(&connection, &terms)?;
        folder.watch(&[DATABASE, "blobs"]);
        let watchers = Arc::new(Watchers::default());
        let writer = Writer::start(connection, Arc::clone(&watchers))?;
        let (readers, last_owner, started) = (Readers::new(path), Arc::default(), Instant::now());
        Ok(Self { terms, writer, readers, watchers, last_owner, started, folder, set_aside })
    }

    /// Writes what makes room sooner or later, on a full disk with the space that is kept back.
    async fn write<T: Send + 'static>(
        &self,
        write: impl FnOnce(&mut Write<'_>) -> rusqlite::Result<T> + Clone + Send + 'static,
    ) -> Result<T, QueueError> {
        match self.writer.write(write.clone()).await {
            Err(QueueError::StorageFull(_)) => {
                // Another write may have released the space since.
                self.folder.release_reserve();
                self.writer.write(write).await
            }
            written => written,
        }
    }

    /// Milliseconds of the process's own clock.
    fn own_now(&self) -> i64 {
        self.started.elapsed().as_millis() as i64
    }

    /// The end of a lease that starts now.
    fn lease_end(&self) -> i64 {
        self.own_now() + self.terms.lease.as_millis() as i64
    }
}

/// Copies a damaged log before SQLite drops a part of it, and returns the folder of the copy.
fn set_aside_damaged_log(folder: &DataFolder) -> Result<Option<PathBuf>, Box<dyn Error>> {
    let log = folder.path().join(format!("{DATABASE}-wal"));
    let log_damage::Dropped { frames, transactions } = log_damage::dropped(&log)?;
    telemetry::transactions_lost(transactions);
    if transactions == 0 {
        return Ok(None);
    }
    let aside = folder.path().join(format!("set-aside-{}", Moment::now().0));
    let copied =
        fs::create_dir(&aside).and_then(|()| fs::copy(&log, aside.join(format!("{DATABASE}-wal"))));
    tracing::error!(
        frames,
        transactions,
        folder = %aside.display(),
        ?copied,
        "the write-ahead log of the jobs is damaged: the changes of its last transactions are lost; \
         the log, and pictures and meshes without a job, are set aside"
    );
    Ok(Some(aside))
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

    async fn claim(&self) -> Result<Option<Claim>, QueueError> {
        let (terms, last, end) = (self.terms, Arc::clone(&self.last_owner), self.lease_end());
        self.write(move |write| claim::claim(write, &last, &terms, end)).await
    }

    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError> {
        let end = self.lease_end();
        self.write(move |write| claim::renew(write, lease, progress.as_ref(), end)).await
    }

    async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError> {
        let read = self.readers.read(move |connection| read::status(connection, lease.job));
        read.await.map(|status| Status::renewal(status, lease))
    }

    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError> {
        let terms = self.terms;
        self.write(move |write| finish::finish(write, lease, &outcome, &terms)).await
    }

    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError> {
        let (owner, terms) = (owner.clone(), self.terms);
        self.write(move |write| finish::cancel(write, &owner, id, &terms)).await
    }

    async fn search(&self, search: Search, limit: usize) -> Result<Page, QueueError> {
        self.readers.read(move |connection| read::search(connection, &search, limit)).await
    }

    async fn change(&self, jobs: Vec<JobId>, change: Change) -> Result<Vec<State>, QueueError> {
        let terms = self.terms;
        self.write(move |write| finish::change(write, &jobs, change, &terms)).await
    }

    async fn paused(&self) -> Result<Paused, QueueError> {
        self.readers.read(read::paused).await
    }

    async fn pause(&self, paused: Paused) -> Result<(), QueueError> {
        self.write(move |write| finish::pause(write, paused)).await
    }

    async fn events_now(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<(Vec<Event>, bool), QueueError> {
        let owner = owner.clone();
        self.readers.read(move |connection| read::events(connection, &owner, id, after)).await
    }

    async fn stats(&self) -> Result<Stats, QueueError> {
        self.readers.read(read::stats).await
    }

    async fn sweep(&self) -> Result<Swept, QueueError> {
        let (terms, own_now) = (self.terms, self.own_now());
        let swept = self.write(move |write| sweep::sweep(write, &terms, own_now)).await;
        self.folder.restore_reserve();
        self.folder.report();
        swept
    }

    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError> {
        self.readers.read(move |connection| read::referenced(connection, blobs)).await
    }

    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError> {
        self.write(move |write| sweep::forget(write, &blobs)).await
    }

    fn check_room(&self) -> Result<(), QueueError> {
        self.folder.check_room()
    }

    async fn stored_bytes(&self) -> Result<Vec<(Owner, u64)>, QueueError> {
        self.readers.read(read::stored_bytes).await
    }

    fn release_reserve(&self) {
        self.folder.release_reserve();
    }

    fn is_healthy(&self) -> bool {
        self.writer.is_healthy() && self.folder.has_reserve() && self.folder.is_in_place()
    }

    fn set_aside(&self) -> Option<&Path> {
        self.set_aside.as_deref()
    }

    fn watchers(&self) -> &Arc<Watchers> {
        &self.watchers
    }

    fn poll_period(&self) -> Duration {
        POLL_PERIOD.max(self.terms.poll_period)
    }
}

#[cfg(test)]
mod tests;
