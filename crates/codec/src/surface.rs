//! The mesh in space: flat, or as a relief, open or closed by a base.
//!
//! `x` and `y` are those of the picture times the size of a pixel, `y` up. A relief has the height
//! that a component or the luma gives it on `z`. A base closes it to a solid: walls around the
//! rectangle down to `-base`, and a fan of triangles beneath. The solid is watertight, each edge
//! belonging to two faces in opposite directions, because walls and bottom use every boundary vertex
//! of the mesh. Positions are computed where they are needed and not kept.

mod geometry;
mod normals;
mod rim;

pub use geometry::{Geometry, Relief, ReliefHeight};

use crate::error::EncodeError;
pub(crate) use normals::{cross_product, unit};

use pixmesh_meshing::{Face, Mesh};

/// A mesh in space.
pub(crate) struct Surface<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) geometry: Geometry,
    /// The boundary's vertices, counter-clockwise; none without a base.
    rim: Vec<u32>,
}

impl<'a> Surface<'a> {
    /// # Errors
    /// When the relief is to follow a component that the mesh does not have.
    pub(crate) fn new(mesh: &'a Mesh, geometry: &Geometry) -> Result<Self, EncodeError> {
        geometry.check(mesh.shape().component_count)?;
        let rim = if geometry.base > 0.0 { rim::boundary(mesh) } else { Vec::new() };
        Ok(Self { mesh, geometry: *geometry, rim })
    }

    /// Vertices: those of the mesh, then with a base one beneath each of the boundary, and one in
    /// the middle of the bottom.
    pub(crate) fn vertex_count(&self) -> usize {
        let bottom = if self.rim.is_empty() { 0 } else { self.rim.len() + 1 };
        self.mesh.points().len() + bottom
    }

    pub(crate) fn face_count(&self) -> usize {
        self.mesh.faces().len() + 3 * self.rim.len()
    }

    /// The vertex of the mesh whose colour a vertex has.
    pub(crate) fn origin(&self, vertex: usize) -> usize {
        let top = self.mesh.points().len();
        if vertex < top {
            return vertex;
        }
        self.rim.get(vertex - top).or(self.rim.first()).map_or(0, |&origin| origin as usize)
    }

    /// Where a vertex lies.
    pub(crate) fn position(&self, vertex: usize) -> [f64; 3] {
        let (pixel_size, base) = (self.geometry.pixel_size, self.geometry.base);
        let top = self.mesh.points().len();
        if vertex >= top && vertex - top >= self.rim.len() {
            let shape = self.mesh.shape();
            let middle = |side: usize| (side - 1) as f64 * pixel_size / 2.0;
            return [middle(shape.width), middle(shape.height), -base];
        }
        let origin = self.origin(vertex);
        let point = self.mesh.points()[origin];
        let height = || self.geometry.height(self.mesh.vertex_samples(origin), self.mesh.shape());
        let z = if vertex < top { height() } else { -base };
        [f64::from(point.x) * pixel_size, f64::from(point.y) * pixel_size, z]
    }

