//! The mesh model of an image: sample points, their samples and the triangulation.

use crate::control::{Cancelled, Control, Stage};
use crate::image::{Image, ImageError, Point, Shape, check_shape, corner_points, largest_sample};
use crate::triangulation::Face;
use crate::triangulation::predicates::{in_circle, orientation};
use thiserror::Error;

/// A triangle mesh that covers the image's rectangle and carries one sample vector per vertex.
///
/// Every value of this type is valid: the points are distinct lattice points and hold the four
/// corners, each belongs to a face, and the faces are counter-clockwise, do not overlap and cover
/// `[0, width - 1] x [0, height - 1]` without a gap.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Mesh {
    shape: Shape,
    points: Vec<Point>,
    /// Vertex by vertex: `samples[v * component_count + c]`.
    samples: Vec<u16>,
    faces: Vec<Face>,
}

/// The first defect found in what should be a mesh.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshError {
    /// The image's shape is not allowed.
    #[error(transparent)]
    Shape(#[from] ImageError),
    /// The number of samples is not the number of vertices times that of components.
    #[error("{actual} samples where {expected} are needed")]
    SampleCount {
        /// Samples found.
        actual: usize,
        /// Samples needed.
        expected: usize,
    },
    /// A vertex lies outside the image.
    #[error("vertex {vertex} at ({x}, {y}) lies outside the image of {width}x{height}")]
    PointOutside {
        /// Index of the vertex.
        vertex: usize,
        /// Its column.
        x: i32,
        /// Its row.
        y: i32,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// Two vertices have the same position.
    #[error("vertex {vertex} repeats the point ({x}, {y}) of vertex {first}")]
    PointRepeated {
        /// Index of the later vertex.
        vertex: usize,
        /// Index of the earlier vertex.
        first: usize,
        /// Their column.
        x: i32,
        /// Their row.
        y: i32,
    },
    /// A sample does not fit the precision.
    #[error("vertex {vertex} has the sample {sample}, more than the maximum {maximum}")]
    SampleRange {
        /// Index of the vertex.
        vertex: usize,
        /// The sample.
        sample: u16,
        /// The largest sample allowed.
        maximum: u16,
    },
    /// A corner of the image is no vertex.
    #[error("the image's corner ({x}, {y}) is not a vertex")]
    CornerMissing {
        /// Column of the corner.
        x: i32,
        /// Row of the corner.
        y: i32,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {count} vertices")]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A face's vertices are collinear or repeated.
    #[error("face {face} is degenerate")]
    FaceDegenerate {
        /// Index of the face.
        face: usize,
    },
    /// A face turns clockwise.
    #[error("face {face} is clockwise")]
    FaceClockwise {
        /// Index of the face.
        face: usize,
    },
    /// Two faces lie on the same side of an edge.
    #[error("face {face} overlaps another at the edge from vertex {from} to vertex {to}")]
    FacesOverlap {
        /// Index of the later face.
        face: usize,
        /// First vertex of the edge.
        from: u32,
        /// Second vertex of the edge.
        to: u32,
    },
    /// An edge inside the image has a face at one side only.
    #[error(
        "face {face} has no neighbour at the edge from vertex {from} to vertex {to}, inside the image"
    )]
    Gap {
        /// Index of the face.
        face: usize,
        /// First vertex of the edge.
        from: u32,
        /// Second vertex of the edge.
        to: u32,
    },
    /// The faces' areas do not sum to the image's.
    #[error("twice the faces' area is {actual}, twice the image's {expected}")]
    Area {
        /// Twice the sum of the faces' areas.
        actual: i128,
        /// Twice the area of the image's rectangle.
        expected: i128,
    },
    /// A vertex belongs to no face.
    #[error("vertex {vertex} belongs to no face")]
    VertexUnused {
        /// Index of the vertex.
        vertex: usize,
    },
    /// The control cancelled the checks.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Mesh {
    /// Makes a mesh of its parts after checking all of its invariants.
    ///
    /// `samples[v * component_count + c]` is component `c` of vertex `v`; faces index `points`
    /// from 0. Costs one sort of the edges. Polls every few thousand vertices and faces.
    ///
    /// # Errors
    /// The first defect found, see [`MeshError`], or [`MeshError::Cancelled`].
    ///
    /// ```
    /// use pixmesh_meshing::{Mesh, Point, Shape};
    ///
    /// let shape = Shape { width: 3, height: 2, component_count: 1, precision: 8 };
    /// let corners = [(0, 0), (2, 0), (0, 1), (2, 1)].map(|(x, y)| Point::new(x, y));
    /// let faces = vec![[0, 1, 3], [0, 3, 2]];
    /// assert!(Mesh::new(shape, corners.to_vec(), vec![0, 9, 0, 9], faces, &()).is_ok());
    /// ```
    pub fn new(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        faces: Vec<Face>,
        control: &dyn Control,
    ) -> Result<Self, MeshError> {
        let mesh = Self { shape, points, samples, faces };
        mesh.check(control)?;
        Ok(mesh)
    }

    /// Makes a mesh of parts that a kernel of this crate has made valid.
    pub(crate) fn from_kernel(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        faces: Vec<Face>,
    ) -> Self {
        let mesh = Self { shape, points, samples, faces };
        debug_assert_eq!(mesh.validate(), Ok(()));
        mesh
    }

    /// The mesh of these points and faces, which a kernel has made valid, with the image's samples.
    pub(crate) fn of_samples(image: &Image, points: Vec<Point>, faces: Vec<Face>) -> Self {
        let sample = |&Point { x, y }: &Point| {
            let components = 0..image.component_count();
            components.map(move |c| image.sample(c, x as usize, y as usize))
        };
        let samples = points.iter().flat_map(sample).collect();
        Self::from_kernel(image.shape(), points, samples, faces)
    }

    /// Shape of the image that the mesh models.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The vertices' positions.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// The vertices' samples, vertex by vertex: component `c` of vertex `v` is
    /// `samples()[v * component_count + c]`.
    #[must_use]
    pub fn samples(&self) -> &[u16] {
        &self.samples
    }

    /// The sample vector of vertex `v`.
    ///
    /// # Panics
    /// When `v` is out of range.
    #[must_use]
    pub fn vertex_samples(&self, v: usize) -> &[u16] {
        let count = self.shape.component_count;
        &self.samples[v * count..][..count]
    }

    /// The faces, counter-clockwise.
    #[must_use]
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// Number of edges, by Euler's formula `vertices + faces - 1`.
    #[must_use]
    pub fn edge_count(&self) -> usize {
        self.points.len() + self.faces.len() - 1
    }

    /// The positions of a face's vertices.
    ///
    /// # Panics
    /// When the face names a vertex out of range.
    #[must_use]
    pub fn corners(&self, face: Face) -> [Point; 3] {
        face.map(|v| self.points[v as usize])
    }

    /// Checks every invariant again.
    ///
    /// # Errors
    /// The first defect found.
    pub fn validate(&self) -> Result<(), MeshError> {
        self.check(&())
    }

    fn check(&self, control: &dyn Control) -> Result<(), MeshError> {
        check_samples(self.shape, self.points.len(), &self.samples)?;
        check_points(self.shape, &self.points, control)?;
        self.check_faces(control)?;
        self.check_edges(control)?;
        self.check_area(control)?;
        self.check_vertices_used()
    }

    /// Tells whether the faces are those of the preferred-directions Delaunay triangulation of the
    /// points, so that these alone say what the faces are. A mesh of another triangulation is no
    /// less valid.
    ///
    /// Costs one sort of the edges: a triangulation is Delaunay when each of its edges is.
    #[must_use]
    pub fn is_preferred_delaunay(&self) -> bool {
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for &[a, b, c] in &self.faces {
            for (from, to, apex) in [(a, b, c), (b, c, a), (c, a, b)] {
                edges.push((from.min(to), from.max(to), from > to, apex));
            }
        }
        edges.sort_unstable();
        edges.windows(2).all(|pair| {
            let [(from, to, _, left), (same_from, same_to, _, right)] = [pair[0], pair[1]];
            let point = |v: u32| self.points[v as usize];
            (from, to) != (same_from, same_to)
                || !in_circle(point(from), point(to), point(left), point(right))
        })
    }

    /// Indices in range, faces counter-clockwise.
    fn check_faces(&self, control: &dyn Control) -> Result<(), MeshError> {
        let count = self.points.len();
        for (face, &corners) in self.faces.iter().enumerate() {
            poll_at(face, self.faces.len(), control)?;
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= count) {
                return Err(MeshError::IndexOutOfRange { face, vertex, count });
            }
            let [a, b, c] = self.corners(corners);
            match orientation(a, b, c).signum() {
                1 => {}
                0 => return Err(MeshError::FaceDegenerate { face }),
                _ => return Err(MeshError::FaceClockwise { face }),
            }
        }
        Ok(())
    }

    /// Each edge has one face at each side, or lies on the image's border.
    ///
    /// Together with the sum of the areas this shows that the faces neither overlap nor leave a
    /// gap: the number of faces over a position can change only across an edge without a neighbour.
    fn check_edges(&self, control: &dyn Control) -> Result<(), MeshError> {
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for (face, &[a, b, c]) in self.faces.iter().enumerate() {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.push((from.min(to), from.max(to), from > to, face));
            }
        }
        sort(&mut edges, control)?;
        for (number, sides) in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).enumerate() {
            poll_at(number, self.faces.len(), control)?;
            let (low, high, reversed, face) = sides[0];
            let (from, to) = if reversed { (high, low) } else { (low, high) };
            let count = sides.len();
            if count > 2 || (count == 2 && sides[1].2 == reversed) {
                let face = sides[count - 1].3;
                return Err(MeshError::FacesOverlap { face, from, to });
            }
            if count == 1 && !self.is_on_border(from, to) {
                return Err(MeshError::Gap { face, from, to });
            }
        }
        Ok(())
    }

    /// Tells whether both ends lie on one side of the image's rectangle.
    fn is_on_border(&self, from: u32, to: u32) -> bool {
        let (a, b) = (self.points[from as usize], self.points[to as usize]);
        let last = |side: usize| side as i32 - 1;
        let along = |p: i32, q: i32, side: usize| p == q && (p == 0 || p == last(side));
        along(a.x, b.x, self.shape.width) || along(a.y, b.y, self.shape.height)
    }

    /// The areas sum to the rectangle's.
    fn check_area(&self, control: &dyn Control) -> Result<(), MeshError> {
        let mut actual = 0;
        for (number, &face) in self.faces.iter().enumerate() {
            poll_at(number, self.faces.len(), control)?;
            let [a, b, c] = self.corners(face);
            actual += i128::from(orientation(a, b, c));
        }
        let expected = 2 * (self.shape.width as i128 - 1) * (self.shape.height as i128 - 1);
        if actual == expected { Ok(()) } else { Err(MeshError::Area { actual, expected }) }
    }

    /// Each vertex belongs to a face.
    fn check_vertices_used(&self) -> Result<(), MeshError> {
        let mut used = vec![false; self.points.len()];
        for &v in self.faces.iter().flatten() {
            used[v as usize] = true;
        }
        match used.iter().position(|&used| !used) {
            Some(vertex) => Err(MeshError::VertexUnused { vertex }),
            None => Ok(()),
        }
    }
}

