//! The jobs that this process has, and the messages that keep them its own.

use super::stored::StoredJob;
use super::table::Versioned;
use crate::queue::{Lease, MAX_ATTEMPTS};
use crate::record::JobId;
use async_nats::jetstream::{AckKind, Message};
use pixmesh_engine::Owner;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// A job that a worker of this process has.
#[derive(Clone, Debug)]
pub(super) struct Holding {
    pub(super) owner: Owner,
    /// What keeps the job from being given to another.
    pub(super) message: Arc<Message>,
    /// The record as this process wrote it last.
    pub(super) record: Versioned<StoredJob>,
    fence: u64,
}

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Holdings {
    jobs: Mutex<HashMap<JobId, Holding>>,
    /// A message whose job is on its last attempt, which is made alone.
    aside: Mutex<Option<Message>>,
    /// Somebody waits for one fewer.
    pub(super) fewer: Notify,
}

impl Holdings {
    /// Takes down that this process has a job.
    pub(super) fn add(
        &self,
        lease: Lease,
        owner: Owner,
        message: Message,
        record: Versioned<StoredJob>,
    ) {
        let (message, fence) = (Arc::new(message), lease.fence);
        self.jobs().insert(lease.job, Holding { owner, message, record, fence });
    }

    /// What is held by a lease.
    pub(super) fn get(&self, lease: Lease) -> Option<Holding> {
        self.jobs().get(&lease.job).filter(|holding| holding.fence == lease.fence).cloned()
    }

    /// Keeps the record as it was written.
    pub(super) fn keep(&self, lease: Lease, record: Versioned<StoredJob>) {
        let mut jobs = self.jobs();
        if let Some(holding) = jobs.get_mut(&lease.job).filter(|held| held.fence == lease.fence) {
            holding.record = record;
        }
    }

    /// Lets go of a job.
    pub(super) fn remove(&self, lease: Lease) {
        let mut jobs = self.jobs();
        if jobs.get(&lease.job).is_some_and(|holding| holding.fence == lease.fence) {
            jobs.remove(&lease.job);
        }
        drop(jobs);
        self.fewer.notify_one();
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.jobs().len()
    }

    /// How many there are of an owner's.
    pub(super) fn count_of(&self, owner: &Owner) -> usize {
        self.jobs().values().filter(|holding| holding.owner == *owner).count()
    }

    /// Whether one of them is on its last attempt.
    pub(super) fn last_attempt_runs(&self) -> bool {
        self.jobs().values().any(|holding| holding.record.value.attempt() >= MAX_ATTEMPTS)
    }

    /// Puts a message aside until nothing else runs.
    pub(super) fn put_aside(&self, message: Message) {
        *self.aside.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }

    /// Whether there is a message put aside.
    pub(super) fn has_aside(&self) -> bool {
        self.aside.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Takes the message that was put aside.
    pub(super) fn take_aside(&self) -> Option<Message> {
        self.aside.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn jobs(&self) -> MutexGuard<'_, HashMap<JobId, Holding>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Answers to a message of the stream of work. An answer that is lost is made good by the server's
/// giving the message to somebody again, who finds the record.
pub(super) async fn answer(message: &Message, kind: AckKind) {
    let answered = match kind {
        AckKind::Progress => message.ack_with(kind).await,
        kind => message.double_ack_with(kind).await,
    };
    if let Err(error) = answered {
        tracing::warn!(%error, "a message of the stream of work could not be answered");
    }
}
