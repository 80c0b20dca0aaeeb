//! Patches: parts of a mesh that threads change on their own.
//!
//! A patch does not know the triangles outside of it. A change is made only where none of them can
//! matter, so that the patch has the triangles that the whole mesh would have.

use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, PATCH_BOUNDARY};
use crate::dynamic_mesh::measured::{FaceMeasure, MeasuredTriangulation};
use crate::dynamic_mesh::partition::{Partition, PatchIndices};
use crate::triangulation::{NONE, next};

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// A copy of a patch, and for each of its vertices whether all of its triangles are in it.
    pub(crate) fn patch(&self, partition: &Partition, number: u32) -> (Self, Vec<bool>) {
        let (triangulation, is_inner) = self.triangulation().patch(partition, number);
        let slots = &partition.patches[number as usize].slots;
        let errors = slots.iter().map(|&slot| self.face_error(slot)).collect();
        let measured = MeasuredTriangulation::new(triangulation, errors);
        (Self::with_errors(measured, self.evaluator.measure.another()), is_inner)
    }

    /// Puts a copy of a patch back.
    pub(crate) fn put_patch(&mut self, indices: &PatchIndices, patch: &Self) {
        let slots = self.measured.triangulation.put_patch(indices, patch.triangulation());
        for (from, &to) in (0..).zip(&slots) {
            self.measured.set_face_error(to, patch.face_error(from));
        }
    }
}

impl DynamicTriangulation {
    /// A copy of a patch, and for each of its vertices whether all of its triangles are in it.
    pub(super) fn patch(&self, partition: &Partition, number: u32) -> (Self, Vec<bool>) {
        let PatchIndices { vertices, slots } = &partition.patches[number as usize];
        let half_edge = |h: u32| {
            let location = partition.slots[h as usize / 3];
            (location.patch == number).then(|| 3 * location.index + h % 3)
        };
        let sides = || slots.iter().flat_map(|&slot| 3 * slot..3 * slot + 3);
        let twin = |h: u32| match self.twins[h as usize] {
            NONE => NONE,
            twin => half_edge(twin).unwrap_or(PATCH_BOUNDARY),
        };
        let origin = |h: u32| partition.vertices[self.origins[h as usize] as usize].index;
        let outgoing = |v: &u32| half_edge(self.outgoing[*v as usize]).unwrap_or(NONE);
        let patch = Self {
            points: vertices.iter().map(|&v| self.points[v as usize]).collect(),
            origins: sides().map(origin).collect(),
            twins: sides().map(twin).collect(),
            outgoing: vertices.iter().map(outgoing).collect(),
            free: Vec::new(),
            right: self.right,
            top: self.top,
        };
        let mut is_inner: Vec<bool> = patch.outgoing.iter().map(|&h| h != NONE).collect();
        for (h, _) in (0..).zip(&patch.twins).filter(|(_, twin)| **twin == PATCH_BOUNDARY) {
            for end in [h, next(h)] {
                is_inner[patch.origins[end as usize] as usize] = false;
            }
        }
        (patch, is_inner)
    }

    /// Puts a copy of a patch back, and returns the slot here of each of its slots.
    pub(super) fn put_patch(&mut self, indices: &PatchIndices, patch: &Self) -> Vec<u32> {
        let mut slots = indices.slots.clone();
        while slots.len() < patch.slot_count() {
            slots.push(self.free_slot());
        }
        let half_edge = |h: u32| 3 * slots[h as usize / 3] + h % 3;
        for (index, &slot) in (0..).zip(&slots) {
            if !patch.is_used(index) {
                self.origins[3 * slot as usize..][..3].fill(NONE);
                self.free.push(slot);
                continue;
            }
            for (from, to) in (3 * index as usize..).zip(3 * slot as usize..).take(3) {
                self.origins[to] = indices.vertices[patch.origins[from] as usize];
                match patch.twins[from] {
                    PATCH_BOUNDARY => {}
                    NONE => self.twins[to] = NONE,
                    twin => self.twins[to] = half_edge(twin),
                }
            }
        }
        for ((&v, &point), &h) in indices.vertices.iter().zip(&patch.points).zip(&patch.outgoing) {
            self.points[v as usize] = point;
            if h != NONE {
                self.outgoing[v as usize] = half_edge(h);
            }
        }
        slots
    }
}
