//! The queue as a trait, independent of the engine that stores it.
//!
//! Every engine passes the suite `conformance`: a job that [`Queue::submit`] acknowledged is on
//! stable storage; one worker at a time has a job, and a worker that lost it changes nothing; an
//! attempt is counted before it starts.

use crate::record::{Event, JobId, MeshFigures, Moment, NewJob, Picture, Progress, Record, State};
use crate::watchers::Watchers;
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde_json::Value;
use std::collections::HashSet;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;

/// How many times a job is given to a worker.
pub const MAX_ATTEMPTS: u32 = 3;

/// The limits and times of a queue.
#[derive(Clone, Copy, Debug)]
pub struct Terms {
    /// The limits of the numbers of jobs.
    pub caps: Caps,
    /// How long a worker keeps a job without renewing its lease.
    pub lease: Duration,
    /// How long a job is kept after its end.
    pub result_ttl: Duration,
    /// How long an idempotency key is kept, from the submission of its job, whatever becomes of that.
    pub idempotency_ttl: Duration,
    /// How long an expired job is known to have existed.
    pub gone_ttl: Duration,
    /// How long a store that nodes share keeps a blob that no job uses: a node may be about to
    /// submit a job that uses it.
    pub unused_blob_ttl: Duration,
    /// The period of polling for changes that no notification announced.
    pub poll_period: Duration,
}

impl Terms {
    /// The terms with the default times.
    #[must_use]
    pub fn new(caps: Caps, lease: Duration, result_ttl: Duration) -> Self {
        Self {
            caps,
            lease,
            result_ttl,
            idempotency_ttl: Duration::from_hours(24),
            gone_ttl: Duration::from_hours(7 * 24),
            unused_blob_ttl: Duration::from_hours(1),
            poll_period: Duration::from_secs(1),
        }
    }
}

/// How long a sweep may delete the blobs that it has taken. Twice as long, no node stores them.
pub(crate) const DELETION_TIME: Duration = Duration::from_mins(2);

/// The limits of the numbers of jobs and of their bytes. Those of one owner do not apply to anonymous
/// jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// Queued jobs of all owners.
    pub queued: usize,
    /// Queued jobs of one owner.
    pub queued_per_owner: usize,
    /// Running jobs of one owner.
    pub running_per_owner: usize,
    /// Bytes of the pictures and meshes of all jobs; `u64::MAX` for no limit.
    pub stored_bytes: u64,
    /// Bytes of the pictures and meshes of one owner's jobs; `u64::MAX` for no limit.
    pub stored_bytes_per_owner: u64,
}

impl Caps {
    /// Why the queue refuses another job of an owner; `None` if it does not.
    pub(crate) fn refusal(
        &self,
        queued: usize,
        owner: &Owner,
        queued_of_owner: usize,
    ) -> Option<Submitted> {
        if queued >= self.queued {
            Some(Submitted::QueueFull { limit: self.queued })
        } else if owner.is_key() && queued_of_owner >= self.queued_per_owner {
            Some(Submitted::OwnerFull { limit: self.queued_per_owner })
        } else {
            None
        }
    }

    /// Why a job is refused with which so many bytes would be stored; `None` if it is not.
    pub(crate) fn refusal_of_bytes(
        &self,
        bytes: u64,
        owner: &Owner,
        bytes_of_owner: u64,
    ) -> Option<Submitted> {
        if bytes > self.stored_bytes {
            Some(Submitted::StoreFull { limit: self.stored_bytes, bytes })
        } else if owner.is_key() && bytes_of_owner > self.stored_bytes_per_owner {
            let (limit, bytes) = (self.stored_bytes_per_owner, bytes_of_owner);
            Some(Submitted::OwnersStoreFull { limit, bytes })
        } else {
            None
        }
    }
}

