//! Vertices in the order of their removal: a heap of four children that knows where each vertex
//! stands, so that a changed key moves its vertex and no stale entry remains.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Not in the queue.
const ABSENT: u32 = u32::MAX;

/// Children of each place.
const ARITY: usize = 4;

/// A vertex with its place in the order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Entry {
    /// By how much its removal changes the error.
    pub(crate) change: i64,
    /// Its place by row, then column, which decides between equal changes.
    pub(crate) rank: u32,
    pub(crate) vertex: u32,
}

/// A priority queue of vertices by change of error, then by rank.
pub(crate) struct RemovalQueue {
    /// The heap: the least first, the children of place `i` at `4 i + 1` to `4 i + 4`.
    heap: Vec<Entry>,
    /// Place of each vertex in the heap.
    places: Vec<u32>,
}

impl RemovalQueue {
    /// A queue of entries for some of `vertex_count` vertices.
    pub(crate) fn new(entries: Vec<Entry>, vertex_count: usize) -> Self {
        let mut queue = Self { heap: entries, places: vec![ABSENT; vertex_count] };
        for (place, entry) in queue.heap.iter().enumerate() {
            queue.places[entry.vertex as usize] = place as u32;
        }
        for place in (0..queue.heap.len() / ARITY + 1).rev() {
            queue.sift_down(place);
        }
        queue
    }

    /// The vertex whose removal changes the error least.
    pub(crate) fn first(&self) -> Option<Entry> {
        self.heap.first().copied()
    }

    /// The first `count` entries in order, which stay in the queue.
    pub(crate) fn least(&self, count: usize) -> Vec<Entry> {
        let mut least = Vec::with_capacity(count);
        // The next one is a child of one of those before it, or the first of all.
        let mut open: BinaryHeap<Reverse<(Entry, usize)>> =
            self.heap.first().map(|&entry| Reverse((entry, 0))).into_iter().collect();
        while let (true, Some(Reverse((entry, place)))) = (least.len() < count, open.pop()) {
            least.push(entry);
            let children = ARITY * place + 1..(ARITY * place + 1 + ARITY).min(self.heap.len());
            open.extend(children.map(|child| Reverse((self.heap[child], child))));
        }
        least
    }

    /// Takes out the first vertex.
    pub(crate) fn remove_first(&mut self) {
        let first = self.heap.swap_remove(0);
        self.places[first.vertex as usize] = ABSENT;
        if let Some(moved) = self.heap.first() {
            self.places[moved.vertex as usize] = 0;
            self.sift_down(0);
        }
    }

    /// Gives a vertex of the queue another key.
    pub(crate) fn change(&mut self, vertex: u32, change: i64) {
        let place = self.places[vertex as usize] as usize;
        self.heap[place].change = change;
        self.sift_up(place);
        self.sift_down(self.places[vertex as usize] as usize);
    }

    /// Moves the entry at `place` towards the first until its parent is less.
    fn sift_up(&mut self, mut place: usize) {
        let entry = self.heap[place];
        while place > 0 {
            let parent = (place - 1) / ARITY;
            if self.heap[parent] <= entry {
                break;
            }
            self.put(place, self.heap[parent]);
            place = parent;
        }
        self.put(place, entry);
    }

    /// Moves the entry at `place` away from the first until its children are greater.
    fn sift_down(&mut self, mut place: usize) {
        let Some(&entry) = self.heap.get(place) else { return };
        loop {
            let start = ARITY * place + 1;
            let end = (start + ARITY).min(self.heap.len());
            let Some(least) = (start..end).min_by_key(|&child| self.heap[child]) else { break };
            if entry <= self.heap[least] {
                break;
            }
            self.put(place, self.heap[least]);
            place = least;
        }
        self.put(place, entry);
    }

    /// Writes an entry to a place.
    fn put(&mut self, place: usize, entry: Entry) {
        self.heap[place] = entry;
        self.places[entry.vertex as usize] = place as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vertices_leave_in_the_order_of_their_latest_keys(
            mut keys in prop::collection::vec(-20i64..20, 1..60),
            changes in prop::collection::vec((0usize..60, -20i64..20), 0..60),
        ) {
            // Ranks run against the numbers of the vertices.
            let entry = |(v, &change): (usize, &i64)| Entry {
                change,
                rank: 100 - v as u32,
                vertex: v as u32,
            };
            let mut queue = RemovalQueue::new(keys.iter().enumerate().map(entry).collect(), keys.len());
            for (v, key) in changes {
                let v = v % keys.len();
                keys[v] = key;
                queue.change(v as u32, key);
            }
            let mut expected: Vec<Entry> = keys.iter().enumerate().map(entry).collect();
            expected.sort_unstable();
            for count in [0, 1, 7, 100] {
                let least = &expected[..count.min(expected.len())];
                prop_assert_eq!(queue.least(count), least);
            }
            for entry in expected {
                prop_assert_eq!(queue.first(), Some(entry));
                queue.remove_first();
            }
            prop_assert_eq!(queue.first(), None);
        }
    }
}
