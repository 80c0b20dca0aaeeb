//! The context of one task: cancellation, deadline, progress, time of each stage, its share of the
//! threads and its memory.

#[cfg(feature = "scheduling")]
use crate::scheduler::{Share, Ticket};
use crate::telemetry;
use pixmesh_meshing::{Cancelled, Control, Stage};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
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
    /// Threads of a task without a ticket; `None` for one.
    threads: Option<NonZeroUsize>,
    /// Steps of the present stage, behind and in all; 0 in all where they are not counted.
    done: AtomicUsize,
    total: AtomicUsize,
    /// How much of the task is behind, 0 to 1, as the bits of a floating-point number.
    whole: AtomicU64,
    stages: Mutex<Stages>,
}

/// How far a task is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage that runs.
    pub stage: &'static str,
    /// How much of the stage is behind, 0 to 1.
    pub fraction: f64,
    /// How much of the task is behind, 0 to 1.
    pub whole: f64,
    /// About how long the rest takes; `None` while that cannot be told.
    pub remaining: Option<Duration>,
}

/// The time after which the rest is estimated.
const ESTIMATES_AFTER: Duration = Duration::from_millis(500);

/// What a ticket grants.
#[derive(Debug)]
struct Granted {
    #[cfg(feature = "scheduling")]
    share: Share,
    memory_bytes: u64,
}

/// The time that each stage took, in the order in which they began, and the one that runs, with its
/// span in the trace.
#[derive(Debug, Default)]
struct Stages {
    past: Vec<(&'static str, Duration)>,
    present: Option<(&'static str, Instant, Span)>,
    /// When the first one began.
    began: Option<Instant>,
    /// Where the work that reports a whole of its own begins and ends in the task.
    part: Option<[f64; 2]>,
}

impl Context {
    /// The context of a task that must end by `deadline`.
    #[must_use]
    pub fn new(deadline: Instant) -> Self {
        Self { deadline: Some(deadline), ..Self::default() }
    }

    /// The context of a task that has so many threads for itself, any time and any amount of memory.
    #[must_use]
    pub fn on_threads(threads: NonZeroUsize) -> Self {
        Self { threads: Some(threads), ..Self::default() }
    }

    /// Lets the task use the threads and the memory that its ticket grants.
    #[cfg(feature = "scheduling")]
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

    /// How far the task is; `None` before its first stage.
    #[must_use]
    pub fn progress(&self) -> Option<Progress> {
        let stages = self.stages();
        let (stage, ..) = stages.present.as_ref()?;
        let [done, total] = [&self.done, &self.total].map(|count| count.load(Ordering::Relaxed));
        let fraction = if total == 0 { 0.0 } else { (done as f64 / total as f64).min(1.0) };
        let whole = f64::from_bits(self.whole.load(Ordering::Relaxed));
        let elapsed = stages.began.map_or(Duration::ZERO, |began| began.elapsed());
        let remaining = (whole > 0.0 && elapsed >= ESTIMATES_AFTER)
            .then(|| elapsed.mul_f64(((1.0 - whole) / whole).min(1e6)));
        Some(Progress { stage, fraction, whole, remaining })
    }

    /// Says that the work which follows, whose whole is reported, is this part of the task, from 0 to
    /// 1.
    pub(crate) fn is_part(&self, from: f64, to: f64) {
        self.stages().part = Some([from, to]);
        self.whole(0.0);
    }

    /// Begins a stage, and ends the one before it.
    pub fn begin(&self, name: &'static str) {
        self.total.store(0, Ordering::Relaxed);
        let mut stages = self.stages();
        if stages.present.as_ref().is_none_or(|(present, ..)| *present != name) {
            stages.end_present();
            let span = tracing::info_span!("stage", otel.name = name);
            let now = Instant::now();
            stages.began.get_or_insert(now);
            stages.present = Some((name, now, span));
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

    fn whole(&self, fraction: f64) {
        let [from, to] = self.stages().part.unwrap_or([0.0, 1.0]);
        self.whole.store((from + fraction * (to - from)).to_bits(), Ordering::Relaxed);
    }

    fn threads(&self) -> NonZeroUsize {
        let own = self.threads.unwrap_or(NonZeroUsize::MIN);
        #[cfg(feature = "scheduling")]
        let own = self.granted.get().map_or(own, |granted| granted.share.threads());
        own
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
        let progress = |stage, fraction, whole| {
            let progress = context.progress().unwrap();
            assert_eq!(progress, Progress { stage, fraction, whole, remaining: None });
        };
        context.begin("decode");
        progress("decode", 0.0, 0.0);
        context.is_part(0.25, 0.75);
        context.poll(Stage::Density, 0, 8).unwrap();
        context.poll(Stage::Density, 6, 8).unwrap();
        context.whole(0.5);
        progress("density", 0.75, 0.5);
        context.begin("encode");
        progress("encode", 0.0, 0.5);
    }

    #[test]
    fn the_rest_of_a_task_takes_as_long_as_its_share() {
        let context = Context::new(Instant::now() + Duration::from_secs(60));
        context.begin("simplify");
        context.whole(0.25);
        std::thread::sleep(ESTIMATES_AFTER);
        let elapsed = ESTIMATES_AFTER.as_secs_f64();
        let remaining = context.progress().unwrap().remaining.unwrap().as_secs_f64();
        assert!((3.0 * elapsed..30.0 * elapsed).contains(&remaining), "{remaining} s");
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