/// Checks the shape, and that there is a sample in range for each vertex and component.
pub(crate) fn check_samples(
    shape: Shape,
    vertex_count: usize,
    samples: &[u16],
) -> Result<(), MeshError> {
    let Shape { width, height, component_count, precision } = shape;
    check_shape(width, height, precision)?;
    if component_count == 0 {
        return Err(ImageError::NoComponents.into());
    }
    let (actual, expected) = (samples.len(), vertex_count * component_count);
    if actual != expected {
        return Err(MeshError::SampleCount { actual, expected });
    }
    let maximum = largest_sample(precision);
    match samples.iter().position(|&sample| sample > maximum) {
        Some(i) => {
            let (vertex, sample) = (i / component_count, samples[i]);
            Err(MeshError::SampleRange { vertex, sample, maximum })
        }
        None => Ok(()),
    }
}

/// Checks that points lie inside, differ, and hold the corners.
pub(crate) fn check_points(
    shape: Shape,
    points: &[Point],
    control: &dyn Control,
) -> Result<(), MeshError> {
    let Shape { width, height, .. } = shape;
    let inside = |side: usize, at: i32| usize::try_from(at).is_ok_and(|at| at < side);
    for (vertex, &Point { x, y }) in points.iter().enumerate() {
        if !inside(width, x) || !inside(height, y) {
            return Err(MeshError::PointOutside { vertex, x, y, width, height });
        }
    }
    let mut order: Vec<(Point, usize)> = points.iter().copied().zip(0..).collect();
    sort(&mut order, control)?;
    for pair in order.windows(2) {
        let [(point, first), (Point { x, y }, vertex)] = [pair[0], pair[1]];
        if point == Point::new(x, y) {
            return Err(MeshError::PointRepeated { vertex, first, x, y });
        }
    }
    for corner in corner_points(width, height) {
        if order.binary_search_by_key(&corner, |&(point, _)| point).is_err() {
            return Err(MeshError::CornerMissing { x: corner.x, y: corner.y });
        }
    }
    Ok(())
}

/// Elements checked between two polls, and sorted at a time.
const CHECKED_PER_POLL: usize = 1 << 14;
const SORTED_AT_A_TIME: usize = 1 << 19;

/// Polls once for every [`CHECKED_PER_POLL`] elements.
fn poll_at(number: usize, total: usize, control: &dyn Control) -> Result<(), Cancelled> {
    if number.is_multiple_of(CHECKED_PER_POLL) {
        control.poll(Stage::Check, number, total)?;
    }
    Ok(())
}

/// Sorts distinct elements under a control.
fn sort<T: Ord>(elements: &mut [T], control: &dyn Control) -> Result<(), Cancelled> {
    control.poll(Stage::Check, 0, elements.len())?;
    if elements.len() <= SORTED_AT_A_TIME {
        elements.sort_unstable();
        return Ok(());
    }
    let half = elements.len() / 2;
    let (lower, _, upper) = elements.select_nth_unstable(half);
    sort(lower, control)?;
    sort(upper, control)
}

#[cfg(test)]
mod tests;
