//! The removal queue: a heap of candidates of which the first is removed next.
//!
//! The order of candidates is the tie rule of removal: the smallest change of the error goes first;
//! of equal changes the vertex in the lowest row, and within a row the one farthest left. Vertices
//! of featureless areas are removed before there is a queue (see `featureless`).
//!
//! A heap node has four children. The index of each vertex in the heap is stored, so that a changed
//! key moves its vertex and no stale entry remains. An entry is one number of 128 bits: its change,
//! its rank and its vertex from the highest bits to the lowest. So two entries compare without
//! branches. The four children of a node fill one cache line and are compared as in a tournament;
//! where there are fewer, the greatest number stands in.

use crate::control::{Cancelled, Poller};
use std::ops::Range;

const ARITY: usize = 4;

/// The index of the least entry, the last of the first four siblings.
const FIRST: usize = ARITY - 1;

/// Stands where there is no entry: after all of them.
const NO_KEY: u128 = u128::MAX;

/// A candidate for removal. Entries compare in the order of removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Entry {
    pub(crate) change: i64,
    /// Its rank among all vertices by row, then column: the lower of equal changes goes first.
    pub(crate) rank: u32,
    pub(crate) vertex: u32,
}

impl Entry {
    /// The entry as a number, in the same order.
    #[inline]
    fn key(self) -> u128 {
        let change = self.change.wrapping_sub(i64::MIN) as u64;
        u128::from(change) << 64 | u128::from(self.rank) << 32 | u128::from(self.vertex)
    }

    #[inline]
    fn from_key(key: u128) -> Self {
        let change = ((key >> 64) as i64).wrapping_add(i64::MIN);
        Self { change, rank: (key >> 32) as u32, vertex: key as u32 }
    }
}

#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Siblings([u128; ARITY]);

/// A priority queue of candidates.
///
/// The first three indices are not used, and [`FIRST`] has the least entry. The children of index
/// `i` have the indices `4 (i - 2)` to `4 (i - 2) + 3`.
pub(crate) struct RemovalQueue {
    pub(super) siblings: Vec<Siblings>,
    len: usize,
    /// The number of the first vertex that may be in the queue.
    first_vertex: u32,
    /// The index of each vertex in the heap, from the first one on.
    indices: Vec<u32>,
}

impl RemovalQueue {
    pub(crate) fn with_capacity(vertices: Range<u32>) -> Self {
        let mut siblings = Vec::with_capacity(1 + vertices.len().div_ceil(ARITY));
        siblings.push(Siblings([NO_KEY; ARITY]));
        let indices = vec![0; vertices.len()];
        Self { siblings, len: 0, first_vertex: vertices.start, indices }
    }

    /// Adds an entry behind all others; [`Self::order`] restores the order of the heap.
    pub(crate) fn push(&mut self, entry: Entry) {
        let index = FIRST + self.len;
        if index / ARITY == self.siblings.len() {
            self.siblings.push(Siblings([NO_KEY; ARITY]));
        }
        self.put(index, entry.key());
        self.len += 1;
    }

    pub(crate) fn order(&mut self, poller: &mut Poller<'_>) -> Result<(), Cancelled> {
        for parent in (FIRST..FIRST + self.siblings.len() - 1).rev() {
            // Each sinks through several levels.
            poller.step(8 * ARITY)?;
            self.sift_down(parent, self.at(parent));
        }
        Ok(())
    }

    pub(crate) fn first(&self) -> Option<Entry> {
        Some(self.at(FIRST)).filter(|&key| key != NO_KEY).map(Entry::from_key)
    }

    #[inline]
    pub(crate) fn second(&self) -> Option<Entry> {
        let Siblings([a, b, c, d]) = self.siblings.get(1)?;
        Some(*a.min(b).min(c.min(d))).filter(|&key| key != NO_KEY).map(Entry::from_key)
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        let keys = self.siblings.iter().flat_map(|Siblings(keys)| keys);
        keys.filter(|&&key| key != NO_KEY).map(|&key| Entry::from_key(key))
    }

