//! A triangulation that knows the error of each of its faces, and what a change would do to their
//! sum.

pub(crate) mod half_edges;
pub(crate) mod moves;
pub(crate) mod occupancy;
pub(crate) mod partition;
pub(crate) mod patches;
pub(crate) mod probe;

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::half_edges::DynamicTriangulation;
use crate::dynamic_mesh::occupancy::Occupancy;
use crate::face_error::quadratic_model::ModelPixels;
use crate::image::Point;
use crate::triangulation::{Face, NONE};
use moves::Trial;
use probe::{Probe, Surface, find_all};

/// The error of a face, a whole number that depends on the places of its vertices alone.
pub(crate) trait FaceMeasure: Send + Sync {
    /// Sum of the errors of the lattice points of a counter-clockwise face.
    fn error(&mut self, corners: [Point; 3]) -> u64;

    /// The errors of faces in order as long as their sum is less than `limit`, and the sum; where it
    /// reaches the limit, that or more.
    fn errors_below(&mut self, faces: &[[Point; 3]], limit: u64, errors: &mut Vec<u64>) -> u64 {
        let mut sum = 0;
        errors.clear();
        for &face in faces {
            let error = self.error(face);
            errors.push(error);
            sum += error;
            if sum >= limit {
                break;
            }
        }
        sum
    }

    /// Another one of the same errors, for another thread.
    fn another(&self) -> Self
    where
        Self: Sized;

    /// The pixels of the quadratic model, where the error is the squared one of these.
    fn model_pixels(&self) -> Option<ModelPixels<'_>> {
        None
    }

    /// The error without weights, whose changes the quadratic model predicts, of a face of some
    /// error.
    fn unweighted_error(&mut self, _corners: [Point; 3], error: u64) -> u64 {
        error
    }
}

impl FaceMeasure for crate::face_error::FaceErrors<'_> {
    fn error(&mut self, corners: [Point; 3]) -> u64 {
        Self::error(self, corners)
    }

    fn errors_below(&mut self, faces: &[[Point; 3]], limit: u64, errors: &mut Vec<u64>) -> u64 {
        Self::errors_below(self, faces, limit, errors)
    }

    fn another(&self) -> Self {
        Self::another(self)
    }

    fn model_pixels(&self) -> Option<ModelPixels<'_>> {
        Self::model_pixels(self)
    }

    fn unweighted_error(&mut self, corners: [Point; 3], error: u64) -> u64 {
        Self::unweighted_error(self, corners, error)
    }
}

/// A preferred-directions Delaunay triangulation of lattice points of an image, with the errors of
/// its faces.
pub(crate) struct MeasuredMesh<M> {
    pub(crate) triangulation: DynamicTriangulation,
    /// Error of each slot's triangle, 0 of a free one.
    face_errors: Vec<u64>,
    /// Sum of the above.
    total_error: u64,
    occupancy: Occupancy,
    probe: Probe<M>,
    /// Slots of the fan put there.
    fan: Vec<u32>,
    trial: Trial,
}

