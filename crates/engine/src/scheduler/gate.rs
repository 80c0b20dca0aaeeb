//! Slots and memory, given out in turns.
//!
//! Tasks wait in one lane for each owner, first in, first out. Owners take turns by the time that
//! their tasks took: whenever slots or memory become free, the lane of the owner who has used the
//! least time gets them, if its first task fits. So tasks that take longer than foreseen cost their
//! own owner turns, and nobody else. An owner without tasks saves no time up: new lanes begin with
//! the time of the lane whose turn was last. A task that does not fit in free memory may be overtaken
//! by tasks of other owners [`MAX_OVERTAKEN`] times. After that all wait until it fits, unless its own
//! owner's unsent answers hold the memory. The owner of a key has a limited number of slots.
//!
//! Threads are not reserved: a task asks for its present share of them as it runs.

use crate::owner::Owner;
use crate::telemetry;
use std::collections::{HashMap, VecDeque};
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::Instant;

/// How often tasks of other owners may overtake a task that does not fit in free memory.
const MAX_OVERTAKEN: u32 = 32;

/// The most threads of one task: the memory of tasks was measured with at most as many.
const MOST_THREADS: usize = 8;

/// What there is to give out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Capacity {
    /// Tasks that run at a time.
    pub(super) slots: usize,
    /// Threads for all tasks together.
    pub(super) threads: usize,
    /// Memory for all tasks, in MiB.
    pub(super) memory_mib: usize,
    /// Tasks of one key that run at a time.
    pub(super) slots_per_key: usize,
}

/// Gives out slots and memory.
#[derive(Debug)]
pub(super) struct Gate {
    capacity: Capacity,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    free_slots: usize,
    free_mib: usize,
    held: HashMap<Owner, Held>,
    /// The time that the tasks of an owner took, if it is more than that of the last turn.
    used: HashMap<Owner, Duration>,
    /// The time of the lane whose turn was last.
    last_turn: Duration,
    /// One for each owner whose tasks wait, in the order of their turns.
    lanes: Vec<Lane>,
    next_id: u64,
}

/// What the tasks and the answers of one owner hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Held {
    slots: usize,
    mib: usize,
}

#[derive(Debug)]
struct Lane {
    owner: Owner,
    /// The time that the owner's tasks took, as far as they have ended.
    used: Duration,
    waiting: VecDeque<Waiter>,
    /// How often other owners' tasks overtook the first of this lane.
    overtaken: u32,
}

#[derive(Debug)]
struct Waiter {
    id: u64,
    wants: Held,
    /// Receives a message when slot and memory are granted.
    grant: oneshot::Sender<()>,
}

/// A worker slot, given back when dropped.
#[derive(Debug)]
pub(super) struct Slot {
    gate: Arc<Gate>,
    owner: Owner,
    taken: Instant,
}

/// Memory of the budget in whole MiB, given back when dropped.
///
/// A task holds what it needs at its peak. Its answer keeps a [part](Memory::split) until its bytes are
/// sent.
#[derive(Debug)]
pub struct Memory {
    gate: Arc<Gate>,
    owner: Owner,
    mib: usize,
}

