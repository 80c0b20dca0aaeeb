//! The queue, counted in seconds of work.
//!
//! A burst may fill the queue up to its limit. When more comes than that, the burst is an overload:
//! everything that is let in would wait for the whole limit, and no more would be done. Then a
//! tenth of the limit may wait, which keeps the workers as busy, until nothing waits any more.

use super::limits::Limits;
use crate::error::EngineError;
use crate::owner::Owner;
use crate::task::{Cost, Effort, WorkKind};
use crate::telemetry::{self, Shed};
use std::collections::HashMap;
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
/// The part of the queue's limit that may wait in an overload.
const OVERLOADED: f64 = 0.1;
/// How many times the queue's limit anything may really wait.
const PATIENCE: f64 = 2.0;

/// What waits and what runs, in units of work of each kind, and the seconds that a unit takes.
#[derive(Debug)]
pub(super) struct Backlog {
    workers: f64,
    limit_s: f64,
    queued_per_key: usize,
    state: Mutex<State>,
}

/// Units of work by its kind.
type Units = [f64; WorkKind::ALL.len()];

const NONE: Units = [0.0; WorkKind::ALL.len()];

#[derive(Debug)]
struct State {
    /// Of every owner of whom something waits.
    waiting: HashMap<Owner, Waiting>,
    /// Whether the queue has been full since something began to wait.
    is_overloaded: bool,
    running_units: Units,
    s_per_unit: Units,
}

/// What waits of one owner.
#[derive(Clone, Copy, Debug, Default)]
struct Waiting {
    count: usize,
    units: Units,
}

/// A place in the queue, given up when dropped.
#[derive(Debug)]
pub(super) struct Place<'a> {
    backlog: &'a Backlog,
    owner: Owner,
    effort: Effort,
}

impl Backlog {
    pub(super) fn new(limits: &Limits) -> Self {
        let state = State {
            waiting: HashMap::new(),
            is_overloaded: false,
            running_units: NONE,
            s_per_unit: WorkKind::ALL.map(WorkKind::first_guess_s),
        };
        Self {
            workers: limits.workers as f64,
            limit_s: limits.queue_s,
            queued_per_key: limits.queued_per_key,
            state: Mutex::new(state),
        }
    }

