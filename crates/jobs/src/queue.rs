//! The queue of jobs as a trait, with nothing in it of the engine that keeps it.
//!
//! An engine promises what [`conformance`](super) checks: what [`Queue::submit`] has acknowledged
//! is on stable storage; a job has one worker at a time, and whoever lost it can change it no more;
//! an attempt is counted before it begins.

use super::fairness::Caps;
use super::record::{Event, JobId, MeshFigures, NewJob, Picture, Progress, Record, State};
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde_json::Value;
use std::collections::HashSet;
use std::fmt;
use std::time::Duration;
use thiserror::Error;

/// How many times a job is given to a worker.
pub const MAX_ATTEMPTS: u32 = 3;

/// What an engine is asked to keep to.
#[derive(Clone, Copy, Debug)]
pub struct Terms {
    /// How many jobs may wait and run.
    pub caps: Caps,
    /// How long a worker has a job without renewing its lease.
    pub lease: Duration,
    /// How long a job is kept after its end.
    pub result_ttl: Duration,
    /// How long the word that a client gave for a submission is remembered.
    pub idempotency_ttl: Duration,
    /// How long it is remembered that there was a job, once it is no longer kept.
    pub gone_ttl: Duration,
    /// How often a worker without work, and whoever waits for a change, looks whether it missed a call.
    pub look_again: Duration,
}

/// How long the word that a client gave for a submission is remembered.
const IDEMPOTENCY_TTL: Duration = Duration::from_hours(24);
/// How long it is remembered that there was a job.
const GONE_TTL: Duration = Duration::from_hours(7 * 24);
/// How often whoever waits for work, or for a change of a job, looks whether a call was missed.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

impl Terms {
    /// The usual times for what no setting says.
    #[must_use]
    pub fn new(caps: Caps, lease: Duration, result_ttl: Duration) -> Self {
        Self {
            caps,
            lease,
            result_ttl,
            idempotency_ttl: IDEMPOTENCY_TTL,
            gone_ttl: GONE_TTL,
            look_again: LOOK_AGAIN,
        }
    }
}

/// Why the queue could not do what it was asked.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum QueueError {
    /// There is no room left on the storage.
    #[error("no room is left on the storage: {0}")]
    StorageFull(String),
    /// The storage fails.
    #[error("the storage fails: {0}")]
    Storage(String),
    /// The storage works, but what it kept is not what was given to it.
    #[error("what was stored is damaged: {0}")]
    Damaged(String),
    /// The store of pictures and results fails, or does not answer.
    #[error("the store of blobs fails: {0}")]
    Blobs(String),
    /// No room is left on the storage of the shared database.
    #[error("no room is left in the database: {0}")]
    DatabaseFull(String),
    /// The shared database answers, but cannot do what it is asked.
    #[error("the database fails: {0}")]
    Database(String),
    /// The shared database does not answer.
    #[error("the database does not answer: {0}")]
    Unreachable(String),
}

/// What became of a submission.
#[derive(Clone, Debug, PartialEq)]
pub enum Submitted {
    /// The job is there, on stable storage.
    Created(Record),
    /// It was there already: the same word was given with the same content.
    Existing(Record),
    /// The same word was given with other content.
    KeyReused,
    /// As many jobs wait as may.
    QueueFull {
        /// So many.
        limit: usize,
    },
    /// As many jobs of this owner wait as may.
    OwnerFull {
        /// So many.
        limit: usize,
    },
}

/// What there is under a job's name.
#[derive(Clone, Debug, PartialEq)]
pub enum Lookup {
    /// The job.
    Found(Box<Record>),
    /// There was a job, and it is no longer kept.
    Gone,
    /// Nothing, or nothing of this owner.
    Unknown,
}

/// Which jobs of an owner to list, newest first.
#[derive(Clone, Copy, Debug)]
pub struct PageRequest {
    /// Only those in this state.
    pub state: Option<State>,
    /// Only those older than this one.
    pub before: Option<JobId>,
    /// The most of them, 1 or more.
    pub limit: usize,
}

/// Some jobs of an owner, newest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// The jobs.
    pub jobs: Vec<Record>,
    /// The one before which the next page begins, when there is more.
    pub next: Option<JobId>,
}

