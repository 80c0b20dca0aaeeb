//! Admits tasks: fair shares of worker slots and memory, and a queue measured in seconds of work.
//!
//! A task needs one worker slot and memory for its [cost](Cost). A task that cannot get both at once
//! waits in a queue. The queue's length is measured in seconds: a moving average of the time that
//! tasks of each kind took turns a cost into seconds. Owners take turns by the time that their tasks
//! took, and while several of them wait, each may fill an equal part of those seconds. The scheduler refuses a task of an owner whose
//! part is full at once, and says when the queue will have drained. From then on, until nothing
//! waits, a tenth of those seconds may wait, so that an overload does not make everyone wait long. Because the seconds are estimates,
//! it also refuses a task that waited for twice the queue's limit.
//!
//! Slot and memory belong to a [`Ticket`], which the running task holds: a handler that is dropped
//! cannot free what its task still uses. Idle workers lend their threads: a [`Share`] tells each task
//! how many threads it may use.
//!
//! An answer holds a part of its task's memory until its bytes are sent, so that slow readers count
//! against the budget, not beside it.

mod backlog;
mod gate;
mod limits;

pub use gate::Memory;
pub use limits::Limits;

use crate::error::EngineError;
use crate::owner::Owner;
use crate::task::Cost;
use crate::telemetry::{self, Shed};
use backlog::Backlog;
use gate::{Capacity, Gate};
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::timeout_at;

/// Admits tasks within limits.
#[derive(Clone, Debug)]
pub struct Scheduler {
    gate: Arc<Gate>,
    backlog: Arc<Backlog>,
}

/// A worker slot without memory.
#[derive(Debug)]
pub struct Slot {
    slot: gate::Slot,
    waited: Duration,
}

/// Tells a task its share of the threads, which changes as tasks begin and end.
#[derive(Clone, Debug)]
pub struct Share(Arc<Gate>);

/// The right to run one task: a slot and memory, given back when dropped.
#[derive(Debug)]
pub struct Ticket {
    /// How long the task waited.
    pub waited: Duration,
    cost: Cost,
    started: Instant,
    backlog: Arc<Backlog>,
    memory: Memory,
    /// Freed after `drop` has counted the end, so that what is counted never exceeds the slots.
    slot: gate::Slot,
}

impl Scheduler {
    /// A scheduler with these limits.
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
    /// [`EngineError::TooLarge`] when the budget is smaller than the task,
    /// [`QueueFull`](EngineError::QueueFull) and [`KeyQueueFull`](EngineError::KeyQueueFull) when
    /// too much waits, [`WaitedTooLong`](EngineError::WaitedTooLong) when the queue takes much longer
    /// than expected, [`DeadlineInQueue`](EngineError::DeadlineInQueue) when the wait outlasts
    /// `deadline`.
    pub async fn admit(
        &self,
        owner: &Owner,
        cost: Cost,
        deadline: Instant,
    ) -> Result<Ticket, EngineError> {
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
        let (slot, memory) = entered.ok_or(EngineError::Stopping)?;
        Ok(self.ticket(cost, arrived.elapsed(), slot, memory))
    }

    /// Refuses what [`Scheduler::admit`] would refuse of this owner at any cost, so that a server need
    /// not receive a long body first.
    ///
    /// # Errors
    /// [`EngineError::QueueFull`] and [`EngineError::KeyQueueFull`].
    pub fn refuse_crowd(&self, owner: &Owner) -> Result<(), EngineError> {
        self.backlog.refuse_crowd(owner, self.gate.has_slot_for(owner))
    }

    /// Waits for a slot for a stored job, in turn with all tasks that wait; `None` when the scheduler
    /// gives out no more.
    pub async fn slot(&self) -> Option<Slot> {
        let asked = Instant::now();
        let (slot, _) = self.gate.enter(&Owner::Jobs, 0).await?;
        Some(Slot { slot, waited: asked.elapsed() })
    }

    /// Waits for the memory of a task that has its slot.
    ///
    /// # Errors
    /// [`EngineError::TooLarge`] when the budget is smaller than the task, and
    /// [`DeadlineInQueue`](EngineError::DeadlineInQueue) when the wait outlasts `deadline`.
    pub async fn admit_to(
        &self,
        slot: Slot,
        cost: Cost,
        deadline: Instant,
    ) -> Result<Ticket, EngineError> {
        self.refuse_too_large(cost)?;
        let asked = Instant::now();
        let memory = timeout_at(deadline.into(), self.gate.memory(&slot.slot, cost.mib())).await;
        let memory = memory.map_err(|_| self.waited_too_long())?.ok_or(EngineError::Stopping)?;
        Ok(self.ticket(cost, slot.waited + asked.elapsed(), slot.slot, memory))
    }

    /// Seconds until the tasks that wait and run now will be done: whole, 1 to 300.
    #[must_use]
    pub fn drain_s(&self) -> u64 {
        self.backlog.drain_s()
    }

    fn ticket(&self, cost: Cost, waited: Duration, slot: gate::Slot, memory: Memory) -> Ticket {
        self.backlog.start(cost);
        telemetry::queue_wait(waited);
        telemetry::tasks_in_progress(1.0);
        let backlog = Arc::clone(&self.backlog);
        Ticket { waited, cost, started: Instant::now(), backlog, memory, slot }
    }

    /// Refuses a task that could never run.
    ///
    /// # Errors
    /// [`EngineError::TooLarge`] when the budget is smaller than the task.
    pub fn refuse_too_large(&self, cost: Cost) -> Result<(), EngineError> {
        let (needed_mib, budget_mib) = (cost.mib(), self.gate.memory_mib());
        match needed_mib as usize <= budget_mib {
            true => Ok(()),
            false => Err(EngineError::TooLarge { needed_mib, budget_mib }),
        }
    }

    fn waited_too_long(&self) -> EngineError {
        telemetry::shed(Shed::Deadline);
        EngineError::DeadlineInQueue { retry_after_s: self.backlog.drain_s() }
    }
}

impl Share {
    /// Threads that the task may use at the moment, its own among them.
    #[must_use]
    pub fn threads(&self) -> NonZeroUsize {
        self.0.threads_of_each()
    }
}

impl Ticket {
    /// The task's share of the threads.
    #[must_use]
    pub fn share(&self) -> Share {
        Share(self.slot.gate())
    }

    /// The memory reserved for the task, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> u64 {
        u64::from(self.cost.mib()) << 20
    }

    /// Counts the time of a task that completed in the average.
    pub fn completed(&self) {
        self.backlog.learn(self.cost, self.started.elapsed());
    }

    /// Splits off the memory that an answer of so many bytes holds until it is sent.
    #[must_use]
    pub fn keep(&mut self, bytes: usize) -> Memory {
        self.memory.split(bytes)
    }

    /// Counts the time of a task that was stopped, when it took longer than expected.
    pub fn stopped(&self) {
        self.backlog.learn_at_least(self.cost, self.started.elapsed());
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.backlog.end(self.cost);
        telemetry::tasks_in_progress(-1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::{Effort, WorkKind};

    fn gate(queue_s: f64) -> Scheduler {
        Scheduler::new(&Limits {
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
        let impatient = matches!(problem, EngineError::WaitedTooLong { .. });
        assert!(impatient, "it waits no longer than the queue may take");
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
        let admitted = gate.admit(&Owner::Anonymous, cost, soon).await;
        assert!(matches!(admitted, Err(EngineError::DeadlineInQueue { .. })));
        drop(ticket);
    }
}
