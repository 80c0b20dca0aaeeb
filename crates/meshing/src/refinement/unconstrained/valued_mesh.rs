//! A mesh whose vertices have values of their own, and whose faces need not be Delaunay.

use crate::alpha::has_alpha;
use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Link};
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, Point};
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{Face, NONE, Triangulation, next, previous};

pub(crate) struct ValuedMesh<'a> {
    pub(crate) image: &'a Image,
    /// How often the squared error of each lattice point counts: once without weights.
    weights: Option<&'a [u8]>,
    pub(crate) errors: FaceErrors<'a>,
    pub(crate) triangulation: DynamicTriangulation,
    /// Component `c` of vertex `v` is at `v * components + c`.
    pub(crate) values: Vec<u16>,
}

impl<'a> ValuedMesh<'a> {
    /// The Delaunay mesh of points given by row, then column, with the samples of the image;
    /// `evaluator` has the squared errors with these weights.
    pub(crate) fn new(
        image: &'a Image,
        weights: Option<&'a [u8]>,
        evaluator: &'a ErrorEvaluator<'a>,
        points: Vec<Point>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let sample = |&Point { x, y }: &Point| {
            (0..image.component_count()).map(move |c| image.sample(c, x as usize, y as usize))
        };
        let values = points.iter().flat_map(sample).collect();
        let triangulation = Triangulation::new(points, control)?;
        let triangulation = DynamicTriangulation::new(triangulation, image.sides(), control)?;
        let errors = FaceErrors::new(evaluator);
        let mut mesh = Self { image, weights, errors, triangulation, values };
        mesh.measure(Stage::Refine, control)?;
        Ok(mesh)
    }

    pub(crate) fn measure(&mut self, stage: Stage, control: &dyn Control) -> Result<(), Cancelled> {
        let poller = &mut Poller::new(control, stage, 0, 1);
        for slot in 0..self.triangulation.slot_count() as u32 {
            poller.poll()?;
            if self.triangulation.is_used(slot) {
                let error = self.error_of(self.triangulation.vertices_of(slot), poller)?;
                self.triangulation.set_face_error(slot, error);
            }
        }
        Ok(())
    }

    /// Lowers premultiplied colours that exceed their alpha.
    pub(crate) fn limit_colors_to_alpha(&mut self) {
        let count = self.image.component_count();
        for values in self.values.chunks_exact_mut(count).filter(|_| has_alpha(count)) {
            if let [colors @ .., alpha] = values {
                colors.iter_mut().for_each(|color| *color = (*color).min(*alpha));
            }
        }
    }

    pub(crate) fn values_of(&self, vertex: u32) -> &[u16] {
        values_of(&self.values, self.image, vertex)
    }

    /// Whether three vertices turn counter-clockwise.
    pub(crate) fn is_face(&self, face: Face) -> bool {
        let [a, b, c] = face.map(|v| self.triangulation.points[v as usize]);
        orientation(a, b, c) > 0
    }

    pub(crate) fn error_of(
        &mut self,
        face: Face,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let corners = face.map(|v| self.triangulation.points[v as usize]);
        let values = face.map(|v| values_of(&self.values, self.image, v));
        self.errors.error_of_values(corners, values, poller)
    }

    pub(crate) fn error_at(
        &mut self,
        [a, b]: [u32; 2],
        at: Point,
        values: &[u16],
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let [from, to] = [a, b].map(|v| self.triangulation.points[v as usize]);
        let [first, second] = [a, b].map(|v| values_of(&self.values, self.image, v));
        self.errors.error_of_values([from, to, at], [first, second, values], poller)
    }

    /// Flips edges while that lowers the error; tries the edges around a flipped one again.
    pub(crate) fn flip_edges(&mut self, control: &dyn Control) -> Result<(), Cancelled> {
        let mut untried: Vec<u32> = (0..self.triangulation.twins.len() as u32).rev().collect();
        let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
        while let Some(h) = untried.pop() {
            poller.poll()?;
            let twin = self.triangulation.twins[h as usize];
            if twin != NONE
                && self.triangulation.is_used(h / 3)
                && self.flip_if_better(h, twin, poller)?
            {
                untried.extend([h, next(h), twin, next(twin)]);
            }
        }
        Ok(())
    }

    /// Flips the edge `h` with its twin if the quadrilateral is convex and the error falls.
    fn flip_if_better(
        &mut self,
        h: u32,
        twin: u32,
        poller: &mut Poller<'_>,
    ) -> Result<bool, Cancelled> {
        let triangulation = &self.triangulation;
        let [a, b, c, d] =
            [h, next(h), previous(h), previous(twin)].map(|h| triangulation.origins[h as usize]);
        let (first, second) = ([d, b, c], [c, a, d]);
        if !self.is_face(first) || !self.is_face(second) {
            return Ok(false);
        }
        let slots = [h / 3, twin / 3];
        let before = self.triangulation.error_of(&slots);
        let first_error = self.error_of(first, poller)?;
        if first_error >= before {
            return Ok(false);
        }
        let errors = [first_error, self.error_of(second, poller)?];
        if errors[0] + errors[1] >= before {
            return Ok(false);
        }
        self.triangulation.flip(h);
        for (slot, error) in slots.into_iter().zip(errors) {
            self.triangulation.set_face_error(slot, error);
        }
        Ok(true)
    }

