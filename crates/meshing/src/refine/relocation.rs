//! Relocation: each vertex in turn goes to the place nearby where the error is least.
//!
//! Coordinate descent on the places of the vertices. Moving a vertex is removal and insertion, so
//! the mesh stays the preferred-directions Delaunay triangulation of its points; every place is
//! scored by the true change of the error over the faces that change. A vertex is looked at again
//! only when the faces around it have changed since. Each move lowers the error, so the passes end.

use super::measured_mesh::{FaceMeasure, MeasuredMesh};
use crate::control::{Cancelled, Control, Stage};
use crate::mesh::Point;
use crate::tile_order::tile_order;

/// Looks at each vertex whose surroundings have changed, pass after pass.
#[derive(Clone)]
pub(crate) struct Relocation {
    /// Whether the surroundings of a vertex have changed since it was looked at.
    changed: Vec<bool>,
    /// The vertices tile by tile, as they were at first.
    order: Vec<u32>,
}

/// Where to look, relative to a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Window {
    /// The 8 lattice points around.
    Square3,
    /// The 24 lattice points around, two columns and rows away.
    Square5,
}

impl Window {
    /// Columns and rows to go, nearer places first.
    fn offsets(self) -> Vec<(i32, i32)> {
        let radius = match self {
            Self::Square3 => 1,
            Self::Square5 => 2,
        };
        let range = || -radius..=radius;
        let around = range().flat_map(|dy| range().map(move |dx| (dx, dy)));
        let squared = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
        let mut offsets: Vec<(i32, i32)> = around.filter(|&offset| offset != (0, 0)).collect();
        offsets.sort_by_key(|&offset| (squared(offset), offset.1, offset.0));
        offsets
    }
}

impl Relocation {
    /// Has every vertex looked at.
    pub(crate) fn new<M: FaceMeasure>(mesh: &MeasuredMesh<M>) -> Self {
        let points = &mesh.triangulation.points;
        let (width, height) = mesh.size();
        let (count, order) = (points.len(), tile_order(points, width, height));
        Self { changed: vec![true; count], order }
    }

    /// Has one more vertex, the next by number, looked at too.
    pub(crate) fn add(&mut self, vertex: u32) {
        self.changed.push(true);
        self.order.push(vertex);
    }

    /// Has every vertex looked at again, for another window.
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
        window: Window,
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let (offsets, mut looked_at) = (window.offsets(), 0);
        for i in 0..self.order.len() {
            let vertex = self.order[i];
            if std::mem::take(&mut self.changed[vertex as usize]) && mesh.is_movable(vertex) {
                control.poll(Stage::Refine, i, self.order.len())?;
                looked_at += 1;
                self.relocate(mesh, vertex, &offsets);
            }
        }
        Ok(looked_at)
    }

    /// Moves a vertex to the best place of the window around it, if one is better than its own.
    fn relocate<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        vertex: u32,
        offsets: &[(i32, i32)],
    ) {
        let from = mesh.triangulation.points[vertex as usize];
        let (change, slot) = mesh.remove(vertex);
        let (mut best, mut place) = (-change, from);
        for &(dx, dy) in offsets {
            let candidate = Point::new(from.x + dx, from.y + dy);
            if !mesh.is_vacant(candidate) {
                continue;
            }
            if let Some(change) = mesh.insertion_change(candidate, slot, best) {
                (best, place) = (change, candidate);
            }
        }
        mesh.insert(vertex, place, slot);
        if place != from {
            self.note(mesh.left());
            self.note(mesh.reached());
            self.changed[vertex as usize] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::image::Image;
    use crate::refine::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// The places after one look at each vertex, each candidate triangulated and measured afresh.
    fn relocated_by_brute_force(
        image: &Image,
        mut points: Vec<Point>,
        order: &[u32],
        window: Window,
    ) -> Vec<Point> {
        let measure = measure_of(image);
        let mesh = measured(&measure, image, points.clone());
        let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
        let (width, height) = (image.width() as i32, image.height() as i32);
        let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
        for &v in order.iter().filter(|&&v| mesh.is_movable(v)) {
            let from = points[v as usize];
            let mut best = (error(&points), from);
            for (dx, dy) in window.offsets() {
                let candidate = Point::new(from.x + dx, from.y + dy);
                if !inside(&candidate) || points.contains(&candidate) {
                    continue;
                }
                points[v as usize] = candidate;
                let error = error(&points);
                if error < best.0 {
                    best = (error, candidate);
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
            window in prop::sample::select(&[Window::Square3, Window::Square5][..]),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let mut relocation = Relocation::new(&mesh);
            let order = relocation.order.clone();
            relocation.pass(&mut mesh, window, &Unattended).unwrap();
            let expected = relocated_by_brute_force(&image, points, &order, window);
            prop_assert_eq!(&mesh.triangulation.points, &expected);
            let total = sum_of_errors(&image, &expected, &triangulate(&expected));
            prop_assert_eq!(mesh.total_error(), total);
        }
    }
}
