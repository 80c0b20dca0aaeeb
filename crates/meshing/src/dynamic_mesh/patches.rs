//! Patches of a measured mesh.

use crate::dynamic_mesh::occupancy::Occupancy;
use crate::dynamic_mesh::partition::{Part, Partition};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// The patch of one part, and for each of its vertices whether all of its triangles are in it.
    ///
    /// Its total error is that of all faces as far as it knows: it changes with its own. Places that
    /// only vertices beyond the fence take are vacant to it.
    pub(crate) fn patch(&self, partition: &Partition, number: u32) -> (Self, Vec<bool>) {
        let (triangulation, is_inner) = self.triangulation.patch(partition, number);
        let occupancy = Occupancy::around(&triangulation.points);
        let mut patch = Self::unmeasured(triangulation, self.probe.measure.another(), occupancy);
        let slots = &partition.parts[number as usize].slots;
        patch.face_errors.extend(slots.iter().map(|&slot| self.face_errors[slot as usize]));
        patch.total_error = self.total_error;
        (patch, is_inner)
    }

    /// Puts a patch back that was taken when the total error was `error_before`.
    pub(crate) fn put_in(&mut self, part: &Part, patch: &Self, error_before: u64) {
        let Self { triangulation, face_errors, occupancy, .. } = self;
        let moved = || {
            let points = part.vertices.iter().zip(&patch.triangulation.points);
            points.map(|(&v, &to)| (v as usize, to))
        };
        for (v, to) in moved() {
            if triangulation.points[v] != to {
                occupancy.leave(triangulation.points[v]);
            }
        }
        moved().for_each(|(_, to)| occupancy.take(to));
        triangulation.put_in(part, &patch.triangulation, |number, slot| {
            if face_errors.len() <= slot as usize {
                face_errors.resize(slot as usize + 1, 0);
            }
            face_errors[slot as usize] = patch.face_errors[number as usize];
        });
        let change = patch.total_error.wrapping_sub(error_before);
        self.total_error = self.total_error.wrapping_add(change);
    }
}