    /// Takes a place, unless more than the owner's part of the allowed seconds waits already.
    ///
    /// # Errors
    /// [`EngineError::QueueFull`] and [`EngineError::KeyQueueFull`].
    pub(super) fn enter(
        &self,
        owner: &Owner,
        cost: Cost,
        slot_is_free: bool,
    ) -> Result<Place<'_>, EngineError> {
        self.refuse_crowd(owner, slot_is_free)?;
        let effort = cost.effort();
        let mut state = self.state();
        let waiting = state.waiting.entry(owner.clone()).or_default();
        waiting.count += 1;
        waiting.units[effort.kind as usize] += effort.units;
        telemetry::queue_depth(state.depth());
        Ok(Place { backlog: self, owner: owner.clone(), effort })
    }

    /// Refuses one more request of an owner of whom too much waits already.
    ///
    /// # Errors
    /// As [`Backlog::enter`].
    pub(super) fn refuse_crowd(
        &self,
        owner: &Owner,
        slot_is_free: bool,
    ) -> Result<(), EngineError> {
        let mut state = self.state();
        let waiting = state.waiting.get(owner).copied().unwrap_or_default();
        let others = state.waiting.len() - usize::from(waiting.count > 0);
        let waiting_s = self.seconds(&waiting.units, &state);
        let part = if state.is_overloaded { OVERLOADED } else { 1.0 };
        let share_s = part * self.limit_s / (others + 1) as f64;
        let is_full = waiting_s > share_s && !slot_is_free;
        state.is_overloaded |= is_full;
        drop(state);
        if owner.is_key() && waiting.count >= self.queued_per_key {
            return Err(self.too_many_of_key(waiting.count));
        }
        if is_full { Err(self.full(waiting_s, share_s)) } else { Ok(()) }
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
        let waiting = state.waiting.values().map(|waiting| self.seconds(&waiting.units, &state));
        let waiting_s: f64 = waiting.sum();
        let running_s = self.seconds(&state.running_units, &state);
        (waiting_s + running_s).ceil().clamp(1.0, MAX_RETRY_AFTER_S) as u64
    }

    /// The longest that anything may really wait: longer waits only what a wrong estimate let in.
    pub(super) fn patience(&self) -> Duration {
        Duration::try_from_secs_f64(PATIENCE * self.limit_s).unwrap_or(Duration::MAX)
    }

    /// Refuses what has waited for so long.
    pub(super) fn lose_patience(&self) -> EngineError {
        telemetry::shed(Shed::QueueFull);
        let waited_s = PATIENCE * self.limit_s;
        let retry_after_s = self.drain_s();
        EngineError::WaitedTooLong { waited_s, limit_s: self.limit_s, retry_after_s }
    }

    fn seconds(&self, units: &Units, state: &State) -> f64 {
        let by_kind = units.iter().zip(&state.s_per_unit);
        by_kind.map(|(units, s_per_unit)| units * s_per_unit).sum::<f64>() / self.workers
    }

    fn full(&self, waiting_s: f64, limit_s: f64) -> EngineError {
        telemetry::shed(Shed::QueueFull);
        EngineError::QueueFull { waiting_s, limit_s, retry_after_s: self.drain_s() }
    }

    fn too_many_of_key(&self, waiting: usize) -> EngineError {
        telemetry::shed(Shed::Quota);
        let (limit, retry_after_s) = (self.queued_per_key, self.drain_s());
        EngineError::KeyQueueFull { waiting, limit, retry_after_s }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// How many wait in all.
    fn depth(&self) -> usize {
        self.waiting.values().map(|waiting| waiting.count).sum()
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        let Effort { kind, units } = self.effort;
        let mut state = self.backlog.state();
        if let Some(waiting) = state.waiting.get_mut(&self.owner) {
            waiting.count -= 1;
            waiting.units[kind as usize] -= units;
            if waiting.count == 0 {
                state.waiting.remove(&self.owner);
            }
        }
        state.is_overloaded &= !state.waiting.is_empty();
        telemetry::queue_depth(state.depth());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work that is expected to take so many seconds before any was measured.
    fn guessed(kind: WorkKind, seconds: f64) -> Cost {
        Cost::of_effort(Effort { kind, units: seconds / kind.first_guess_s() })
    }

    fn backlog(workers: usize) -> Backlog {
        Backlog::new(&Limits {
            workers,
            threads: 1,
            memory_bytes: 1 << 20,
            queue_s: 1.0,
            running_per_key: 1,
            queued_per_key: 3,
        })
    }

    #[test]
    fn owners_share_the_seconds_of_the_queue() {
        let backlog = backlog(1);
        let [a, b] = ["a", "b"].map(Owner::named);
        let cost = guessed(WorkKind::OneShot, 0.4);
        let filled: Vec<_> = (0..3).map(|_| backlog.enter(&a, cost, false)).collect();
        assert!(filled.iter().all(Result::is_ok), "1.2 s, alone");
        let other: Vec<_> = (0..3).map(|_| backlog.enter(&b, cost, false)).collect();
        let admitted: Vec<_> = other.iter().map(Result::is_ok).collect();
        assert_eq!(admitted, [true, true, false], "half a second is the part of each");
        let problem = backlog.enter(&a, cost, false).unwrap_err();
        let full = matches!(problem, EngineError::KeyQueueFull { waiting: 3, limit: 3, .. });
        assert!(full, "three of a key may wait");
        assert!(backlog.enter(&Owner::Anonymous, cost, false).is_ok());
    }

    #[test]
    fn the_queue_is_full_when_the_seconds_that_wait_exceed_the_limit() {
        let backlog = backlog(1);
        let [one_shot, simplifying] = WorkKind::ALL.map(|kind| guessed(kind, 0.55));
        let costs = [one_shot, simplifying, one_shot];
        let places = costs.map(|cost| backlog.enter(&Owner::Anonymous, cost, false));
        assert!(places[0].is_ok() && places[1].is_ok());
        assert!(matches!(places[2], Err(EngineError::QueueFull { .. })));
        assert_eq!(backlog.drain_s(), 2, "twice 0.55 s");
        assert!(
            backlog.enter(&Owner::Anonymous, one_shot, true).is_ok(),
            "an idle worker never refuses"
        );
        drop(places);
        assert!(backlog.enter(&Owner::Anonymous, one_shot, false).is_ok());
    }

    #[test]
    fn a_tenth_of_the_limit_may_wait_from_when_it_is_full_until_nothing_waits() {
        let backlog = backlog(1);
        let cost = guessed(WorkKind::OneShot, 0.06);
        let enter = || backlog.enter(&Owner::Anonymous, cost, false);
        let mut places: Vec<_> = (0..30).map_while(|_| enter().ok()).collect();
        assert_eq!(places.len(), 17, "1.02 s");
        places.truncate(2);
        assert!(enter().is_err(), "0.12 s wait, and 0.1 s may");
        places.truncate(1);
        let second = enter();
        assert!(second.is_ok() && enter().is_err());
        drop((places, second));
        let places: Vec<_> = (0..30).map_while(|_| enter().ok()).collect();
        assert_eq!(places.len(), 17, "it begins anew");
    }

    #[test]
    fn stopped_work_counts_only_when_it_took_longer_than_expected() {
        let backlog = backlog(1);
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
        let backlog = backlog(2);
        let cost = guessed(WorkKind::OneShot, 100.0);
        assert!(backlog.enter(&Owner::Anonymous, cost, false).is_ok());
        for _ in 0..20 {
            backlog.learn(cost, Duration::from_secs(1));
        }
        backlog.start(cost);
        assert_eq!(backlog.drain_s(), 1, "half a second for each worker");
    }

    #[test]
    fn neither_tiny_work_nor_another_kind_changes_what_large_work_is_expected_to_take() {
        let backlog = backlog(1);
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
