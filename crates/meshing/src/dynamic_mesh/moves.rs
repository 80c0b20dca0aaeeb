//! Moves of one vertex, tried at several places.
//!
//! While a vertex is tried at places it is out of the triangulation. The triangles that fill its hole
//! are replaced again wherever it is put down nearby, so their errors are measured only where one of
//! them would stay; and wherever it ends up, the errors of its faces are known already. Where no place
//! is better, it gets its old faces back as they were.

use crate::dynamic_mesh::half_edges::Ring;
use crate::dynamic_mesh::probe::Probe;
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::image::Point;

/// The error of a triangle of a fill that has not been measured.
const UNMEASURED: u64 = u64::MAX;

/// Which of the places that lower the error a vertex takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Choice {
    /// The first one.
    First,
    /// The best one; of equal ones the first.
    Best,
}

/// Faces beyond the fence of a patch would change.
struct Fenced;

/// What came of a try to move a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moved {
    Yes,
    /// No place is better.
    No,
    /// It stays for now, because a place would change faces beyond the fence of a patch.
    Fenced,
}

/// What is remembered while a vertex is moved.
#[derive(Default)]
pub(crate) struct Trial {
    /// The vertex.
    vertex: u32,
    /// Errors of the faces that the vertex had, around it.
    before: Vec<u64>,
    /// Sum of these.
    error_before: u64,
    /// Triangles that fill its hole, which have the first slots of its star.
    fill_count: usize,
    /// Errors of the faces that it would have at the place tried last, and at the one chosen.
    tried: Vec<u64>,
    chosen: Vec<u64>,
    /// The ring of the place chosen.
    cavity: Ring,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Gathers the star of a movable vertex, which is then the one looked at; `false` when it lies at
    /// the fence of a patch, where the vertex can't be moved.
    pub(crate) fn look_at(&mut self, vertex: u32) -> bool {
        let Self { triangulation, probe: Probe { star, boundary, .. }, trial, .. } = self;
        trial.vertex = vertex;
        triangulation.star(vertex, star);
        boundary.clear();
        boundary.extend(star.vertices.iter().map(|&v| triangulation.points[v as usize]));
        !star.is_fenced()
    }

