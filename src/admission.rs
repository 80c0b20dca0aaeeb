//! What may run now, what waits, and what is turned away at once.
//!
//! Work needs a worker's slot and memory for its [cost](Cost). What does not get both at once waits
//! in a queue whose length is counted in seconds of work: each cost is turned into seconds by the
//! moving averages of what work of its kind has taken so far. Owners share the queue: where several
//! wait, each may fill its part of those seconds, and they take turns. When more than that wait
//! already, a request is refused without waiting, and told when the queue will have drained.
//! The seconds are estimates; what has really waited for twice as long is refused too. Slots and
//! memory belong to a [`Ticket`], which the work itself holds: a handler that is dropped cannot
//! free what its work still uses. Workers that have none of their own help those that do: each piece
//! of work is told its [`Share`] of the threads.
//!
//! An answer holds a part of its work's memory until its bytes are sent, so that slow readers use
//! the budget and not what is beyond it. While they read, less work is admitted; the server cuts
//! those that stall.

mod backlog;
mod cost;
mod effort;
mod footprint;
mod gate;
mod memory;
mod task;

pub use cost::{Compared, Cost, Kept};
pub use memory::Memory;
pub use task::MeshTask;

use crate::extract::owner::Owner;
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use backlog::Backlog;
use gate::{Capacity, Gate};
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::timeout_at;

/// The gate that all work passes.
#[derive(Clone, Debug)]
pub struct Admission {
    gate: Arc<Gate>,
    backlog: Arc<Backlog>,
}

/// What admission gives out.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Pieces of work at a time.
    pub workers: usize,
    /// Threads that they may work on together, where there are fewer of them.
    pub threads: usize,
    /// Memory for all of them and for answers that are not sent yet.
    pub memory_bytes: u64,
    /// Seconds of waiting work.
    pub queue_s: f64,
    /// Pieces of work at a time of one key's owner.
    pub running_per_key: usize,
    /// Requests of one key's owner that may wait.
    pub queued_per_key: usize,
}

/// A worker's slot, without the memory to work.
#[derive(Debug)]
pub struct Slot {
    slot: gate::Slot,
    waited: Duration,
}

/// Tells a piece of work its share of the threads, which those that come and go change.
#[derive(Clone, Debug)]
pub struct Share(Arc<Gate>);

/// The right to work: one slot and memory, given back when dropped.
#[derive(Debug)]
pub struct Ticket {
    /// How long it took to get.
    pub waited: Duration,
    cost: Cost,
    started: Instant,
    backlog: Arc<Backlog>,
    memory: Memory,
    /// Freed after `drop` has counted the end, so that what is counted never exceeds the slots.
    slot: gate::Slot,
}

impl Admission {
    /// A gate with these limits.
    #[must_use]
    pub fn new(limits: &Limits) -> Self {
        let memory_mib = usize::try_from(limits.memory_bytes >> 20).unwrap_or(usize::MAX).max(1);
        telemetry::memory_total_mib(memory_mib);
        let capacity = Capacity {
            slots: limits.workers,
            threads: limits.threads,
            memory_mib,
            slots_per_key: limits.running_per_key.min(limits.workers),
        };
        Self { gate: Arc::new(Gate::new(capacity)), backlog: Arc::new(Backlog::new(limits)) }
    }

    /// Waits for a slot and memory.
    ///
    /// # Errors
    /// `work-too-large` when there is not that much memory at all, `overloaded` when the queue is
    /// full or the wait outlasts what it should take, `quota-exceeded` when too much of the owner
    /// waits, `deadline-exceeded` when the wait outlasts `deadline`.
    pub async fn admit(
        &self,
        owner: &Owner,
        cost: Cost,
        deadline: Instant,
    ) -> Result<Ticket, Problem> {
        self.refuse_too_large(cost)?;
        let arrived = Instant::now();
        let place = self.backlog.enter(owner, cost, self.gate.has_slot_for(owner))?;
        let patience = arrived.checked_add(self.backlog.patience());
        let patience = patience.filter(|&end| end < deadline);
        let entered = self.gate.enter(owner, cost.mib());
        let entered = timeout_at(patience.unwrap_or(deadline).into(), entered).await;
        drop(place);
        let entered = entered.map_err(|_| match patience {
            Some(_) => self.backlog.lose_patience(),
            None => self.waited_too_long(),
        })?;
        let (slot, memory) = entered.ok_or_else(stopped)?;
        Ok(self.ticket(cost, arrived.elapsed(), slot, memory))
    }

    /// Refuses what [`Admission::admit`] would refuse of this owner whatever it costs: so that a long
    /// body need not be received first.
    ///
    /// # Errors
    /// `overloaded` and `quota-exceeded`.
    pub fn refuse_crowd(&self, owner: &Owner) -> Result<(), Problem> {
        self.backlog.refuse_crowd(owner, self.gate.has_slot_for(owner))
    }

