//! Removals prepared ahead of their turn, on several threads.
//!
//! What a removal changes depends on its neighbourhood alone. So the vertices that are next in the
//! queue are prepared side by side, and then take their turns one by one: one whose neighbourhood
//! has not changed in the meantime takes what was prepared for it, any other is prepared again.
//! The order, and with it the result, is that of one thread; among many vertices those that are
//! next lie far apart, and almost all that is prepared is used.

use crate::face_error::Measure;
use crate::parallel::share_out_all;
use crate::removal::{Neighbour, Net, Remover};
use crate::removal_queue::RemovalQueue;
use crate::star::Stars;
use std::num::NonZeroUsize;

/// Fewer vertices than this are not worth the threads.
const LEAST_VERTICES: usize = 30_000;

/// Most removals prepared at once, and the part of all vertices that they are at most: the more,
/// the more of them meet.
const MOST_AT_ONCE: usize = 512;
const PART_AT_ONCE: usize = 64;

/// A removal in all its consequences.
pub(crate) struct Prepared {
    vertex: u32,
    /// The vertices around it, as they will be.
    pub(crate) neighbours: Vec<Neighbour>,
}

/// The removals prepared, in the order of their turns.
pub(crate) struct Foresight<'m> {
    threads: NonZeroUsize,
    removers: Vec<Remover<'m>>,
    prepared: Vec<Prepared>,
    /// The first one whose turn has not come.
    next: usize,
    /// For each vertex the round in which its star last changed.
    changed: Vec<u32>,
    round: u32,
}

impl<'m> Foresight<'m> {
    /// Foresight on so many threads; `None` on one, or for few vertices.
    pub(crate) fn new(
        measure: &'m Measure<'m>,
        vertex_count: usize,
        threads: NonZeroUsize,
    ) -> Option<Self> {
        (threads.get() > 1 && vertex_count >= LEAST_VERTICES).then(|| Self {
            threads,
            removers: (0..threads.get()).map(|_| Remover::new(measure)).collect(),
            prepared: Vec::new(),
            next: 0,
            changed: vec![0; vertex_count],
            round: 0,
        })
    }

    /// Prepares the next removals when the turns of all those prepared are over.
    pub(crate) fn look_ahead(
        &mut self,
        net: &Net<'_, Stars>,
        queue: &RemovalQueue,
        remaining: usize,
    ) {
        self.skip_changed();
        if self.next < self.prepared.len() || remaining < LEAST_VERTICES {
            return;
        }
        self.round += 1;
        self.next = 0;
        let next = queue.least(MOST_AT_ONCE.min(remaining / PART_AT_ONCE));
        self.prepared.truncate(next.len());
        for (i, entry) in next.iter().enumerate() {
            match self.prepared.get_mut(i) {
                Some(prepared) => prepared.vertex = entry.vertex,
                None => {
                    let neighbours = Vec::new();
                    self.prepared.push(Prepared { vertex: entry.vertex, neighbours });
                }
            }
        }
        let share = self.prepared.len().div_ceil(self.removers.len()).max(1);
        let shares = self.prepared.chunks_mut(share).zip(&mut self.removers);
        let prepare = |(share, remover): (&mut [Prepared], &mut Remover<'m>)| {
            prepare_all(share, remover, net);
        };
        share_out_all(self.threads, shares, prepare);
    }

    /// What was prepared for the vertex whose turn it is, if that still holds.
    pub(crate) fn take(&mut self, vertex: u32, net: &Net<'_, Stars>) -> Option<&mut Prepared> {
        self.skip_changed();
        let prepared = self.prepared.get_mut(self.next)?;
        if prepared.vertex != vertex {
            return None;
        }
        self.next += 1;
        let is_current = |v: &u32| self.changed[*v as usize] != self.round;
        net.stars.neighbours(vertex).iter().all(is_current).then_some(prepared)
    }

    /// Hears that the star of a vertex has changed.
    pub(crate) fn note_change(&mut self, vertex: u32) {
        self.changed[vertex as usize] = self.round;
    }

    /// Leaves out the vertices that have another turn now.
    fn skip_changed(&mut self) {
        let is_changed = |prepared: &Prepared| self.changed[prepared.vertex as usize] == self.round;
        while self.prepared.get(self.next).is_some_and(is_changed) {
            self.next += 1;
        }
    }
}

/// Prepares some removals.
fn prepare_all(share: &mut [Prepared], remover: &mut Remover<'_>, net: &Net<'_, Stars>) {
    for Prepared { vertex, neighbours } in share {
        remover.prepare(*vertex, net, neighbours);
    }
}
