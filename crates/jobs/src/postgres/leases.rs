//! The jobs that this node's workers have, and the one that it has set aside.

use crate::queue::{Lease, MAX_ATTEMPTS};
use crate::record::JobId;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// All of them.
#[derive(Debug, Default)]
pub(super) struct HeldLeases(Mutex<Held>);

#[derive(Debug, Default)]
struct Held {
    jobs: HashMap<JobId, HeldLease>,
    reserved: Option<Reserved>,
}

#[derive(Debug)]
struct HeldLease {
    fence: u64,
    attempt: u32,
    until: Instant,
}

/// A job that waits until its last attempt can be made alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reserved {
    pub(super) job: JobId,
    /// When it was last kept from other nodes.
    pub(super) since: Instant,
}

impl HeldLeases {
    /// A worker of this node has a job.
    pub(super) fn add(&self, lease: Lease, attempt: u32, term: Duration) {
        let holding = HeldLease { fence: lease.fence, attempt, until: Instant::now() + term };
        self.held().jobs.insert(lease.job, holding);
    }

    /// It has it for another term.
    pub(super) fn keep(&self, lease: Lease, term: Duration) {
        if let Some(held) = self.held().jobs.get_mut(&lease.job).filter(|h| h.fence == lease.fence)
        {
            held.until = Instant::now() + term;
        }
    }

    /// It has it no more.
    pub(super) fn remove(&self, lease: Lease) {
        let mut held = self.held();
        if held.jobs.get(&lease.job).is_some_and(|holding| holding.fence == lease.fence) {
            held.jobs.remove(&lease.job);
        }
    }

    /// Whether there are any; those whose leases ended are none.
    pub(super) fn is_empty(&self) -> bool {
        let now = Instant::now();
        self.held().jobs.retain(|_, holding| holding.until > now);
        self.held().jobs.is_empty()
    }

    /// Whether one of them is on its last attempt.
    pub(super) fn last_attempt_runs(&self) -> bool {
        !self.is_empty() && self.held().jobs.values().any(|holding| holding.attempt >= MAX_ATTEMPTS)
    }

    /// The job that is set aside.
    pub(super) fn reserved(&self) -> Option<Reserved> {
        self.held().reserved
    }

    /// Sets a job aside, or none.
    pub(super) fn reserve(&self, job: Option<JobId>) {
        self.held().reserved = job.map(|job| Reserved { job, since: Instant::now() });
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