    /// The sample vectors of all vertices.
    pub(crate) fn samples(&self) -> impl Iterator<Item = &'a [u16]> {
        (0..self.vertex_count()).map(|vertex| self.mesh.vertex_samples(self.origin(vertex)))
    }

    /// All positions.
    pub(crate) fn positions(&self) -> impl Iterator<Item = [f64; 3]> {
        (0..self.vertex_count()).map(|vertex| self.position(vertex))
    }

    /// All faces, counter-clockwise seen from outside.
    pub(crate) fn faces(&self) -> impl Iterator<Item = Face> {
        let top = self.mesh.points().len() as u32;
        let middle = top + self.rim.len() as u32;
        let sides = (0..self.rim.len()).flat_map(move |i| {
            let next = (i + 1) % self.rim.len();
            let below = |i: usize| top + i as u32;
            let (a, b) = (self.rim[i], self.rim[next]);
            [[b, a, below(i)], [b, below(i), below(next)], [below(next), below(i), middle]]
        });
        self.mesh.faces().iter().copied().chain(sides)
    }

    /// Whether all of the surface lies in one plane.
    pub(crate) fn is_flat(&self) -> bool {
        self.geometry.relief.is_none() && self.rim.is_empty()
    }

    /// The least and the largest `z` that any sample could have.
    pub(crate) fn depth_range(&self) -> [f64; 2] {
        let bottom = if self.rim.is_empty() { 0.0 } else { -self.geometry.base };
        [bottom, self.geometry.total_height(self.mesh.shape())]
    }

    /// The unit normal of every vertex.
    pub(crate) fn normals(&self) -> Vec<[f64; 3]> {
        normals::vertex_normals(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::{Point, Shape};
    use std::collections::HashMap;

    /// A mesh with vertices on two of its sides.
    fn mesh() -> Mesh {
        let shape = Shape { width: 5, height: 3, component_count: 1, precision: 8 };
        let places = [(0, 0), (4, 0), (0, 2), (4, 2), (2, 0), (2, 1), (4, 1)];
        let points = places.map(|(x, y)| Point::new(x, y)).to_vec();
        let faces = vec![[0, 4, 5], [4, 1, 5], [1, 6, 5], [6, 3, 5], [3, 2, 5], [2, 0, 5]];
        Mesh::new(shape, points, vec![0, 255, 51, 102, 0, 255, 10], faces, &()).unwrap()
    }

    #[test]
    fn a_relief_with_a_base_is_closed_and_has_the_volume_beneath_it() {
        let mesh = mesh();
        let relief = Relief { height: ReliefHeight::Total(2.0), ..Relief::default() };
        let geometry =
            Geometry { relief: Some(relief), base: 1.0, pixel_size: 0.5, ..Geometry::default() };
        let surface = Surface::new(&mesh, &geometry).unwrap();
        let faces: Vec<Face> = surface.faces().collect();
        assert_eq!(faces.len(), surface.face_count());
        let mut directed = HashMap::new();
        for &[a, b, c] in &faces {
            for edge in [(a, b), (b, c), (c, a)] {
                *directed.entry(edge).or_insert(0) += 1;
            }
        }
        assert!(
            directed.iter().all(|(&(a, b), &count)| count == 1 && directed.contains_key(&(b, a)))
        );
        let volume: f64 = faces.iter().map(|&face| signed_volume(&surface, face)).sum();
        let beneath: f64 = mesh.faces().iter().map(|&face| prism(&surface, face)).sum();
        assert!((volume - beneath).abs() < 1e-12, "{volume} {beneath}");
        assert!(volume > 2.0);
    }

    fn signed_volume(surface: &Surface<'_>, face: Face) -> f64 {
        let [a, b, c] = face.map(|v| surface.position(v as usize));
        let cross =
            [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
        (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
    }

    /// The volume between a face and the bottom at -1.
    fn prism(surface: &Surface<'_>, face: Face) -> f64 {
        let [a, b, c] = face.map(|v| surface.position(v as usize));
        let area = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / 2.0;
        area * (1.0 + (a[2] + b[2] + c[2]) / 3.0)
    }

    #[test]
    fn heights_follow_what_they_are_to_follow() {
        let mesh = mesh();
        let z = |relief: Relief, vertex: usize| {
            let geometry = Geometry { relief: Some(relief), ..Geometry::default() };
            Surface::new(&mesh, &geometry).unwrap().position(vertex)[2]
        };
        let total = Relief { height: ReliefHeight::Total(5.0), ..Relief::default() };
        assert_eq!([z(total, 0), z(total, 1), z(total, 2)], [0.0, 5.0, 1.0]);
        assert_eq!(z(Relief { invert: true, ..total }, 2), 4.0);
        let each = Relief { height: ReliefHeight::PerSample(0.5), ..Relief::default() };
        assert_eq!(z(each, 1), 127.5);
        // A tenth of the longer side.
        assert_eq!(z(Relief::default(), 1), 0.5);
        let geometry = Geometry {
            relief: Some(Relief { source: crate::ReliefSource::Second, ..total }),
            ..Geometry::default()
        };
        let error = Surface::new(&mesh, &geometry).err().unwrap().to_string();
        assert_eq!(error, "the relief is to follow component 1 (counted from 0) of 1");
    }
}
