//! The mesh in space: flat, or as a relief, open or closed by a base.
//!
//! `x` and `y` are those of the picture times the size of a pixel, `y` up. A relief has the height
//! that a component or the luma gives it on `z`. A base closes it to a solid: walls around the
//! rectangle down to `-base`, and a fan of triangles beneath; of a mesh without all of its faces,
//! walls around these and the same faces beneath. The solid is watertight, each edge belonging to
//! as many faces in one direction as in the other. Positions are computed where they are needed and not kept.

mod base;
mod geometry;
mod normals;
mod paint;

pub use geometry::{Geometry, Relief, ReliefHeight, ZOffset};

use crate::choices::{Coloring, LengthUnit, UpAxis};
use crate::error::EncodeError;
use base::Base;
pub(crate) use normals::{cross_product, unit};

use crate::shown::Shown;
use pixmesh_meshing::{Face, Shape};

/// A mesh in space.
pub(crate) struct Surface<'a> {
    pub(crate) mesh: &'a Shown<'a>,
    pub(crate) geometry: Geometry,
    /// The samples of the faces, each of which has three vertices of its own then.
    face_samples: Option<&'a [u16]>,
    /// The colours of the vertices, three samples of 8 bits each, where they are not the mesh's.
    painted: Option<Vec<u16>>,
    /// The height that comes to `z = 0`.
    zero: f64,
    /// The `z` of the bottom.
    bottom: f64,
    base: Option<Base>,
}

impl<'a> Surface<'a> {
    /// A surface whose faces share the vertices of the mesh.
    ///
    /// # Errors
    /// When the relief is to follow a component that the mesh does not have.
    pub(crate) fn new(mesh: &'a Shown<'a>, geometry: &Geometry) -> Result<Self, EncodeError> {
        geometry.check(mesh.shape().component_count)?;
        let geometry = geometry.sized(mesh.shape());
        let base = (geometry.base > 0.0).then(|| Base::new(mesh));
        let height = |vertex| geometry.height(mesh.vertex_samples(vertex), mesh.shape());
        let least = (0..mesh.points().len()).map(height).fold(f64::INFINITY, f64::min);
        let zero = match geometry.z_offset {
            ZOffset::Least => least,
            ZOffset::Length(length) => length,
        };
        // Below the lowest vertex, wherever 0 is.
        let bottom = (least - zero).min(0.0) - geometry.base;
        Ok(Self { mesh, geometry, face_samples: None, painted: None, zero, bottom, base })
    }

