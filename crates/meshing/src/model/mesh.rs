//! The mesh model of an image: sample points, their samples and the triangulation.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage, sort};
use crate::image::{Image, ImageError, Point, Shape, check_shape, corner_points, largest_sample};
use crate::triangulation::Face;
use crate::triangulation::predicates::{in_circle, orientation};
use thiserror::Error;

/// A triangle mesh that covers the image's rectangle and carries one sample vector per vertex.
///
/// Every value of this type is valid: the points are distinct lattice points and hold the four
/// corners, each belongs to a face, and the faces are counter-clockwise, do not overlap and cover
/// `[0, width - 1] x [0, height - 1]` without a gap.
///
/// ```
/// use pixmesh_meshing::{Mesh, Point, Shape};
/// let shape = Shape { width: 3, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (2, 0), (0, 1), (2, 1)].map(|(x, y)| Point::new(x, y));
/// let faces = vec![[0, 1, 3], [0, 3, 2]];
/// let mesh = Mesh::new(shape, corners.to_vec(), vec![0, 9, 0, 9], faces, &())?;
/// assert_eq!((mesh.edge_count(), mesh.vertex_samples(1)), (5, &[9][..]));
/// # Ok::<(), pixmesh_meshing::MeshError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Mesh {
    shape: Shape,
    points: Vec<Point>,
    samples: Vec<u16>,
    faces: Vec<Face>,
    /// The samples of the faces; empty where the vertices' samples are interpolated.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    face_samples: Vec<u16>,
}

