//! The front of the sweep: the upper boundary of the triangles so far, a chain of edges from the
//! left side of the rectangle to its right side with at most one vertex in each column.

use crate::triangulation::NONE;

/// Indices of the neighbours of a [`Node`].
pub(super) const LEFT: usize = 0;
pub(super) const RIGHT: usize = 1;

#[derive(Clone, Copy)]
pub(super) struct Node {
    pub(super) vertex: u32,
    /// The columns of the next vertices at the left and at the right, [`NONE`] beyond the ends.
    pub(super) neighbours: [u32; 2],
}

pub(super) struct Front {
    nodes: Vec<Node>,
    /// One bit for each column, set where the front has a vertex.
    columns: Vec<u64>,
}

impl Front {
    pub(super) fn new(width: usize) -> Self {
        let node = Node { vertex: NONE, neighbours: [NONE; 2] };
        Self { nodes: vec![node; width], columns: vec![0; width.div_ceil(64)] }
    }

    /// The vertex of a column that has one.
    #[inline]
    pub(super) fn node(&self, column: u32) -> Node {
        self.nodes[column as usize]
    }

    /// The nearest column with a vertex, at or left of a column; 0 always has one.
    #[inline]
    pub(super) fn at_or_before(&self, column: u32) -> u32 {
        let mut word = column as usize / 64;
        let mut bits = self.columns[word] & (u64::MAX >> (63 - column % 64));
        while bits == 0 && word > 0 {
            word -= 1;
            bits = self.columns[word];
        }
        word as u32 * 64 + bits.checked_ilog2().unwrap_or(0)
    }

    /// Inserts a vertex at the right of the one in column `left`, or first if that is [`NONE`].
    #[inline]
    pub(super) fn insert_after(&mut self, left: u32, column: u32, vertex: u32) {
        let mut right = NONE;
        if left != NONE {
            right = std::mem::replace(&mut self.nodes[left as usize].neighbours[RIGHT], column);
        }
        if right != NONE {
            self.nodes[right as usize].neighbours[LEFT] = column;
        }
        self.nodes[column as usize] = Node { vertex, neighbours: [left, right] };
        self.columns[column as usize / 64] |= 1 << (column % 64);
    }

    #[inline]
    pub(super) fn replace(&mut self, column: u32, vertex: u32) {
        self.nodes[column as usize].vertex = vertex;
    }

    #[inline]
    pub(super) fn remove(&mut self, column: u32) {
        let [left, right] = self.nodes[column as usize].neighbours;
        self.nodes[left as usize].neighbours[RIGHT] = right;
        self.nodes[right as usize].neighbours[LEFT] = left;
        self.columns[column as usize / 64] &= !(1 << (column % 64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn finds_the_nearest_column_at_the_left(
            width in prop::sample::select(vec![2usize, 64, 65, 4097]),
            changes in prop::collection::vec(any::<prop::sample::Index>(), 0..60),
        ) {
            let mut front = Front::new(width);
            front.insert_after(NONE, 0, 0);
            front.insert_after(0, width as u32 - 1, 1);
            let mut expected = BTreeSet::from([0, width as u32 - 1]);
            for change in changes {
                let column = change.index(width) as u32;
                let left = front.at_or_before(column);
                prop_assert_eq!(Some(&left), expected.range(..=column).next_back());
                if expected.insert(column) {
                    front.insert_after(left, column, 2);
                } else if 0 < column && column < width as u32 - 1 {
                    front.remove(column);
                    expected.remove(&column);
                }
            }
            let mut column = 0;
            for &next in &expected {
                prop_assert_eq!(column, next);
                column = front.node(column).neighbours[RIGHT];
            }
        }
    }
}
