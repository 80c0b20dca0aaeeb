//! Memory of the budget that somebody holds.

use super::gate::Gate;
use crate::owner::Owner;
use crate::telemetry;
use std::sync::Arc;

/// Whole MiB of the budget for work, given back when dropped.
///
/// Work holds what it needs at its peak. What it leaves behind, its answer, goes on holding a
/// [part](Memory::split) for as long as there are bytes of it.
#[derive(Debug)]
pub struct Memory {
    gate: Arc<Gate>,
    owner: Owner,
    mib: usize,
}

impl Memory {
    /// Memory that the gate has given out.
    pub(super) fn new(gate: Arc<Gate>, owner: Owner, mib: usize) -> Self {
        telemetry::memory_used_mib(mib as f64);
        Self { gate, owner, mib }
    }

    /// Takes the part that `bytes` need, or all there is when they need more.
    pub(super) fn split(&mut self, bytes: usize) -> Self {
        let mib = bytes.div_ceil(1 << 20).min(self.mib);
        self.mib -= mib;
        Self { gate: Arc::clone(&self.gate), owner: self.owner.clone(), mib }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        telemetry::memory_used_mib(-(self.mib as f64));
        self.gate.free(&self.owner, self.mib);
    }
}
