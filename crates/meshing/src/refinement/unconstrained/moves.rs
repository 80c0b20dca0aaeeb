//! Moves of vertices with their values; the faces around them keep their vertices.
//!
//! The interpolants of the faces around a vertex are linear in its value, so their squared error,
//! but for rounding, is a parabola of it. One scan of the pixels of the faces gives the best value
//! and its error, for each component. Of the vertex's position and the 8 around it, the one of
//! least estimated error is measured with the rounded value, and taken if the error falls.

use crate::alpha::has_alpha;
use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::half_edges::Link;
use crate::face_error::scan_conversion::try_for_each_row;
use crate::image::Point;
use crate::refinement::relocation::window;
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use crate::triangulation::NONE;
use crate::triangulation::predicates::orientation;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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

    /// The whole number from 0 to `largest` nearest to the minimum, if there is one: where all
    /// weights are 0 there is none.
    fn best(self, largest: u16) -> Option<u16> {
        let best = self.linear / self.square;
        (self.square > 0.0).then(|| (best + 0.5).floor().clamp(0.0, largest.into()) as u16)
    }
}

#[derive(Default)]
pub(crate) struct VertexMoves {
    freedom: Freedom,
    /// Offsets of the positions tried, the vertex's own first.
    offsets: Vec<(i32, i32)>,
    pub(super) is_outdated: Vec<bool>,
    star: Link,
    parabolas: Vec<Parabola>,
    /// Values at the position estimated last, and at the best one so far.
    values: Vec<u16>,
    best_values: Vec<u16>,
    errors: Vec<u64>,
}

impl VertexMoves {
    pub(crate) fn new(vertex_count: usize, freedom: Freedom) -> Self {
        Self {
            freedom,
            offsets: [vec![(0, 0)], window(1)].concat(),
            is_outdated: vec![true; vertex_count],
            ..Self::default()
        }
    }

    /// Moves that change the values of vertices alone.
    pub(crate) fn of_values(vertex_count: usize, freedom: Freedom) -> Self {
        Self { offsets: vec![(0, 0)], ..Self::new(vertex_count, freedom) }
    }

    pub(crate) fn pass(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let count = self.is_outdated.len();
        let poller = &mut Poller::new(control, Stage::Refine, 0, count);
        for vertex in 0..count {
            let is_left = mesh.triangulation.outgoing[vertex] != NONE;
            if std::mem::take(&mut self.is_outdated[vertex]) && is_left {
                poller.done = vertex;
                poller.poll()?;
                self.visit(mesh, vertex as u32, poller)?;
            }
        }
        Ok(())
    }

    /// Moves a vertex to the position of least estimated error, with its values, if that helps.
    fn visit(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        vertex: u32,
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        mesh.triangulation.star(vertex, &mut self.star);
        let from = mesh.triangulation.points[vertex as usize];
        let mut best: Option<(f64, Point)> = None;
        for i in 0..self.offsets.len() {
            let (dx, dy) = self.offsets[i];
            let at = Point::new(from.x + dx, from.y + dy);
            if at == from || self.may_move(mesh, from, at) {
                let estimate = self.estimate(mesh, at, poller)?;
                if best.is_none_or(|(least, _)| estimate < least) {
                    best = Some((estimate, at));
                    std::mem::swap(&mut self.values, &mut self.best_values);
                }
            }
        }
        match best {
            Some((_, at)) if at != from || self.best_values != mesh.values_of(vertex) => {
                self.move_if_better(mesh, vertex, at, poller)
            }
            _ => Ok(()),
        }
    }

    /// Whether a vertex may move: its faces stay counter-clockwise, the border of the image and its
    /// corners keep their vertices.
    fn may_move(&self, mesh: &ValuedMesh<'_>, from: Point, at: Point) -> bool {
        let triangulation = &mesh.triangulation;
        if !triangulation.holds(at) || triangulation.is_corner(from) {
            return false;
        }
        let point = |v: u32| triangulation.points[v as usize];
        let neighbours = &self.star.vertices;
        if triangulation.is_on_border(from)
            && orientation(point(neighbours[0]), point(neighbours[neighbours.len() - 1]), at) != 0
        {
            return false;
        }
        self.star.edges().all(|(a, b)| orientation(point(a), point(b), at) > 0)
            && (self.freedom.connectivity || mesh.stays_delaunay(&self.star, at))
    }

