//! A triangulation whose vertices move, enter and leave, with the error of each face and their sum.
//!
//! [`half_edges`] holds the triangulation and [`measured`] the errors of its faces; this module
//! changes both, and [`moves`] tries positions of one vertex. [`patches`] cuts a mesh into parts
//! that threads change on their own.

pub(crate) mod half_edges;
pub(crate) mod measured;
pub(crate) mod moves;
pub(crate) mod partition;
mod patches;

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Link};
use crate::dynamic_mesh::measured::{Evaluator, FaceMeasure, MeasuredTriangulation, evaluate_all};
use crate::image::Point;
use crate::triangulation::{NONE, Triangulation};
use std::num::NonZeroUsize;

/// A preferred-directions Delaunay triangulation of lattice points of an image, with the errors of
/// its faces and what measures them.
pub(crate) struct MeasuredMesh<M> {
    measured: MeasuredTriangulation,
    evaluator: Evaluator<M>,
    /// Slots of the faces of the last insertion.
    fan: Vec<u32>,
    tentative: TentativeMove,
}

/// The state of a move by [`moves`].
#[derive(Default)]
struct TentativeMove {
    vertex: u32,
    /// Errors of the faces that the vertex had, and their sum.
    errors_before: Vec<u64>,
    error_before: u64,
    /// Number of triangles of the fill, which have the first slots of the star.
    fill_count: usize,
    /// The cavity of the best position so far, and the errors of its fan.
    best_cavity: Link,
    best_errors: Vec<u64>,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Triangulates and measures points, given by row, then column, of an image of `width` columns
    /// and `height` rows, its corners among them. Polls report the beginning of `stage`.
    ///
    /// # Errors
    /// When the control cancels.
    pub(crate) fn new(
        points: Vec<Point>,
        (width, height): (usize, usize),
        measure: M,
        stage: Stage,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let control = BeginningOf { control, stage };
        let triangulation = Triangulation::new(points, &control)?;
        let triangulation = DynamicTriangulation::new(triangulation, width, height, &control)?;
        let slots: Vec<u32> = (0..triangulation.slot_count() as u32).collect();
        let new = || Evaluator::new(measure.another());
        let error = |slot, own: &mut Evaluator<M>| own.measure.error(triangulation.corners(slot));
        let errors = evaluate_all(&slots, new, error, &control)?;
        let measured = MeasuredTriangulation::new(triangulation, errors);
        Ok(Self::with_errors(measured, measure))
    }

    /// A mesh whose faces are measured already.
    fn with_errors(measured: MeasuredTriangulation, measure: M) -> Self {
        let evaluator = Evaluator::new(measure);
        Self { measured, evaluator, fan: Vec::new(), tentative: TentativeMove::default() }
    }

    /// The triangulation with its errors, to evaluate changes on several threads.
    pub(crate) fn measured(&self) -> &MeasuredTriangulation {
        &self.measured
    }

    /// The triangulation.
    pub(crate) fn triangulation(&self) -> &DynamicTriangulation {
        &self.measured.triangulation
    }

    /// Another evaluator of the same errors.
    pub(crate) fn another_evaluator(&self) -> Evaluator<M> {
        Evaluator::new(self.evaluator.measure.another())
    }

    /// Replaces the mesh by an earlier copy of its triangulation.
    pub(crate) fn restore(&mut self, measured: MeasuredTriangulation) {
        self.measured = measured;
    }

    /// The sum of the errors of all faces.
    pub(crate) fn total_error(&self) -> u64 {
        self.measured.total_error()
    }

    /// The error of a slot's face, 0 of a free slot.
    pub(crate) fn face_error(&self, slot: u32) -> u64 {
        self.measured.face_error(slot)
    }

    /// Number of vertices in the mesh.
    pub(crate) fn vertex_count(&self) -> usize {
        self.triangulation().outgoing.iter().filter(|&&h| h != NONE).count()
    }

    /// Whether a vertex may be moved or removed: it is in the mesh and no corner of the image.
    pub(crate) fn is_movable(&self, vertex: u32) -> bool {
        let triangulation = self.triangulation();
        triangulation.outgoing[vertex as usize] != NONE
            && !triangulation.is_corner(triangulation.points[vertex as usize])
    }

    /// Whether a model predicts the change of the error when a vertex moves.
    pub(crate) fn has_model(&self) -> bool {
        self.evaluator.measure.model_pixels().is_some()
    }

    /// By how much the error would change with a vertex at a vacant position, if by less than
    /// `limit`; `hint` is a slot near it. `None` too where another vertex is.
    pub(crate) fn insertion_change(&mut self, at: Point, hint: u32, limit: i64) -> Option<i64> {
        self.evaluator.insertion_change(&self.measured, at, hint, limit)
    }

    /// Removes a movable vertex, and returns by how much the error changed.
    ///
    /// Its neighbours were those that [`link`](Self::link) returns.
    pub(crate) fn remove(&mut self, vertex: u32) -> i64 {
        let change = self.evaluator.removal_change(&self.measured, vertex);
        let Evaluator { star, filler, errors, .. } = &mut self.evaluator;
        self.measured.remove(vertex, star, filler.triangles(), errors);
        change
    }

    /// Adds a vertex, unless there is one at this position already; `hint` is a slot near it.
    ///
    /// Its neighbours are those that [`new_link`](Self::new_link) returns.
    pub(crate) fn add_vertex(&mut self, at: Point, hint: u32) -> Option<u32> {
        self.evaluator.insertion_change(&self.measured, at, hint, i64::MAX)?;
        let vertex = self.measured.triangulation.add_vertex(at);
        let Evaluator { cavity, errors, .. } = &self.evaluator;
        self.measured.insert(vertex, at, cavity, errors, &mut self.fan);
        Some(vertex)
    }

    /// The neighbours that the last vertex removed or moved had before.
    pub(crate) fn link(&self) -> &[u32] {
        &self.evaluator.star.vertices
    }

    /// The neighbours of the last vertex inserted or moved.
    pub(crate) fn new_link(&self) -> &[u32] {
        &self.evaluator.cavity.vertices
    }

    /// The slots of the faces of the last insertion.
    pub(crate) fn fan(&self) -> &[u32] {
        &self.fan
    }
}

/// Reports everything as the beginning of one stage.
struct BeginningOf<'a> {
    control: &'a dyn Control,
    stage: Stage,
}

impl Control for BeginningOf<'_> {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        self.control.poll(self.stage, 0, 1)
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}