    pub(crate) fn change_of(&self, vertex: u32) -> i64 {
        Entry::from_key(self.at(self.indices[self.offset(vertex)] as usize)).change
    }

    pub(crate) fn remove_first(&mut self) {
        if self.len == 0 {
            return;
        }
        self.len -= 1;
        let last = std::mem::replace(self.at_mut(FIRST + self.len), NO_KEY);
        if self.len > 0 {
            self.sift_down(FIRST, last);
        }
    }

    pub(crate) fn change(&mut self, vertex: u32, change: i64) {
        let index = self.indices[self.offset(vertex)] as usize;
        let old = self.at(index);
        let key = Entry { change, ..Entry::from_key(old) }.key();
        if key < old {
            self.sift_up(index, key);
        } else {
            self.sift_down(index, key);
        }
    }

    /// Writes an entry to `index` or above, and moves the greater ancestors passed down.
    fn sift_up(&mut self, mut index: usize, key: u128) {
        while index > FIRST {
            let parent = index / ARITY + FIRST - 1;
            let above = self.at(parent);
            if above <= key {
                break;
            }
            self.put(index, above);
            index = parent;
        }
        self.put(index, key);
    }

    /// Writes an entry to `index` or below, and moves the least children passed up.
    fn sift_down(&mut self, mut index: usize, key: u128) {
        while let Some(&Siblings([a, b, c, d])) = self.siblings.get(index + 1 - FIRST) {
            let (first, i) = if b < a { (b, 1) } else { (a, 0) };
            let (second, j) = if d < c { (d, 3) } else { (c, 2) };
            let (least, child) = if second < first { (second, j) } else { (first, i) };
            if key <= least {
                break;
            }
            self.put(index, least);
            index = ARITY * (index + 1 - FIRST) + child;
        }
        self.put(index, key);
    }

    #[inline(always)]
    fn offset(&self, vertex: u32) -> usize {
        vertex.wrapping_sub(self.first_vertex) as usize
    }

    #[inline]
    fn at(&self, index: usize) -> u128 {
        self.siblings[index / ARITY].0[index % ARITY]
    }

    #[inline]
    fn at_mut(&mut self, index: usize) -> &mut u128 {
        &mut self.siblings[index / ARITY].0[index % ARITY]
    }

    #[inline]
    fn put(&mut self, index: usize, key: u128) {
        *self.at_mut(index) = key;
        let offset = self.offset(key as u32);
        self.indices[offset] = index as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Stage;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn returns_entries_in_the_order_of_their_keys(
            mut keys in prop::collection::vec(-20i64..20, 1..60),
            changes in prop::collection::vec((0usize..60, -20i64..20), 0..60),
        ) {
            // Ranks run against the numbers of the vertices.
            let entry = |(v, &change): (usize, &i64)| Entry {
                change,
                rank: 100 - v as u32,
                vertex: v as u32,
            };
            let mut queue = RemovalQueue::with_capacity(0..keys.len() as u32);
            keys.iter().enumerate().map(entry).for_each(|entry| queue.push(entry));
            queue.order(&mut Poller::new(&(), Stage::Simplify, 0, 0)).unwrap();
            for (v, key) in changes {
                let v = v % keys.len();
                keys[v] = key;
                queue.change(v as u32, key);
            }
            let mut expected: Vec<Entry> = keys.iter().enumerate().map(entry).collect();
            expected.sort_unstable();
            for (i, &entry) in expected.iter().enumerate() {
                prop_assert_eq!(queue.len(), expected.len() - i);
                prop_assert_eq!(queue.first(), Some(entry));
                prop_assert_eq!(queue.second(), expected.get(i + 1).copied());
                queue.remove_first();
            }
            prop_assert_eq!(queue.first(), None);
        }
    }
}
