//! How many bytes the jobs of each owner keep in the store, and whether more may come.
//!
//! To count them, a query reads every job. So each node counts only for a hundredth of the time, and
//! adds the pictures that it stores in between. Meshes, deletions and what other nodes store follow
//! with the next count.

use crate::queue::{Caps, Queue, QueueError, Submitted};
use crate::telemetry;
use pixmesh_engine::Owner;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The part of the time in which a node does not count, in durations of a count.
const PAUSE: u32 = 99;

/// The bytes that jobs keep, as far as this node knows.
#[derive(Debug)]
pub struct StoredBytes {
    caps: Caps,
    known: Mutex<Known>,
}

#[derive(Debug)]
struct Known {
    of_owners: HashMap<Owner, u64>,
    of_all: u64,
    next_count: Instant,
}

impl StoredBytes {
    /// Nothing is known before the first count.
    pub(crate) fn new(caps: Caps) -> Self {
        let known = Known { of_owners: HashMap::new(), of_all: 0, next_count: Instant::now() };
        Self { caps, known: Mutex::new(known) }
    }

    /// Adds what a job is about to store, or says why it may not.
    pub(crate) fn add(&self, owner: &Owner, bytes: u64) -> Option<Submitted> {
        let mut known = self.known();
        let (of_all, of_owner) = (known.of_all, known.of_owners.get(owner).copied().unwrap_or(0));
        let refusal = self.caps.refusal_of_bytes(of_all + bytes, owner, of_owner + bytes);
        if refusal.is_none() {
            known.of_all += bytes;
            *known.of_owners.entry(owner.clone()).or_default() += bytes;
        }
        refusal
    }

    /// Subtracts what was not stored after all.
    pub(crate) fn subtract(&self, owner: &Owner, bytes: u64) {
        let mut known = self.known();
        known.of_all = known.of_all.saturating_sub(bytes);
        if let Some(of_owner) = known.of_owners.get_mut(owner) {
            *of_owner = of_owner.saturating_sub(bytes);
        }
    }

    /// Counts anew, if it is time.
    pub(crate) async fn count(&self, queue: &dyn Queue) -> Result<(), QueueError> {
        let began = Instant::now();
        if began < self.known().next_count {
            return Ok(());
        }
        let of_owners: HashMap<Owner, u64> = queue.stored_bytes().await?.into_iter().collect();
        let of_all = of_owners.values().sum();
        telemetry::stored_bytes(of_all, self.caps.stored_bytes);
        let next_count = Instant::now() + began.elapsed() * PAUSE;
        *self.known() = Known { of_owners, of_all, next_count };
        Ok(())
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{jobs, picture, submit_picture, terms};

    fn limits(stored_bytes: u64, stored_bytes_per_owner: u64) -> Caps {
        Caps { stored_bytes, stored_bytes_per_owner, ..terms().caps }
    }

    #[test]
    fn limits_hold_for_all_and_for_each_key() {
        let stored = StoredBytes::new(limits(10, 6));
        let (a, b) = (Owner::named("a"), Owner::named("b"));
        assert_eq!(stored.add(&a, 6), None);
        assert_eq!(stored.add(&a, 1), Some(Submitted::OwnersStoreFull { limit: 6, bytes: 7 }));
        assert_eq!(stored.add(&b, 5), Some(Submitted::StoreFull { limit: 10, bytes: 11 }));
        stored.subtract(&a, 6);
        assert_eq!(stored.add(&Owner::Anonymous, 10), None);
    }

    #[tokio::test]
    async fn count_follows_the_jobs() {
        let (mut jobs, _folder) = jobs(terms());
        let bytes = picture(b"1234567").stored_bytes();
        jobs.stored = StoredBytes::new(limits(2 * bytes, u64::MAX)).into();
        let (first, _) = submit_picture(&jobs, "1234567").await;
        submit_picture(&jobs, "7654321").await;
        assert!(jobs.stored.add(&Owner::Anonymous, 1).is_some());
        jobs.queue.cancel(&Owner::Anonymous, first).await.unwrap();
        jobs.stored.count(&*jobs.queue).await.unwrap();
        assert_eq!(jobs.stored.add(&Owner::Anonymous, bytes), None);
        assert!(jobs.stored.add(&Owner::Anonymous, 1).is_some());
    }
}
