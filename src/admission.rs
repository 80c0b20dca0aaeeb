//! What may run now, what waits, and what is turned away at once.
//!
//! Work needs a worker's slot and memory for its [cost](Cost). What does not get both at once waits
//! in a queue whose length is counted in seconds of work: each cost is turned into seconds by the
//! moving average of what work has taken so far. When more than the allowed seconds wait already,
//! a request is refused without waiting, and told when the queue will have drained. Slots and
//! memory belong to a [`Ticket`], which the work itself holds: a handler that is dropped cannot
//! free what its work still uses.

mod backlog;
mod cost;

pub use cost::Cost;

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

/// The right to work: one slot and memory, given back when dropped.
#[derive(Debug)]
pub struct Ticket {
    /// How long it took to get.
    pub waited: Duration,
    cost: Cost,
    started: Instant,
    gate: Admission,
    /// Freed after `drop` has counted the end, so that what is counted never exceeds the slots.
    _permits: (OwnedSemaphorePermit, OwnedSemaphorePermit),
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
    /// full, `deadline-exceeded` when the wait outlasts `deadline`.
    pub async fn admit(&self, cost: Cost, deadline: Instant) -> Result<Ticket, Problem> {
        self.refuse_too_large(cost)?;
        let arrived = Instant::now();
        let place = self.backlog.enter(cost, self.slots.available_permits() > 0)?;
        let permits = timeout_at(deadline.into(), self.permits(cost)).await;
        drop(place);
        let permits = permits.map_err(|_| self.waited_too_long())?.map_err(stopped)?;
        Ok(self.ticket(cost, arrived.elapsed(), permits))
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
        permits: (OwnedSemaphorePermit, OwnedSemaphorePermit),
    ) -> Ticket {
        self.backlog.start(cost);
        telemetry::memory_used_mib(f64::from(cost.mib()));
        telemetry::queue_wait(waited);
        telemetry::jobs_in_progress(1.0);
        Ticket { waited, cost, started: Instant::now(), gate: self.clone(), _permits: permits }
    }

    fn refuse_too_large(&self, cost: Cost) -> Result<(), Problem> {
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

    /// Says that the work was stopped before its end.
    pub fn stopped(&self) {
        self.gate.backlog.learn_at_least(self.cost, self.started.elapsed());
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.gate.backlog.end(self.cost);
        telemetry::memory_used_mib(-f64::from(self.cost.mib()));
        telemetry::jobs_in_progress(-1.0);
    }
}

/// The semaphores are never closed, but if they were, this is what it would mean.
fn stopped(_: AcquireError) -> Problem {
    Problem::new(Kind::ShuttingDown, "the service is stopping")
}