    /// Whether the faces of a vertex, counter-clockwise with the vertex at `at`, are those of the
    /// preferred-directions Delaunay triangulation; `star` is its star.
    pub(crate) fn stays_delaunay(&self, star: &Link, at: Point) -> bool {
        let triangulation = &self.triangulation;
        let point = |v: u32| triangulation.points[v as usize];
        let is_delaunay = |((from, to), &outer): ((u32, u32), &u32)| {
            outer == NONE || {
                let apex = point(triangulation.origins[previous(outer) as usize]);
                !in_circle(point(from), point(to), at, apex)
            }
        };
        let count = star.vertices.len();
        let spokes = if star.is_closed() { 0..count } else { 1..count - 1 };
        star.edges().zip(&star.outer).all(is_delaunay)
            && spokes.into_iter().all(|i| {
                let [before, end, after] =
                    [i + count - 1, i, i + 1].map(|i| point(star.vertices[i % count]));
                !in_circle(before, end, at, after)
            })
    }

    pub(crate) fn weights_of_row(&self, y: i32, first: i32, end: i32) -> Option<&[u8]> {
        let row = y as usize * self.image.width();
        self.weights.map(|weights| &weights[row + first as usize..row + end as usize])
    }
}

fn values_of<'v>(values: &'v [u16], image: &Image, vertex: u32) -> &'v [u16] {
    let count = image.component_count();
    &values[vertex as usize * count..][..count]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::parameters::choices::ErrorMetric;
    use crate::quality::fidelity::Fidelity;
    use crate::refinement::tests::picture;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::HashMap;

    /// The mesh of points with the samples of an image; its evaluator is leaked.
    pub(in crate::refinement) fn valued<'a>(
        image: &'a Image,
        weights: Option<&'a [u8]>,
        points: Vec<Point>,
    ) -> ValuedMesh<'a> {
        let evaluator =
            ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, weights, &mut poller()).unwrap();
        let evaluator = Box::leak(Box::new(evaluator));
        ValuedMesh::new(image, weights, evaluator, points, &()).unwrap()
    }

    /// The squared error of a picture rebuilt from faces and values, sample by sample.
    pub(in crate::refinement) fn error_of_rebuilt(
        image: &Image,
        points: &[Point],
        values: &[u16],
        faces: &[Face],
    ) -> u64 {
        let (points, values) = (points.to_vec(), values.to_vec());
        let mesh = Mesh::from_kernel(image.shape(), points, values, faces.to_vec());
        let rebuilt = rasterize(&mesh, &()).unwrap();
        Fidelity::between(image, &rebuilt, &()).unwrap().squared_error
    }

    /// The faces, each by its vertices as the mesh numbers them.
    pub(in crate::refinement) fn faces_of(mesh: &ValuedMesh<'_>) -> Vec<Face> {
        let slots = 0..mesh.triangulation.slot_count() as u32;
        slots.map(|slot| mesh.triangulation.vertices_of(slot)).collect()
    }

    /// All faces with one edge flipped, for each edge between two faces whose quadrilateral is
    /// convex.
    fn flipped(points: &[Point], faces: &[Face]) -> Vec<Vec<Face>> {
        let corner = |face: Face, i: usize| face[i % 3];
        let sides: HashMap<(u32, u32), (usize, u32)> = (0..faces.len())
            .flat_map(|f| {
                (0..3).map(move |i| {
                    let face = faces[f];
                    ((corner(face, i), corner(face, i + 1)), (f, corner(face, i + 2)))
                })
            })
            .collect();
        let is_face = |face: Face| {
            let [a, b, c] = face.map(|v| points[v as usize]);
            orientation(a, b, c) > 0
        };
        let mut all = Vec::new();
        for (&(a, b), &(f, c)) in &sides {
            let Some(&(g, d)) = sides.get(&(b, a)) else { continue };
            let (first, second) = ([d, b, c], [c, a, d]);
            if f < g && is_face(first) && is_face(second) {
                let mut faces = faces.to_vec();
                (faces[f], faces[g]) = (first, second);
                all.push(faces);
            }
        }
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn no_flip_left_lowers_the_error(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..10),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let faces = triangulate(&points);
            let mut mesh = valued(&image, None, points.clone());
            let error = |mesh: &ValuedMesh<'_>, faces: &[Face]| {
                error_of_rebuilt(&image, &points, &mesh.values, faces)
            };
            prop_assert_eq!(mesh.triangulation.total_error, error(&mesh, &faces));
            mesh.flip_edges(&()).unwrap();
            let after = faces_of(&mesh);
            prop_assert_eq!(mesh.triangulation.total_error, error(&mesh, &after));
            prop_assert!(mesh.triangulation.total_error <= error(&mesh, &faces));
            prop_assert_eq!(after.len(), faces.len());
            for other in flipped(&points, &after) {
                prop_assert!(error(&mesh, &other) >= mesh.triangulation.total_error);
            }
        }
    }
}
