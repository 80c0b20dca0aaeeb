//! Counts a body as it arrives, against the limit of one body and the memory for all bodies.

use crate::problem::{Kind, Problem};
use pixmesh_engine::Owner;
use pixmesh_engine::telemetry::{Shed, shed};
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Seconds after which a client may try again when bodies take all of their memory.
const RETRY_AFTER_S: u64 = 2;

/// The longest body in bytes, and the setting that says so.
#[derive(Clone, Copy, Debug)]
pub struct BodyLimit {
    /// Bytes.
    pub bytes: u64,
    /// The flag of the setting.
    pub setting: &'static str,
}

impl BodyLimit {
    /// Refuses a body of more bytes.
    pub(crate) fn check(self, length: u64) -> Result<(), Problem> {
        let Self { bytes, setting } = self;
        if length <= bytes {
            return Ok(());
        }
        let detail = format!("the body is longer than the limit of {bytes} bytes");
        Err(Problem::new(Kind::BodyTooLarge, detail).setting(setting).limit(bytes, length))
    }
}

/// The memory that all bodies share, in KiB.
///
/// One key may use at most as much body memory as stays free for others. A key's only upload may use
/// all of it.
#[derive(Clone, Debug)]
pub struct BodyMemory(Arc<Mutex<Shared>>);

#[derive(Debug)]
struct Shared {
    free_kib: usize,
    held_kib: HashMap<Owner, usize>,
}

impl BodyMemory {
    /// Memory for `bytes` of bodies at a time.
    #[must_use]
    pub fn new(bytes: u64) -> Self {
        let free_kib = usize::try_from(bytes / 1024).unwrap_or(usize::MAX).max(1);
        Self(Arc::new(Mutex::new(Shared { free_kib, held_kib: HashMap::new() })))
    }

    /// A reservation of 0 bytes.
    pub(super) fn charge(&self, owner: &Owner) -> Charge {
        Charge { memory: self.clone(), owner: owner.clone(), held_kib: AtomicUsize::new(0) }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Shared {
    /// Reserves `kib` more for a body of this owner that has `body_kib`; returns whether the share rule
    /// allows it.
    fn take(&mut self, owner: &Owner, body_kib: usize, kib: usize) -> bool {
        let held_kib = self.held_kib.get(owner).copied().unwrap_or_default();
        let Some(left_kib) = self.free_kib.checked_sub(kib) else { return false };
        let is_only_body = held_kib == body_kib;
        if owner.is_key() && !is_only_body && held_kib + kib > left_kib {
            return false;
        }
        self.free_kib = left_kib;
        *self.held_kib.entry(owner.clone()).or_default() += kib;
        true
    }

    fn give_back(&mut self, owner: &Owner, kib: usize) {
        self.free_kib += kib;
        if let Some(held_kib) = self.held_kib.get_mut(owner) {
            *held_kib -= kib;
            if *held_kib == 0 {
                self.held_kib.remove(owner);
            }
        }
    }
}

/// The memory reserved for one body; released when dropped.
#[derive(Debug)]
pub struct Charge {
    memory: BodyMemory,
    owner: Owner,
    held_kib: AtomicUsize,
}

impl Charge {
    /// Grows the reservation to `bytes`.
    ///
    /// # Errors
    /// `overloaded` when there is no memory for them.
    pub(super) fn grow_or_refuse(&self, bytes: u64) -> Result<(), Problem> {
        if self.grow_to(bytes) { Ok(()) } else { Err(no_memory()) }
    }

    /// Grows the reservation to `bytes`, and returns whether there was memory for them.
    fn grow_to(&self, bytes: u64) -> bool {
        let needed_kib = usize::try_from(bytes.div_ceil(1024)).unwrap_or(usize::MAX);
        let held_kib = self.held_kib.load(Ordering::Relaxed);
        let missing_kib = needed_kib.saturating_sub(held_kib);
        let taken =
            missing_kib == 0 || self.memory.shared().take(&self.owner, held_kib, missing_kib);
        if taken {
            self.held_kib.fetch_add(missing_kib, Ordering::Relaxed);
        }
        taken
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        let held_kib = self.held_kib.load(Ordering::Relaxed);
        self.memory.shared().give_back(&self.owner, held_kib);
    }
}

/// Counts one body against both.
pub(super) struct Meter {
    received: u64,
    limit: BodyLimit,
    charge: Arc<Charge>,
}

impl Meter {
    pub(super) fn new(limit: BodyLimit, charge: Arc<Charge>) -> Self {
        Self { received: 0, limit, charge }
    }

    /// Counts `length` more bytes.
    ///
    /// # Errors
    /// `body-too-large` over the limit, `overloaded` without memory.
    pub(super) fn count(&mut self, length: usize) -> Result<(), Problem> {
        self.received = self.received.saturating_add(length as u64);
        self.limit.check(self.received)?;
        self.charge.grow_or_refuse(self.received)
    }
}

fn no_memory() -> Problem {
    shed(Shed::Memory);
    Problem::new(
        Kind::Overloaded,
        "the uploads in progress take all memory for request bodies: try again",
    )
    .setting("--memory-budget")
    .retry_after_s(RETRY_AFTER_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bodies_of_one_key_leave_as_much_to_others_and_a_single_one_may_take_all() {
        let memory = BodyMemory::new(100 << 10);
        let [a, b] = ["a", "b"].map(Owner::named);
        let bodies: Vec<_> = (0..10).map(|_| memory.charge(&a)).collect();
        let received = bodies.iter().filter(|body| body.grow_to(10 << 10)).count();
        assert_eq!(received, 5);
        assert!(memory.charge(&b).grow_to(10 << 10), "there is room for others");
        drop(bodies);
        assert!(memory.charge(&a).grow_to(100 << 10));
        let anonymous: Vec<_> = (0..10).map(|_| memory.charge(&Owner::Anonymous)).collect();
        assert!(anonymous.iter().all(|body| body.grow_to(10 << 10)));
        drop(anonymous);
        assert_eq!(memory.shared().free_kib, 100);
        assert!(memory.shared().held_kib.is_empty());
    }
}
