//! The vertices of a mesh in the order of what their removal costs, kept up to date.

use super::measured_mesh::{FaceMeasure, MeasuredMesh};
use crate::control::{Cancelled, Control, Stage};
use crate::removal_queue::{Entry, RemovalQueue};

/// The movable vertices by the change of the error that their removal makes.
pub(crate) struct RemovalCosts {
    queue: RemovalQueue,
}

impl RemovalCosts {
    /// Evaluates every movable vertex.
    pub(crate) fn new<M: FaceMeasure>(
        mesh: &mut MeasuredMesh<M>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let count = mesh.triangulation.points.len();
        let mut costs = Vec::with_capacity(count);
        for vertex in 0..count as u32 {
            if mesh.is_movable(vertex) {
                control.poll(Stage::Refine, 0, count)?;
                let change = mesh.removal_change(vertex);
                costs.push(Entry { change, rank: vertex, vertex });
            }
        }
        Ok(Self { queue: RemovalQueue::new(costs, count) })
    }

    /// The least cost, and the vertex of it.
    pub(crate) fn cheapest(&self) -> Option<(i64, u32)> {
        self.queue.first().map(|entry| (entry.change, entry.vertex))
    }

    /// Takes the cheapest vertex out of the order, which is then out of the mesh too.
    pub(crate) fn remove_cheapest(&mut self) {
        self.queue.remove_first();
    }

    /// Evaluates vertices again whose surroundings have changed.
    pub(crate) fn update<M: FaceMeasure>(&mut self, mesh: &mut MeasuredMesh<M>, vertices: &[u32]) {
        for &vertex in vertices {
            if mesh.is_movable(vertex) {
                let change = mesh.removal_change(vertex);
                self.queue.change(vertex, change);
            }
        }
    }
}
