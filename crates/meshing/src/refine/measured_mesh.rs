//! A triangulation that knows the error of each of its faces, and what a change would do to their
//! sum.

pub(crate) mod moves;

use super::dynamic_triangulation::{DynamicTriangulation, Ring};
use crate::hole::HoleFiller;
use crate::mesh::{Face, Point};
use crate::small_face::Pixels;
use crate::triangulation::NONE;
use moves::Trial;

/// The error of a face, a whole number that depends on the places of its vertices alone.
pub(crate) trait FaceMeasure {
    /// Sum of the errors of the lattice points of a counter-clockwise face.
    fn error(&mut self, corners: [Point; 3]) -> u64;

    /// The points by which moves can be foreseen, where the error is the squared one on them.
    fn pixels(&self) -> Option<&Pixels> {
        None
    }

    /// Whether some points matter more than others, so that the error is not that on the points.
    fn is_weighted(&self) -> bool {
        false
    }
}

impl FaceMeasure for crate::face_error::FaceErrors<'_> {
    fn error(&mut self, corners: [Point; 3]) -> u64 {
        Self::error(self, corners)
    }

    fn pixels(&self) -> Option<&Pixels> {
        Self::pixels(self)
    }

    fn is_weighted(&self) -> bool {
        Self::is_weighted(self)
    }
}

/// A preferred-directions Delaunay triangulation of lattice points of an image, with the errors of
/// its faces.
pub(crate) struct MeasuredMesh<M> {
    pub(crate) triangulation: DynamicTriangulation,
    measure: M,
    /// Error of each slot's triangle, 0 of a free one.
    face_errors: Vec<u64>,
    /// Sum of the above.
    total_error: u64,
    width: usize,
    /// Whether a lattice point is a vertex, row by row.
    occupied: Vec<bool>,
    /// The ring of the vertex looked at last.
    star: Ring,
    /// The places of its vertices.
    boundary: Vec<Point>,
    filler: HoleFiller,
    /// Error of each triangle of the last fill.
    fill_errors: Vec<u64>,
    /// The ring of the place looked at last.
    cavity: Ring,
    /// Slots of the fan put there.
    fan: Vec<u32>,
    trial: Trial,
}

/// What a mesh was at one time.
pub(crate) struct Snapshot {
    triangulation: DynamicTriangulation,
    face_errors: Vec<u64>,
    total_error: u64,
    occupied: Vec<bool>,
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// Measures every face of the triangulation of points of an image of `width` columns and
    /// `height` rows.
    pub(crate) fn new(
        points: Vec<Point>,
        faces: &[Face],
        (width, height): (usize, usize),
        measure: M,
    ) -> Self {
        let mut occupied = vec![false; width * height];
        for p in &points {
            occupied[p.y as usize * width + p.x as usize] = true;
        }
        let mut mesh = Self {
            triangulation: DynamicTriangulation::new(points, faces, width, height),
            measure,
            face_errors: Vec::new(),
            total_error: 0,
            width,
            occupied,
            star: Ring::default(),
            boundary: Vec::new(),
            filler: HoleFiller::default(),
            fill_errors: Vec::new(),
            cavity: Ring::default(),
            fan: Vec::new(),
            trial: Trial::default(),
        };
        for slot in 0..mesh.triangulation.slot_count() as u32 {
            let error = mesh.measure.error(mesh.triangulation.corners(slot));
            mesh.face_errors.push(error);
            mesh.total_error += error;
        }
        mesh
    }

    /// The mesh as it is now.
    pub(crate) fn snapshot(&self) -> Snapshot {
        Snapshot {
            triangulation: self.triangulation.clone(),
            face_errors: self.face_errors.clone(),
            total_error: self.total_error,
            occupied: self.occupied.clone(),
        }
    }

    /// The mesh as it was.
    pub(crate) fn restore(&mut self, snapshot: Snapshot) {
        let Snapshot { triangulation, face_errors, total_error, occupied } = snapshot;
        self.triangulation = triangulation;
        self.face_errors = face_errors;
        self.total_error = total_error;
        self.occupied = occupied;
    }

    /// The sum of the errors of all faces.
    pub(crate) fn total_error(&self) -> u64 {
        self.total_error
    }