/// Why the queue failed.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum QueueError {
    /// There is no room left on the storage.
    #[error("no room is left on the storage: {0}")]
    StorageFull(String),
    /// The storage has less free space than must be left.
    #[error("{free} bytes are free on the storage, and {least} must stay free")]
    SpaceLow {
        /// The bytes that are free.
        free: u64,
        /// The bytes that must be.
        least: u64,
    },
    /// An operator has paused the intake of jobs.
    #[error("an operator has paused the intake of jobs")]
    Paused,
    /// The storage fails.
    #[error("the storage fails: {0}")]
    Storage(String),
    /// The storage works, but returns other data than were stored.
    #[error("what was stored is damaged: {0}")]
    Damaged(String),
    /// The shared store of pictures and meshes fails, or does not answer.
    #[error("the store of blobs fails: {0}")]
    Blobs(String),
    /// No room is left on the storage of the shared database.
    #[error("no room is left in the database: {0}")]
    DatabaseFull(String),
    /// The shared database answers, but fails.
    #[error("the database fails: {0}")]
    Database(String),
    /// The shared database does not answer.
    #[error("the database does not answer: {0}")]
    Unreachable(String),
}

/// The result of a submission.
#[derive(Clone, Debug, PartialEq)]
pub enum Submitted {
    /// The job is on stable storage.
    Created(Record),
    /// The job was submitted before with the same idempotency key and the same content.
    Existing(Record),
    /// The same idempotency key was used with other content.
    KeyReused,
    /// The job that was submitted with the same idempotency key expired or was deleted.
    KeyOfGone,
    /// The queue is full.
    QueueFull {
        /// The limit of queued jobs.
        limit: usize,
    },
    /// The owner has as many queued jobs as one owner may have.
    OwnerFull {
        /// The limit of queued jobs.
        limit: usize,
    },
    /// All jobs together keep as many bytes as they may.
    StoreFull {
        /// The limit of stored bytes.
        limit: u64,
        /// The bytes that would be stored.
        bytes: u64,
    },
    /// The owner's jobs keep as many bytes as those of one owner may.
    OwnersStoreFull {
        /// The limit of stored bytes.
        limit: u64,
        /// The bytes that would be stored.
        bytes: u64,
    },
}

impl Submitted {
    /// The result of submitting a job whose idempotency key belongs to a stored job.
    pub(crate) fn again(job: &NewJob, stored: Record, fingerprint: Option<Digest>) -> Self {
        if stored.id == job.id {
            // The job was committed before, and the acknowledgement was lost.
            Self::Created(stored)
        } else if fingerprint == Some(job.fingerprint()) {
            Self::Existing(stored)
        } else {
            Self::KeyReused
        }
    }
}

/// What the queue has under the id of a job.
#[derive(Clone, Debug, PartialEq)]
pub enum Lookup {
    /// The job.
    Found(Box<Record>),
    /// The job has expired.
    Gone,
    /// The owner has no such job.
    Unknown,
}

/// Which jobs of an owner to list, newest first.
#[derive(Clone, Copy, Debug)]
pub struct PageRequest {
    /// Only jobs in this state.
    pub state: Option<State>,
    /// Only jobs older than this one.
    pub before: Option<JobId>,
    /// The most jobs, at least 1.
    pub limit: usize,
}

/// Which jobs of all owners to find, newest first. Indexes serve a type of problem, an owner, a state
/// or both of these, and the ids; what else is asked for is compared after reading.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Only jobs of this owner.
    pub owner: Option<Owner>,
    /// Only jobs in this state.
    pub state: Option<State>,
    /// Only jobs that failed with a problem of this type, such as `/problems/attempts-exhausted`.
    pub problem: Option<String>,
    /// Only jobs whose picture's file has as many bytes.
    pub least_bytes: u64,
    /// Only this job and later ones; [`JobId::first_at`] is that of a time.
    pub from: Option<JobId>,
    /// Only jobs older than this one.
    pub before: Option<JobId>,
}

impl Search {
    /// The owner, the state and the problem that the engine looks for in one index.
    pub(crate) fn indexed(&self) -> (Option<&str>, Option<State>, Option<&str>) {
        match &self.problem {
            Some(problem) => (None, None, Some(problem)),
            None => (self.owner.as_ref().map(Owner::as_str), self.state, None),
        }
    }

    /// The ids, with the first and without the last.
    pub(crate) fn ids(&self) -> [JobId; 2] {
        let last = JobId::from_bytes([u8::MAX; 16]);
        [self.from.unwrap_or(JobId::from_bytes([0; 16])), self.before.unwrap_or(last)]
    }