    /// A surface whose vertices show colours: where faces have colours and the picture is shown, each
    /// face has three vertices of its own.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn colored(mesh: &'a Shown<'a>, geometry: &Geometry) -> Result<Self, EncodeError> {
        let shared = Self::new(mesh, geometry)?;
        let painted = paint::painted(&shared);
        let shows_image = geometry.color == Coloring::Image && painted.is_none();
        let face_samples = if shows_image { mesh.face_samples() } else { None };
        Ok(Self { face_samples, painted, ..shared })
    }

    /// The same surface without colours.
    fn bare(&self) -> Self {
        let (mesh, base) = (self.mesh, self.base.clone());
        Self { mesh, base, face_samples: None, painted: None, ..*self }
    }

    /// Vertices: those of the faces, then with a base those of its walls and bottom: one beneath
    /// each that it reaches down from, and of a rectangle one in the middle of the bottom.
    pub(crate) fn vertex_count(&self) -> usize {
        let middle = usize::from(self.base.as_ref().is_some_and(|base| base.is_rectangle));
        self.top_count() + self.below().len() + middle
    }

    pub(crate) fn face_count(&self) -> usize {
        let faces = self.mesh.faces().len();
        let floor = |base: &Base| if base.is_rectangle { base.edges.len() } else { faces };
        faces + self.base.as_ref().map_or(0, |base| 2 * base.edges.len() + floor(base))
    }

    /// The vertices of the mesh that the base reaches down from.
    fn below(&self) -> &[u32] {
        self.base.as_ref().map_or(&[], |base| &base.vertices)
    }

    /// The number of vertices that belong to faces of the mesh.
    fn mesh_vertex_count(&self) -> usize {
        match self.face_samples {
            Some(_) => 3 * self.mesh.faces().len(),
            None => self.mesh.points().len(),
        }
    }

    /// The number of vertices at the height of the mesh. Walls share the vertices of the faces, or
    /// have their own.
    fn top_count(&self) -> usize {
        let walls = if self.face_samples.is_some() { self.below().len() } else { 0 };
        self.mesh_vertex_count() + walls
    }

    /// The vertex of the mesh whose place on the picture a vertex has.
    pub(crate) fn origin(&self, vertex: usize) -> usize {
        let count = self.mesh_vertex_count();
        if vertex < count {
            let corners = self.mesh.faces().as_flattened();
            return self.face_samples.map_or(vertex, |_| corners[vertex] as usize);
        }
        let below = self.below();
        let place = (vertex - count).checked_rem(below.len().max(1)).unwrap_or_default();
        below.get(place).map_or(0, |&origin| origin as usize)
    }

    /// Where a vertex lies.
    pub(crate) fn position(&self, vertex: usize) -> [f64; 3] {
        let [column, row] = self.geometry.steps();
        let top = self.top_count();
        if vertex >= top && vertex - top >= self.below().len() {
            let shape = self.mesh.shape();
            let middle = |side: usize, step| (side - 1) as f64 * step / 2.0;
            return [middle(shape.width, column), middle(shape.height, row), self.bottom];
        }
        let origin = self.origin(vertex);
        let point = self.mesh.points()[origin];
        let height = || self.geometry.height(self.mesh.vertex_samples(origin), self.mesh.shape());
        let z = if vertex < top { height() - self.zero } else { self.bottom };
        [f64::from(point.x) * column, f64::from(point.y) * row, z]
    }

    /// Where a vertex lies in a file without a node that turns and moves it.
    pub(crate) fn placed(&self, vertex: usize) -> [f64; 3] {
        let [center_x, center_y] = self.center();
        let [x, y, z] = self.position(vertex);
        self.turned([x - center_x, y - center_y, z], UpAxis::Z)
    }

    /// The place on the mesh that lies at `x = 0` and `y = 0`.
    pub(crate) fn center(&self) -> [f64; 2] {
        let Shape { width, height, .. } = self.mesh.shape();
        let [column, row] = self.geometry.steps();
        let middle = |side: usize, step| (side - 1) as f64 * step / 2.0;
        if self.geometry.center { [middle(width, column), middle(height, row)] } else { [0.0; 2] }
    }

    /// A place where heights follow the axis asked for, or else `otherwise`.
    pub(crate) fn turned(&self, [x, y, z]: [f64; 3], otherwise: UpAxis) -> [f64; 3] {
        match self.geometry.up.unwrap_or(otherwise) {
            // 0 stays positive.
            UpAxis::Y => [x, z, 0.0 - y],
            UpAxis::Z => [x, y, z],
        }
    }

    /// The shape of the samples that vertices show; `None` where they show nothing.
    pub(crate) fn color_shape(&self) -> Option<Shape> {
        let shape = self.mesh.shape();
        let shown = if self.painted.is_some() { paint::shape(shape) } else { shape };
        (self.geometry.color != Coloring::None).then_some(shown)
    }

    /// Whether the colours are already those of a surface in the light.
    pub(crate) fn is_shaded(&self) -> bool {
        self.geometry.color == Coloring::Hillshade
    }

    /// The unit, or that of formats that are silent about it.
    pub(crate) fn unit(&self) -> LengthUnit {
        self.geometry.unit.unwrap_or_default()
    }

    /// The sample vectors that all vertices show: painted, of the face, or of the vertex of the mesh.
    pub(crate) fn samples(&self) -> impl Iterator<Item = &[u16]> {
        let count = self.mesh.shape().component_count;
        (0..self.vertex_count()).map(move |vertex| match (&self.painted, self.face_samples) {
            (Some(painted), _) => &painted[3 * vertex..][..3],
            (None, Some(samples)) if vertex < self.mesh_vertex_count() => {
                &samples[vertex / 3 * count..][..count]
            }
            _ => self.mesh.vertex_samples(self.origin(vertex)),
        })
    }

    /// All positions.
    pub(crate) fn positions(&self) -> impl Iterator<Item = [f64; 3]> {
        (0..self.vertex_count()).map(|vertex| self.position(vertex))
    }

    /// All positions in a file without a node.
    pub(crate) fn placed_positions(&self) -> impl Iterator<Item = [f64; 3]> {
        (0..self.vertex_count()).map(|vertex| self.placed(vertex))
    }

    /// All faces, counter-clockwise seen from outside.
    pub(crate) fn faces(&self) -> impl Iterator<Item = Face> {
        let (own, top) = (self.mesh_vertex_count() as u32, self.top_count() as u32);
        let below = self.below();
        let middle = top + below.len() as u32;
        let faces = self.mesh.faces().iter().zip(0..).map(move |(&face, index): (_, u32)| {
            self.face_samples.map_or(face, |_| [3 * index, 3 * index + 1, 3 * index + 2])
        });
        let above = move |i: u32| self.face_samples.map_or(below[i as usize], |_| own + i);
        let edges = self.base.iter().flat_map(|base| &base.edges);
        let is_rectangle = self.base.as_ref().is_some_and(|base| base.is_rectangle);
        let sides = edges.flat_map(move |&[from, to]| {
            let [a, b, c, d] = [above(from), above(to), top + from, top + to];
            [[b, a, c], [b, c, d]].into_iter().chain(is_rectangle.then_some([d, c, middle]))
        });
        let mirrored = if self.base.is_some() && !is_rectangle { self.mesh.faces() } else { &[] };
        let floor = mirrored.iter().map(move |&[a, b, c]| [top + c, top + b, top + a]);
        faces.chain(sides).chain(floor)
    }

    /// Whether all of the surface lies in one plane.
    pub(crate) fn is_flat(&self) -> bool {
        self.geometry.relief.is_none() && self.base.is_none()
    }

    /// The least and the largest `z` that any sample could have.
    pub(crate) fn depth_range(&self) -> [f64; 2] {
        let top = self.geometry.total_height(self.mesh.shape()) - self.zero;
        [if self.base.is_none() { -self.zero } else { self.bottom }, top]
    }

    /// The unit normal of every vertex.
    pub(crate) fn normals(&self) -> Vec<[f64; 3]> {
        normals::vertex_normals(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::{Mesh, Point, Shape};
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
        let mesh = Shown::new(&mesh, false, false);
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

    #[test]
    fn a_solid_with_colors_of_faces_has_their_colors_and_is_closed() {
        let flat = mesh().with_face_samples((0..6).map(|face| 10 * face).collect()).unwrap();
        let flat = Shown::new(&flat, false, false);
        let geometry =
            Geometry { relief: Some(Relief::default()), base: 1.0, ..Geometry::default() };
        let surface = Surface::colored(&flat, &geometry).unwrap();
        let samples: Vec<&[u16]> = surface.samples().collect();
        let faces: Vec<Face> = surface.faces().collect();
        assert_eq!((samples.len(), faces.len()), (surface.vertex_count(), surface.face_count()));
        for (face, color) in faces.iter().zip([0, 10, 20, 30, 40, 50]) {
            assert!(face.iter().all(|&vertex| samples[vertex as usize] == [color]));
        }
        // Its positions are those of the solid that shares vertices.
        let shared = Surface::new(&flat, &geometry).unwrap();
        let corners = |surface: &Surface<'_>| -> Vec<[[f64; 3]; 3]> {
            surface.faces().map(|face| face.map(|v| surface.position(v as usize))).collect()
        };
        assert_eq!(corners(&surface), corners(&shared));
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
        let mesh = Shown::new(&mesh, false, false);
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