/// What a mesh was at one time.
pub(crate) struct Snapshot {
    triangulation: DynamicTriangulation,
    face_errors: Vec<u64>,
    total_error: u64,
    occupancy: Occupancy,
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
        let occupancy = Occupancy::of_image(width, height, &points);
        let triangulation = DynamicTriangulation::new(points, faces, width, height);
        let mut mesh = Self::unmeasured(triangulation, measure, occupancy);
        for slot in 0..mesh.triangulation.slot_count() as u32 {
            let error = mesh.probe.measure.error(mesh.triangulation.corners(slot));
            mesh.face_errors.push(error);
            mesh.total_error += error;
        }
        mesh
    }

    /// The same on all threads.
    ///
    /// # Errors
    /// When the control cancels.
    pub(crate) fn new_on_all_threads(
        points: Vec<Point>,
        faces: &[Face],
        (width, height): (usize, usize),
        measure: M,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let occupancy = Occupancy::of_image(width, height, &points);
        let triangulation = DynamicTriangulation::new(points, faces, width, height);
        let mut mesh = Self::unmeasured(triangulation, measure, occupancy);
        let slots: Vec<u32> = (0..mesh.triangulation.slot_count() as u32).collect();
        let corners = |slot| mesh.triangulation.corners(slot);
        let find = |slot, probe: &mut Probe<M>| probe.measure.error(corners(slot));
        let face_errors = find_all(&slots, || mesh.another_probe(), find, control)?;
        mesh.total_error = face_errors.iter().sum();
        mesh.face_errors = face_errors;
        Ok(mesh)
    }

    /// A mesh without the errors of its faces.
    fn unmeasured(triangulation: DynamicTriangulation, measure: M, occupancy: Occupancy) -> Self {
        Self {
            triangulation,
            face_errors: Vec::new(),
            total_error: 0,
            occupancy,
            probe: Probe::new(measure),
            fan: Vec::new(),
            trial: Trial::default(),
        }
    }

    /// The mesh as it is now.
    pub(crate) fn snapshot(&self) -> Snapshot {
        Snapshot {
            triangulation: self.triangulation.clone(),
            face_errors: self.face_errors.clone(),
            total_error: self.total_error,
            occupancy: self.occupancy.clone(),
        }
    }

    /// The mesh as it was.
    pub(crate) fn restore(&mut self, snapshot: Snapshot) {
        let Snapshot { triangulation, face_errors, total_error, occupancy } = snapshot;
        self.triangulation = triangulation;
        self.face_errors = face_errors;
        self.total_error = total_error;
        self.occupancy = occupancy;
    }

    /// The sum of the errors of all faces.
    pub(crate) fn total_error(&self) -> u64 {
        self.total_error
    }

    /// Columns and rows of the image.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.occupancy.size()
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

    /// Whether a model predicts the change of the error when a vertex moves.
    pub(crate) fn has_model(&self) -> bool {
        self.probe.measure.model_pixels().is_some()
    }

    /// Tells whether a point may become a vertex: it lies in the image and is none.
    #[inline]
    pub(crate) fn is_vacant(&self, p: Point) -> bool {
        self.surface().is_vacant(p)
    }

    /// The mesh as it is, for probes on several threads.
    pub(crate) fn surface(&self) -> Surface<'_> {
        let Self { triangulation, face_errors, occupancy, .. } = self;
        Surface { triangulation, face_errors, occupancy }
    }

    /// One more probe of the same errors.
    pub(crate) fn another_probe(&self) -> Probe<M> {
        Probe::new(self.probe.measure.another())
    }

    /// The mesh and its own probe.
    pub(crate) fn probed(&mut self) -> (Surface<'_>, &mut Probe<M>) {
        let Self { triangulation, face_errors, occupancy, probe, .. } = self;
        (Surface { triangulation, face_errors, occupancy }, probe)
    }

    /// By how much the error changes when a movable vertex goes.
    pub(crate) fn removal_change(&mut self, vertex: u32) -> i64 {
        let (surface, probe) = self.probed();
        surface.removal_change(vertex, probe)
    }

    /// Takes a movable vertex out, and tells by how much the error changed and a slot where it was.
    ///
    /// The vertices around it are those it has [`left`](Self::left).
    pub(crate) fn remove(&mut self, vertex: u32) -> (i64, u32) {
        let change = self.removal_change(vertex);
        let place = self.triangulation.points[vertex as usize];
        let Probe { star, filler, fill_errors, .. } = &mut self.probe;
        self.triangulation.remove(vertex, star, filler.triangles());
        for (i, &slot) in star.triangles.iter().enumerate() {
            self.face_errors[slot as usize] = fill_errors.get(i).copied().unwrap_or(0);
        }
        self.occupancy.leave(place);
        self.total_error = self.total_error.wrapping_add_signed(change);
        (change, self.probe.star.triangles[0])
    }

    /// By how much the error would change with a vertex at a vacant place, if by less than `limit`;
    /// `hint` is a slot near it.
    pub(crate) fn insertion_change(&mut self, place: Point, hint: u32, limit: i64) -> Option<i64> {
        let (surface, probe) = self.probed();
        surface.insertion_change(place, hint, limit, probe)
    }

    /// Puts a vertex that is out of the mesh at a vacant place; `hint` is a slot near it.
    ///
    /// The vertices around it are those it has [`reached`](Self::reached).
    pub(crate) fn insert(&mut self, vertex: u32, place: Point, hint: u32) {
        let slot = self.triangulation.locate(place, hint);
        let Probe { cavity, measure, .. } = &mut self.probe;
        self.triangulation.cavity(place, slot, cavity);
        for &slot in &cavity.triangles {
            self.total_error -= self.face_errors[slot as usize];
        }
        self.triangulation.insert(vertex, place, cavity, &mut self.fan);
        self.face_errors.resize(self.triangulation.slot_count(), 0);
        for &slot in &self.fan {
            let error = measure.error(self.triangulation.corners(slot));
            self.face_errors[slot as usize] = error;
            self.total_error += error;
        }
        self.occupancy.take(place);
    }

    /// Adds a vertex at a vacant place; `hint` is a slot near it.
    pub(crate) fn add_vertex(&mut self, place: Point, hint: u32) -> u32 {
        let vertex = self.triangulation.add_vertex(place);
        self.insert(vertex, place, hint);
        vertex
    }

    /// The vertices around the last removal, or the last look at one.
    pub(crate) fn left(&self) -> &[u32] {
        &self.probe.star.vertices
    }

    /// The vertices around the last insertion, or the last look at one.
    pub(crate) fn reached(&self) -> &[u32] {
        &self.probe.cavity.vertices
    }

    /// The slots of the triangles that the last insertion made.
    pub(crate) fn fan(&self) -> &[u32] {
        &self.fan
    }
}
