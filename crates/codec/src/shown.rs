//! What a file shows of a mesh: its straight colours, with or without the faces that show nothing.

use pixmesh_meshing::{Face, Mesh, Point, Shape};
use std::borrow::Cow;

/// No vertex yet.
const NONE: u32 = u32::MAX;

/// The vertices and faces that a file shows.
#[derive(Clone, Debug)]
pub(crate) struct Shown<'a> {
    shape: Shape,
    points: Cow<'a, [Point]>,
    samples: Cow<'a, [u16]>,
    faces: Cow<'a, [Face]>,
    face_samples: Option<Cow<'a, [u16]>>,
    /// Whether the faces cover the picture's rectangle.
    pub(crate) is_whole: bool,
}

impl<'a> Shown<'a> {
    /// A mesh, without the faces that show nothing and the vertices of none of the others if `cut`.
    /// All of a mesh that shows nothing at all is kept. With `has_holes` the faces that have a corner of
    /// alpha 0 belong to holes, and are left out.
    pub(crate) fn new(mesh: &'a Mesh, cut: bool, has_holes: bool) -> Self {
        let whole = Self {
            shape: mesh.shape(),
            points: mesh.points().into(),
            samples: mesh.straight_samples(),
            faces: mesh.faces().into(),
            face_samples: mesh.straight_face_samples(),
            is_whole: true,
        };
        let count = mesh.faces().len();
        let is_hole = |face: &usize| {
            let alpha = |&v: &u32| mesh.vertex_samples(v as usize).last();
            has_holes && mesh.faces()[*face].iter().any(|v| alpha(v) == Some(&0))
        };
        let is_shown = |face: &usize| !is_hole(face) && (!cut || mesh.is_seen(*face));
        let seen: Vec<usize> = (0..count).filter(is_shown).collect();
        let leaves_out = !seen.is_empty() && seen.len() < count;
        if leaves_out {
            Self { is_whole: false, ..whole.with_faces(&seen, |face| face) }
        } else {
            whole
        }
    }

    /// The faces of these indices in this order, each changed by `turn`, and their vertices in the
    /// order in which they name them first.
    pub(crate) fn with_faces(&self, order: &[usize], mut turn: impl FnMut(Face) -> Face) -> Self {
        let mut places = vec![NONE; self.points.len()];
        let mut vertices = Vec::new();
        let mut place_of = |vertex: u32| {
            let place = &mut places[vertex as usize];
            if *place == NONE {
                *place = vertices.len() as u32;
                vertices.push(vertex as usize);
            }
            *place
        };
        let faces = order.iter().map(|&face| turn(self.faces[face]).map(&mut place_of)).collect();
        let count = self.shape.component_count;
        let samples = vertices.iter().flat_map(|&v| self.vertex_samples(v)).copied().collect();
        let face_samples = self.face_samples.as_ref().map(|samples| {
            order.iter().flat_map(|&face| &samples[face * count..][..count]).copied().collect()
        });
        Self {
            shape: self.shape,
            points: vertices.iter().map(|&vertex| self.points[vertex]).collect(),
            samples: Cow::Owned(samples),
            faces: Cow::Owned(faces),
            face_samples: face_samples.map(Cow::Owned),
            is_whole: self.is_whole,
        }
    }

    pub(crate) fn shape(&self) -> Shape {
        self.shape
    }

    pub(crate) fn points(&self) -> &[Point] {
        &self.points
    }

    pub(crate) fn vertex_samples(&self, vertex: usize) -> &[u16] {
        let count = self.shape.component_count;
        &self.samples[vertex * count..][..count]
    }

    pub(crate) fn faces(&self) -> &[Face] {
        &self.faces
    }

    pub(crate) fn corners(&self, face: Face) -> [Point; 3] {
        face.map(|vertex| self.points[vertex as usize])
    }

    pub(crate) fn face_samples(&self) -> Option<&[u16]> {
        self.face_samples.as_deref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_that_show_nothing_are_left_out_with_their_vertices() {
        let shape = Shape { width: 4, height: 2, component_count: 2, precision: 8 };
        let places = [(0, 0), (3, 0), (0, 1), (3, 1), (2, 0), (2, 1)];
        let points = places.map(|(x, y)| Point::new(x, y)).to_vec();
        let samples = vec![9, 255, 0, 0, 9, 255, 0, 0, 0, 0, 0, 0];
        let faces = vec![[0, 4, 2], [4, 5, 2], [4, 1, 5], [1, 3, 5]];
        let mesh = Mesh::new(shape, points, samples, faces, &()).unwrap();
        let (whole, cut) = (Shown::new(&mesh, false, false), Shown::new(&mesh, true, false));
        assert_eq!((whole.faces().len(), whole.is_whole), (4, true));
        assert_eq!(cut.faces(), [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(cut.points(), [0, 4, 2, 5].map(|vertex: usize| mesh.points()[vertex]));
        assert_eq!(cut.vertex_samples(3), [9, 0], "the colour of its neighbour");
        assert!(!cut.is_whole);
        let clear = Mesh::new(shape, mesh.points().into(), vec![0; 12], mesh.faces().into(), &());
        assert!(Shown::new(&clear.unwrap(), true, false).is_whole);
        // Each face has a corner of alpha 0, and all of such a mesh is kept.
        assert_eq!(Shown::new(&mesh, false, true).faces().len(), 4);
    }
}
