//! Tentative moves of one vertex.
//!
//! While positions are tried, the vertex is detached: a triangulation of its link fills its star. A
//! face of the fill is measured only where it would stay, and at most once. The move is then
//! committed at the best position, where the errors of the faces are known, or rolled back.

use crate::control::{Cancelled, Poller};
use crate::dynamic_mesh::evaluator::{Evaluator, LeavesPatch};
use crate::dynamic_mesh::{MeasuredMesh, TentativeMove};
use crate::face_error::FaceMeasure;
use crate::image::Point;

const UNMEASURED: u64 = u64::MAX;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Acceptance {
    First,
    /// The best one; of equally good ones the first.
    Best,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Moved,
    Stayed,
    /// The vertex stays because a position would change faces outside of its patch.
    LeavesPatch,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Selects a movable vertex to be moved; `false` when its link is on the boundary of a patch.
    pub(crate) fn begin_move(&mut self, vertex: u32) -> bool {
        self.tentative.vertex = vertex;
        self.evaluator.gather_star(&self.triangulation, vertex);
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
        poller: &mut Poller<'_>,
    ) -> Result<bool, Cancelled> {
        candidates.clear();
        let Self { triangulation, evaluator, tentative, .. } = self;
        let Evaluator { measure, star, boundary, .. } = evaluator;
        let mut error = 0;
        for &slot in &star.triangles {
            let (corners, weighted) = (triangulation.corners(slot), triangulation.face_error(slot));
            error += measure.unweighted_error(corners, weighted, poller)?;
        }
        let Some(pixels) = measure.model_pixels() else { return Ok(false) };
        let from = triangulation.points[tentative.vertex as usize];
        let Some(model) = pixels.model(from, boundary, star.outer.len()) else { return Ok(false) };
        let mut limit = tolerance * error as f32;
        for &(dx, dy) in offsets {
            let to = Point::new(from.x + dx, from.y + dy);
            if !triangulation.holds(to) || boundary.contains(&to) {
                continue;
            }
            let change = model.predicted_change(to, pixels.samples_at(to));
            if change < limit {
                let rank = candidates.partition_point(|better| better.0 <= change);
                candidates.truncate(count - 1);
                candidates.insert(rank, (change, to));
                if candidates.len() == count {
                    limit = candidates[count - 1].0;
                }
            }
        }
        Ok(true)
    }

    /// Moves the selected vertex to one of some positions if that lowers the error. Skips positions
    /// of other vertices and those outside of the image. Detaches the vertex if it is cancelled.
    ///
    /// The neighbours before are then those of [`link`](Self::link), the new ones those of
    /// [`new_link`](Self::new_link).
    pub(crate) fn move_vertex(
        &mut self,
        positions: impl Iterator<Item = Point>,
        acceptance: Acceptance,
        poller: &mut Poller<'_>,
    ) -> Result<Outcome, Cancelled> {
        self.detach();
        let (mut limit, mut best) = (0, None);
        for position in positions {
            if !self.triangulation.holds(position) {
                continue;
            }
            match self.change_at(position, limit, poller)? {
                Err(LeavesPatch) => {
                    self.roll_back();
                    return Ok(Outcome::LeavesPatch);
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
            return Ok(Outcome::Stayed);
        };
        self.commit(position);
        Ok(Outcome::Moved)
    }

    fn detach(&mut self) {
        let Self { triangulation, evaluator, tentative, .. } = self;
        let Evaluator { star, boundary, filler, .. } = evaluator;
        tentative.errors_before.clear();
        let errors = star.triangles.iter().map(|&slot| triangulation.face_error(slot));
        tentative.errors_before.extend(errors);
        let fill = filler.fill(boundary);
        tentative.best_errors.clear();
        tentative.best_errors.resize(fill.len(), UNMEASURED);
        triangulation.remove(tentative.vertex, star, fill, &tentative.best_errors);
    }

    /// By how much the error will have changed when the detached vertex is inserted at a position,
    /// if by less than `limit`; `None` too where another vertex is.
    fn change_at(
        &mut self,
        at: Point,
        limit: i64,
        poller: &mut Poller<'_>,
    ) -> Result<Result<Option<i64>, LeavesPatch>, Cancelled> {
        let Self { triangulation, evaluator, tentative, .. } = self;
        let hint = evaluator.star.triangles[0];
        let detached = Some(tentative.errors_before.iter().sum());
        let mut change =
            match evaluator.fan_change(triangulation, at, hint, detached, limit, poller)? {
                Ok(Some(change)) => change,
                none => return Ok(none),
            };
        let Evaluator { measure, star, cavity, .. } = evaluator;
        for &slot in star.fill().iter().filter(|slot| !cavity.triangles.contains(slot)) {
            if triangulation.face_error(slot) == UNMEASURED {
                let error = measure.error(triangulation.corners(slot), poller)?;
                triangulation.set_face_error(slot, error);
            }
            change += triangulation.face_error(slot) as i64;
        }
        Ok(Ok((change < limit).then_some(change)))
    }

    fn commit(&mut self, at: Point) {
        let Self { triangulation, evaluator, fan, tentative } = self;
        std::mem::swap(&mut evaluator.cavity, &mut tentative.best_cavity);
        let errors = &tentative.best_errors;
        triangulation.insert(tentative.vertex, at, &evaluator.cavity, errors, fan);
    }

    fn roll_back(&mut self) {
        let Self { triangulation, evaluator: Evaluator { star, .. }, fan, tentative } = self;
        let TentativeMove { vertex, errors_before, .. } = tentative;
        let freed = star.triangles.len() - star.fill().len();
        triangulation.free.truncate(triangulation.free.len() - freed);
        let from = triangulation.points[*vertex as usize];
        triangulation.insert(*vertex, from, star, errors_before, fan);
    }
}
