//! Evaluation of changes: what a removal or an insertion would do to the error of a mesh.

use crate::control::{Cancelled, Poller};
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Link};
use crate::face_error::FaceMeasure;
use crate::image::Point;
use crate::triangulation::hole::{HoleFiller, HoleTriangle};

pub(crate) struct Evaluator<M> {
    pub(crate) measure: M,
    /// The star of the vertex evaluated last, and the positions of its link's vertices.
    pub(super) star: Link,
    pub(super) boundary: Vec<Point>,
    pub(super) filler: HoleFiller,
    /// The cavity of the position evaluated last.
    pub(super) cavity: Link,
    /// The faces measured last, those of a fan or a fill, and their errors.
    faces: Vec<[Point; 3]>,
    pub(super) errors: Vec<u64>,
}

/// A change would reach beyond the boundary of the patch.
pub(super) struct LeavesPatch;

impl<M: FaceMeasure> Evaluator<M> {
    pub(super) fn new(measure: M) -> Self {
        Self {
            measure,
            star: Link::default(),
            boundary: Vec::new(),
            filler: HoleFiller::default(),
            cavity: Link::default(),
            faces: Vec::new(),
            errors: Vec::new(),
        }
    }

    pub(super) fn gather_star(&mut self, triangulation: &DynamicTriangulation, vertex: u32) {
        triangulation.star(vertex, &mut self.star);
        self.boundary.clear();
        let neighbours = self.star.vertices.iter();
        self.boundary.extend(neighbours.map(|&v| triangulation.points[v as usize]));
    }

    pub(crate) fn removal_change(
        &mut self,
        triangulation: &DynamicTriangulation,
        vertex: u32,
        poller: &mut Poller<'_>,
    ) -> Result<i64, Cancelled> {
        self.gather_star(triangulation, vertex);
        let Self { boundary, filler, faces, .. } = self;
        let corners = |triangle: &HoleTriangle| triangle.map(|i| boundary[i as usize]);
        faces.clear();
        faces.extend(filler.fill(boundary).iter().map(corners));
        let after = self.measure.errors_below(faces, u64::MAX, &mut self.errors, poller)?;
        Ok(after as i64 - triangulation.error_of(&self.star.triangles) as i64)
    }

    /// By how much the error would change with a vertex at a position in the image, if by less than
    /// `limit`; `hint` is a slot near it. `None` too where another vertex is.
    pub(crate) fn insertion_change(
        &mut self,
        triangulation: &DynamicTriangulation,
        at: Point,
        hint: u32,
        limit: i64,
        poller: &mut Poller<'_>,
    ) -> Result<Option<i64>, Cancelled> {
        Ok(self.fan_change(triangulation, at, hint, None, limit, poller)?.ok().flatten())
    }

    /// The same for a detached vertex whose faces had the error `detached`, against the error
    /// before it was detached. Errors of its fill do not count.
    pub(super) fn fan_change(
        &mut self,
        triangulation: &DynamicTriangulation,
        at: Point,
        hint: u32,
        detached: Option<u64>,
        limit: i64,
        poller: &mut Poller<'_>,
    ) -> Result<Result<Option<i64>, LeavesPatch>, Cancelled> {
        let Self { measure, star, cavity, faces, errors, .. } = self;
        let Some(slot) = triangulation.locate(at, hint) else { return Ok(Err(LeavesPatch)) };
        if triangulation.corners(slot).contains(&at) {
            return Ok(Ok(None));
        }
        triangulation.cavity(at, slot, cavity);
        if cavity.touches_patch_boundary() {
            return Ok(Err(LeavesPatch));
        }
        let fill = detached.map_or(&[][..], |_| star.fill());
        let replaced = cavity.triangles.iter().filter(|slot| !fill.contains(slot));
        let replaced_error: u64 = replaced.map(|&slot| triangulation.face_error(slot)).sum();
        let before = detached.unwrap_or(0) + replaced_error;
        faces.clear();
        let point = |v: u32| triangulation.points[v as usize];
        faces.extend(cavity.edges().map(|(from, to)| [point(from), point(to), at]));
        let most = limit.saturating_add_unsigned(before).max(0) as u64;
        let change = measure.errors_below(faces, most, errors, poller)? as i64 - before as i64;
        Ok(Ok((change < limit).then_some(change)))
    }
}