    /// Columns and rows of the image.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.width, self.occupied.len() / self.width)
    }

    /// Number of vertices in the mesh.
    pub(crate) fn vertex_count(&self) -> usize {
        self.triangulation.outgoing.iter().filter(|&&h| h != NONE).count()
    }

    /// The error of a slot's triangle.
    pub(crate) fn face_error(&self, slot: u32) -> u64 {
        self.face_errors[slot as usize]
    }

    /// Tells whether a vertex may be moved or removed: it is in the mesh and no corner.
    pub(crate) fn is_movable(&self, vertex: u32) -> bool {
        let triangulation = &self.triangulation;
        triangulation.outgoing[vertex as usize] != NONE
            && !triangulation.is_corner(triangulation.points[vertex as usize])
    }

    /// Tells whether a point may become a vertex: it lies in the image and is none.
    pub(crate) fn is_vacant(&self, p: Point) -> bool {
        self.triangulation.holds(p) && !self.occupied[p.y as usize * self.width + p.x as usize]
    }

    /// By how much the error changes when a movable vertex goes.
    pub(crate) fn removal_change(&mut self, vertex: u32) -> i64 {
        let Self { triangulation, star, boundary, filler, fill_errors, measure, .. } = self;
        triangulation.star(vertex, star);
        boundary.clear();
        boundary.extend(star.vertices.iter().map(|&v| triangulation.points[v as usize]));
        fill_errors.clear();
        for triangle in filler.fill(boundary) {
            let corners = triangle.map(|place| boundary[place as usize]);
            fill_errors.push(measure.error(corners));
        }
        let before: u64 = star.triangles.iter().map(|&t| self.face_errors[t as usize]).sum();
        self.fill_errors.iter().sum::<u64>() as i64 - before as i64
    }

    /// Takes a movable vertex out, and tells by how much the error changed and a slot where it was.
    ///
    /// The vertices around it are those it has [`left`](Self::left).
    pub(crate) fn remove(&mut self, vertex: u32) -> (i64, u32) {
        let change = self.removal_change(vertex);
        let place = self.place_of(vertex);
        self.triangulation.remove(vertex, &mut self.star, self.filler.triangles());
        for (i, &slot) in self.star.triangles.iter().enumerate() {
            self.face_errors[slot as usize] = self.fill_errors.get(i).copied().unwrap_or(0);
        }
        self.occupied[place] = false;
        self.total_error = self.total_error.wrapping_add_signed(change);
        (change, self.star.triangles[0])
    }

    /// By how much the error would change with a vertex at a vacant place, if by less than `limit`;
    /// `hint` is a slot near it.
    pub(crate) fn insertion_change(&mut self, place: Point, hint: u32, limit: i64) -> Option<i64> {
        let Self { triangulation, cavity, measure, .. } = self;
        let slot = triangulation.locate(place, hint);
        triangulation.cavity(place, slot, cavity);
        let before: u64 = cavity.triangles.iter().map(|&t| self.face_errors[t as usize]).sum();
        let mut change = -(before as i64);
        for (from, to) in cavity.edges() {
            let ends = [from, to].map(|v| triangulation.points[v as usize]);
            change += measure.error([ends[0], ends[1], place]) as i64;
            if change >= limit {
                return None;
            }
        }
        Some(change)
    }

    /// Puts a vertex that is out of the mesh at a vacant place; `hint` is a slot near it.
    ///
    /// The vertices around it are those it has [`reached`](Self::reached).
    pub(crate) fn insert(&mut self, vertex: u32, place: Point, hint: u32) {
        let slot = self.triangulation.locate(place, hint);
        self.triangulation.cavity(place, slot, &mut self.cavity);
        for &slot in &self.cavity.triangles {
            self.total_error -= self.face_errors[slot as usize];
        }
        self.triangulation.insert(vertex, place, &self.cavity, &mut self.fan);
        self.face_errors.resize(self.triangulation.slot_count(), 0);
        for &slot in &self.fan {
            let error = self.measure.error(self.triangulation.corners(slot));
            self.face_errors[slot as usize] = error;
            self.total_error += error;
        }
        let place = self.place_of(vertex);
        self.occupied[place] = true;
    }

    /// Adds a vertex at a vacant place; `hint` is a slot near it.
    pub(crate) fn add_vertex(&mut self, place: Point, hint: u32) -> u32 {
        let vertex = self.triangulation.add_vertex(place);
        self.insert(vertex, place, hint);
        vertex
    }

    /// The vertices around the last removal, or the last look at one.
    pub(crate) fn left(&self) -> &[u32] {
        &self.star.vertices
    }

    /// The vertices around the last insertion, or the last look at one.
    pub(crate) fn reached(&self) -> &[u32] {
        &self.cavity.vertices
    }

    /// The slots of the triangles that the last insertion made.
    pub(crate) fn fan(&self) -> &[u32] {
        &self.fan
    }

    /// Where a vertex's place stands among the lattice points.
    fn place_of(&self, vertex: u32) -> usize {
        let p = self.triangulation.points[vertex as usize];
        p.y as usize * self.width + p.x as usize
    }
}
