//! The context of one task: cancellation, deadline, progress, time of each stage, its share of the
//! threads and its memory.

use crate::scheduler::{Share, Ticket};
use crate::telemetry;
use pixmesh_meshing::{Cancelled, Control, Stage};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tracing::Span;

/// The context of one task.
///
/// [`Context::default`] has no deadline, one thread and any amount of memory.
#[derive(Debug, Default)]
pub struct Context {
    cancelled: AtomicBool,
    /// `None` for a task that may take any time.
    deadline: Option<Instant>,
    /// What the task's ticket grants; unset for a task without one.
    granted: OnceLock<Granted>,
    /// Steps of the present stage, behind and in all; 0 in all where they are not counted.
    done: AtomicUsize,
    total: AtomicUsize,
    stages: Mutex<Stages>,
}

/// What a ticket grants.
#[derive(Debug)]
struct Granted {
    share: Share,
    memory_bytes: u64,
}

/// The time that each stage took, in the order in which they began, and the one that runs, with its
/// span in the trace.
#[derive(Debug, Default)]
struct Stages {
    past: Vec<(&'static str, Duration)>,
    present: Option<(&'static str, Instant, Span)>,
}

impl Context {
    /// The context of a task that must end by `deadline`.
    #[must_use]
    pub fn new(deadline: Instant) -> Self {
        Self { deadline: Some(deadline), ..Self::default() }
    }

    /// Lets the task use the threads and the memory that its ticket grants.
    pub(crate) fn grant(&self, ticket: &Ticket) {
        let granted = Granted { share: ticket.share(), memory_bytes: ticket.memory_bytes() };
        // A task has one ticket, and this is called once.
        let _ = self.granted.set(granted);
    }

    /// The memory that the scheduler reserved for the task, in bytes; `None` for a task without a
    /// ticket, which may take any amount.
    #[must_use]
    pub fn memory_bytes(&self) -> Option<u64> {
        self.granted.get().map(|granted| granted.memory_bytes)
    }

    /// Asks the task to stop.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Checks that the task shall go on.
    ///
    /// # Errors
    /// [`Cancelled`] when it shall not.
    pub fn check(&self) -> Result<(), Cancelled> {
        let is_late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        if self.cancelled.load(Ordering::Relaxed) || is_late {
            return Err(Cancelled);
        }
        Ok(())
    }

    /// The stage that runs, and how much of it is behind, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> Option<(&'static str, f64)> {
        let stages = self.stages();
        let (name, ..) = stages.present.as_ref()?;
        let [done, total] = [&self.done, &self.total].map(|count| count.load(Ordering::Relaxed));
        let fraction = if total == 0 { 0.0 } else { (done as f64 / total as f64).min(1.0) };
        Some((name, fraction))
    }

    /// Begins a stage, and ends the one before it.
    pub fn begin(&self, name: &'static str) {
        self.total.store(0, Ordering::Relaxed);
        let mut stages = self.stages();
        if stages.present.as_ref().is_none_or(|(present, ..)| *present != name) {
            stages.end_present();
            let span = tracing::info_span!("stage", otel.name = name);
            stages.present = Some((name, Instant::now(), span));
        }
    }

    /// Adds a stage that was timed elsewhere.
    pub fn record(&self, name: &'static str, took: Duration) {
        self.stages().add(name, took);
    }

    /// Ends the last stage and returns the time of each.
    #[must_use]
    pub fn finish(&self) -> Vec<(&'static str, Duration)> {
        let mut stages = self.stages();
        stages.end_present();
        for (name, took) in &stages.past {
            telemetry::stage(name, *took);
        }
        std::mem::take(&mut stages.past)
    }

    fn stages(&self) -> MutexGuard<'_, Stages> {
        self.stages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stages {
    fn end_present(&mut self) {
        if let Some((name, began, _)) = self.present.take() {
            self.add(name, began.elapsed());
        }
    }

    fn add(&mut self, name: &'static str, took: Duration) {
        match self.past.iter_mut().find(|(past, _)| *past == name) {
            Some((_, sum)) => *sum += took,
            None => self.past.push((name, took)),
        }
    }
}

impl Control for Context {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        if done == 0 {
            self.begin(stage.name());
        }
        self.done.store(done, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        self.check()
    }

    fn threads(&self) -> NonZeroUsize {
        self.granted.get().map_or(NonZeroUsize::MIN, |granted| granted.share.threads())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_timed_in_the_order_in_which_they_begin() {
        let context = Context::new(Instant::now() + Duration::from_secs(60));
        context.record("queue", Duration::from_millis(3));
        context.begin("decode");
        context.poll(Stage::Density, 0, 9).unwrap();
        context.poll(Stage::Density, 5, 9).unwrap();
        context.begin("encode");
        let names: Vec<_> = context.finish().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["queue", "decode", "density", "encode"]);
    }

    #[test]
    fn progress_is_that_of_the_stage_that_runs() {
        let context = Context::new(Instant::now() + Duration::from_secs(60));
        assert_eq!(context.progress(), None);
        context.begin("decode");
        assert_eq!(context.progress(), Some(("decode", 0.0)));
        context.poll(Stage::Density, 0, 8).unwrap();
        context.poll(Stage::Density, 6, 8).unwrap();
        assert_eq!(context.progress(), Some(("density", 0.75)));
        context.begin("encode");
        assert_eq!(context.progress(), Some(("encode", 0.0)));
    }

    #[test]
    fn work_stops_at_its_deadline_or_when_nobody_waits() {
        let late = Context::new(Instant::now());
        assert_eq!(late.poll(Stage::Simplify, 1, 2), Err(Cancelled));
        let left = Context::new(Instant::now() + Duration::from_secs(60));
        assert_eq!(left.check(), Ok(()));
        left.cancel();
        assert_eq!(left.check(), Err(Cancelled));
    }
}