    /// Sets the values at a position, and estimates the error of the vertex's faces.
    fn estimate(
        &mut self,
        mesh: &ValuedMesh<'_>,
        at: Point,
        poller: &mut Poller<'_>,
    ) -> Result<f64, Cancelled> {
        let image = mesh.image;
        self.parabolas.clear();
        self.parabolas.resize(image.component_count(), Parabola::default());
        for (a, b) in self.star.edges() {
            let [from, to] = [a, b].map(|v| mesh.triangulation.points[v as usize]);
            let values = [a, b].map(|v| mesh.values_of(v));
            add_face(mesh, [from, to, at], values, &mut self.parabolas, poller)?;
        }
        let value = |c: usize, largest| {
            let fitted = self.parabolas[c].best(largest).filter(|_| self.freedom.values);
            fitted.unwrap_or_else(|| image.sample(c, at.x as usize, at.y as usize))
        };
        let (last, largest) = (image.component_count() - 1, image.max_sample());
        // Premultiplied colours are at most the alpha.
        let most = if has_alpha(last + 1) { value(last, largest) } else { largest };
        self.values.clear();
        self.values.extend((0..=last).map(|c| value(c, if c < last { most } else { largest })));
        let mut sum = 0.0;
        for (parabola, &value) in self.parabolas.iter().zip(&self.values) {
            sum += parabola.at(value.into());
        }
        Ok(sum)
    }

    fn move_if_better(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        vertex: u32,
        at: Point,
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        let before = mesh.triangulation.error_of(&self.star.triangles);
        self.errors.clear();
        let mut after = 0;
        for (a, b) in self.star.edges() {
            let error = mesh.error_at([a, b], at, &self.best_values, poller)?;
            self.errors.push(error);
            after += error;
            if after >= before {
                return Ok(());
            }
        }
        for (&slot, &error) in self.star.triangles.iter().zip(&self.errors) {
            mesh.triangulation.set_face_error(slot, error);
        }
        mesh.triangulation.points[vertex as usize] = at;
        let count = self.best_values.len();
        mesh.values[vertex as usize * count..][..count].copy_from_slice(&self.best_values);
        for &v in self.star.vertices.iter().chain(&[vertex]) {
            self.is_outdated[v as usize] = true;
        }
        Ok(())
    }
}

