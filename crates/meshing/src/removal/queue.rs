//! Vertices in the order of their removal: a heap of four children that knows where each vertex
//! stands, so that a changed key moves its vertex and no stale entry remains.
//!
//! An entry is one number of 128 bits: its change, its rank and its vertex from the highest bits to
//! the lowest. So two entries compare without branches, and the four children of a place, which lie
//! side by side in one line of memory, are compared as in a tournament; where there are fewer, the
//! greatest number stands in.

/// Not in the queue.
const ABSENT: u32 = u32::MAX;

/// Children of each place.
const ARITY: usize = 4;

/// Stands where there is no entry: after all of them.
const NO_KEY: u128 = u128::MAX;

/// A vertex with its place in the order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Entry {
    /// By how much its removal changes the error.
    pub(crate) change: i64,
    /// Its place by row, then column, which decides between equal changes.
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

/// The entries of the four children of a place.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Children([u128; ARITY]);

/// A priority queue of vertices by change of error, then by rank.
///
/// The least entry stands at place 0, the children of place `i` at `4 i + 1` to `4 i + 4`.
pub(crate) struct RemovalQueue {
    first: u128,
    /// The entries at the other places: child `k` of place `i` is the `k`-th of the `i`-th element.
    children: Vec<Children>,
    len: usize,
    /// The number of the first vertex that may be in the queue.
    first_vertex: u32,
    /// Place of each vertex in the heap, from the first one on.
    places: Vec<u32>,
}

impl RemovalQueue {
    /// A queue of entries for some of `vertex_count` vertices.
    pub(crate) fn new(entries: Vec<Entry>, vertex_count: usize) -> Self {
        Self::of_vertices_from(0, vertex_count, entries)
    }

    /// The same for vertices that are numbered from `first_vertex` on.
    pub(crate) fn of_vertices_from(
        first_vertex: u32,
        vertex_count: usize,
        entries: Vec<Entry>,
    ) -> Self {
        let mut queue = Self {
            first: NO_KEY,
            children: vec![Children([NO_KEY; ARITY]); entries.len().div_ceil(ARITY)],
            len: entries.len(),
            first_vertex,
            places: vec![ABSENT; vertex_count],
        };
        for (place, entry) in entries.into_iter().enumerate() {
            queue.put(place, entry.key());
        }
        for parent in (0..queue.children.len()).rev() {
            queue.sift_down(parent, queue.at(parent));
        }
        queue
    }

    /// The vertex whose removal changes the error least.
    pub(crate) fn first(&self) -> Option<Entry> {
        (self.len > 0).then(|| Entry::from_key(self.first))
    }

    /// The vertex after that.
    #[inline]
    pub(crate) fn second(&self) -> Option<Entry> {
        let Children([a, b, c, d]) = self.children.first()?;
        Some(*a.min(b).min(c.min(d))).filter(|&key| key != NO_KEY).map(Entry::from_key)
    }

    /// Number of vertices in the queue.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// All entries, in any order.
    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        let others = self.children.iter().flat_map(|Children(keys)| keys);
        let keys = std::iter::once(&self.first).chain(others);
        keys.filter(|&&key| key != NO_KEY).map(|&key| Entry::from_key(key))
    }

    /// All entries, in any order; gives the rest of the memory back first.
    pub(crate) fn into_entries(self) -> impl Iterator<Item = Entry> {
        let Self { first, children, .. } = self;
        let others = children.into_iter().flat_map(|Children(keys)| keys);
        let keys = std::iter::once(first).chain(others);
        keys.filter(|&key| key != NO_KEY).map(Entry::from_key)
    }

    /// The change of a vertex of the queue.
    pub(crate) fn change_of(&self, vertex: u32) -> i64 {
        Entry::from_key(self.at(self.places[self.index(vertex)] as usize)).change
    }

    /// Takes out the first vertex.
    pub(crate) fn remove_first(&mut self) {
        if self.len == 0 {
            return;
        }
        let gone = self.index(self.first as u32);
        self.places[gone] = ABSENT;
        self.len -= 1;
        let last = self.at(self.len);
        self.set(self.len, NO_KEY);
        if self.len > 0 {
            self.sift_down(0, last);
        }
    }

    /// Gives a vertex of the queue another key.
    pub(crate) fn change(&mut self, vertex: u32, change: i64) {
        let place = self.places[self.index(vertex)] as usize;
        let old = self.at(place);
        let key = Entry { change, ..Entry::from_key(old) }.key();
        if key < old {
            self.sift_up(place, key);
        } else {
            self.sift_down(place, key);
        }
    }

    /// Puts an entry to `place` or, while the parent there is greater, to that of its parent.
    fn sift_up(&mut self, mut place: usize, key: u128) {
        while place > 0 {
            let parent = (place - 1) / ARITY;
            let above = self.at(parent);
            if above <= key {
                break;
            }
            self.put(place, above);
            place = parent;
        }
        self.put(place, key);
    }

    /// Puts an entry to `place` or, while a child there is less, to that of its least child.
    fn sift_down(&mut self, mut place: usize, key: u128) {
        while let Some(&Children([a, b, c, d])) = self.children.get(place) {
            let (first, i) = if b < a { (b, 2) } else { (a, 1) };
            let (second, j) = if d < c { (d, 4) } else { (c, 3) };
            let (least, child) = if second < first { (second, j) } else { (first, i) };
            if key <= least {
                break;
            }
            self.put(place, least);
            place = ARITY * place + child;
        }
        self.put(place, key);
    }

    /// Where the place of a vertex is noted.
    #[inline(always)]
    fn index(&self, vertex: u32) -> usize {
        vertex.wrapping_sub(self.first_vertex) as usize
    }

    /// The entry at a place.
    #[inline]
    fn at(&self, place: usize) -> u128 {
        match place.checked_sub(1) {
            None => self.first,
            Some(other) => self.children[other / ARITY].0[other % ARITY],
        }
    }

    #[inline]
    fn set(&mut self, place: usize, key: u128) {
        match place.checked_sub(1) {
            None => self.first = key,
            Some(other) => self.children[other / ARITY].0[other % ARITY] = key,
        }
    }

    /// Writes an entry to a place.
    #[inline]
    fn put(&mut self, place: usize, key: u128) {
        self.set(place, key);
        let index = self.index(key as u32);
        self.places[index] = place as u32;
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
