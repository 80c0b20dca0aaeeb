//! Moves of vertices with their values, the faces around them staying.
//!
//! For a vertex at a place the interpolants of the faces around it are linear in its value, so
//! their squared error, but for rounding, is a parabola of it: one walk over the points of the faces gives
//! the best value and its error, for each component. The most promising place of a few is
//! then measured exactly, with the rounded value, and taken if the error falls.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::half_edges::Ring;
use crate::face_error::pixels_of_face::for_each_row;
use crate::image::Point;
use crate::refinement::unconstrained::valued_mesh::{ValuedMesh, squared_error};
use crate::triangulation::predicates::orientation;

/// What vertices may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Freedom {
    /// Whether the faces need not be Delaunay.
    pub(crate) connectivity: bool,
    /// Whether the values need not be the image's samples.
    pub(crate) values: bool,
}

/// The squared error of one component around a vertex as a parabola of its value `z`:
/// `constant - 2 linear z + square z^2`.
#[derive(Clone, Copy, Default)]
struct Parabola {
    constant: f64,
    linear: f64,
    square: f64,
}

impl Parabola {
    fn at(self, z: f64) -> f64 {
        self.constant - 2.0 * self.linear * z + self.square * z * z
    }

    /// The whole number from 0 to `largest` nearest to where it is least.
    fn best(self, largest: u16) -> u16 {
        // The vertex is a point of which it alone counts, so that the square is 1 at least.
        let best = self.linear / self.square;
        (best + 0.5).floor().clamp(0.0, largest.into()) as u16
    }
}

/// Moves vertices, each looked at when its surroundings have changed.
pub(crate) struct VertexMoves {
    freedom: Freedom,
    changed: Vec<bool>,
    ring: Ring,
    parabolas: Vec<Parabola>,
    /// Values for the place looked at.
    values: Vec<u16>,
    /// Values for the best place so far.
    best_values: Vec<u16>,
    errors: Vec<u64>,
}

