//! A triangulation whose vertices move, enter and leave, with the error of each face and their sum.
//!
//! [`half_edges`] holds the triangulation and the errors, an [`evaluator`] says what a change would
//! do to them, and this module makes changes. [`moves`] tries positions of one vertex; [`patches`]
//! divides a mesh into parts that threads change on their own.

pub(crate) mod evaluator;
pub(crate) mod half_edges;
pub(crate) mod moves;
pub(crate) mod patches;

use crate::control::{Cancelled, Control, Poller, Stage, Translated};
use crate::dynamic_mesh::evaluator::Evaluator;
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Link};
use crate::face_error::FaceMeasure;
use crate::image::Point;
use crate::parallel::share_out;
use crate::triangulation::{NONE, Triangulation};

/// Changes that a thread evaluates at a time: some 0.3 ms.
const CHANGES_PER_SHARE: usize = 64;

/// A preferred-directions Delaunay triangulation of lattice points of an image, with the errors of
/// its faces and what measures them.
pub(crate) struct MeasuredMesh<M> {
    pub(crate) triangulation: DynamicTriangulation,
    pub(crate) evaluator: Evaluator<M>,
    pub(crate) fan: Vec<u32>,
    tentative: TentativeMove,
}

#[derive(Default)]
struct TentativeMove {
    vertex: u32,
    /// Errors of the faces that the vertex had before it was detached.
    errors_before: Vec<u64>,
    /// The cavity of the best position so far, and the errors of its fan.
    best_cavity: Link,
    best_errors: Vec<u64>,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Triangulates and measures points, given by row, then column, of an image of `size` columns
    /// and rows, its corners among them. Polls report the beginning of `stage`.
    pub(crate) fn new(
        points: Vec<Point>,
        size: (usize, usize),
        measure: M,
        stage: Stage,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let control = Translated { control, translate: |_, _, _| (stage, 0, 1) };
        let triangulation = Triangulation::new(points, &control)?;
        let triangulation = DynamicTriangulation::new(triangulation, size, &control)?;
        let slots: Vec<u32> = (0..triangulation.slot_count() as u32).collect();
        let mut mesh = Self::of_parts(triangulation, measure);
        let errors = mesh.evaluate_all(
            &slots,
            |evaluator, mesh, slot, poller| evaluator.measure.error(mesh.corners(slot), poller),
            &control,
        )?;
        for (slot, error) in (0..).zip(errors) {
            mesh.triangulation.set_face_error(slot, error);
        }
        Ok(mesh)
    }

    fn of_parts(triangulation: DynamicTriangulation, measure: M) -> Self {
        let (evaluator, tentative) = (Evaluator::new(measure), TentativeMove::default());
        Self { triangulation, evaluator, fan: Vec::new(), tentative }
    }

    pub(crate) fn has_model(&self) -> bool {
        self.evaluator.measure.model_pixels().is_some()
    }

    /// Evaluates something of each of some vertices or slots, the same on any number of threads.
    pub(crate) fn evaluate_all<T: Clone + Default + Send, F>(
        &self,
        items: &[u32],
        evaluate: F,
        control: &dyn Control,
    ) -> Result<Vec<T>, Cancelled>
    where
        F: Fn(&mut Evaluator<M>, &DynamicTriangulation, u32, &mut Poller) -> Result<T, Cancelled>,
        F: Sync,
    {
        let mut results = vec![T::default(); items.len()];
        let work = |(items, results): (&[u32], &mut [T]), control: &dyn Control| {
            let mut evaluator = Evaluator::new(self.evaluator.measure.clone());
            let mut poller = Poller::new(control, Stage::Refine, 0, 1);
            for (&item, result) in items.iter().zip(results) {
                poller.poll()?;
                *result = evaluate(&mut evaluator, &self.triangulation, item, &mut poller)?;
            }
            Ok(())
        };
        let shares = items.chunks(CHANGES_PER_SHARE).zip(results.chunks_mut(CHANGES_PER_SHARE));
        share_out(shares, control, work)?;
        Ok(results)
    }

    /// Removes a movable vertex, and returns by how much the error changed. Its neighbours were
    /// those of [`link`](Self::link).
    pub(crate) fn remove(
        &mut self,
        vertex: u32,
        poller: &mut Poller<'_>,
    ) -> Result<i64, Cancelled> {
        let change = self.evaluator.removal_change(&self.triangulation, vertex, poller)?;
        let Evaluator { star, filler, errors, .. } = &mut self.evaluator;
        self.triangulation.remove(vertex, star, &filler.triangles, errors);
        Ok(change)
    }

    /// Adds a vertex, unless there is one at this position already; `hint` is a slot near it. Its
    /// neighbours are those of [`new_link`](Self::new_link).
    pub(crate) fn add_vertex(
        &mut self,
        at: Point,
        hint: u32,
        poller: &mut Poller<'_>,
    ) -> Result<Option<u32>, Cancelled> {
        let Self { triangulation, evaluator, .. } = self;
        if evaluator.insertion_change(triangulation, at, hint, i64::MAX, poller)?.is_none() {
            return Ok(None);
        }
        let vertex = self.triangulation.points.len() as u32;
        self.triangulation.points.push(at);
        self.triangulation.outgoing.push(NONE);
        let Evaluator { cavity, errors, .. } = &self.evaluator;
        self.triangulation.insert(vertex, at, cavity, errors, &mut self.fan);
        Ok(Some(vertex))
    }

    /// The neighbours that the last vertex removed or moved had before.
    pub(crate) fn link(&self) -> &[u32] {
        &self.evaluator.star.vertices
    }

    /// The neighbours of the last vertex inserted or moved.
    pub(crate) fn new_link(&self) -> &[u32] {
        &self.evaluator.cavity.vertices
    }
}