/// The first defect found in what should be a mesh. Indices count from 0.
///
/// ```
/// use pixmesh_meshing::{Mesh, MeshError, Point, Shape};
/// let shape = Shape { width: 2, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Point::new(x, y)).to_vec();
/// let turned = Mesh::new(shape, corners, vec![0; 4], vec![[0, 3, 1], [0, 3, 2]], &());
/// assert_eq!(turned, Err(MeshError::FaceClockwise { face: 0 }));
/// ```
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each variant and its message explain the fields")]
pub enum MeshError {
    /// The image's shape is not allowed.
    #[error(transparent)]
    Shape(#[from] ImageError),
    /// The number of samples is not the number of vertices times that of components.
    #[error("{actual} samples where {expected} are needed")]
    SampleCount { actual: usize, expected: usize },
    /// A vertex lies outside the image of `width` columns and `height` rows.
    #[error("vertex {vertex} at ({x}, {y}) lies outside the image of {width}x{height}")]
    PointOutside { vertex: usize, x: i32, y: i32, width: usize, height: usize },
    /// A vertex has the position of an earlier one, `first`.
    #[error("vertex {vertex} repeats the point ({x}, {y}) of vertex {first}")]
    PointRepeated { vertex: usize, first: usize, x: i32, y: i32 },
    /// A sample is larger than the precision allows.
    #[error("vertex {vertex} has the sample {sample}, more than the maximum {maximum}")]
    SampleRange { vertex: usize, sample: u16, maximum: u16 },
    /// The number of samples of faces is not the number of faces times that of components.
    #[error("{actual} samples of faces where {expected} are needed")]
    FaceSampleCount { actual: usize, expected: usize },
    /// A sample of a face is larger than the precision allows.
    #[error("face {face} has the sample {sample}, more than the maximum {maximum}")]
    FaceSampleRange { face: usize, sample: u16, maximum: u16 },
    /// A corner of the image is not a vertex.
    #[error("the image's corner ({x}, {y}) is not a vertex")]
    CornerMissing { x: i32, y: i32 },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {count} vertices")]
    IndexOutOfRange { face: usize, vertex: u32, count: usize },
    /// A face's vertices are collinear or repeated.
    #[error("face {face} is degenerate")]
    FaceDegenerate { face: usize },
    /// A face turns clockwise.
    #[error("face {face} is clockwise")]
    FaceClockwise { face: usize },
    /// Two faces lie at the same side of an edge.
    #[error("face {face} overlaps another at the edge from vertex {from} to vertex {to}")]
    FacesOverlap { face: usize, from: u32, to: u32 },
    /// An edge inside the image has a face at one side only.
    #[error(
        "face {face} has no neighbour at the edge from vertex {from} to vertex {to}, \
        inside the image"
    )]
    Gap { face: usize, from: u32, to: u32 },
    /// The faces' areas do not sum to that of the image's rectangle.
    #[error("twice the faces' area is {actual}, twice the image's {expected}")]
    Area { actual: i128, expected: i128 },
    /// A vertex belongs to no face.
    #[error("vertex {vertex} belongs to no face")]
    VertexUnused { vertex: usize },
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
    pub fn new(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        faces: Vec<Face>,
        control: &dyn Control,
    ) -> Result<Self, MeshError> {
        let mesh = Self { shape, points, samples, faces, face_samples: Vec::new() };
        mesh.check(control)?;
        Ok(mesh)
    }

    /// Gives each face one colour: component `c` of face `f` is
    /// `face_samples[f * component_count + c]`. The picture of such a mesh shows these colours, and
    /// does not interpolate the vertices' samples.
    ///
    /// # Errors
    /// When the number of samples is wrong, or a sample is larger than the precision allows.
    ///
    /// ```
    /// use pixmesh_meshing::{Mesh, Point, Shape, rasterize};
    /// let shape = Shape { width: 3, height: 2, component_count: 1, precision: 8 };
    /// let corners = [(0, 0), (2, 0), (0, 1), (2, 1)].map(|(x, y)| Point::new(x, y));
    /// let faces = vec![[0, 1, 3], [0, 3, 2]];
    /// let mesh = Mesh::new(shape, corners.to_vec(), vec![0, 9, 0, 9], faces, &())?;
    /// let flat = mesh.with_face_samples(vec![7, 5])?;
    /// assert_eq!(flat.face_samples(), Some(&[7, 5][..]));
    /// assert_eq!(rasterize(&flat, &())?.row(0, 0), [7, 7, 7]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn with_face_samples(mut self, face_samples: Vec<u16>) -> Result<Self, MeshError> {
        let (count, maximum) = (self.shape.component_count, largest_sample(self.shape.precision));
        let (actual, expected) = (face_samples.len(), self.faces.len() * count);
        if actual != expected {
            return Err(MeshError::FaceSampleCount { actual, expected });
        }
        if let Some(i) = face_samples.iter().position(|&sample| sample > maximum) {
            let (face, sample) = (i / count, face_samples[i]);
            return Err(MeshError::FaceSampleRange { face, sample, maximum });
        }
        self.face_samples = face_samples;
        Ok(self)
    }

    /// Gives the faces samples that a kernel has made valid.
    pub(crate) fn with_kernel_face_samples(self, face_samples: Vec<u16>) -> Self {
        Self { face_samples, ..self }
    }

    /// Gives the vertices other samples, which a kernel has made valid.
    pub(crate) fn with_kernel_samples(self, samples: Vec<u16>) -> Self {
        Self { samples, ..self }
    }

    /// The same mesh without colours of its faces.
    #[must_use]
    pub fn without_face_samples(self) -> Self {
        Self { face_samples: Vec::new(), ..self }
    }

    /// Makes a mesh of parts that a kernel of this crate has made valid.
    pub(crate) fn from_kernel(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        faces: Vec<Face>,
    ) -> Self {
        let mesh = Self { shape, points, samples, faces, face_samples: Vec::new() };
        debug_assert_eq!(mesh.validate(), Ok(()));
        mesh
    }

    /// The mesh of these points and faces, which a kernel has made valid, with the image's samples.
    pub(crate) fn of_samples(
        image: &Image,
        points: Vec<Point>,
        faces: Vec<Face>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let sample = |&Point { x, y }: &Point| {
            let components = 0..image.component_count();
            components.map(move |c| image.sample(c, x as usize, y as usize))
        };
        let mut samples = Vec::with_capacity(points.len() * image.component_count());
        for points in points.chunks(POINTS_PER_POLL) {
            samples.extend(points.iter().flat_map(sample));
            // Smaller meshes take no time, and report no stage.
            if points.len() == POINTS_PER_POLL {
                control.poll(Stage::Measure, 0, 1)?;
            }
        }
        Ok(Self::from_kernel(image.shape(), points, samples, faces))
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

    /// The samples of the faces, face by face, where each face has one colour; see
    /// [`Self::with_face_samples`].
    #[must_use]
    pub fn face_samples(&self) -> Option<&[u16]> {
        Some(&self.face_samples[..]).filter(|samples| !samples.is_empty())
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
        check_vertices(self.shape, &self.points, &self.samples, control)?;
        let mut is_used = vec![false; self.points.len()];
        let actual = self.check_faces(&mut is_used, control)?;
        self.check_edges(control)?;
        let expected = 2 * (self.shape.width as i128 - 1) * (self.shape.height as i128 - 1);
        if actual != expected {
            return Err(MeshError::Area { actual, expected });
        }
        let unused = is_used.iter().position(|&is_used| !is_used);
        unused.map_or(Ok(()), |vertex| Err(MeshError::VertexUnused { vertex }))
    }

    /// Indices in range, faces counter-clockwise. Marks the vertices that the faces use, and
    /// returns twice the sum of the areas.
    fn check_faces(&self, is_used: &mut [bool], control: &dyn Control) -> Result<i128, MeshError> {
        let (count, mut double_area) = (self.points.len(), 0);
        for (face, &corners) in self.faces.iter().enumerate() {
            poll_at(face, self.faces.len(), control)?;
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= count) {
                return Err(MeshError::IndexOutOfRange { face, vertex, count });
            }
            corners.iter().for_each(|&v| is_used[v as usize] = true);
            let [a, b, c] = self.corners(corners);
            match orientation(a, b, c) {
                1.. => double_area += i128::from(orientation(a, b, c)),
                0 => return Err(MeshError::FaceDegenerate { face }),
                _ => return Err(MeshError::FaceClockwise { face }),
            }
        }
        Ok(double_area)
    }

    /// Each edge has one face at each side, or lies on the image's border.
    ///
    /// Together with the sum of the areas this shows that the faces neither overlap nor leave a
    /// gap: the number of faces over a position can change only across an edge without a neighbour.
    fn check_edges(&self, control: &dyn Control) -> Result<(), MeshError> {
        let edges = self.sorted_edges(control)?;
        for (i, sides) in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).enumerate() {
            poll_at(i, self.faces.len(), control)?;
            let (low, high, is_reversed, face) = sides[0];
            let (from, to) = if is_reversed { (high, low) } else { (low, high) };
            let count = sides.len();
            if count > 2 || (count == 2 && sides[1].2 == is_reversed) {
                let face = sides[count - 1].3;
                return Err(MeshError::FacesOverlap { face, from, to });
            }
            if count == 1 && !self.is_on_border(from, to) {
                return Err(MeshError::Gap { face, from, to });
            }
        }
        Ok(())
    }

    /// The edges of all faces: the smaller vertex, the larger one, whether the face runs from the
    /// larger to the smaller, and the face.
    fn sorted_edges(
        &self,
        control: &dyn Control,
    ) -> Result<Vec<(u32, u32, bool, usize)>, Cancelled> {
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for (face, &[a, b, c]) in self.faces.iter().enumerate() {
            poll_at(face, self.faces.len(), control)?;
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.push((from.min(to), from.max(to), from > to, face));
            }
        }
        sort(&mut edges, &|| control.poll(Stage::Check, 0, self.faces.len()))?;
        Ok(edges)
    }

    fn is_on_border(&self, from: u32, to: u32) -> bool {
        let (a, b) = (self.points[from as usize], self.points[to as usize]);
        let is_border = |at: i32, side: usize| at == 0 || at == side as i32 - 1;
        (a.x == b.x && is_border(a.x, self.shape.width))
            || (a.y == b.y && is_border(a.y, self.shape.height))
    }

    /// Whether the faces are the preferred-directions Delaunay triangulation of the points, so that
    /// the points alone determine the faces. A valid mesh may have another triangulation.
    ///
    /// Costs one sort of the edges: a triangulation is Delaunay when each of its edges is. Polls
    /// every few thousand edges.
    ///
    /// # Errors
    /// When the control cancels.
    pub fn is_preferred_delaunay(&self, control: &dyn Control) -> Result<bool, Cancelled> {
        let edges = self.sorted_edges(control)?;
        for (i, pair) in edges.windows(2).enumerate() {
            poll_at(i, edges.len(), control)?;
            let [(from, to, _, left), (same_from, same_to, _, right)] = [pair[0], pair[1]];
            let opposite = |face: usize| {
                let apex = self.faces[face].into_iter().find(|&v| v != from && v != to);
                self.points[apex.unwrap_or(from) as usize]
            };
            let [a, b] = [from, to].map(|v| self.points[v as usize]);
            if (from, to) == (same_from, same_to)
                && in_circle(a, b, opposite(left), opposite(right))
            {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Checks the vertices of a mesh: the shape, a sample in range for each vertex and component, and
/// points that lie inside, differ, and hold the corners.
pub(crate) fn check_vertices(
    shape: Shape,
    points: &[Point],
    samples: &[u16],
    control: &dyn Control,
) -> Result<(), MeshError> {
    let Shape { width, height, component_count, precision } = shape;
    check_shape(width, height, precision)?;
    if component_count == 0 {
        return Err(ImageError::NoComponents.into());
    }
    let (actual, expected) = (samples.len(), points.len() * component_count);
    if actual != expected {
        return Err(MeshError::SampleCount { actual, expected });
    }
    let maximum = largest_sample(precision);
    let is_inside = |at: i32, side: usize| usize::try_from(at).is_ok_and(|at| at < side);
    let vertices = points.iter().zip(samples.chunks_exact(component_count)).enumerate();
    for (vertex, (&Point { x, y }, samples)) in vertices {
        poll_at(vertex, points.len(), control)?;
        if let Some(&sample) = samples.iter().find(|&&sample| sample > maximum) {
            return Err(MeshError::SampleRange { vertex, sample, maximum });
        }
        if !is_inside(x, width) || !is_inside(y, height) {
            return Err(MeshError::PointOutside { vertex, x, y, width, height });
        }
    }
    let order = sorted_points(points, &|| control.poll(Stage::Check, 0, points.len()))?;
    for pair in order.windows(2) {
        let [(point, first), (Point { x, y }, vertex)] = [pair[0], pair[1]];
        if point == Point::new(x, y) {
            return Err(MeshError::PointRepeated { vertex, first, x, y });
        }
    }
    for corner @ Point { x, y } in corner_points(width, height) {
        if order.binary_search_by_key(&corner, |&(point, _)| point).is_err() {
            return Err(MeshError::CornerMissing { x, y });
        }
    }
    Ok(())
}

pub(crate) fn sorted_points(
    points: &[Point],
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<Vec<(Point, usize)>, Cancelled> {
    let mut sorted: Vec<(Point, usize)> = points.iter().copied().zip(0..).collect();
    sort(&mut sorted, poll)?;
    Ok(sorted)
}

/// Polls once for every 16,384 elements checked.
fn poll_at(done: usize, total: usize, control: &dyn Control) -> Result<(), Cancelled> {
    if done.is_multiple_of(1 << 14) { control.poll(Stage::Check, done, total) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