/// The right to work on a job: void as soon as somebody else has got it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lease {
    /// The job.
    pub job: JobId,
    /// Grows each time the job is given to somebody.
    pub fence: u64,
}

/// A job that was given to a worker.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The right to it.
    pub lease: Lease,
    /// Whose it is.
    pub owner: Owner,
    /// Which attempt this is, from 1.
    pub attempt: u32,
    /// What to make.
    pub order: String,
    /// Of which image.
    pub picture: Picture,
}

/// What a worker hears when it renews its lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Renewal {
    /// It goes on having the job.
    Ok,
    /// So it does, but the owner wants the job no more.
    CancelRequested,
    /// Somebody else has got the job, or it is gone.
    Lost,
}

/// How a worker leaves a job.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The mesh is stored.
    Completed(MeshFigures),
    /// It cannot be done: the problem document says why.
    Failed(Value),
    /// The owner wanted it no more.
    Cancelled,
    /// Nothing came of this attempt; another may do, or the problem is what is left.
    Retry(Value),
    /// The worker stops, through no fault of the job: the attempt does not count.
    HandedBack,
}

/// Whether what a worker left was accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// The job is in this state now.
    Committed(State),
    /// The worker had lost the job; nothing was changed.
    Fenced,
}

/// What became of a job whose owner wants it no more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancellation {
    /// It waited, and is cancelled.
    Cancelled,
    /// A worker has it, and is being told.
    Requested,
    /// It had come to its end, and is deleted.
    Deleted,
    /// There is no such job of this owner.
    Unknown,
    /// There was one, and it is no longer kept.
    Gone,
}

/// How much there is of what.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Jobs that wait.
    pub queued: usize,
    /// Jobs that run.
    pub running: usize,
    /// How long the one has waited that has waited longest, in seconds.
    pub oldest_queued_s: f64,
}

/// What a sweep found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Jobs whose workers fell silent, and that wait again.
    pub requeued: usize,
    /// Jobs whose workers fell silent for the last time.
    pub exhausted: usize,
    /// Jobs that are no longer kept.
    pub expired: usize,
    /// Blobs that a job had and gave up.
    pub given_up: Vec<Digest>,
}

/// A durable queue of jobs.
#[async_trait]
pub trait Queue: fmt::Debug + Send + Sync {
    /// Puts a job on stable storage, or says why not.
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError>;

    /// An owner's job.
    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError>;

    /// An owner's jobs.
    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError>;

    /// Waits until there may be something to claim.
    async fn work(&self);

    /// Gives the next job to a worker, and counts the attempt.
    async fn claim(&self) -> Result<Option<Claim>, QueueError>;

    /// Lengthens a lease, and tells how far the work is.
    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError>;

    /// Waits until the worker must stop: never [`Renewal::Ok`].
    async fn interruption(&self, lease: Lease) -> Renewal;

    /// Ends a worker's attempt.
    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError>;

    /// Cancels an owner's job, or deletes it where it has come to its end.
    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError>;

    /// What happened to an owner's job after a revision; waits until something has. Empty when there is no
    /// such job, or nothing more will happen to it.
    async fn events(&self, owner: &Owner, id: JobId, after: u64) -> Result<Vec<Event>, QueueError>;

    /// How much there is of what.
    async fn stats(&self) -> Result<Stats, QueueError>;

    /// How many seconds a job takes of late on average, as far as is known: nodes that share a queue
    /// tell each other. `own` is this node's mean.
    async fn mean_duration_s(&self, own: Option<f64>) -> Result<Option<f64>, QueueError> {
        Ok(own)
    }

    /// Takes jobs from workers that fell silent, forgets those kept long enough, and names the
    /// blobs that were given up, until [`Self::forget`] is told that they are seen to.
    async fn sweep(&self) -> Result<Swept, QueueError>;

    /// Those of the blobs that a job has.
    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError>;

    /// A blob is about to be stored: should no job come to have it, it is given up. An engine whose
    /// blobs nobody else stores need not take that down.
    async fn expect(&self, _blob: Digest) -> Result<(), QueueError> {
        Ok(())
    }

    /// The blobs that were given up are seen to.
    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError>;

    /// Whether the storage took what it was last given.
    fn is_healthy(&self) -> bool;
}