    /// Waits for a slot, in turn with all else that waits for one, for work that is kept elsewhere
    /// meanwhile; `None` when there will be none.
    pub async fn slot(&self) -> Option<Slot> {
        let asked = Instant::now();
        let (slot, _) = self.gate.enter(&Owner::Jobs, 0).await?;
        Some(Slot { slot, waited: asked.elapsed() })
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
        let asked = Instant::now();
        let memory = timeout_at(deadline.into(), self.gate.memory(&slot.slot, cost.mib())).await;
        let memory = memory.map_err(|_| self.waited_too_long())?.ok_or_else(stopped)?;
        Ok(self.ticket(cost, slot.waited + asked.elapsed(), slot.slot, memory))
    }

    /// Whole seconds until what waits and runs now will be done, 1 or more.
    #[must_use]
    pub fn drain_s(&self) -> u64 {
        self.backlog.drain_s()
    }

    fn ticket(&self, cost: Cost, waited: Duration, slot: gate::Slot, memory: Memory) -> Ticket {
        self.backlog.start(cost);
        telemetry::queue_wait(waited);
        telemetry::jobs_in_progress(1.0);
        let backlog = Arc::clone(&self.backlog);
        Ticket { waited, cost, started: Instant::now(), backlog, memory, slot }
    }

    /// Refuses what could never run.
    ///
    /// # Errors
    /// `work-too-large` when there is not that much memory at all.
    pub fn refuse_too_large(&self, cost: Cost) -> Result<(), Problem> {
        let memory_mib = self.gate.memory_mib();
        if cost.mib() as usize <= memory_mib {
            return Ok(());
        }
        let detail = format!(
            "this image with these parameters needs about {} MiB, and there are {} MiB for work: \
             send a smaller image, or ask for fewer vertices or a method that starts with fewer \
             points",
            cost.mib(),
            memory_mib
        );
        let problem = Problem::new(Kind::WorkTooLarge, detail).setting("--memory-budget");
        Err(problem.limit(memory_mib, cost.mib()))
    }

    fn waited_too_long(&self) -> Problem {
        telemetry::shed(Shed::Deadline);
        let detail = "the deadline passed while the request waited for a worker";
        Problem::new(Kind::DeadlineExceeded, detail)
            .setting("--sync-deadline")
            .retry_after_s(self.backlog.drain_s())
    }
}

impl Share {
    /// How many threads the work may use at the moment, its own among them.
    #[must_use]
    pub fn threads(&self) -> NonZeroUsize {
        self.0.threads_of_each()
    }
}

impl Ticket {
    /// What tells the work its share of the threads.
    #[must_use]
    pub fn share(&self) -> Share {
        Share(self.slot.gate())
    }

    /// Says that the work was done to its end, so that its time counts in the average.
    pub fn completed(&self) {
        self.backlog.learn(self.cost, self.started.elapsed());
    }

    /// Takes out the memory that an answer of so many bytes needs for as long as it is there.
    #[must_use]
    pub fn keep(&mut self, bytes: usize) -> Memory {
        self.memory.split(bytes)
    }

    /// Says that the work was stopped before its end.
    pub fn stopped(&self) {
        self.backlog.learn_at_least(self.cost, self.started.elapsed());
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.backlog.end(self.cost);
        telemetry::jobs_in_progress(-1.0);
    }
}

/// The gate is never closed, but if it were, this is what it would mean.
fn stopped() -> Problem {
    Problem::new(Kind::ShuttingDown, "the service is stopping")
}

#[cfg(test)]
mod tests {
    use super::effort::{Effort, WorkKind};
    use super::*;

    fn gate(queue_s: f64) -> Admission {
        Admission::new(&Limits {
            workers: 1,
            threads: 1,
            memory_bytes: 1 << 20,
            queue_s,
            running_per_key: 1,
            queued_per_key: 1,
        })
    }

    #[tokio::test]
    async fn an_answer_keeps_its_memory_and_not_the_slot_until_it_is_gone() {
        let gate = gate(0.02);
        let cost = Cost::of_effort(Effort { kind: WorkKind::OneShot, units: 1.0 });
        let deadline = Instant::now() + Duration::from_secs(60);
        let mut ticket = gate.admit(&Owner::Anonymous, cost, deadline).await.unwrap();
        let kept = ticket.keep(usize::MAX);
        drop(ticket);
        assert!(gate.gate.has_slot_for(&Owner::Anonymous));
        let problem = gate.admit(&Owner::Anonymous, cost, deadline).await.unwrap_err();
        assert_eq!(problem.kind(), Kind::Overloaded, "it waits no longer than the queue may take");
        drop(kept);
        assert!(gate.admit(&Owner::Anonymous, cost, deadline).await.is_ok());
    }

    #[tokio::test]
    async fn a_deadline_before_the_end_of_patience_is_what_is_exceeded() {
        let gate = gate(60.0);
        let cost = Cost::of_effort(Effort { kind: WorkKind::OneShot, units: 1.0 });
        let ticket = gate
            .admit(&Owner::Anonymous, cost, Instant::now() + Duration::from_secs(60))
            .await
            .unwrap();
        let soon = Instant::now() + Duration::from_millis(20);
        assert_eq!(
            gate.admit(&Owner::Anonymous, cost, soon).await.unwrap_err().kind(),
            Kind::DeadlineExceeded
        );
        drop(ticket);
    }
}
