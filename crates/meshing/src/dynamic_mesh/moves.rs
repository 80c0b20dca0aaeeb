//! Tentative moves of one vertex.
//!
//! While positions are tried, the vertex is detached: a triangulation of its link fills its star. A
//! face of the fill is measured only where it would stay, and at most once. The vertex then commits
//! to the best position, where the errors of its faces are known already, or rolls back.

use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::measured::{Evaluator, FaceMeasure};
use crate::image::Point;

/// The error of a face of a fill that has not been measured.
const UNMEASURED: u64 = u64::MAX;

/// Which of the positions that lower the error a vertex moves to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Acceptance {
    /// The first one.
    First,
    /// The best one; of equally good ones the first.
    Best,
}

/// What came of an attempt to move a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Moved,
    /// No position is better.
    Stayed,
    /// The vertex stays because a position would change faces outside of its patch.
    LeavesPatch,
}

/// A position would change faces outside of the patch.
struct LeavesPatch;

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Selects a movable vertex to be moved; `false` when it is on the boundary of a patch, where it
    /// can't be moved.
    pub(crate) fn begin_move(&mut self, vertex: u32) -> bool {
        self.tentative.vertex = vertex;
        self.evaluator.gather_star(&self.measured.triangulation, vertex);
        !self.evaluator.star.touches_patch_boundary()
    }

    /// Ranks positions at some offsets from the selected vertex by the predicted change of the
    /// error: the `count` lowest, in ascending order, among those below `tolerance` times the error
    /// of its faces. `false` when there is no prediction.
    pub(crate) fn find_candidates(
        &mut self,
        offsets: &[(i32, i32)],
        count: usize,
        tolerance: f32,
        candidates: &mut Vec<(f32, Point)>,
    ) -> bool {
        candidates.clear();
        let Self { measured, evaluator, tentative, .. } = self;
        let Evaluator { measure, star, boundary, .. } = evaluator;
        let triangulation = &measured.triangulation;
        let unweighted = |&slot: &u32| {
            measure.unweighted_error(triangulation.corners(slot), measured.face_error(slot))
        };
        let error: u64 = star.triangles.iter().map(unweighted).sum();
        let Some(pixels) = measure.model_pixels() else { return false };
        let from = triangulation.points[tentative.vertex as usize];
        let Some(model) = pixels.model(from, boundary, star.outer.len()) else { return false };
        let mut limit = tolerance * error as f32;
        for &(dx, dy) in offsets {
            let to = Point::new(from.x + dx, from.y + dy);
            if !triangulation.holds(to) || boundary.contains(&to) {
                continue;
            }
            let change = pixels.predicted_change(&model, to);
            if change < limit {
                let rank = candidates.partition_point(|better| better.0 <= change);
                candidates.truncate(count - 1);
                candidates.insert(rank, (change, to));
                if candidates.len() == count {
                    limit = candidates[count - 1].0;
                }
            }
        }
        true
    }

    /// Moves the selected vertex to one of some positions if that lowers the error. Positions of
    /// other vertices and positions outside of the image are skipped.
    ///
    /// The neighbours before are then those of [`link`](Self::link), the new ones those of
    /// [`new_link`](Self::new_link).
    pub(crate) fn move_vertex(
        &mut self,
        positions: impl Iterator<Item = Point>,
        acceptance: Acceptance,
    ) -> Outcome {
        self.detach();
        let (mut limit, mut best) = (0, None);
        for position in positions {
            if !self.measured.triangulation.holds(position) {
                continue;
            }
            match self.change_at(position, limit) {
                Err(LeavesPatch) => {
                    self.roll_back();
                    return Outcome::LeavesPatch;
                }
                Ok(None) => continue,
                Ok(Some(change)) => (limit, best) = (change, Some(position)),
            }
            std::mem::swap(&mut self.evaluator.errors, &mut self.tentative.best_errors);
            std::mem::swap(&mut self.evaluator.cavity, &mut self.tentative.best_cavity);
            if acceptance == Acceptance::First {
                break;
            }
        }
        let Some(position) = best else {
            self.roll_back();
            return Outcome::Stayed;
        };
        self.commit(position);
        Outcome::Moved
    }

    /// Removes the selected vertex from the triangulation for a while.
    fn detach(&mut self) {
        let Self {
            measured, evaluator: Evaluator { star, boundary, filler, .. }, tentative, ..
        } = self;
        tentative.errors_before.clear();
        let errors = star.triangles.iter().map(|&slot| measured.face_error(slot));
        tentative.errors_before.extend(errors);
        tentative.error_before = tentative.errors_before.iter().sum();
        let fill = filler.fill(boundary);
        tentative.fill_count = fill.len();
        tentative.best_errors.clear();
        tentative.best_errors.resize(fill.len(), UNMEASURED);
        measured.remove(tentative.vertex, star, fill, &tentative.best_errors);
    }

    /// By how much the error will have changed when the detached vertex is inserted at a position,
    /// if by less than `limit`; `None` too where another vertex is.
    fn change_at(&mut self, at: Point, limit: i64) -> Result<Option<i64>, LeavesPatch> {
        let Self { measured, evaluator, tentative, .. } = self;
        let Evaluator { cavity, measure, star, faces, errors, .. } = evaluator;
        let triangulation = &measured.triangulation;
        let slot = triangulation.locate(at, star.triangles[0]).ok_or(LeavesPatch)?;
        if triangulation.corners(slot).contains(&at) {
            return Ok(None);
        }
        triangulation.cavity(at, slot, cavity);
        if cavity.touches_patch_boundary() {
            return Err(LeavesPatch);
        }
        let fill = &star.triangles[..tentative.fill_count];
        let kept = cavity.triangles.iter().filter(|slot| !fill.contains(slot));
        let replaced = kept.map(|&slot| measured.face_error(slot)).sum::<u64>();
        let before = tentative.error_before + replaced;
        faces.clear();
        faces.extend(triangulation.fan_around(at, cavity));
        let most = limit.saturating_add_unsigned(before).max(0) as u64;
        let mut change = measure.errors_below(faces, most, errors) as i64 - before as i64;
        if change >= limit {
            return Ok(None);
        }
        for &slot in fill.iter().filter(|slot| !cavity.triangles.contains(slot)) {
            if measured.face_error(slot) == UNMEASURED {
                let error = measure.error(measured.triangulation.corners(slot));
                measured.set_face_error(slot, error);
            }
            change += measured.face_error(slot) as i64;
        }
        Ok((change < limit).then_some(change))
    }

    /// Inserts the detached vertex at the best position.
    fn commit(&mut self, at: Point) {
        let Self { measured, evaluator, fan, tentative, .. } = self;
        std::mem::swap(&mut evaluator.cavity, &mut tentative.best_cavity);
        let errors = &tentative.best_errors;
        measured.insert(tentative.vertex, at, &evaluator.cavity, errors, fan);
    }

    /// Gives the detached vertex its old faces again.
    fn roll_back(&mut self) {
        let Self { measured, evaluator: Evaluator { star, .. }, fan, tentative, .. } = self;
        measured.triangulation.undo_removal(tentative.vertex, star, tentative.fill_count, fan);
        for (&slot, &error) in star.triangles.iter().zip(&tentative.errors_before) {
            measured.set_face_error(slot, error);
        }
    }
}
