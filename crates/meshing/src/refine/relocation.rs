//! Relocation: each vertex in turn goes to the place nearby where the error is least.
//!
//! Coordinate descent on the places of the vertices. Moving a vertex is removal and insertion, so
//! the mesh stays the preferred-directions Delaunay triangulation of its points; every place is
//! scored by the true change of the error over the faces that change. A vertex is looked at again
//! only when the faces around it have changed since. Each move lowers the error, so the passes end.
//!
//! A thorough look tries every place of a window. A foresighted one tries the few that the
//! derivatives of the error promise most from, for a third of the time.

use super::measured_mesh::moves::Choice;
use super::measured_mesh::{FaceMeasure, MeasuredMesh};
use crate::control::{Cancelled, Control, Stage};
use crate::mesh::Point;
use crate::tile_order::tile_order;

/// Places that a foresighted look tries at most.
const PROMISING: usize = 3;

/// A place is tried when the error is foreseen to rise by less than this part of that of the faces
/// around: the forecast is rough where faces are of few points.
const DOUBT: f32 = 0.5;

/// Looks at each vertex whose surroundings have changed, pass after pass.
#[derive(Clone)]
pub(crate) struct Relocation {
    /// Whether the surroundings of a vertex have changed since it was looked at.
    changed: Vec<bool>,
    /// The vertices tile by tile, as they were at first.
    order: Vec<u32>,
    /// What a foresighted look has found.
    promising: Vec<(f32, Point)>,
}

/// How to look for a better place for a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// The first that is better of the most promising places up to two columns and rows away; where
    /// none can be foreseen, the best of the 8 lattice points around.
    Foresighted,
    /// The best of the 24 lattice points up to two columns and rows away.
    Thorough,
}

/// Columns and rows to go to the lattice points at most so many columns and rows away, nearer ones
/// first.
fn offsets(radius: i32) -> Vec<(i32, i32)> {
    let range = || -radius..=radius;
    let around = range().flat_map(|dy| range().map(move |dx| (dx, dy)));
    let squared = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
    let mut offsets: Vec<(i32, i32)> = around.filter(|&offset| offset != (0, 0)).collect();
    offsets.sort_by_key(|&offset| (squared(offset), offset.1, offset.0));
    offsets
}

impl Relocation {
    /// Has every vertex looked at.
    pub(crate) fn new<M: FaceMeasure>(mesh: &MeasuredMesh<M>) -> Self {
        let points = &mesh.triangulation.points;
        let (width, height) = mesh.size();
        let (count, order) = (points.len(), tile_order(points, width, height));
        Self { changed: vec![true; count], order, promising: Vec::new() }
    }

    /// Has one more vertex, the next by number, looked at too.
    pub(crate) fn add(&mut self, vertex: u32) {
        self.changed.push(true);
        self.order.push(vertex);
    }

    /// Has every vertex looked at again, for another kind of look.
    pub(crate) fn restart(&mut self) {
        self.changed.fill(true);
    }

    /// Notes that the surroundings of vertices have changed.
    pub(crate) fn note(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.changed[v as usize] = true;
        }
    }

    /// Looks once at each vertex whose surroundings have changed, and tells how many there were.
    pub(crate) fn pass<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let (near, window, mut looked_at) = (offsets(1), offsets(2), 0);
        for i in 0..self.order.len() {
            let vertex = self.order[i];
            if std::mem::take(&mut self.changed[vertex as usize]) && mesh.is_movable(vertex) {
                control.poll(Stage::Refine, i, self.order.len())?;
                looked_at += 1;
                let moved = match look {
                    Look::Foresighted => self.follow_forecast(mesh, vertex, &near, &window),
                    Look::Thorough => move_to_best(mesh, vertex, &window),
                };
                if moved {
                    self.note(mesh.left());
                    self.note(mesh.reached());
                    self.changed[vertex as usize] = true;
                }
            }
        }
        Ok(looked_at)
    }

    /// Moves a vertex to the first of the promising places that is better than its own.
    fn follow_forecast<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        vertex: u32,
        near: &[(i32, i32)],
        window: &[(i32, i32)],
    ) -> bool {
        if !mesh.find_promising(vertex, window, (PROMISING, DOUBT), &mut self.promising) {
            return move_to_best(mesh, vertex, near);
        }
        let places = self.promising.iter().map(|&(_, place)| place);
        !self.promising.is_empty() && mesh.move_vertex(vertex, places, Choice::First)
    }
}