    /// Whether a job is one that is asked for. One that has expired is not.
    pub(crate) fn accepts(&self, job: &Record, now: Moment) -> bool {
        self.owner.as_ref().is_none_or(|owner| *owner == job.owner)
            && self.state.is_none_or(|state| state == job.state)
            && job.picture.bytes >= self.least_bytes
            && job.expires.is_none_or(|expires| expires > now)
    }
}

/// What an operator does to jobs. Jobs in other states are left alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Queues failed jobs again, with all their attempts.
    Retry,
    /// Cancels queued and running jobs.
    Cancel,
    /// Lets jobs that have ended expire.
    Delete,
}

/// What an operator has paused, on all nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Paused {
    /// No new jobs are accepted.
    pub intake: bool,
    /// No queued job is started. Running ones go on.
    pub work: bool,
}

/// A page of jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// The jobs.
    pub jobs: Vec<Record>,
    /// Jobs whose records cannot be read.
    pub damaged: Vec<JobId>,
    /// The job before which the next page starts; `None` on the last page.
    pub next: Option<JobId>,
}

impl Page {
    /// The page of the first `limit` rows, of which the query returned one more if there is another
    /// page. Damaged records are logged and left out.
    pub(crate) fn of<E: fmt::Display>(rows: Vec<(JobId, Result<Record, E>)>, limit: usize) -> Self {
        let next = (rows.len() > limit).then(|| rows[limit - 1].0);
        let mut page = Self { next, ..Self::default() };
        for (job, record) in rows.into_iter().take(limit) {
            match record {
                Ok(record) => page.jobs.push(record),
                Err(error) => {
                    tracing::error!(%job, %error, "job record damaged");
                    page.damaged.push(job);
                }
            }
        }
        page
    }
}

/// The right to work on a job, until another worker claims it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Lease {
    /// The job.
    pub job: JobId,
    /// Grows with each claim of the job.
    pub fence: u64,
}

/// A job that a worker claimed.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The lease.
    pub lease: Lease,
    /// The owner of the job.
    pub owner: Owner,
    /// The number of this attempt, from 1.
    pub attempt: u32,
    /// The [stored](pixmesh_engine::MeshOptions::stored) options of the mesh.
    pub options: String,
    /// The picture to mesh.
    pub picture: Picture,
}

/// What a worker learns about its lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Renewal {
    /// The worker keeps the job.
    Ok,
    /// The worker keeps the job, but the owner cancelled it.
    CancelRequested,
    /// Another worker has the job, or it is gone.
    Lost,
}

/// How an attempt ends.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The mesh is stored.
    Completed(MeshFigures),
    /// The job fails for good, with this problem document.
    Failed(Value),
    /// The worker stopped because the owner cancelled the job.
    Cancelled,
    /// The attempt failed, and another may succeed. After the last one the job fails with this
    /// problem document.
    Retry(Value),
    /// The worker stops for a reason of its own: the attempt does not count.
    HandedBack,
}

/// Whether the outcome of an attempt was accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// The job is in this state now.
    Committed(State),
    /// The lease was lost; nothing changed.
    Fenced,
}

/// The result of a cancellation by the owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancellation {
    /// The job was queued and is cancelled.
    Cancelled,
    /// The job runs; its worker is notified.
    Requested,
    /// The job had ended and is deleted.
    Deleted,
    /// The owner has no such job.
    Unknown,
    /// The job has expired.
    Gone,
}

/// The numbers of jobs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Queued jobs.
    pub queued: usize,
    /// Running jobs.
    pub running: usize,
    /// The age of the oldest queued job in seconds; 0 without one.
    pub oldest_queued_s: f64,
}

/// The result of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Jobs that are queued again because a lease expired.
    pub requeued: usize,
    /// Jobs that failed because the lease of their last attempt expired.
    pub exhausted: usize,
    /// Jobs that expired.
    pub expired: usize,
    /// Blobs that no job uses, as far as the queue knows.
    pub orphans: Vec<Digest>,
}

/// A durable queue of jobs.
#[async_trait]
pub trait Queue: fmt::Debug + Send + Sync {
    /// Puts a job on stable storage, unless a limit or its idempotency key forbids it.
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError>;

    /// An owner's job.
    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError>;

    /// An owner's jobs.
    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError>;

