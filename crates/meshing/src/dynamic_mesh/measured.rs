//! The errors of a triangulation's faces, and what a change would do to their sum.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Link};
use crate::face_error::FaceErrors;
use crate::face_error::quadratic_model::ModelPixels;
use crate::image::Point;
use crate::parallel::share_out;
use crate::triangulation::hole::{HoleFiller, HoleTriangle};

/// Changes evaluated between two polls of the control.
const CHANGES_PER_POLL: usize = 64;

/// The error of a face, a whole number that depends on the positions of its vertices alone.
pub(crate) trait FaceMeasure: Send + Sync {
    /// Sum of the errors of the lattice points of a counter-clockwise face.
    fn error(&mut self, corners: [Point; 3]) -> u64;

    /// Measures faces in order until the sum of their errors reaches `limit`, and returns the sum.
    fn errors_below(&mut self, faces: &[[Point; 3]], limit: u64, errors: &mut Vec<u64>) -> u64 {
        let mut sum = 0;
        errors.clear();
        for &face in faces {
            let error = self.error(face);
            errors.push(error);
            sum += error;
            if sum >= limit {
                break;
            }
        }
        sum
    }

    /// Another measure of the same errors, for another thread.
    fn another(&self) -> Self
    where
        Self: Sized;

    /// The pixels of the quadratic model, where the error is the squared one of these.
    fn model_pixels(&self) -> Option<ModelPixels<'_>> {
        None
    }

    /// The error without weights, whose changes the quadratic model predicts, of a face of some
    /// error.
    fn unweighted_error(&mut self, _corners: [Point; 3], error: u64) -> u64 {
        error
    }
}

impl FaceMeasure for FaceErrors<'_> {
    fn error(&mut self, corners: [Point; 3]) -> u64 {
        Self::error(self, corners)
    }

    fn errors_below(&mut self, faces: &[[Point; 3]], limit: u64, errors: &mut Vec<u64>) -> u64 {
        Self::errors_below(self, faces, limit, errors)
    }

    fn another(&self) -> Self {
        Self::another(self)
    }

    fn model_pixels(&self) -> Option<ModelPixels<'_>> {
        Self::model_pixels(self)
    }

    fn unweighted_error(&mut self, corners: [Point; 3], error: u64) -> u64 {
        Self::unweighted_error(self, corners, error)
    }
}

/// A triangulation with the error of each face and their sum.
pub(crate) struct MeasuredTriangulation {
    pub(crate) triangulation: DynamicTriangulation,
    /// Error of each slot's face, 0 of a free slot.
    face_errors: Vec<u64>,
    /// Sum of these.
    total_error: u64,
}

impl MeasuredTriangulation {
    pub(crate) fn new(triangulation: DynamicTriangulation, face_errors: Vec<u64>) -> Self {
        let total_error = face_errors.iter().sum();
        Self { triangulation, face_errors, total_error }
    }

    /// A copy.
    ///
    /// # Errors
    /// When the control cancels.
    pub(crate) fn copy(&self, control: &dyn Control) -> Result<Self, Cancelled> {
        let triangulation = self.triangulation.copy(control)?;
        let face_errors = self.face_errors.clone();
        Ok(Self { triangulation, face_errors, total_error: self.total_error })
    }

    pub(crate) fn total_error(&self) -> u64 {
        self.total_error
    }

    pub(crate) fn face_error(&self, slot: u32) -> u64 {
        self.face_errors[slot as usize]
    }

    /// Sum of the errors of some slots' faces.
    pub(crate) fn error_of(&self, slots: &[u32]) -> u64 {
        slots.iter().map(|&slot| self.face_error(slot)).sum()
    }

    /// Sets the error of a slot's face, of a new slot too.
    pub(crate) fn set_face_error(&mut self, slot: u32, error: u64) {
        if self.face_errors.len() <= slot as usize {
            self.face_errors.resize(slot as usize + 1, 0);
        }
        let before = std::mem::replace(&mut self.face_errors[slot as usize], error);
        self.total_error = self.total_error.wrapping_sub(before).wrapping_add(error);
    }

    /// Removes a vertex whose star is `star`; `fill` triangulates the link, with these errors.
    pub(super) fn remove(
        &mut self,
        vertex: u32,
        star: &mut Link,
        fill: &[HoleTriangle],
        errors: &[u64],
    ) {
        self.triangulation.remove(vertex, star, fill);
        for (i, &slot) in star.triangles.iter().enumerate() {
            self.set_face_error(slot, errors.get(i).copied().unwrap_or(0));
        }
    }

