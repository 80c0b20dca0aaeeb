//! What may run now, what waits, and what is turned away at once.
//!
//! Work needs a worker's slot and memory for its [cost](Cost). What does not get both at once waits
//! in a queue whose length is counted in seconds of work: each cost is turned into seconds by the
//! moving averages of what work of its kind has taken so far. When more than the allowed seconds
//! wait already, a request is refused without waiting, and told when the queue will have drained.
//! The seconds are estimates; what has really waited for twice as long is refused too. Slots and
//! memory belong to a [`Ticket`], which the work itself holds: a handler that is dropped cannot
//! free what its work still uses.
//!
//! An answer holds a part of its work's memory until its bytes are sent, so that slow readers use
//! the budget and not what is beyond it. While they read, less work is admitted; the server cuts
//! those that stall.

mod backlog;
mod cost;
mod effort;
mod footprint;
mod memory;

pub use cost::{Compared, Cost};
pub use memory::Memory;

use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use backlog::Backlog;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{AcquireError, OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout_at;

/// The gate that all work passes.
#[derive(Clone, Debug)]
pub struct Admission {
    slots: Arc<Semaphore>,
    memory: Arc<Semaphore>,
    memory_mib: usize,
    backlog: Arc<Backlog>,
}

/// A worker's slot, without the memory to work.
#[derive(Debug)]
pub struct Slot {
    permit: OwnedSemaphorePermit,
    asked: Instant,
}

/// The right to work: one slot and memory, given back when dropped.
#[derive(Debug)]
pub struct Ticket {
    /// How long it took to get.
    pub waited: Duration,
    cost: Cost,
    started: Instant,
    gate: Admission,
    memory: Memory,
    /// Freed after `drop` has counted the end, so that what is counted never exceeds the slots.
    _slot: OwnedSemaphorePermit,
}

impl Admission {
    /// A gate for `workers` at a time, `memory_bytes` for all of them, and `queue_s` seconds of
    /// waiting work.
    #[must_use]
    pub fn new(workers: usize, memory_bytes: u64, queue_s: f64) -> Self {
        let memory_mib = usize::try_from(memory_bytes >> 20).unwrap_or(usize::MAX);
        let memory_mib = memory_mib.clamp(1, Semaphore::MAX_PERMITS);
        telemetry::memory_total_mib(memory_mib);
        Self {
            slots: Arc::new(Semaphore::new(workers.min(Semaphore::MAX_PERMITS))),
            memory: Arc::new(Semaphore::new(memory_mib)),
            memory_mib,
            backlog: Arc::new(Backlog::new(workers, queue_s)),
        }
    }

    /// Waits for a slot and memory.
    ///
    /// # Errors
    /// `work-too-large` when there is not that much memory at all, `overloaded` when the queue is
    /// full or the wait outlasts what it should take, `deadline-exceeded` when the wait outlasts
    /// `deadline`.
    pub async fn admit(&self, cost: Cost, deadline: Instant) -> Result<Ticket, Problem> {
        self.refuse_too_large(cost)?;
        let arrived = Instant::now();
        let place = self.backlog.enter(cost, self.slots.available_permits() > 0)?;
        let patience = arrived.checked_add(self.backlog.patience());
        let patience = patience.filter(|&end| end < deadline);
        let permits = timeout_at(patience.unwrap_or(deadline).into(), self.permits(cost)).await;
        drop(place);
        let permits = permits.map_err(|_| match patience {
            Some(_) => self.backlog.lose_patience(),
            None => self.waited_too_long(),
        })?;
        let (slot, memory) = permits.map_err(stopped)?;
        Ok(self.ticket(cost, arrived.elapsed(), slot, Memory::new(memory)))
    }

    /// Waits for a slot, in turn with all else that waits for one, for work that is kept elsewhere
    /// meanwhile; `None` when there will be none.
    pub async fn slot(&self) -> Option<Slot> {
        let permit = Arc::clone(&self.slots).acquire_owned().await.ok()?;
        Some(Slot { permit, asked: Instant::now() })
    }

    /// Waits for the memory that is missing to a slot.
    ///
    /// # Errors
    /// `work-too-large` when there is not that much memory at all, `deadline-exceeded` when the
    /// wait outlasts `deadline`.
    pub async fn admit_to(
        &self,
        slot: Slot,
        cost: Cost,
        deadline: Instant,
    ) -> Result<Ticket, Problem> {
        self.refuse_too_large(cost)?;
        let permits = Arc::clone(&self.memory).acquire_many_owned(cost.mib());
        let memory = timeout_at(deadline.into(), permits).await;
        let memory = memory.map_err(|_| self.waited_too_long())?.map_err(stopped)?;
        Ok(self.ticket(cost, slot.asked.elapsed(), slot.permit, Memory::new(memory)))
    }

    /// Whole seconds until what waits and runs now will be done, 1 or more.
    #[must_use]
    pub fn drain_s(&self) -> u64 {
        self.backlog.drain_s()
    }

    /// First a slot, so that only as many as there are slots hold or await memory.
    async fn permits(
        &self,
        cost: Cost,
    ) -> Result<(OwnedSemaphorePermit, OwnedSemaphorePermit), AcquireError> {
        let slot = Arc::clone(&self.slots).acquire_owned().await?;
        let memory = Arc::clone(&self.memory).acquire_many_owned(cost.mib()).await?;
        Ok((slot, memory))
    }

    fn ticket(
        &self,
        cost: Cost,
        waited: Duration,
        slot: OwnedSemaphorePermit,
        memory: Memory,
    ) -> Ticket {
        self.backlog.start(cost);
        telemetry::queue_wait(waited);
        telemetry::jobs_in_progress(1.0);
        let gate = self.clone();
        Ticket { waited, cost, started: Instant::now(), gate, memory, _slot: slot }
    }

    /// Refuses what could never run.
    ///
    /// # Errors
    /// `work-too-large` when there is not that much memory at all.
    pub fn refuse_too_large(&self, cost: Cost) -> Result<(), Problem> {
        if cost.mib() as usize <= self.memory_mib {
            return Ok(());
        }
        let detail = format!(
            "this image with these parameters needs about {} MiB, and there are {} MiB for work: \
             send a smaller image, or ask for fewer vertices or a method that starts with fewer \
             points",
            cost.mib(),
            self.memory_mib
        );
        let problem = Problem::new(Kind::WorkTooLarge, detail).setting("--memory-budget");
        Err(problem.limit(self.memory_mib, cost.mib()))
    }

    fn waited_too_long(&self) -> Problem {
        telemetry::shed(Shed::Deadline);
        let detail = "the deadline passed while the request waited for a worker";
        Problem::new(Kind::DeadlineExceeded, detail)
            .setting("--sync-deadline")
            .retry_after_s(self.backlog.drain_s())
    }
}

impl Ticket {
    /// Says that the work was done to its end, so that its time counts in the average.
    pub fn completed(&self) {
        self.gate.backlog.learn(self.cost, self.started.elapsed());
    }

    /// Takes out the memory that an answer of so many bytes needs for as long as it is there.
    pub fn keep(&mut self, bytes: usize) -> Option<Memory> {
        self.memory.split(bytes)
    }

    /// Says that the work was stopped before its end.
    pub fn stopped(&self) {
        self.gate.backlog.learn_at_least(self.cost, self.started.elapsed());
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.gate.backlog.end(self.cost);
        telemetry::jobs_in_progress(-1.0);
    }
}

/// The semaphores are never closed, but if they were, this is what it would mean.
fn stopped(_: AcquireError) -> Problem {
    Problem::new(Kind::ShuttingDown, "the service is stopping")
}

#[cfg(test)]
mod tests {
    use super::effort::{Effort, WorkKind};
    use super::*;

    #[tokio::test]
    async fn an_answer_keeps_its_memory_and_not_the_slot_until_it_is_gone() {
        let gate = Admission::new(1, 1 << 20, 0.02);
        let cost = Cost::of_effort(Effort { kind: WorkKind::OneShot, units: 1.0 });
        let deadline = Instant::now() + Duration::from_secs(60);
        let mut ticket = gate.admit(cost, deadline).await.unwrap();
        let kept = ticket.keep(usize::MAX);
        drop(ticket);
        assert_eq!(gate.slots.available_permits(), 1);
        let problem = gate.admit(cost, deadline).await.unwrap_err();
        assert_eq!(problem.kind(), Kind::Overloaded, "it waits no longer than the queue may take");
        drop(kept);
        assert!(gate.admit(cost, deadline).await.is_ok());
    }

    #[tokio::test]
    async fn a_deadline_before_the_end_of_patience_is_what_is_exceeded() {
        let gate = Admission::new(1, 1 << 20, 60.0);
        let cost = Cost::of_effort(Effort { kind: WorkKind::OneShot, units: 1.0 });
        let ticket = gate.admit(cost, Instant::now() + Duration::from_secs(60)).await.unwrap();
        let soon = Instant::now() + Duration::from_millis(20);
        assert_eq!(gate.admit(cost, soon).await.unwrap_err().kind(), Kind::DeadlineExceeded);
        drop(ticket);
    }
}