    /// Claims the next job for a worker, and counts the attempt.
    async fn claim(&self) -> Result<Option<Claim>, QueueError>;

    /// Renews a lease, and stores new progress.
    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError>;

    /// Whether the holder of a lease still has the job.
    async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError>;

    /// Ends an attempt.
    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError>;

    /// Cancels an owner's job, or deletes it if it has ended.
    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError>;

    /// The newest jobs of all owners that one index finds, read at most `limit`; the caller compares
    /// them with the rest of the search.
    async fn search(&self, search: Search, limit: usize) -> Result<Page, QueueError>;

    /// Changes jobs of any owners in one transaction, and returns the states of those that it changed.
    async fn change(&self, jobs: Vec<JobId>, change: Change) -> Result<Vec<State>, QueueError>;

    /// What is paused.
    async fn paused(&self) -> Result<Paused, QueueError>;

    /// Stores what is paused from now on.
    async fn pause(&self, paused: Paused) -> Result<(), QueueError>;

    /// The changes of an owner's job after a revision, and whether more may come: not if the job
    /// has ended or does not exist.
    async fn events_now(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<(Vec<Event>, bool), QueueError>;

    /// The numbers of jobs.
    async fn stats(&self) -> Result<Stats, QueueError>;

    /// The recent mean duration of an attempt in seconds on the nodes that share the queue; `None`
    /// before the first. `own` is the mean of this node.
    async fn mean_duration_s(&self, own: Option<f64>) -> Result<Option<f64>, QueueError> {
        Ok(own)
    }

    /// Periodic maintenance: requeues jobs whose leases expired, deletes expired jobs, and returns
    /// blobs that no job uses, until [`Self::forget`] removes them from the list. The caller deletes
    /// them within [`DELETION_TIME`].
    async fn sweep(&self) -> Result<Swept, QueueError>;

    /// Which of the blobs a job uses.
    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError>;

    /// Marks a blob that is about to be stored, so that a sweep finds it if no job comes to use it.
    /// Waits while a sweep deletes it. Engines of one process find such blobs when
    /// they start, and need no mark.
    async fn expect(&self, _blob: Digest) -> Result<(), QueueError> {
        Ok(())
    }

    /// Fails if there is no room for new jobs beside the space that must stay free.
    fn check_room(&self) -> Result<(), QueueError> {
        Ok(())
    }

    /// The bytes of the pictures and meshes that the jobs of each owner keep. Jobs with the same
    /// picture are counted as if each had its own.
    async fn stored_bytes(&self) -> Result<Vec<(Owner, u64)>, QueueError>;

    /// The folder for blobs that the next cleaning must not delete, because their jobs may be lost.
    fn set_aside(&self) -> Option<&Path> {
        None
    }

    /// Gives up the space that is kept back, because there is no other.
    fn release_reserve(&self) {}

    /// Removes blobs that were deleted from the list of orphans.
    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError>;

    /// Whether the last write succeeded.
    fn is_healthy(&self) -> bool;

    /// The tasks that wait for changes.
    fn watchers(&self) -> &Arc<Watchers>;

    /// How often waiting tasks read again without a notification.
    fn poll_period(&self) -> Duration;

    /// Waits until there may be a job to claim.
    async fn work(&self) {
        self.watchers().work(self.poll_period()).await;
    }

    /// Waits until the worker must stop: until the answer is not [`Renewal::Ok`].
    async fn interruption(&self, lease: Lease) -> Renewal {
        let mut changes = self.watchers().subscribe(lease.job);
        loop {
            match self.standing(lease).await {
                Ok(Renewal::Ok) => {}
                Ok(interruption) => return interruption,
                Err(error) => tracing::warn!(%error, "lease not checked"),
            }
            changes.changed(self.poll_period()).await;
        }
    }

    /// The changes of an owner's job after a revision; waits for the first one. Empty if no more
    /// changes can come.
    async fn events(&self, owner: &Owner, id: JobId, after: u64) -> Result<Vec<Event>, QueueError> {
        let mut changes = self.watchers().subscribe(id);
        loop {
            let (events, more_may_come) = self.events_now(owner, id, after).await?;
            if !events.is_empty() || !more_may_come {
                return Ok(events);
            }
            changes.changed(self.poll_period()).await;
        }
    }
}