    /// Inserts a vertex at a position whose cavity is `cavity`; the faces of the fan have these
    /// errors, and `fan` becomes their slots.
    pub(super) fn insert(
        &mut self,
        vertex: u32,
        at: Point,
        cavity: &Link,
        errors: &[u64],
        fan: &mut Vec<u32>,
    ) {
        self.triangulation.insert(vertex, at, cavity, fan);
        for (&slot, &error) in fan.iter().zip(errors) {
            self.set_face_error(slot, error);
        }
    }
}

/// Evaluates changes; keeps its memory from one to the next.
pub(crate) struct Evaluator<M> {
    pub(super) measure: M,
    /// The star of the vertex evaluated last, and the positions of its link's vertices.
    pub(super) star: Link,
    pub(super) boundary: Vec<Point>,
    pub(super) filler: HoleFiller,
    /// The cavity of the position evaluated last.
    pub(super) cavity: Link,
    /// The faces measured last, those of a fan or a fill, and their errors.
    pub(super) faces: Vec<[Point; 3]>,
    pub(super) errors: Vec<u64>,
}

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

    /// Gathers the star of a vertex and the positions of its neighbours.
    pub(super) fn gather_star(&mut self, triangulation: &DynamicTriangulation, vertex: u32) {
        triangulation.star(vertex, &mut self.star);
        self.boundary.clear();
        let neighbours = self.star.vertices.iter();
        self.boundary.extend(neighbours.map(|&v| triangulation.points[v as usize]));
    }

    /// By how much the error changes when a movable vertex is removed.
    pub(crate) fn removal_change(&mut self, mesh: &MeasuredTriangulation, vertex: u32) -> i64 {
        self.gather_star(&mesh.triangulation, vertex);
        let Self { boundary, filler, faces, .. } = self;
        faces.clear();
        let corners = |triangle: &HoleTriangle| triangle.map(|i| boundary[i as usize]);
        faces.extend(filler.fill(boundary).iter().map(corners));
        let after = self.measure.errors_below(&self.faces, u64::MAX, &mut self.errors);
        after as i64 - mesh.error_of(&self.star.triangles) as i64
    }

    /// By how much the error would change with a vertex at a position in the image, if by less than
    /// `limit`; `hint` is a slot near it. `None` too where another vertex is.
    pub(crate) fn insertion_change(
        &mut self,
        mesh: &MeasuredTriangulation,
        at: Point,
        hint: u32,
        limit: i64,
    ) -> Option<i64> {
        let slot = mesh.triangulation.locate(at, hint)?;
        if mesh.triangulation.corners(slot).contains(&at) {
            return None;
        }
        mesh.triangulation.cavity(at, slot, &mut self.cavity);
        let before = mesh.error_of(&self.cavity.triangles);
        self.faces.clear();
        self.faces.extend(mesh.triangulation.fan_around(at, &self.cavity));
        let most = limit.saturating_add_unsigned(before).max(0) as u64;
        let after = self.measure.errors_below(&self.faces, most, &mut self.errors);
        let change = after as i64 - before as i64;
        (change < limit).then_some(change)
    }
}

/// Evaluates something of each of some vertices or slots, on all threads, each of which has an
/// evaluator of its own.
///
/// # Errors
/// When the control cancels.
pub(crate) fn evaluate_all<M: FaceMeasure, T: Clone + Default + Send>(
    items: &[u32],
    new_evaluator: impl Fn() -> Evaluator<M> + Sync,
    evaluate: impl Fn(u32, &mut Evaluator<M>) -> T + Sync,
    control: &dyn Control,
) -> Result<Vec<T>, Cancelled> {
    let mut results = vec![T::default(); items.len()];
    let work = |(items, results): (&[u32], &mut [T]), control: &dyn Control| {
        control.poll(Stage::Refine, 0, 1)?;
        let mut evaluator = new_evaluator();
        for (&item, result) in items.iter().zip(results) {
            *result = evaluate(item, &mut evaluator);
        }
        Ok(())
    };
    let shares = items.chunks(CHANGES_PER_POLL).zip(results.chunks_mut(CHANGES_PER_POLL));
    share_out(shares, control, work)?;
    Ok(results)
}