impl Memory {
    /// Memory that the gate has granted.
    fn new(gate: Arc<Gate>, owner: Owner, mib: usize) -> Self {
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

/// A place in a lane. Dropping it gives back what was granted and not taken.
struct Place {
    gate: Arc<Gate>,
    owner: Owner,
    id: u64,
    wants: Held,
    is_taken: bool,
}

impl Gate {
    pub(super) fn new(capacity: Capacity) -> Self {
        let state = State {
            free_slots: capacity.slots,
            free_mib: capacity.memory_mib,
            held: HashMap::new(),
            used: HashMap::new(),
            last_turn: Duration::ZERO,
            lanes: Vec::new(),
            next_id: 0,
        };
        Self { capacity, state: Mutex::new(state) }
    }

    /// Memory for all tasks, in MiB.
    pub(super) fn memory_mib(&self) -> usize {
        self.capacity.memory_mib
    }

    /// Whether there is a slot that this owner may have.
    pub(super) fn has_slot_for(&self, owner: &Owner) -> bool {
        let state = self.state();
        state.free_slots > 0 && state.held(owner).slots < self.slots_of(owner)
    }

    /// Threads that each task may use at the moment, its own among them.
    pub(super) fn threads_of_each(&self) -> NonZeroUsize {
        let held_slots = self.capacity.slots - self.state().free_slots;
        let threads = self.capacity.threads / held_slots.max(1);
        NonZeroUsize::new(threads.min(MOST_THREADS)).unwrap_or(NonZeroUsize::MIN)
    }

    /// Waits for a slot and memory; `None` when the gate is gone.
    pub(super) async fn enter(self: &Arc<Self>, owner: &Owner, mib: u32) -> Option<(Slot, Memory)> {
        let wants = Held { slots: 1, mib: mib as usize };
        let (place, granted) = self.wait_in_lane(owner, wants);
        granted.await.ok()?;
        let memory = place.take();
        let slot = Slot { gate: Arc::clone(self), owner: owner.clone(), taken: Instant::now() };
        Some((slot, memory))
    }

    /// Waits for memory beside a slot.
    pub(super) async fn memory(self: &Arc<Self>, slot: &Slot, mib: u32) -> Option<Memory> {
        let wants = Held { slots: 0, mib: mib as usize };
        let (place, granted) = self.wait_in_lane(&slot.owner, wants);
        granted.await.ok()?;
        Some(place.take())
    }

    fn wait_in_lane(
        self: &Arc<Self>,
        owner: &Owner,
        wants: Held,
    ) -> (Place, oneshot::Receiver<()>) {
        let (grant, granted) = oneshot::channel();
        let mut state = self.state();
        let id = state.next_id;
        state.next_id += 1;
        state.lane_of(owner).insert(Waiter { id, wants, grant });
        self.give_out(&mut state);
        drop(state);
        let (gate, owner) = (Arc::clone(self), owner.clone());
        (Place { gate, owner, id, wants, is_taken: false }, granted)
    }

    /// Grants free slots and memory to those whose turn it is.
    fn give_out(&self, state: &mut State) {
        while let Some(index) = self.next_lane(state) {
            for lane in &mut state.lanes[..index] {
                lane.overtaken += 1;
            }
            let mut lane = state.lanes.remove(index);
            if let Some(waiter) = lane.waiting.pop_front() {
                state.take(&lane.owner, waiter.wants);
                state.last_turn = state.last_turn.max(lane.used);
                lane.overtaken = 0;
                // A task that left gives it back when its place is dropped.
                let _ = waiter.grant.send(());
            }
            if !lane.waiting.is_empty() {
                state.insert(lane);
            }
        }
    }

    /// The lane whose turn it is among those whose first task fits.
    fn next_lane(&self, state: &State) -> Option<usize> {
        for (index, lane) in state.lanes.iter().enumerate() {
            let held = state.held(&lane.owner);
            let Some(first) = lane.waiting.front() else { continue };
            let Held { slots, mib } = first.wants;
            if slots > state.free_slots || held.slots + slots > self.slots_of(&lane.owner) {
                continue;
            }
            if mib <= state.free_mib {
                return Some(index);
            }
            let fits_beside_own = mib + held.mib <= self.capacity.memory_mib;
            if lane.overtaken >= MAX_OVERTAKEN && fits_beside_own {
                return None;
            }
        }
        None
    }

    fn slots_of(&self, owner: &Owner) -> usize {
        if owner.is_key() { self.capacity.slots_per_key } else { self.capacity.slots }
    }

    /// Takes back what an owner held, and grants it again.
    fn give_back(&self, owner: &Owner, what: Held) {
        let mut state = self.state();
        state.give_back(owner, what);
        self.give_out(&mut state);
    }

    /// Takes back memory.
    pub(super) fn free(&self, owner: &Owner, mib: usize) {
        self.give_back(owner, Held { slots: 0, mib });
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn held(&self, owner: &Owner) -> Held {
        self.held.get(owner).copied().unwrap_or_default()
    }

    /// The lane of an owner.
    fn lane_of(&mut self, owner: &Owner) -> &mut Lane {
        let known = self.lanes.iter().position(|lane| lane.owner == *owner);
        let index = known.unwrap_or_else(|| {
            let used = self.used.get(owner).copied().unwrap_or_default().max(self.last_turn);
            let waiting = VecDeque::new();
            self.insert(Lane { owner: owner.clone(), used, waiting, overtaken: 0 })
        });
        &mut self.lanes[index]
    }

    /// Puts a lane behind those that have used no more time, and returns its index.
    fn insert(&mut self, lane: Lane) -> usize {
        let index = self.lanes.partition_point(|other| other.used <= lane.used);
        self.lanes.insert(index, lane);
        index
    }

    /// Charges an owner for the time of a task.
    fn charge(&mut self, owner: &Owner, took: Duration) {
        let last_turn = self.last_turn;
        self.used.retain(|_, used| *used > last_turn);
        let used = self.used.entry(owner.clone()).or_insert(last_turn);
        *used += took;
        let used = *used;
        if let Some(index) = self.lanes.iter().position(|lane| lane.owner == *owner) {
            let lane = self.lanes.remove(index);
            self.insert(Lane { used, ..lane });
        }
    }

    fn take(&mut self, owner: &Owner, what: Held) {
        self.free_slots -= what.slots;
        self.free_mib -= what.mib;
        let held = self.held.entry(owner.clone()).or_default();
        held.slots += what.slots;
        held.mib += what.mib;
    }

    fn give_back(&mut self, owner: &Owner, what: Held) {
        self.free_slots += what.slots;
        self.free_mib += what.mib;
        if let Some(held) = self.held.get_mut(owner) {
            held.slots -= what.slots;
            held.mib -= what.mib;
            if *held == Held::default() {
                self.held.remove(owner);
            }
        }
    }

    /// Takes a waiter out of its lane, and says whether it was still there.
    fn leave(&mut self, owner: &Owner, id: u64) -> bool {
        let Some(index) = self.lanes.iter().position(|lane| lane.owner == *owner) else {
            return false;
        };
        let waiting = &mut self.lanes[index].waiting;
        let before = waiting.len();
        waiting.retain(|waiter| waiter.id != id);
        let was_there = waiting.len() < before;
        if waiting.is_empty() {
            self.lanes.remove(index);
        }
        was_there
    }
}

impl Lane {
    /// Adds a piece at the end; one that has its slot goes before those that wait for slots, one of
    /// which may be its own.
    fn insert(&mut self, waiter: Waiter) {
        let has_slot = waiter.wants.slots == 0;
        let before = self.waiting.iter().position(|other| has_slot && other.wants.slots > 0);
        self.waiting.insert(before.unwrap_or(self.waiting.len()), waiter);
    }
}

impl Place {
    /// Takes what was granted.
    fn take(mut self) -> Memory {
        self.is_taken = true;
        Memory::new(Arc::clone(&self.gate), self.owner.clone(), self.wants.mib)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if self.is_taken {
            return;
        }
        let mut state = self.gate.state();
        if !state.leave(&self.owner, self.id) {
            state.give_back(&self.owner, self.wants);
        }
        // The next in the lane may need less.
        self.gate.give_out(&mut state);
    }
}

impl Slot {
    /// The gate that gave it out.
    pub(super) fn gate(&self) -> Arc<Gate> {
        Arc::clone(&self.gate)
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.gate.state().charge(&self.owner, self.taken.elapsed());
        self.gate.give_back(&self.owner, Held { slots: 1, mib: 0 });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use tokio::time::timeout;

    fn gate(slots: usize, memory_mib: usize, slots_per_key: usize) -> Arc<Gate> {
        let threads = slots;
        Arc::new(Gate::new(Capacity { slots, threads, memory_mib, slots_per_key }))
    }

    fn owner(name: &str) -> Owner {
        Owner::named(name)
    }

    /// What is granted at once, or `None` while it waits.
    async fn at_once<T>(future: impl Future<Output = Option<T>>) -> Option<T> {
        timeout(Duration::from_millis(1), future).await.ok().flatten()
    }

    #[tokio::test(start_paused = true)]
    async fn owners_take_turns_whoever_has_more_waiting() {
        let gate = gate(1, 10, 1);
        let first = gate.enter(&owner("a"), 1).await.unwrap();
        let (turns, mut order) = tokio::sync::mpsc::unbounded_channel();
        for name in ["a", "a", "a", "b", "b", "c"] {
            let (gate, turns) = (Arc::clone(&gate), turns.clone());
            tokio::spawn(async move {
                let granted = gate.enter(&owner(name), 1).await;
                turns.send(name).unwrap();
                drop(granted);
            });
            tokio::task::yield_now().await;
        }
        drop((first, turns));
        let mut names = Vec::new();
        while let Some(name) = order.recv().await {
            names.push(name);
        }
        assert_eq!(names, ["b", "c", "a", "b", "a", "a"]);
    }

    #[tokio::test(start_paused = true)]
    async fn owner_of_long_tasks_waits_until_others_have_used_as_much_time() {
        let gate = gate(1, 10, 1);
        let (turns, mut order) = tokio::sync::mpsc::unbounded_channel();
        let first = gate.enter(&owner("long"), 1).await.unwrap();
        for (name, task_s) in [("long", 3), ("long", 3), ("short", 1), ("short", 1), ("short", 1)] {
            let (gate, turns) = (Arc::clone(&gate), turns.clone());
            tokio::spawn(async move {
                let granted = gate.enter(&owner(name), 1).await;
                turns.send(name).unwrap();
                tokio::time::sleep(Duration::from_secs(task_s)).await;
                drop(granted);
            });
            tokio::task::yield_now().await;
        }
        tokio::time::advance(Duration::from_secs(2)).await;
        drop((first, turns));
        let mut names = Vec::new();
        while let Some(name) = order.recv().await {
            names.push(name);
        }
        assert_eq!(names, ["short", "short", "long", "short", "long"]);
        // An owner that comes later has no time saved up, and none to make up for.
        let held = gate.enter(&owner("new"), 1).await.unwrap();
        assert!(gate.state().last_turn >= Duration::from_secs(2));
        drop(held);
        assert!(gate.state().used.len() <= 3);
    }

    #[tokio::test]
    async fn a_key_has_its_slots_and_nobody_in_particular_has_all() {
        let gate = gate(3, 10, 2);
        let held = [gate.enter(&owner("a"), 1).await, gate.enter(&owner("a"), 1).await];
        assert!(!gate.has_slot_for(&owner("a")) && gate.has_slot_for(&owner("b")));
        assert!(at_once(gate.enter(&owner("a"), 1)).await.is_none());
        assert!(at_once(gate.enter(&owner("b"), 1)).await.is_some());
        drop(held);
        let mut all = Vec::new();
        for _ in 0..3 {
            all.push(at_once(gate.enter(&Owner::Anonymous, 1)).await.unwrap());
        }
    }

    #[tokio::test]
    async fn work_shares_the_threads_of_those_that_do_nothing() {
        let capacity = Capacity { slots: 20, threads: 18, memory_mib: 20, slots_per_key: 20 };
        let gate = Arc::new(Gate::new(capacity));
        let mut held = Vec::new();
        let mut told = Vec::new();
        for _ in 0..20 {
            held.push(gate.enter(&Owner::Anonymous, 1).await.unwrap());
            told.push(gate.threads_of_each().get());
        }
        assert_eq!(told, [8, 8, 6, 4, 3, 3, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
        held.truncate(1);
        assert_eq!(gate.threads_of_each().get(), 8);
        held.clear();
        assert_eq!(gate.threads_of_each().get(), 8, "of work that has just ended");
    }

    #[tokio::test]
    async fn who_leaves_while_waiting_or_when_granted_takes_nothing_along() {
        let gate = gate(1, 10, 1);
        let first = gate.enter(&owner("a"), 10).await;
        assert!(at_once(gate.enter(&owner("b"), 1)).await.is_none(), "it leaves the lane");
        assert!(gate.state().lanes.is_empty());
        let (place, granted) = gate.wait_in_lane(&owner("b"), Held { slots: 1, mib: 10 });
        drop(first);
        assert!(granted.await.is_ok(), "granted, and never taken");
        drop(place);
        let state = gate.state();
        assert_eq!((state.free_slots, state.free_mib, state.held.len()), (1, 10, 0));
    }

    #[tokio::test]
    async fn memory_may_come_after_the_slot() {
        let gate = gate(1, 10, 1);
        let (slot, none) = gate.enter(&Owner::Jobs, 0).await.unwrap();
        let memory = gate.memory(&slot, 10).await.unwrap();
        assert!(at_once(gate.memory(&slot, 1)).await.is_none());
        drop((none, memory));
        assert!(at_once(gate.memory(&slot, 1)).await.is_some());
        let jobs = Owner::Jobs;
        let mut next = pin!(gate.enter(&jobs, 0));
        assert!(at_once(next.as_mut()).await.is_none());
        assert!(at_once(gate.memory(&slot, 1)).await.is_some(), "it waits for no slot");
        drop(slot);
        drop(at_once(next).await.unwrap());
        assert_eq!(gate.state().held.len(), 0);
    }

    #[tokio::test]
    async fn small_work_overtakes_what_finds_no_memory_but_not_for_ever() {
        let gate = gate(3, 10, 2);
        let [a, b] = ["a", "b"].map(owner);
        let other = gate.enter(&owner("c"), 5).await.unwrap();
        let mut large = pin!(gate.enter(&a, 8));
        assert!(at_once(large.as_mut()).await.is_none());
        for _ in 0..MAX_OVERTAKEN {
            assert!(at_once(gate.enter(&b, 5)).await.is_some());
        }
        let mut small = pin!(gate.enter(&b, 5));
        assert!(at_once(small.as_mut()).await.is_none(), "it waits for the large one now");
        drop(other);
        drop(at_once(large).await.unwrap());
        assert!(at_once(small).await.is_some());
    }

    #[tokio::test]
    async fn who_is_in_the_way_of_nobody_but_itself_holds_up_nobody_else() {
        let gate = gate(3, 10, 2);
        let [a, b] = ["a", "b"].map(owner);
        let (slot, unread_answer) = gate.enter(&a, 5).await.unwrap();
        drop(slot);
        let mut large = pin!(gate.enter(&a, 8));
        assert!(at_once(large.as_mut()).await.is_none());
        for _ in 0..2 * MAX_OVERTAKEN {
            assert!(at_once(gate.enter(&b, 5)).await.is_some());
        }
        drop(unread_answer);
        assert!(at_once(large).await.is_some());
    }
}
