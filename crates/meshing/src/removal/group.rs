//! The removal loop: the vertices of neighbouring tiles, each tile with a queue of its own.
//!
//! The exact order is a group of one tile that holds all vertices. `partition` runs several groups
//! at a time; a vertex with a neighbour outside its group then waits for a larger group.

use crate::control::Cancelled;
use crate::face_error::ErrorEvaluator;
use crate::removal::candidate::{Evaluator, Neighbour};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{INLINE_CAPACITY, StarBlock};
use crate::removal::vertices::{MeshView, Vertices};

/// Stands for the change of a vertex that waits for a larger group.
const WAITS: i64 = i64::MAX;

/// Decides which removals a group makes, and keeps account of them.
pub(crate) trait Selection {
    /// Whether the first vertex of a queue is to be removed now.
    fn accepts(&mut self, first: Entry) -> Result<bool, Cancelled>;

    /// Takes note of a removal.
    fn record(&mut self, removed: Entry);
}

/// Tiles that follow each other: their stars and queues.
pub(crate) struct Group<'t, 'a> {
    vertices: &'a Vertices,
    stars: &'t mut [StarBlock],
    queues: &'t mut [RemovalQueue],
    /// The number of the first tile.
    first_tile: usize,
    evaluator: Evaluator<'a>,
    /// The neighbours of the last vertex removed.
    neighbours: Vec<Neighbour>,
    /// The entries, as they were, of vertices that wait for a larger group.
    waiting: Vec<Entry>,
}

impl<'t, 'a> Group<'t, 'a> {
    /// The group of these tiles.
    pub(crate) fn new(
        vertices: &'a Vertices,
        measure: &'a ErrorEvaluator<'a>,
        first_tile: usize,
        stars: &'t mut [StarBlock],
        queues: &'t mut [RemovalQueue],
    ) -> Self {
        let (evaluator, neighbours, waiting) = (Evaluator::new(measure), Vec::new(), Vec::new());
        Self { vertices, stars, queues, first_tile, evaluator, neighbours, waiting }
    }

    /// Removes vertices of a tile, always the first of its queue, as long as the selection accepts
    /// it. A vertex that has neighbours outside the group stays in the queue as the last.
    pub(crate) fn remove_from(
        &mut self,
        tile: usize,
        selection: &mut impl Selection,
    ) -> Result<(), Cancelled> {
        while let Some(first) = self.queues[tile].first()
            && selection.accepts(first)?
        {
            if self.holds_all(self.stars[tile].neighbours(first.vertex)) {
                self.remove_first(tile, first.vertex);
                selection.record(first);
            } else {
                self.queues[tile].change(first.vertex, WAITS);
                self.waiting.push(first);
            }
        }
        Ok(())
    }

    /// Removes the first vertex of a tile, fills its hole and gives its neighbours their new keys.
    #[inline]
    fn remove_first(&mut self, tile: usize, vertex: u32) {
        self.queues[tile].remove_first();
        self.prefetch_next(tile);
        let view =
            MeshView { vertices: self.vertices, blocks: self.stars, first_block: self.first_tile };
        self.evaluator.prepare(vertex, &view, &mut self.neighbours);
        for Neighbour { vertex, star, change } in self.neighbours.drain(..) {
            let tile = self.vertices.block_of(vertex) - self.first_tile;
            self.stars[tile].write(vertex, star);
            if let Some(change) = change {
                self.queues[tile].change(vertex, change);
            }
        }
        self.stars[tile].remove(vertex);
    }

    /// Prefetches what the next removals of a tile probably need: the stars around the first vertex
    /// of the queue, and the star of the second.
    #[inline]
    fn prefetch_next(&self, tile: usize) {
        let (stars, queue) = (&self.stars[tile], &self.queues[tile]);
        if let Some(next) = queue.first() {
            let around = stars.neighbours(next.vertex);
            stars.prefetch(&around[..around.len().min(INLINE_CAPACITY)]);
        }
        if let Some(second) = queue.second() {
            stars.prefetch(&[second.vertex]);
        }
    }

    /// Gives the vertices that wait their keys back, for the next group.
    pub(crate) fn end_waiting(self) {
        // The key of one that waited may have changed, and it may have waited again.
        for entry in self.waiting.into_iter().rev() {
            let queue = &mut self.queues[self.vertices.block_of(entry.vertex) - self.first_tile];
            if queue.change_of(entry.vertex) == WAITS {
                queue.change(entry.vertex, entry.change);
            }
        }
    }

    /// Whether all of some vertices are in the group.
    #[inline]
    fn holds_all(&self, vertices: &[u32]) -> bool {
        let tile = |v: u32| self.vertices.block_of(v).wrapping_sub(self.first_tile);
        vertices.iter().fold(true, |all, &v| all & (tile(v) < self.queues.len()))
    }
}
