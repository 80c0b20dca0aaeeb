//! The queue, counted in seconds of work.

use super::Cost;
use super::effort::{Effort, WorkKind};
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The seconds of work that move an average half of the way to what they took per unit.
///
/// Short work counts for little, because what every request costs, whatever its size, makes it look
/// dear: two hundred requests of a millisecond must not decide what a picture of 40 megapixels is
/// expected to take.
const HALF_WAY_S: f64 = 2.0;
/// The longest time that a client is told to wait, in seconds.
const MAX_RETRY_AFTER_S: f64 = 300.0;
/// How many times the queue's limit anything may really wait.
const PATIENCE: f64 = 2.0;

/// What waits and what runs, in units of work of each kind, and the seconds that a unit takes.
#[derive(Debug)]
pub(super) struct Backlog {
    workers: f64,
    limit_s: f64,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    waiting: usize,
    /// By kind of work, as the two below.
    waiting_units: [f64; WorkKind::ALL.len()],
    running_units: [f64; WorkKind::ALL.len()],
    s_per_unit: [f64; WorkKind::ALL.len()],
}

/// A place in the queue, given up when dropped.
#[derive(Debug)]
pub(super) struct Place<'a> {
    backlog: &'a Backlog,
    effort: Effort,
}

impl Backlog {
    pub(super) fn new(workers: usize, limit_s: f64) -> Self {
        let none = [0.0; WorkKind::ALL.len()];
        let state = State {
            waiting: 0,
            waiting_units: none,
            running_units: none,
            s_per_unit: WorkKind::ALL.map(WorkKind::first_guess_s),
        };
        Self { workers: workers as f64, limit_s, state: Mutex::new(state) }
    }

