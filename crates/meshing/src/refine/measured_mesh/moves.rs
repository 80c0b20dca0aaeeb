//! Moves of one vertex, tried at several places.
//!
//! While a vertex is tried at places it is out of the triangulation. The triangles that fill its hole
//! are replaced again wherever it is put down nearby, so their errors are measured only where one of
//! them would stay; and wherever it ends up, the errors of its faces are known already.

use super::{FaceMeasure, MeasuredMesh};
use crate::mesh::Point;

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

/// What is remembered while a vertex is moved.
#[derive(Default)]
pub(crate) struct Trial {
    /// Errors of the faces that the vertex had, around it.
    before: Vec<u64>,
    /// Sum of these.
    error_before: u64,
    /// Triangles that fill its hole, which have the first slots of its star.
    fill_count: usize,
    /// Errors of the faces that it would have at the place tried last, and at the one chosen.
    tried: Vec<u64>,
    chosen: Vec<u64>,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Finds the places around a movable vertex that promise most, at most `count`, the best first,
    /// among those where the error is foreseen to rise by less than `doubt` times that of the faces
    /// around the vertex; `false` when nothing can be foreseen.
    pub(crate) fn find_promising(
        &mut self,
        vertex: u32,
        offsets: &[(i32, i32)],
        (count, doubt): (usize, f32),
        promising: &mut Vec<(f32, Point)>,
    ) -> bool {
        promising.clear();
        self.look_around(vertex);
        let Some(pixels) = self.measure.pixels() else { return false };
        let from = self.triangulation.points[vertex as usize];
        let face_count = self.star.beyond.len();
        let Some(forecast) = pixels.forecast(from, &self.boundary, face_count) else {
            return false;
        };
        let around: u64 = if self.measure.is_weighted() {
            // Forecasts know no weights, so that equal ones change nothing.
            let faces = self.star.triangles.iter().map(|&t| self.triangulation.corners(t));
            self.trial.tried.clear();
            pixels.squared_errors(&faces.collect::<Vec<_>>(), &mut self.trial.tried);
            self.trial.tried.iter().sum()
        } else {
            self.star.triangles.iter().map(|&t| self.face_errors[t as usize]).sum()
        };
        let limit = doubt * around as f32;
        for &(dx, dy) in offsets {
            let place = Point::new(from.x + dx, from.y + dy);
            if !self.is_vacant(place) {
                continue;
            }
            let change = pixels.foreseen(&forecast, from, place);
            let rank = promising.partition_point(|better| better.0 <= change);
            if change < limit && rank < count {
                promising.truncate(count - 1);
                promising.insert(rank, (change, place));
            }
        }
        true
    }

    /// Moves a movable vertex to one of some places, where vacant, if that lowers the error; tells
    /// whether it moved.
    ///
    /// The vertices around it before are then those it has [`left`](Self::left), those around it now
    /// those it has [`reached`](Self::reached).
    pub(crate) fn move_vertex(
        &mut self,
        vertex: u32,
        places: impl Iterator<Item = Point>,
        choice: Choice,
    ) -> bool {
        let from = self.triangulation.points[vertex as usize];
        self.lift(vertex);
        let (mut best, mut place) = (0, from);
        for candidate in places {
            if candidate == from || !self.is_vacant(candidate) {
                continue;
            }
            let Some(change) = self.change_at(candidate, best) else { continue };
            (best, place) = (change, candidate);
            std::mem::swap(&mut self.trial.tried, &mut self.trial.chosen);
            if choice == Choice::First {
                break;
            }
        }
        self.put_down(vertex, place, place != from);
        self.total_error = self.total_error.wrapping_add_signed(best);
        place != from
    }

    /// Gathers the star of a vertex and the places around it.
    fn look_around(&mut self, vertex: u32) {
        let Self { triangulation, star, boundary, .. } = self;
        triangulation.star(vertex, star);
        boundary.clear();
        boundary.extend(star.vertices.iter().map(|&v| triangulation.points[v as usize]));
    }

    /// Takes a vertex out for a while; the sum of the errors stays what it was.
    fn lift(&mut self, vertex: u32) {
        self.look_around(vertex);
        let place = self.place_of(vertex);
        let Self { triangulation, star, boundary, filler, face_errors, trial, .. } = self;
        trial.before.clear();
        trial.before.extend(star.triangles.iter().map(|&t| face_errors[t as usize]));
        trial.error_before = trial.before.iter().sum();
        trial.fill_count = filler.fill(boundary).len();
        triangulation.remove(vertex, star, filler.triangles());
        for (i, &slot) in star.triangles.iter().enumerate() {
            face_errors[slot as usize] = if i < trial.fill_count { UNMEASURED } else { 0 };
        }
        self.occupied[place] = false;
    }

    /// By how much the error will have changed when the vertex that is lifted is put down at a
    /// vacant place, if by less than `limit`.
    fn change_at(&mut self, place: Point, limit: i64) -> Option<i64> {
        let Self { triangulation, cavity, measure, star, face_errors, trial, .. } = self;
        let slot = triangulation.locate(place, star.triangles[0]);
        triangulation.cavity(place, slot, cavity);
        let fill = &star.triangles[..trial.fill_count];
        let (mut change, mut replaced) = (-(trial.error_before as i64), 0);
        for triangle in &cavity.triangles {
            if fill.contains(triangle) {
                replaced += 1;
            } else {
                change -= face_errors[*triangle as usize] as i64;
            }
        }
        trial.tried.clear();
        for (from, to) in cavity.edges() {
            let ends = [from, to].map(|v| triangulation.points[v as usize]);
            let error = measure.error([ends[0], ends[1], place]);
            trial.tried.push(error);
            change += error as i64;
            if change >= limit {
                return None;
            }
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
        (change < limit).then_some(change)
    }

    /// Puts the vertex that is lifted down, at its old place or at the one chosen.
    fn put_down(&mut self, vertex: u32, place: Point, is_chosen: bool) {
        let Self { triangulation, star, cavity, fan, face_errors, trial, .. } = self;
        let slot = triangulation.locate(place, star.triangles[0]);
        triangulation.cavity(place, slot, cavity);
        triangulation.insert(vertex, place, cavity, fan);
        face_errors.resize(triangulation.slot_count(), 0);
        if !is_chosen {
            // The ring is the old one, but may begin elsewhere.
            let first = star.vertices.iter().position(|v| *v == cavity.vertices[0]);
            trial.before.rotate_left(first.unwrap_or_default());
        }
        let errors = if is_chosen { &trial.chosen } else { &trial.before };
        for (&slot, &error) in fan.iter().zip(errors) {
            face_errors[slot as usize] = error;
        }
        let place = self.place_of(vertex);
        self.occupied[place] = true;
    }
}
