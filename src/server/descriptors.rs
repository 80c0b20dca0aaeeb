//! How many connections the process may have open, by the system's limit on file descriptors.
//!
//! A connection over that limit is not refused but never accepted, and with it those that ask for
//! health. So the soft limit is raised as far as the hard one allows, and what the public listener
//! may take leaves a reserve for the listener for operations, and for all else that is open.

use super::listener::REFUSED_AT_A_TIME;
use rustix::process::{Resource, getrlimit, setrlimit};

/// The most connections of the listener for operations.
pub(super) const OPERATIONS_CONNECTIONS: usize = 32;
/// Descriptors for the log, the listeners, the runtimes, and what they read about the process.
const OWN: usize = 32;
/// What the public connections leave, with what both listeners are refusing at a time.
const RESERVE: usize = OPERATIONS_CONNECTIONS + 2 * REFUSED_AT_A_TIME + OWN;

/// The number of public connections: as many as asked for, or as the limit on descriptors allows.
pub(super) fn public_connections(asked: usize) -> usize {
    let connections = asked.min(left_by_reserve(raise_limit(asked.saturating_add(RESERVE))));
    if connections < asked {
        tracing::warn!(
            asked,
            connections,
            "the limit on file descriptors allows fewer connections than --max-connections"
        );
    }
    connections
}

/// Raises the soft limit to `needed` or as near as the hard one allows, and returns what it is.
fn raise_limit(needed: usize) -> usize {
    let mut limit = getrlimit(Resource::Nofile);
    let needed = needed as u64;
    if limit.current.is_some_and(|current| current < needed) {
        let before = limit.current;
        limit.current = Some(limit.maximum.map_or(needed, |maximum| maximum.min(needed)));
        if setrlimit(Resource::Nofile, limit).is_err() {
            limit.current = before;
        }
    }
    // No limit at all is written as none.
    limit.current.map_or(usize::MAX, |current| usize::try_from(current).unwrap_or(usize::MAX))
}

/// What the reserve leaves of a limit, one at least.
fn left_by_reserve(limit: usize) -> usize {
    limit.saturating_sub(RESERVE).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reserve_is_kept_whatever_is_asked_for() {
        assert_eq!(left_by_reserve(1024), 1024 - RESERVE);
        assert_eq!(left_by_reserve(3), 1);
        assert_eq!(public_connections(1), 1);
        let limit = raise_limit(0);
        assert!(public_connections(usize::MAX) >= left_by_reserve(limit));
    }
}
