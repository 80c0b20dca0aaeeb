//! The queue, counted in seconds of work.

use super::Cost;
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Seconds of work per MiB of cost that is assumed before any work was measured.
const FIRST_GUESS_S_PER_MIB: f64 = 0.05;
/// The weight of the latest piece of work in the moving average.
const WEIGHT: f64 = 0.2;
/// The longest time that a client is told to wait, in seconds.
const MAX_RETRY_AFTER_S: f64 = 300.0;

/// What waits and what runs, in MiB of cost, and the seconds that a MiB takes.
#[derive(Debug)]
pub(super) struct Backlog {
    workers: f64,
    limit_s: f64,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    waiting: usize,
    waiting_mib: f64,
    running_mib: f64,
    s_per_mib: f64,
}

/// A place in the queue, given up when dropped.
#[derive(Debug)]
pub(super) struct Place<'a> {
    backlog: &'a Backlog,
    mib: f64,
}

impl Backlog {
    pub(super) fn new(workers: usize, limit_s: f64) -> Self {
        let (waiting, waiting_mib, running_mib) = (0, 0.0, 0.0);
        let s_per_mib = FIRST_GUESS_S_PER_MIB;
        let state = Mutex::new(State { waiting, waiting_mib, running_mib, s_per_mib });
        Self { workers: workers as f64, limit_s, state }
    }

    /// Takes a place, unless more than the allowed seconds of work wait already.
    ///
    /// # Errors
    /// `overloaded`, with the seconds until the queue will have drained.
    pub(super) fn enter(&self, cost: Cost, slot_is_free: bool) -> Result<Place<'_>, Problem> {
        let mut state = self.state();
        let waiting_s = self.seconds(state.waiting_mib, &state);
        if waiting_s > self.limit_s && !slot_is_free {
            drop(state);
            return Err(self.full(waiting_s));
        }
        let mib = f64::from(cost.mib());
        state.waiting += 1;
        state.waiting_mib += mib;
        telemetry::queue_depth(state.waiting);
        Ok(Place { backlog: self, mib })
    }

    /// Work of this cost begins.
    pub(super) fn start(&self, cost: Cost) {
        self.state().running_mib += f64::from(cost.mib());
    }

    /// Work of this cost has ended, one way or another.
    pub(super) fn end(&self, cost: Cost) {
        self.state().running_mib -= f64::from(cost.mib());
    }

    /// Lets completed work count in the average.
    pub(super) fn learn(&self, cost: Cost, took: Duration) {
        let mut state = self.state();
        let s_per_mib = took.as_secs_f64() / f64::from(cost.mib());
        state.s_per_mib += WEIGHT * (s_per_mib - state.s_per_mib);
    }

    /// Lets work that was stopped count when it has taken longer than expected already.
    pub(super) fn learn_at_least(&self, cost: Cost, took: Duration) {
        let expected_s = self.state().s_per_mib * f64::from(cost.mib());
        if took.as_secs_f64() > expected_s {
            self.learn(cost, took);
        }
    }

    /// Whole seconds until everything that waits or runs will be done, 1 or more.
    pub(super) fn drain_s(&self) -> u64 {
        let state = self.state();
        let drain_s = self.seconds(state.waiting_mib + state.running_mib, &state);
        drain_s.ceil().clamp(1.0, MAX_RETRY_AFTER_S) as u64
    }

    fn seconds(&self, mib: f64, state: &State) -> f64 {
        mib * state.s_per_mib / self.workers
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
        let mut state = self.backlog.state();
        state.waiting -= 1;
        state.waiting_mib -= self.mib;
        telemetry::queue_depth(state.waiting);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_queue_is_full_when_the_seconds_that_wait_exceed_the_limit() {
        let backlog = Backlog::new(1, 1.0);
        let cost = Cost::of_mib(10);
        let places: Vec<_> = (0..3).map(|_| backlog.enter(cost, false).unwrap()).collect();
        let problem = backlog.enter(cost, false).unwrap_err();
        assert_eq!(problem.kind(), Kind::Overloaded);
        assert_eq!(backlog.drain_s(), 2, "three times 0.5 s");
        assert!(backlog.enter(cost, true).is_ok(), "an idle worker never refuses");
        drop(places);
        assert!(backlog.enter(cost, false).is_ok());
    }

    #[test]
    fn stopped_work_counts_only_when_it_took_longer_than_expected() {
        let backlog = Backlog::new(1, 1.0);
        let cost = Cost::of_mib(100);
        backlog.start(cost);
        backlog.learn_at_least(cost, Duration::from_secs(1));
        assert_eq!(backlog.drain_s(), 5, "the first guess");
        backlog.learn_at_least(cost, Duration::from_secs(30));
        assert_eq!(backlog.drain_s(), 10, "a fifth of the way from 5 s to 30 s");
    }

    #[test]
    fn quick_work_makes_room_for_more() {
        let backlog = Backlog::new(2, 1.0);
        for _ in 0..100 {
            backlog.learn(Cost::of_mib(10), Duration::from_millis(10));
        }
        let places: Vec<_> =
            (0..100).filter_map(|_| backlog.enter(Cost::of_mib(10), false).ok()).collect();
        assert_eq!(places.len(), 100);
    }
}