    /// Takes a place, unless more than the allowed seconds of work wait already.
    ///
    /// # Errors
    /// `overloaded`, with the seconds until the queue will have drained.
    pub(super) fn enter(&self, cost: Cost, slot_is_free: bool) -> Result<Place<'_>, Problem> {
        let mut state = self.state();
        let waiting_s = self.seconds(&state.waiting_units, &state);
        if waiting_s > self.limit_s && !slot_is_free {
            drop(state);
            return Err(self.full(waiting_s));
        }
        let effort = cost.effort();
        state.waiting += 1;
        state.waiting_units[effort.kind as usize] += effort.units;
        telemetry::queue_depth(state.waiting);
        Ok(Place { backlog: self, effort })
    }

    /// Work of this cost begins.
    pub(super) fn start(&self, cost: Cost) {
        let Effort { kind, units } = cost.effort();
        self.state().running_units[kind as usize] += units;
    }

    /// Work of this cost has ended, one way or another.
    pub(super) fn end(&self, cost: Cost) {
        let Effort { kind, units } = cost.effort();
        self.state().running_units[kind as usize] -= units;
    }

    /// Lets completed work count in the average of its kind, by how long it took.
    pub(super) fn learn(&self, cost: Cost, took: Duration) {
        let Effort { kind, units } = cost.effort();
        let took_s = took.as_secs_f64();
        let weight = took_s / (took_s + HALF_WAY_S);
        let s_per_unit = &mut self.state().s_per_unit[kind as usize];
        *s_per_unit += weight * (took_s / units - *s_per_unit);
    }

    /// Lets work that was stopped count when it has taken longer than expected already.
    pub(super) fn learn_at_least(&self, cost: Cost, took: Duration) {
        let Effort { kind, units } = cost.effort();
        let expected_s = self.state().s_per_unit[kind as usize] * units;
        if took.as_secs_f64() > expected_s {
            self.learn(cost, took);
        }
    }

    /// Whole seconds until everything that waits or runs will be done, 1 or more.
    pub(super) fn drain_s(&self) -> u64 {
        let state = self.state();
        let [waiting_s, running_s] =
            [&state.waiting_units, &state.running_units].map(|units| self.seconds(units, &state));
        (waiting_s + running_s).ceil().clamp(1.0, MAX_RETRY_AFTER_S) as u64
    }

    /// The longest that anything may really wait: longer waits only what a wrong estimate let in.
    pub(super) fn patience(&self) -> Duration {
        Duration::try_from_secs_f64(PATIENCE * self.limit_s).unwrap_or(Duration::MAX)
    }

    /// Refuses what has waited for so long.
    pub(super) fn lose_patience(&self) -> Problem {
        telemetry::shed(Shed::QueueFull);
        let waited_s = PATIENCE * self.limit_s;
        let detail = format!(
            "the request waited {waited_s} s for a worker and memory, {PATIENCE} times what the \
             queue should take: the work before it took longer than expected"
        );
        Problem::new(Kind::Overloaded, detail)
            .setting("--queue-seconds")
            .limit(self.limit_s, waited_s)
            .retry_after_s(self.drain_s())
    }

    fn seconds(&self, units: &[f64; WorkKind::ALL.len()], state: &State) -> f64 {
        let by_kind = units.iter().zip(&state.s_per_unit);
        by_kind.map(|(units, s_per_unit)| units * s_per_unit).sum::<f64>() / self.workers
    }

    fn full(&self, waiting_s: f64) -> Problem {
        telemetry::shed(Shed::QueueFull);
        let Self { limit_s, .. } = self;
        let detail =
            format!("{waiting_s:.3} s of work wait already, more than the limit of {limit_s} s");
        Problem::new(Kind::Overloaded, detail)
            .setting("--queue-seconds")
            .limit(*limit_s, waiting_s)
            .retry_after_s(self.drain_s())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        let Effort { kind, units } = self.effort;
        let mut state = self.backlog.state();
        state.waiting -= 1;
        state.waiting_units[kind as usize] -= units;
        telemetry::queue_depth(state.waiting);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work that is expected to take so many seconds before any was measured.
    fn guessed(kind: WorkKind, seconds: f64) -> Cost {
        Cost::of_effort(Effort { kind, units: seconds / kind.first_guess_s() })
    }

    #[test]
    fn the_queue_is_full_when_the_seconds_that_wait_exceed_the_limit() {
        let backlog = Backlog::new(1, 1.0);
        let [one_shot, simplifying] = WorkKind::ALL.map(|kind| guessed(kind, 0.55));
        let costs = [one_shot, simplifying, one_shot];
        let places = costs.map(|cost| backlog.enter(cost, false));
        assert!(places[0].is_ok() && places[1].is_ok());
        assert_eq!(places[2].as_ref().unwrap_err().kind(), Kind::Overloaded);
        assert_eq!(backlog.drain_s(), 2, "twice 0.55 s");
        assert!(backlog.enter(one_shot, true).is_ok(), "an idle worker never refuses");
        drop(places);
        assert!(backlog.enter(one_shot, false).is_ok());
    }

    #[test]
    fn stopped_work_counts_only_when_it_took_longer_than_expected() {
        let backlog = Backlog::new(1, 1.0);
        let cost = guessed(WorkKind::Simplifying, 5.0);
        backlog.start(cost);
        backlog.learn_at_least(cost, Duration::from_secs(1));
        assert_eq!(backlog.drain_s(), 5, "the first guess");
        backlog.learn_at_least(cost, Duration::from_secs(30));
        assert_eq!(backlog.drain_s(), 29, "30 of 32 parts of the way from 5 s to 30 s");
        backlog.end(cost);
        assert_eq!(backlog.drain_s(), 1);
    }

    #[test]
    fn long_quick_work_makes_room_for_more() {
        let backlog = Backlog::new(2, 1.0);
        let cost = guessed(WorkKind::OneShot, 100.0);
        assert!(backlog.enter(cost, false).is_ok());
        for _ in 0..20 {
            backlog.learn(cost, Duration::from_secs(1));
        }
        backlog.start(cost);
        assert_eq!(backlog.drain_s(), 1, "half a second for each worker");
    }

    #[test]
    fn neither_tiny_work_nor_another_kind_changes_what_large_work_is_expected_to_take() {
        let backlog = Backlog::new(1, 1.0);
        let large = guessed(WorkKind::Simplifying, 20.0);
        backlog.start(large);
        for _ in 0..200 {
            // Both quicker and slower per unit than was guessed.
            backlog.learn(guessed(WorkKind::Simplifying, 0.01), Duration::from_millis(1));
            backlog.learn(guessed(WorkKind::OneShot, 10.0), Duration::from_secs(1));
        }
        assert!((17..=20).contains(&backlog.drain_s()), "{}", backlog.drain_s());
    }
}
