//! The vertices of a mesh in the order of what their removal costs, kept up to date.

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::probe::find_all;
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::removal::queue::{Entry, RemovalQueue};

/// The movable vertices by the change of the error that their removal makes.
pub(crate) struct RemovalCosts {
    queue: RemovalQueue,
}

impl RemovalCosts {
    /// Evaluates every movable vertex.
    pub(crate) fn new<M: FaceMeasure>(
        mesh: &MeasuredMesh<M>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let count = mesh.triangulation.points.len();
        let vertices: Vec<u32> = (0..count as u32).filter(|&v| mesh.is_movable(v)).collect();
        let (surface, new_probe) = (mesh.surface(), || mesh.another_probe());
        let find = |vertex, probe: &mut _| surface.removal_change(vertex, probe);
        let changes = find_all(&vertices, new_probe, find, control)?;
        let costs = vertices.iter().zip(changes);
        let costs = costs.map(|(&vertex, change)| Entry { change, rank: vertex, vertex }).collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn the_cheapest_vertex_is_the_one_whose_loss_costs_least_when_all_is_triangulated_afresh(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        ) {
            let (image, mut points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let mut costs = RemovalCosts::new(&mesh, &()).unwrap();
            let error = |points: &[_]| sum_of_errors(&image, points, &triangulate(points)) as i64;
            let numbers = points.clone();
            while let Some((cost, vertex)) = costs.cheapest() {
                let without = |v: u32| {
                    let gone = numbers[v as usize];
                    points.iter().copied().filter(|p| *p != gone).collect::<Vec<_>>()
                };
                let left = (0..numbers.len() as u32).filter(|&v| mesh.is_movable(v));
                let all = left.map(|v| (error(&without(v)) - error(&points), v));
                prop_assert_eq!(Some((cost, vertex)), all.min());
                points = without(vertex);
                costs.remove_cheapest();
                mesh.remove(vertex);
                let around = mesh.left().to_vec();
                costs.update(&mut mesh, &around);
            }
            prop_assert_eq!(points.len(), 4);
        }
    }
}