/// The place itself and those around it.
const PLACES: [(i32, i32); 9] =
    [(0, 0), (0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

impl VertexMoves {
    pub(crate) fn new(vertex_count: usize, freedom: Freedom) -> Self {
        Self {
            freedom,
            changed: vec![true; vertex_count],
            ring: Ring::default(),
            parabolas: Vec::new(),
            values: Vec::new(),
            best_values: Vec::new(),
            errors: Vec::new(),
        }
    }

    /// Has every vertex looked at again.
    pub(crate) fn restart(&mut self) {
        self.changed.fill(true);
    }

    /// Looks once at each vertex whose surroundings have changed.
    pub(crate) fn pass(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let count = self.changed.len();
        for vertex in 0..count {
            if std::mem::take(&mut self.changed[vertex]) {
                control.poll(Stage::Refine, vertex, count)?;
                self.look_at(mesh, vertex as u32);
            }
        }
        Ok(())
    }

    /// Moves a vertex to the most promising place, with the most promising value, if the error
    /// falls.
    fn look_at(&mut self, mesh: &mut ValuedMesh<'_>, vertex: u32) {
        mesh.triangulation.star(vertex, &mut self.ring);
        let from = mesh.triangulation.points[vertex as usize];
        let mut best: Option<(f64, Point)> = None;
        for (dx, dy) in PLACES {
            let place = Point::new(from.x + dx, from.y + dy);
            if place == from || self.may_move(mesh, from, place) {
                let estimate = self.estimate(mesh, place);
                if best.is_none_or(|(least, _)| estimate < least) {
                    best = Some((estimate, place));
                    std::mem::swap(&mut self.values, &mut self.best_values);
                }
            }
        }
        let Some((_, place)) = best else { return };
        if place == from && self.best_values == mesh.values_of(vertex) {
            return;
        }
        self.take_if_better(mesh, vertex, place);
    }

    /// Tells whether a vertex may go from one place to another: faces stay counter-clockwise,
    /// the border and its corners stay where they are.
    fn may_move(&self, mesh: &ValuedMesh<'_>, from: Point, place: Point) -> bool {
        let triangulation = &mesh.triangulation;
        if !triangulation.holds(place) || triangulation.is_corner(from) {
            return false;
        }
        let at = |v: u32| triangulation.points[v as usize];
        if triangulation.is_on_border(from) {
            let [Some(first), Some(last)] = [self.ring.vertices.first(), self.ring.vertices.last()]
            else {
                return false;
            };
            if orientation(at(*first), at(*last), place) != 0 {
                return false;
            }
        }
        self.ring.edges().all(|(a, b)| orientation(at(a), at(b), place) > 0)
            && (self.freedom.connectivity || mesh.stays_delaunay(&self.ring, place))
    }

    /// Sets the values for a place, and estimates the squared error of the faces around it.
    fn estimate(&mut self, mesh: &ValuedMesh<'_>, place: Point) -> f64 {
        let count = mesh.image.component_count();
        self.parabolas.clear();
        self.parabolas.resize(count, Parabola::default());
        for (a, b) in self.ring.edges() {
            let corners = [a, b].map(|v| mesh.triangulation.points[v as usize]);
            let values = [a, b].map(|v| mesh.values_of(v));
            add_face(mesh, [corners[0], corners[1], place], values, &mut self.parabolas);
        }
        self.values.clear();
        let largest = mesh.image.max_sample();
        let mut sum = 0.0;
        for (c, parabola) in self.parabolas.iter().enumerate() {
            let value = if self.freedom.values {
                parabola.best(largest)
            } else {
                mesh.image.sample(c, place.x as usize, place.y as usize)
            };
            self.values.push(value);
            sum += parabola.at(value.into());
        }
        sum
    }

    /// Moves a vertex, whose star `ring` is, to a place with the best values if the error falls.
    fn take_if_better(&mut self, mesh: &mut ValuedMesh<'_>, vertex: u32, place: Point) {
        let slots = &self.ring.triangles;
        let before: u64 = slots.iter().map(|&slot| mesh.face_errors[slot as usize]).sum();
        self.errors.clear();
        let mut after = 0;
        for (a, b) in self.ring.edges() {
            let corners = [a, b].map(|v| mesh.triangulation.points[v as usize]);
            let [za, zb] = [a, b].map(|v| mesh.values_of(v));
            let error = squared_error(
                mesh.image,
                [corners[0], corners[1], place],
                [za, zb, &self.best_values],
            );
            self.errors.push(error);
            after += error;
            if after >= before {
                return;
            }
        }
        for (&slot, &error) in slots.iter().zip(&self.errors) {
            mesh.face_errors[slot as usize] = error;
        }
        mesh.total_error = mesh.total_error + after - before;
        mesh.triangulation.points[vertex as usize] = place;
        let count = self.best_values.len();
        mesh.values[vertex as usize * count..][..count].copy_from_slice(&self.best_values);
        for &v in &self.ring.vertices {
            self.changed[v as usize] = true;
        }
        self.changed[vertex as usize] = true;
    }
}

/// Adds the points of a face to the parabolas of its third vertex.
fn add_face(
    mesh: &ValuedMesh<'_>,
    corners: [Point; 3],
    [first, second]: [&[u16]; 2],
    parabolas: &mut [Parabola],
) {
    let [a, b, apex] = corners;
    let reciprocal = 1.0 / orientation(a, b, apex) as f64;
    let per_column = |from: Point, to: Point| f64::from(from.y - to.y) * reciprocal;
    let (weight_step, first_step) = (per_column(a, b), per_column(b, apex));
    let second_step = per_column(apex, a);
    for_each_row(corners, |y, left, end| {
        let start = Point::new(left, y);
        let weight = orientation(a, b, start) as f64 * reciprocal;
        let first_weight = orientation(b, apex, start) as f64 * reciprocal;
        let second_weight = orientation(apex, a, start) as f64 * reciprocal;
        for (c, parabola) in parabolas.iter_mut().enumerate() {
            let samples = &mesh.image.row(c, y as usize)[left as usize..end as usize];
            let (za, zb) = (f64::from(first[c]), f64::from(second[c]));
            let rest = za * first_weight + zb * second_weight;
            let rest_step = za * first_step + zb * second_step;
            for (i, &sample) in samples.iter().enumerate() {
                let i = i as f64;
                let (w, r) = (weight + weight_step * i, f64::from(sample) - (rest + rest_step * i));
                parabola.constant += r * r;
                parabola.linear += w * r;
                parabola.square += w * w;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Image, Shape, corner_points};
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::refinement::tests::picture;
    use crate::refinement::unconstrained::valued_mesh::tests::{error_of_rebuilt, faces_of};
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;

    /// The squared error, without rounding, of one component over the faces around a vertex whose
    /// place and value are given.
    fn unrounded_error(
        mesh: &ValuedMesh<'_>,
        around: &[(u32, u32)],
        place: Point,
        c: usize,
        z: f64,
    ) -> f64 {
        let mut sum = 0.0;
        for &(u, v) in around {
            let [a, b] = [u, v].map(|v| mesh.triangulation.points[v as usize]);
            let [za, zb] = [u, v].map(|v| f64::from(mesh.values_of(v)[c]));
            let area = orientation(a, b, place) as f64;
            for_each_row([a, b, place], |y, first, end| {
                for x in first..end {
                    let p = Point::new(x, y);
                    let weight = |from, to| orientation(from, to, p) as f64 / area;
                    let value = za * weight(b, place) + zb * weight(place, a) + z * weight(a, b);
                    let sample = f64::from(mesh.image.sample(c, x as usize, y as usize));
                    sum += (sample - value).powi(2);
                }
            });
        }
        sum
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn the_value_estimated_best_is_the_best_of_all_values_and_its_error_is_the_sum_over_points(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let mesh = ValuedMesh::new(&image, points.clone(), &triangulate(&points));
            let freedom = Freedom { connectivity: true, values: true };
            let mut moves = VertexMoves::new(points.len(), freedom);
            for vertex in 0..points.len() as u32 {
                mesh.triangulation.star(vertex, &mut moves.ring);
                let from = points[vertex as usize];
                for (dx, dy) in PLACES {
                    let place = Point::new(from.x + dx, from.y + dy);
                    if place != from && !moves.may_move(&mesh, from, place) {
                        continue;
                    }
                    let estimate = moves.estimate(&mesh, place);
                    let around: Vec<(u32, u32)> = moves.ring.edges().collect();
                    let error = |c: usize, z: u16| {
                        unrounded_error(&mesh, &around, place, c, z.into())
                    };
                    let at_best: f64 = (0..2).map(|c| error(c, moves.values[c])).sum();
                    prop_assert!((estimate - at_best).abs() < 1e-6 * (1.0 + at_best));
                    for c in 0..2 {
                        let best = error(c, moves.values[c]);
                        for z in 0..=image.max_sample() {
                            prop_assert!(best <= error(c, z) + 1e-6 * (1.0 + best));
                        }
                    }
                }
            }
        }

        #[test]
        fn passes_keep_account_of_the_rebuilt_picture_and_never_make_it_worse(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..64, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
            (connectivity, values) in (any::<bool>(), any::<bool>()),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let mut mesh = ValuedMesh::new(&image, points.clone(), &triangulate(&points));
            let mut moves = VertexMoves::new(points.len(), Freedom { connectivity, values });
            let mut last = mesh.total_error;
            for _ in 0..3 {
                let before = (mesh.triangulation.points.clone(), mesh.values.clone());
                moves.pass(&mut mesh, &()).unwrap();
                if mesh.total_error == last {
                    prop_assert_eq!((&mesh.triangulation.points, &mesh.values), (&before.0, &before.1));
                }
                let places = &mesh.triangulation.points;
                let error = error_of_rebuilt(&image, places, &mesh.values, &faces_of(&mesh));
                prop_assert_eq!(mesh.total_error, error);
                prop_assert!(error <= last);
                last = error;
            }
            let is_sample = |v: usize| {
                let Point { x, y } = mesh.triangulation.points[v];
                (0..2).all(|c| mesh.values_of(v as u32)[c] == image.sample(c, x as usize, y as usize))
            };
            prop_assert!(values || (0..points.len()).all(is_sample));
            if !connectivity {
                let (points, faces, _): (Vec<Point>, Vec<Face>, _) = mesh.triangulation.mesh();
                prop_assert_eq!(faces, triangulate(&points));
            }
        }
    }

    /// A picture of one component, and the mesh of its corners and other vertices, which may be
    /// anything.
    fn free_mesh(image: &Image, inner: &[(i32, i32)]) -> (Vec<Point>, Vec<Face>) {
        let corners = corner_points(image.width(), image.height());
        let inner = inner.iter().map(|&(x, y)| Point::new(x, y));
        let mut points: Vec<Point> = inner.chain(corners).collect();
        points.sort_unstable();
        let faces = triangulate(&points);
        (points, faces)
    }

    #[test]
    fn of_places_that_promise_as_much_the_first_is_taken() {
        let sample = |i| if i == 5 * 11 + 5 { 63 } else { 0 };
        let image =
            Image::from_bottom_up(11, 11, 8, vec![(0..11 * 11).map(sample).collect()]).unwrap();
        // Wherever the vertex goes from its odd point, that alone is wrong then.
        for (taken, expected) in [
            (&[][..], (5, 4)),
            (&[(5, 4)], (4, 5)),
            (&[(5, 4), (4, 5)], (6, 5)),
            (&[(5, 4), (4, 5), (6, 5)], (5, 6)),
        ] {
            let (points, faces) = free_mesh(&image, &[&[(5, 5)], taken].concat());
            let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap();
            let mut mesh = ValuedMesh::new(&image, points.clone(), &faces);
            let freedom = Freedom { connectivity: true, values: false };
            VertexMoves::new(points.len(), freedom).look_at(&mut mesh, vertex as u32);
            let place = mesh.triangulation.points[vertex];
            assert_eq!((place.x, place.y), expected);
            assert_eq!(mesh.total_error, 63 * 63);
        }
    }

    #[test]
    fn a_vertex_goes_where_the_value_is_what_it_was() {
        let sample = |i: usize| (i % 11).saturating_sub(5) as u16 * 10;
        let image =
            Image::from_bottom_up(11, 11, 8, vec![(0..11 * 11).map(sample).collect()]).unwrap();
        let (points, faces) = free_mesh(&image, &[(5, 0), (4, 5), (5, 10)]);
        let vertex = points.iter().position(|p| (p.x, p.y) == (4, 5)).unwrap();
        for values in [false, true] {
            let mut mesh = ValuedMesh::new(&image, points.clone(), &faces);
            assert!(mesh.total_error > 0);
            let freedom = Freedom { connectivity: true, values };
            VertexMoves::new(points.len(), freedom).look_at(&mut mesh, vertex as u32);
            assert_eq!(mesh.triangulation.points[vertex], Point::new(5, 5));
            assert_eq!((mesh.values[vertex], mesh.total_error), (0, 0));
        }
    }

    #[test]
    fn a_value_that_is_wrong_is_put_right_where_the_vertex_stays() {
        let (points, faces, image) = modelled();
        let right = ValuedMesh::new(&image, points.clone(), &faces);
        for vertex in 0..points.len() {
            let mut mesh = ValuedMesh::new(&image, points.clone(), &faces);
            mesh.values[2 * vertex + vertex % 2] += 2;
            mesh.measure();
            assert!(mesh.total_error > 0);
            let freedom = Freedom { connectivity: true, values: true };
            VertexMoves::new(points.len(), freedom).look_at(&mut mesh, vertex as u32);
            assert_eq!((&mesh.values, mesh.total_error), (&right.values, 0));
            assert_eq!(mesh.triangulation.points, points);
        }
    }

    /// A mesh with vertices inside and on each side, and the picture that it is of without error.
    fn modelled() -> (Vec<Point>, Vec<Face>, Image) {
        let side = 25;
        let mut points: Vec<Point> = [
            (0, 0),
            (11, 0),
            (24, 0),
            (0, 13),
            (12, 9),
            (24, 10),
            (7, 17),
            (17, 16),
            (0, 24),
            (13, 24),
            (24, 24),
        ]
        .map(|(x, y)| Point::new(x, y))
        .to_vec();
        points.sort_unstable();
        let faces = triangulate(&points);
        let values = (0..points.len() as u16).flat_map(|v| [v * 97 % 211, 250 - v * 61 % 239]);
        let shape = Shape { width: side, height: side, component_count: 2, precision: 8 };
        let mesh = Mesh::from_kernel(shape, points.clone(), values.collect(), faces.clone());
        let image = rasterize(&mesh, &()).unwrap();
        (points, faces, image)
    }

    #[test]
    fn a_vertex_beside_its_place_is_moved_there_and_others_stay() {
        let (points, faces, image) = modelled();
        let last = 24;
        let mut tried = [0; 2];
        for (vertex, &from) in points.iter().enumerate() {
            for (dx, dy) in PLACES {
                let beside = Point::new(from.x + dx, from.y + dy);
                let on_side = |from: i32, to: i32| from % last != 0 || from == to;
                let inside = (0..=last).contains(&beside.x) && (0..=last).contains(&beside.y);
                if !inside || !on_side(from.x, beside.x) || !on_side(from.y, beside.y) {
                    continue;
                }
                // The order of the points is free, and so the vertices keep their numbers.
                let mut moved = points.clone();
                moved[vertex] = beside;
                let mut sorted = moved.clone();
                sorted.sort_unstable();
                let is_delaunay = sorted == moved && triangulate(&moved) == faces;
                for connectivity in [true, false] {
                    if !connectivity && !is_delaunay {
                        continue;
                    }
                    for values in [true, false] {
                        let mut mesh = ValuedMesh::new(&image, moved.clone(), &faces);
                        let freedom = Freedom { connectivity, values };
                        let mut moves = VertexMoves::new(points.len(), freedom);
                        // All but this one are said to be as they were.
                        moves.changed.fill(false);
                        moves.pass(&mut mesh, &()).unwrap();
                        assert_eq!(mesh.triangulation.points, moved);
                        moves.changed[vertex] = true;
                        moves.pass(&mut mesh, &()).unwrap();
                        assert_eq!(mesh.triangulation.points, points, "{vertex} from {beside:?}");
                        assert_eq!(mesh.total_error, 0);
                        tried[usize::from(connectivity)] += 1;
                        // Its neighbours are looked at next, and nothing is left to gain.
                        assert_eq!(moves.changed.contains(&true), beside != from);
                        moves.restart();
                        assert!(moves.changed.iter().all(|&changed| changed));
                        moves.pass(&mut mesh, &()).unwrap();
                        assert_eq!(mesh.triangulation.points, points);
                        assert!(!moves.changed.contains(&true));
                    }
                }
            }
        }
        assert!(tried.iter().all(|&count| count > 50), "{tried:?}");
    }
}
