//! Memory of the budget that somebody holds.

use crate::telemetry;
use tokio::sync::OwnedSemaphorePermit;

/// Whole MiB of the budget for work, given back when dropped.
///
/// Work holds what it needs at its peak. What it leaves behind, its answer, goes on holding a
/// [part](Memory::split) for as long as there are bytes of it.
#[derive(Debug)]
pub struct Memory(OwnedSemaphorePermit);

impl Memory {
    /// Memory of a permit, which has one unit for each MiB.
    pub(super) fn new(permit: OwnedSemaphorePermit) -> Self {
        telemetry::memory_used_mib(permit.num_permits() as f64);
        Self(permit)
    }

    /// Takes the part that `bytes` need, or all there is when they need more.
    pub(super) fn split(&mut self, bytes: usize) -> Option<Self> {
        self.0.split(bytes.div_ceil(1 << 20).min(self.0.num_permits())).map(Self)
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        telemetry::memory_used_mib(-(self.0.num_permits() as f64));
    }
}
