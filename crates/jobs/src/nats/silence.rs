//! How long a record has not changed, by this process's own clock: no two machines' clocks are
//! compared. A worker changes its job's record with each renewal of its lease.

use crate::record::JobId;
use pixmesh_engine::Owner;
use std::collections::{HashMap, HashSet};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What was seen, and since when.
#[derive(Debug, Default)]
pub(super) struct Silence {
    seen: Mutex<HashMap<JobId, (u64, Instant)>>,
}

impl Silence {
    /// Whether the record of a job has had this version for as long as a lease.
    pub(super) fn is_over(&self, id: JobId, version: u64, lease: Duration) -> bool {
        let mut seen = self.seen();
        let since = seen.entry(id).or_insert_with(|| (version, Instant::now()));
        if since.0 != version {
            *since = (version, Instant::now());
        }
        since.1.elapsed() >= lease
    }

    /// Forgets all other jobs.
    pub(super) fn keep_only(&self, jobs: &[(Owner, JobId)]) {
        let ids: HashSet<JobId> = jobs.iter().map(|(_, id)| *id).collect();
        self.seen().retain(|id, _| ids.contains(id));
    }

    fn seen(&self) -> MutexGuard<'_, HashMap<JobId, (u64, Instant)>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_silent_once_it_has_not_changed_for_a_lease() {
        let (silence, id) = (Silence::default(), JobId::new());
        // Nothing holds the machine up for as long as that between two lines.
        let lease = Duration::from_secs(3);
        assert!(!silence.is_over(id, 1, lease));
        std::thread::sleep(lease);
        assert!(silence.is_over(id, 1, lease));
        assert!(!silence.is_over(id, 2, lease), "it has changed");
        std::thread::sleep(lease);
        silence.keep_only(&[]);
        assert!(!silence.is_over(id, 2, lease), "it was forgotten");
    }
}