/// Adds the pixels of a face to the parabolas of its third vertex.
fn add_face(
    mesh: &ValuedMesh<'_>,
    corners: [Point; 3],
    [first, second]: [&[u16]; 2],
    parabolas: &mut [Parabola],
    poller: &mut Poller<'_>,
) -> Result<(), Cancelled> {
    let [a, b, apex] = corners;
    let reciprocal = 1.0 / orientation(a, b, apex) as f64;
    // The weights of the third vertex, the first and the second, and their changes per column.
    let sides = [(a, b), (b, apex), (apex, a)];
    let steps = sides.map(|(from, to)| f64::from(from.y - to.y) * reciprocal);
    try_for_each_row(corners, |y, left, end| {
        poller.step((end - left) as usize)?;
        let start = Point::new(left, y);
        let weights = sides.map(|(from, to)| orientation(from, to, start) as f64 * reciprocal);
        let pixel_weights = mesh.weights_of_row(y, left, end);
        for (c, parabola) in parabolas.iter_mut().enumerate() {
            let samples = &mesh.image.row(c, y as usize)[left as usize..end as usize];
            let (za, zb) = (f64::from(first[c]), f64::from(second[c]));
            let rest = za * weights[1] + zb * weights[2];
            let rest_step = za * steps[1] + zb * steps[2];
            for (i, &sample) in samples.iter().enumerate() {
                let count = pixel_weights.map_or(1.0, |weights| f64::from(weights[i]));
                let i = i as f64;
                let (w, r) =
                    (weights[0] + steps[0] * i, f64::from(sample) - (rest + rest_step * i));
                parabola.constant += count * r * r;
                parabola.linear += count * w * r;
                parabola.square += count * w * w;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::face_error::scan_conversion::for_each_row;
    use crate::image::{Image, Shape, corner_points};
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::refinement::tests::picture;
    use crate::refinement::unconstrained::valued_mesh::tests::valued;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// The squared error, without rounding, of one component over the faces around a vertex at a
    /// position with a value.
    fn unrounded_error(
        mesh: &ValuedMesh<'_>,
        around: &[(u32, u32)],
        at: Point,
        c: usize,
        z: f64,
    ) -> f64 {
        let mut sum = 0.0;
        for &(u, v) in around {
            let [a, b] = [u, v].map(|v| mesh.triangulation.points[v as usize]);
            let [za, zb] = [u, v].map(|v| f64::from(mesh.values_of(v)[c]));
            let area = orientation(a, b, at) as f64;
            for_each_row([a, b, at], |y, first, end| {
                for x in first..end {
                    let p = Point::new(x, y);
                    let weight = |from, to| orientation(from, to, p) as f64 / area;
                    let value = za * weight(b, at) + zb * weight(at, a) + z * weight(a, b);
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
        fn estimates_are_the_least_sums_over_pixels(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let mesh = valued(&image, None, points.clone());
            let freedom = Freedom { connectivity: true, values: true };
            let mut moves = VertexMoves::new(points.len(), freedom);
            for vertex in 0..points.len() as u32 {
                mesh.triangulation.star(vertex, &mut moves.star);
                let from = points[vertex as usize];
                for (dx, dy) in moves.offsets.clone() {
                    let at = Point::new(from.x + dx, from.y + dy);
                    if at != from && !moves.may_move(&mesh, from, at) {
                        continue;
                    }
                    let estimate = moves.estimate(&mesh, at, &mut poller()).unwrap();
                    let around: Vec<(u32, u32)> = moves.star.edges().collect();
                    let error = |c: usize, z: u16| {
                        unrounded_error(&mesh, &around, at, c, z.into())
                    };
                    let at_best: f64 = (0..2).map(|c| error(c, moves.values[c])).sum();
                    prop_assert!((estimate - at_best).abs() < 1e-6 * (1.0 + at_best));
                    for c in 0..2 {
                        let best = error(c, moves.values[c]);
                        // A colour is at most its alpha.
                        let most = if c == 0 { moves.values[1] } else { image.max_sample() };
                        for z in 0..=most {
                            prop_assert!(best <= error(c, z) + 1e-6 * (1.0 + best));
                        }
                    }
                }
            }
        }

    }

    /// The corners of a picture and other points.
    fn points_with_corners(image: &Image, inner: &[(i32, i32)]) -> Vec<Point> {
        let corners = corner_points(image.width(), image.height());
        let inner = inner.iter().map(|&(x, y)| Point::new(x, y));
        let mut points: Vec<Point> = inner.chain(corners).collect();
        points.sort_unstable();
        points
    }

    #[test]
    fn ties_take_the_first_offset() {
        let sample = |i| if i == 5 * 11 + 5 { 63 } else { 0 };
        let image =
            Image::from_bottom_up(11, 11, 8, vec![(0..11 * 11).map(sample).collect()]).unwrap();
        // At every other position of the vertex the odd point alone has an error.
        for (taken, expected) in [
            (&[][..], (5, 4)),
            (&[(5, 4)], (4, 5)),
            (&[(5, 4), (4, 5)], (6, 5)),
            (&[(5, 4), (4, 5), (6, 5)], (5, 6)),
        ] {
            let points = points_with_corners(&image, &[&[(5, 5)], taken].concat());
            let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap();
            let mut mesh = valued(&image, None, points.clone());
            let freedom = Freedom { connectivity: true, values: false };
            let mut moves = VertexMoves::new(points.len(), freedom);
            moves.visit(&mut mesh, vertex as u32, &mut poller()).unwrap();
            let at = mesh.triangulation.points[vertex];
            assert_eq!((at.x, at.y), expected);
            assert_eq!(mesh.triangulation.total_error, 63 * 63);
        }
    }

    /// Points inside of a picture, on its sides and at its corners, and the picture that a mesh of
    /// them models without error.
    fn modelled() -> (Vec<Point>, Image) {
        let inner = [(11, 0), (0, 13), (12, 9), (24, 10), (7, 17), (17, 16), (13, 24)];
        let inner = inner.into_iter().map(|(x, y)| Point::new(x, y));
        let mut points: Vec<Point> = inner.chain(corner_points(25, 25)).collect();
        points.sort_unstable();
        let values = (0..points.len() as u16).flat_map(|v| {
            let alpha = 250 - v * 61 % 239;
            [alpha.min(v * 97 % 211), alpha]
        });
        let shape = Shape { width: 25, height: 25, component_count: 2, precision: 8 };
        let faces = triangulate(&points);
        let mesh = Mesh::from_kernel(shape, points.clone(), values.collect(), faces);
        (points, rasterize(&mesh, &()).unwrap())
    }

    #[test]
    fn a_displaced_vertex_returns() {
        let (points, image) = modelled();
        let plain = valued(&image, None, points.clone());
        for (vertex, &from) in points.iter().enumerate() {
            for (dx, dy) in window(1) {
                let to = Point::new(from.x + dx, from.y + dy);
                let is_along = |from: i32, to: i32| from % 24 != 0 || from == to;
                if !is_along(from.x, to.x) || !is_along(from.y, to.y) {
                    continue;
                }
                for values in [false, true] {
                    let mut mesh = valued(&image, None, points.clone());
                    mesh.triangulation.points[vertex] = to;
                    for c in 0..2 {
                        let sample = image.sample(c, to.x as usize, to.y as usize);
                        mesh.values[2 * vertex + c] = sample;
                    }
                    mesh.measure(Stage::Refine, &()).unwrap();
                    assert!(mesh.triangulation.total_error > 0);
                    let freedom = Freedom { connectivity: true, values };
                    let mut moves = VertexMoves::new(points.len(), freedom);
                    moves.is_outdated.fill(false);
                    moves.is_outdated[vertex] = true;
                    moves.pass(&mut mesh, &()).unwrap();
                    assert_eq!(mesh.triangulation.points, points, "{vertex} from {to:?}");
                    assert_eq!((&mesh.values, mesh.triangulation.total_error), (&plain.values, 0));
                    // The neighbours are visited in the next pass.
                    assert!(moves.is_outdated.contains(&true));
                }
            }
        }
    }
}
