//! What a change would do to the error of a mesh, found without changing it.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::FaceMeasure;
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Ring};
use crate::dynamic_mesh::occupancy::Occupancy;
use crate::image::Point;
use crate::parallel::share_out;
use crate::triangulation::hole::HoleFiller;

/// What is probed on one thread at a time.
const SHARE: usize = 64;

/// What finds the changes; keeps its memory from one to the next.
pub(crate) struct Probe<M> {
    pub(super) measure: M,
    /// The ring of the vertex looked at last.
    pub(super) star: Ring,
    /// The places of its vertices.
    pub(super) boundary: Vec<Point>,
    pub(super) filler: HoleFiller,
    /// Error of each triangle of the last fill.
    pub(super) fill_errors: Vec<u64>,
    /// The ring of the place looked at last.
    pub(super) cavity: Ring,
    /// The faces measured last: of a fan or a fill.
    pub(super) faces: Vec<[Point; 3]>,
    /// Errors of those of a fan.
    errors: Vec<u64>,
}

/// A mesh that does not change while it is probed.
#[derive(Clone, Copy)]
pub(crate) struct Surface<'a> {
    pub(super) triangulation: &'a DynamicTriangulation,
    pub(super) face_errors: &'a [u64],
    pub(super) occupancy: &'a Occupancy,
}

impl<M: FaceMeasure> Probe<M> {
    pub(super) fn new(measure: M) -> Self {
        Self {
            measure,
            star: Ring::default(),
            boundary: Vec::new(),
            filler: HoleFiller::default(),
            fill_errors: Vec::new(),
            cavity: Ring::default(),
            faces: Vec::new(),
            errors: Vec::new(),
        }
    }
}

impl Surface<'_> {
    /// Tells whether a point may become a vertex: it lies in the image and is none.
    #[inline]
    pub(crate) fn is_vacant(self, p: Point) -> bool {
        self.triangulation.holds(p) && !self.occupancy.is_taken(p)
    }

    /// The places of a triangle's vertices.
    pub(crate) fn corners(self, slot: u32) -> [Point; 3] {
        self.triangulation.corners(slot)
    }

    /// By how much the error changes when a movable vertex goes.
    pub(crate) fn removal_change<M: FaceMeasure>(self, vertex: u32, probe: &mut Probe<M>) -> i64 {
        let Probe { measure, star, boundary, filler, fill_errors, faces, .. } = probe;
        self.triangulation.star(vertex, star);
        boundary.clear();
        boundary.extend(star.vertices.iter().map(|&v| self.triangulation.points[v as usize]));
        faces.clear();
        let corners = |triangle: &[_; 3]| triangle.map(|place| boundary[place as usize]);
        faces.extend(filler.fill(boundary).iter().map(corners));
        let after = measure.errors_below(faces, u64::MAX, fill_errors);
        let before: u64 = star.triangles.iter().map(|&t| self.face_errors[t as usize]).sum();
        after as i64 - before as i64
    }

    /// By how much the error would change with a vertex at a vacant place, if by less than `limit`;
    /// `hint` is a slot near it.
    pub(crate) fn insertion_change<M: FaceMeasure>(
        self,
        place: Point,
        hint: u32,
        limit: i64,
        probe: &mut Probe<M>,
    ) -> Option<i64> {
        let Probe { measure, cavity, faces, errors, .. } = probe;
        let slot = self.triangulation.locate(place, hint);
        self.triangulation.cavity(place, slot, cavity);
        let before: u64 = cavity.triangles.iter().map(|&t| self.face_errors[t as usize]).sum();
        faces.clear();
        faces.extend(self.triangulation.fan_around(place, cavity));
        let left = limit.saturating_add_unsigned(before).max(0) as u64;
        let change = measure.errors_below(faces, left, errors) as i64 - before as i64;
        (change < limit).then_some(change)
    }
}

/// Finds something of each of some vertices or faces, on all threads, each of which has a probe of
/// its own.
pub(crate) fn find_all<M: FaceMeasure, T: Clone + Default + Send>(
    of: &[u32],
    new_probe: impl Fn() -> Probe<M> + Sync,
    find: impl Fn(u32, &mut Probe<M>) -> T + Sync,
    control: &dyn Control,
) -> Result<Vec<T>, Cancelled> {
    let mut found = vec![T::default(); of.len()];
    let work = |(of, found): (&[u32], &mut [T]), control: &dyn Control| {
        control.poll(Stage::Refine, 0, 1)?;
        let mut probe = new_probe();
        found.iter_mut().zip(of).for_each(|(found, &of)| *found = find(of, &mut probe));
        Ok(())
    };
    share_out(of.chunks(SHARE).zip(found.chunks_mut(SHARE)), control, work)?;
    Ok(found)
}