    /// Ranks the vacant positions at some offsets from the vertex by the predicted change of the
    /// error: the `count` lowest, in ascending order, among those below `tolerance` times the error
    /// of the faces around the vertex. `false` when there is no prediction.
    pub(crate) fn find_candidates(
        &mut self,
        offsets: &[(i32, i32)],
        count: usize,
        tolerance: f32,
        candidates: &mut Vec<(f32, Point)>,
    ) -> bool {
        candidates.clear();
        let Self { triangulation, probe: Probe { star, measure, .. }, face_errors, .. } = self;
        let error_of = |&slot: &u32| {
            measure.unweighted_error(triangulation.corners(slot), face_errors[slot as usize])
        };
        let error: u64 = star.triangles.iter().map(error_of).sum();
        let Some(pixels) = self.probe.measure.model_pixels() else { return false };
        let from = self.triangulation.points[self.trial.vertex as usize];
        let face_count = self.probe.star.beyond.len();
        let Some(model) = pixels.model(from, &self.probe.boundary, face_count) else {
            return false;
        };
        let mut limit = tolerance * error as f32;
        for &(dx, dy) in offsets {
            let to = Point::new(from.x + dx, from.y + dy);
            if !self.is_vacant(to) {
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

    /// Moves the vertex looked at to one of some places, where vacant, if that lowers the error.
    ///
    /// The vertices around it before are then those it has [`left`](Self::left), those around it now
    /// those it has [`reached`](Self::reached).
    pub(crate) fn move_vertex(
        &mut self,
        places: impl Iterator<Item = Point>,
        choice: Choice,
    ) -> Moved {
        let from = self.triangulation.points[self.trial.vertex as usize];
        self.lift();
        let (mut best, mut chosen) = (0, None);
        for candidate in places {
            if candidate == from || !self.is_vacant(candidate) {
                continue;
            }
            let Ok(change) = self.change_at(candidate, best) else {
                self.put_back();
                return Moved::Fenced;
            };
            let Some(change) = change else { continue };
            (best, chosen) = (change, Some(candidate));
            std::mem::swap(&mut self.trial.tried, &mut self.trial.chosen);
            std::mem::swap(&mut self.probe.cavity, &mut self.trial.cavity);
            if choice == Choice::First {
                break;
            }
        }
        let Some(place) = chosen else {
            self.put_back();
            return Moved::No;
        };
        self.put_down(place);
        self.total_error = self.total_error.wrapping_add_signed(best);
        Moved::Yes
    }

    /// Takes the vertex looked at out for a while; the sum of the errors stays what it was.
    fn lift(&mut self) {
        let Self { triangulation, probe, face_errors, trial, .. } = self;
        let Probe { star, boundary, filler, .. } = probe;
        trial.before.clear();
        trial.before.extend(star.triangles.iter().map(|&t| face_errors[t as usize]));
        trial.error_before = trial.before.iter().sum();
        trial.fill_count = filler.fill(boundary).len();
        triangulation.remove(trial.vertex, star, filler.triangles());
        for (i, &slot) in star.triangles.iter().enumerate() {
            face_errors[slot as usize] = if i < trial.fill_count { UNMEASURED } else { 0 };
        }
    }

    /// By how much the error will have changed when the vertex that is lifted is put down at a
    /// vacant place, if by less than `limit`.
    fn change_at(&mut self, place: Point, limit: i64) -> Result<Option<i64>, Fenced> {
        let Self { triangulation, probe, face_errors, trial, .. } = self;
        let Probe { cavity, measure, star, faces, .. } = probe;
        let slot = triangulation.locate_in_patch(place, star.triangles[0]).ok_or(Fenced)?;
        triangulation.cavity(place, slot, cavity);
        if cavity.is_fenced() {
            return Err(Fenced);
        }
        let fill = &star.triangles[..trial.fill_count];
        let (mut change, mut replaced) = (-(trial.error_before as i64), 0);
        for triangle in &cavity.triangles {
            if fill.contains(triangle) {
                replaced += 1;
            } else {
                change -= face_errors[*triangle as usize] as i64;
            }
        }
        faces.clear();
        faces.extend(triangulation.fan_around(place, cavity));
        let left = limit.saturating_sub(change).max(0) as u64;
        change += measure.errors_below(faces, left, &mut trial.tried) as i64;
        if change >= limit {
            return Ok(None);
        }
        if replaced < fill.len() {
            for &triangle in fill.iter().filter(|triangle| !cavity.triangles.contains(triangle)) {
                let error = &mut face_errors[triangle as usize];
                if *error == UNMEASURED {
                    *error = measure.error(triangulation.corners(triangle));
                }
                change += *error as i64;
            }
        }
        Ok((change < limit).then_some(change))
    }

    /// Puts the vertex that is lifted down at the place chosen.
    fn put_down(&mut self, place: Point) {
        let Self { triangulation, probe, fan, face_errors, trial, occupancy, .. } = self;
        let cavity = &mut probe.cavity;
        occupancy.leave(triangulation.points[trial.vertex as usize]);
        occupancy.take(place);
        std::mem::swap(cavity, &mut trial.cavity);
        triangulation.insert(trial.vertex, place, cavity, fan);
        face_errors.resize(triangulation.slot_count(), 0);
        for (&slot, &error) in fan.iter().zip(&trial.chosen) {
            face_errors[slot as usize] = error;
        }
    }

    /// Puts the vertex that is lifted back, where its faces are what they were.
    fn put_back(&mut self) {
        let Self { triangulation, probe, fan, face_errors, trial, .. } = self;
        let star = &probe.star;
        triangulation.put_back(trial.vertex, star, trial.fill_count, fan);
        for (&slot, &error) in star.triangles.iter().zip(&trial.before) {
            face_errors[slot as usize] = error;
        }
    }
}
