//! A mesh whose vertices carry values of their own, and whose faces need not be Delaunay.

use crate::dynamic_mesh::half_edges::{DynamicTriangulation, Ring};
use crate::face_error::interpolant::Interpolant;
use crate::face_error::pixels_of_face::for_each_row;
use crate::image::{Image, Point};
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{Face, NONE, next, previous};

/// A triangulation with values at its vertices and the squared errors of its faces.
pub(crate) struct ValuedMesh<'a> {
    pub(crate) image: &'a Image,
    pub(crate) triangulation: DynamicTriangulation,
    /// Vertex by vertex: component `c` of vertex `v` is at `v * components + c`.
    pub(crate) values: Vec<u16>,
    /// Squared error of each slot's triangle.
    pub(crate) face_errors: Vec<u64>,
    /// Sum of the above.
    pub(crate) total_error: u64,
}

impl<'a> ValuedMesh<'a> {
    /// The mesh of these points and faces, which carry the samples of `image`.
    pub(crate) fn new(image: &'a Image, points: Vec<Point>, faces: &[Face]) -> Self {
        let sample = |&Point { x, y }: &Point| {
            (0..image.component_count()).map(move |c| image.sample(c, x as usize, y as usize))
        };
        let values = points.iter().flat_map(sample).collect();
        let triangulation = DynamicTriangulation::new(points, faces, image.width(), image.height());
        let mut mesh =
            Self { image, triangulation, values, face_errors: Vec::new(), total_error: 0 };
        mesh.measure();
        mesh
    }

    /// Measures every face.
    pub(crate) fn measure(&mut self) {
        let slots = 0..self.triangulation.slot_count() as u32;
        self.face_errors =
            slots.map(|slot| self.error_of(self.triangulation.vertices_of(slot))).collect();
        self.total_error = self.face_errors.iter().sum();
    }

    /// The values of a vertex.
    pub(crate) fn values_of(&self, vertex: u32) -> &[u16] {
        let count = self.image.component_count();
        &self.values[vertex as usize * count..][..count]
    }

    /// The squared error of the face of three vertices.
    pub(crate) fn error_of(&self, face: Face) -> u64 {
        let corners = face.map(|v| self.triangulation.points[v as usize]);
        squared_error(self.image, corners, face.map(|v| self.values_of(v)))
    }

    /// Flips edges while that lowers the error, those around a flipped one again.
    pub(crate) fn flip_edges(&mut self) {
        let mut suspects: Vec<u32> = (0..self.triangulation.twins.len() as u32).rev().collect();
        while let Some(h) = suspects.pop() {
            let twin = self.triangulation.twins[h as usize];
            if twin == NONE || !self.flip_if_better(h, twin) {
                continue;
            }
            suspects.extend([h, next(h), twin, next(twin)]);
        }
    }

    /// Flips the edge `h` with its twin if the quadrilateral is convex and the error falls.
    fn flip_if_better(&mut self, h: u32, twin: u32) -> bool {
        let [a, b, c, d] = [h, next(h), previous(h), previous(twin)]
            .map(|h| self.triangulation.origins[h as usize]);
        let place = |v: u32| self.triangulation.points[v as usize];
        let is_face = |[a, b, c]: Face| orientation(place(a), place(b), place(c)) > 0;
        let (first, second) = ([d, b, c], [c, a, d]);
        if !is_face(first) || !is_face(second) {
            return false;
        }
        let slots = [h / 3, twin / 3];
        let before: u64 = slots.iter().map(|&slot| self.face_errors[slot as usize]).sum();
        let after_first = self.error_of(first);
        if after_first >= before {
            return false;
        }
        let after = [after_first, self.error_of(second)];
        if after[0] + after[1] >= before {
            return false;
        }
        self.triangulation.flip(h);
        for (slot, error) in slots.into_iter().zip(after) {
            self.face_errors[slot as usize] = error;
        }
        self.total_error = self.total_error + after[0] + after[1] - before;
        true
    }

    /// Tells whether the faces around a vertex stay those of the preferred-directions Delaunay
    /// triangulation when it goes to `place`, where they turn counter-clockwise; `ring` is its star.
    pub(crate) fn stays_delaunay(&self, ring: &Ring, place: Point) -> bool {
        let at = |v: u32| self.triangulation.points[v as usize];
        let outside = |(from, to): (u32, u32), beyond: u32| {
            beyond == NONE || {
                let apex = at(self.triangulation.origins[previous(beyond) as usize]);
                !in_circle(at(from), at(to), place, apex)
            }
        };
        let closed = ring.vertices.len() == ring.beyond.len();
        let count = ring.vertices.len();
        let spokes = if closed { 0..count } else { 1..count - 1 };
        ring.edges().zip(&ring.beyond).all(|(edge, &beyond)| outside(edge, beyond))
            && spokes.into_iter().all(|i| {
                let [before, spoke, after] =
                    [i + count - 1, i, i + 1].map(|i| at(ring.vertices[i % count]));
                !in_circle(before, spoke, place, after)
            })
    }
}

/// The squared error of a face with any values at its vertices.
pub(crate) fn squared_error(image: &Image, corners: [Point; 3], values: [&[u16]; 3]) -> u64 {
    let mut sum = 0;
    for (c, samples) in image.components().iter().enumerate() {
        let interpolant = Interpolant::new(corners, values.map(|values| values[c]));
        for_each_row(corners, |y, first, end| {
            let row = y as usize * image.width();
            let samples = &samples[row + first as usize..row + end as usize];
            sum += interpolant.squared_error(first, y, samples);
        });
    }
    sum
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::quality::fidelity::Fidelity;
    use crate::refinement::tests::picture;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::HashMap;

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
        Fidelity::between(image, &rebuilt).unwrap().squared_error
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
        fn edges_are_flipped_until_no_flip_of_one_lowers_the_error_of_the_rebuilt_picture(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..10),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let faces = triangulate(&points);
            let mut mesh = ValuedMesh::new(&image, points.clone(), &faces);
            let error = |mesh: &ValuedMesh<'_>, faces: &[Face]| {
                error_of_rebuilt(&image, &points, &mesh.values, faces)
            };
            prop_assert_eq!(mesh.total_error, error(&mesh, &faces));
            mesh.flip_edges();
            let after = faces_of(&mesh);
            prop_assert_eq!(mesh.total_error, error(&mesh, &after));
            prop_assert!(mesh.total_error <= error(&mesh, &faces));
            prop_assert_eq!(after.len(), faces.len());
            for other in flipped(&points, &after) {
                prop_assert!(error(&mesh, &other) >= mesh.total_error);
            }
        }
    }
}