/// Moves a vertex to the best place of those around it, if one is better than its own.
fn move_to_best<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    vertex: u32,
    offsets: &[(i32, i32)],
) -> bool {
    let from = mesh.triangulation.points[vertex as usize];
    let places = offsets.iter().map(|&(dx, dy)| Point::new(from.x + dx, from.y + dy));
    mesh.move_vertex(vertex, places, Choice::Best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::face_error::{FaceErrors, Measure};
    use crate::image::Image;
    use crate::refine::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// The places after one look at each vertex, each candidate triangulated and measured afresh.
    fn relocated_by_brute_force(
        image: &Image,
        mut points: Vec<Point>,
        order: &[u32],
        look: Look,
    ) -> Vec<Point> {
        let measure = measure_of(image);
        let mesh = measured(&measure, image, points.clone());
        let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
        let (width, height) = (image.width() as i32, image.height() as i32);
        let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
        for &v in order.iter().filter(|&&v| mesh.is_movable(v)) {
            let from = points[v as usize];
            let around = offsets(2).into_iter().map(|(x, y)| Point::new(from.x + x, from.y + y));
            let places: Vec<Point> = match look {
                Look::Thorough => around.filter(inside).collect(),
                Look::Foresighted => {
                    let mut mesh = measured(&measure, image, points.clone());
                    let mut promising = Vec::new();
                    let most = (PROMISING, DOUBT);
                    assert!(mesh.find_promising(v, &offsets(2), most, &mut promising));
                    promising.into_iter().map(|(_, place)| place).collect()
                }
            };
            let mut best = (error(&points), from);
            for candidate in places {
                if points.contains(&candidate) {
                    continue;
                }
                let mut moved = points.clone();
                moved[v as usize] = candidate;
                let error = error(&moved);
                if error < best.0 {
                    best = (error, candidate);
                    if look == Look::Foresighted {
                        break;
                    }
                }
            }
            points[v as usize] = best.1;
        }
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_pass_moves_vertices_as_trying_every_place_on_a_fresh_mesh_does(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
            look in prop::sample::select(&[Look::Foresighted, Look::Thorough][..]),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let mut relocation = Relocation::new(&mesh);
            let order = relocation.order.clone();
            relocation.pass(&mut mesh, look, &Unattended).unwrap();
            let expected = relocated_by_brute_force(&image, points, &order, look);
            prop_assert_eq!(&mesh.triangulation.points, &expected);
            let total = sum_of_errors(&image, &expected, &triangulate(&expected));
            prop_assert_eq!(mesh.total_error(), total);
            for slot in 0..mesh.triangulation.slot_count() as u32 {
                let used = mesh.triangulation.is_used(slot);
                let error = used.then(|| measured_error(&measure, mesh.triangulation.corners(slot)));
                prop_assert_eq!(mesh.face_error(slot), error.unwrap_or(0));
            }
        }

        #[test]
        fn the_promising_places_are_the_vacant_ones_of_least_forecast_in_order(
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 1..8),
        ) {
            let (image, points) = picture(9, 9, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let (mut all, mut few) = (Vec::new(), Vec::new());
            for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
                prop_assert!(mesh.find_promising(v, &offsets(2), (24, f32::MAX), &mut all));
                prop_assert!(mesh.find_promising(v, &offsets(2), (2, f32::MAX), &mut few));
                let from = points[v as usize];
                let near = |p: &Point| (p.x - from.x).abs() <= 2 && (p.y - from.y).abs() <= 2;
                let lattice = (0..9).flat_map(|y| (0..9).map(move |x| Point::new(x, y)));
                let vacant = lattice.filter(near).filter(|p| !points.contains(p)).count();
                // Where there is no error nothing can be gained, though rounding may foresee it.
                let slots = 0..mesh.triangulation.slot_count() as u32;
                let around = slots.filter(|&t| mesh.triangulation.corners(t).contains(&from));
                let is_perfect = around.map(|t| mesh.face_error(t)).sum::<u64>() == 0;
                if is_perfect {
                    prop_assert!(all.iter().all(|&(change, _)| change < 0.0));
                } else {
                    prop_assert_eq!(all.len(), vacant);
                }
                prop_assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
                prop_assert_eq!(&few[..], &all[..few.len()]);
            }
        }
    }

    /// The error of a face, measured afresh.
    fn measured_error(measure: &Measure<'_>, corners: [Point; 3]) -> u64 {
        FaceErrors::new(measure).error(corners)
    }
}
