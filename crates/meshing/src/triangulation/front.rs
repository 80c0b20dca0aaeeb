//! The upper boundary of a triangulation that grows upwards: a chain of edges from the left side
//! to the right side with at most one vertex in each column.

use crate::triangulation::NONE;
use crate::triangulation::column_set::ColumnSet;

/// A vertex of the front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Its number.
    pub(super) vertex: u32,
    /// Column of the vertex at its left, [`NONE`] at the left side.
    pub(super) left: u32,
    /// Column of the vertex at its right, [`NONE`] at the right side.
    pub(super) right: u32,
}

/// The vertices of the front by their columns.
#[derive(Debug)]
pub(super) struct Front {
    nodes: Vec<Node>,
    columns: ColumnSet,
}

impl Front {
    /// An empty front.
    pub(super) fn new(width: usize) -> Self {
        let nobody = Node { vertex: NONE, left: NONE, right: NONE };
        Self { nodes: vec![nobody; width], columns: ColumnSet::new(width) }
    }

    /// The node of a column that has one.
    #[inline]
    pub(super) fn node(&self, column: u32) -> Node {
        self.nodes[column as usize]
    }

    /// The vertex of a column that has one.
    #[inline]
    pub(super) fn vertex(&self, column: u32) -> u32 {
        self.nodes[column as usize].vertex
    }

    /// The nearest column with a vertex, not after the given one; the left side always has one.
    #[inline]
    pub(super) fn at_or_before(&self, column: u32) -> u32 {
        self.columns.at_or_before(column as usize).map_or(0, |found| found as u32)
    }

    /// Puts a vertex at the right of another one, or of nothing.
    #[inline]
    pub(super) fn insert_after(&mut self, left: u32, column: u32, vertex: u32) {
        let right = if left == NONE { NONE } else { self.nodes[left as usize].right };
        self.nodes[column as usize] = Node { vertex, left, right };
        if left != NONE {
            self.nodes[left as usize].right = column;
        }
        if right != NONE {
            self.nodes[right as usize].left = column;
        }
        self.columns.insert(column as usize);
    }

    /// Puts another vertex of the same column in the place of one.
    #[inline]
    pub(super) fn replace(&mut self, column: u32, vertex: u32) {
        self.nodes[column as usize].vertex = vertex;
    }

    /// Takes a vertex out that has neighbours at both sides.
    #[inline]
    pub(super) fn remove(&mut self, column: u32) {
        let Node { left, right, .. } = self.nodes[column as usize];
        self.nodes[left as usize].right = right;
        self.nodes[right as usize].left = left;
        self.columns.remove(column as usize);
    }
}
