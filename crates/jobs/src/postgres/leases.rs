//! The leases that the workers of this node hold, and the job that the node has reserved.

use crate::queue::{Claim, Lease, MAX_ATTEMPTS};
use crate::record::JobId;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

#[derive(Debug, Default)]
pub(super) struct HeldLeases(Mutex<Held>);

#[derive(Debug, Default)]
struct Held {
    leases: HashMap<Lease, HeldLease>,
    reserved: Option<Reserved>,
}

#[derive(Debug)]
struct HeldLease {
    attempt: u32,
    end: Instant,
}

/// A job whose last attempt waits until nothing else runs on this node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reserved {
    pub(super) job: JobId,
    /// The time of the last reservation in the database.
    pub(super) since: Instant,
}

impl HeldLeases {
    pub(super) fn add(&self, claim: &Claim, term: Duration) {
        let held = HeldLease { attempt: claim.attempt, end: Instant::now() + term };
        self.held().leases.insert(claim.lease, held);
    }

    pub(super) fn renew(&self, lease: Lease, term: Duration) {
        if let Some(held) = self.held().leases.get_mut(&lease) {
            held.end = Instant::now() + term;
        }
    }

    pub(super) fn remove(&self, lease: Lease) {
        self.held().leases.remove(&lease);
    }

    /// Whether no worker of this node holds a lease that has not expired.
    pub(super) fn is_empty(&self) -> bool {
        let (mut held, now) = (self.held(), Instant::now());
        held.leases.retain(|_, lease| lease.end > now);
        held.leases.is_empty()
    }

    /// Whether a job is on its last attempt.
    pub(super) fn last_attempt_runs(&self) -> bool {
        !self.is_empty() && self.held().leases.values().any(|held| held.attempt >= MAX_ATTEMPTS)
    }

    pub(super) fn reserved(&self) -> Option<Reserved> {
        self.held().reserved
    }

    /// Replaces the reservation.
    pub(super) fn reserve(&self, job: Option<JobId>) {
        self.held().reserved = job.map(|job| Reserved { job, since: Instant::now() });
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
