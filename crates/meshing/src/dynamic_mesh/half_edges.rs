//! A preferred-directions Delaunay triangulation whose vertices move, enter and leave.
//!
//! Adrian Bowyer, "Computing Dirichlet tessellations", 1981, and David F. Watson, "Computing the
//! n-dimensional Delaunay tessellation", 1981, insert a point by replacing the triangles whose
//! circles hold it, the cavity, by a fan around it. Removal is the reverse: the triangulation of a
//! vertex's link replaces its star. Preferred directions leave no tie, so a vertex removed and
//! inserted again at its old position has its old triangles. Both take time proportional to the
//! number of triangles that change, six on average.

use crate::control::{Cancelled, Control, Poller, Stage, collect, sort};
use crate::image::Point;
use crate::triangulation::hole::HoleTriangle;
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{Face, NONE, Triangulation, next, previous, smallest_first};

/// Stands for the opposite of a half-edge on the boundary of a patch.
pub(crate) const PATCH_BOUNDARY: u32 = NONE - 1;

/// A triangulation as arrays of half-edges, with an error for each face.
///
/// Slot `t` has the half-edges `3t`, `3t + 1`, `3t + 2`, counter-clockwise; a free slot has
/// [`NONE`] as origins. Vertices keep their indices; one not in the mesh has no outgoing half-edge.
pub(crate) struct DynamicTriangulation {
    pub(crate) points: Vec<Point>,
    pub(crate) origins: Vec<u32>,
    /// The opposite of each half-edge, [`NONE`] on the border, [`PATCH_BOUNDARY`] on a patch's.
    pub(crate) twins: Vec<u32>,
    /// A half-edge that begins at each vertex; on the border of the image the one without twin.
    pub(crate) outgoing: Vec<u32>,
    pub(super) free: Vec<u32>,
    /// Error of each slot's face, 0 of a free slot.
    pub(super) face_errors: Vec<u64>,
    pub(crate) total_error: u64,
    pub(super) right: i32,
    pub(super) top: i32,
}

/// The link of a vertex or the boundary of a cavity, counter-clockwise, with the triangles inside.
#[derive(Default)]
pub(crate) struct Link {
    pub(crate) triangles: Vec<u32>,
    /// The vertices. An open link, that of a vertex on the border, has one vertex more than edges.
    pub(crate) vertices: Vec<u32>,
    /// For each edge its half-edge outside of the polygon.
    pub(crate) outer: Vec<u32>,
    /// Half-edges that the search for a cavity has yet to cross.
    pending: Vec<u32>,
    /// The last side of each triangle of a fill: the indices in the link of its first and its last
    /// vertex, and the half-edge. In ascending order.
    last_sides: Vec<(u32, u32, u32)>,
}

impl Link {
    fn clear(&mut self) {
        self.triangles.clear();
        self.vertices.clear();
        self.outer.clear();
    }

    /// Indexes the last sides of the triangles of a fill, which take the slots inside in order.
    fn index_last_sides(&mut self, fill: &[HoleTriangle]) {
        self.last_sides.clear();
        let slots = fill.iter().zip(&self.triangles);
        let sides = slots.map(|(triangle, &slot)| (triangle[0], triangle[2], 3 * slot + 2));
        self.last_sides.extend(sides);
        self.last_sides.sort_unstable();
    }

    fn last_side(&self, from: u32, to: u32) -> u32 {
        let found = self.last_sides.binary_search_by_key(&(from, to), |side| (side.0, side.1));
        found.map_or(NONE, |i| self.last_sides[i].2)
    }

    /// The slots that the triangles of a fill of the link of a vertex take.
    pub(super) fn fill(&self) -> &[u32] {
        &self.triangles[..self.vertices.len() - 2]
    }

    pub(crate) fn touches_patch_boundary(&self) -> bool {
        self.outer.contains(&PATCH_BOUNDARY)
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.vertices.len() == self.outer.len()
    }

    pub(crate) fn edges(&self) -> impl Iterator<Item = (u32, u32)> {
        let ends = self.vertices.iter().skip(1).chain(&self.vertices[..1]);
        self.vertices.iter().copied().zip(ends.copied()).take(self.outer.len())
    }
}

impl DynamicTriangulation {
    /// A triangulation of an image of `width` columns and `height` rows, with errors of 0.
    pub(crate) fn new(
        triangulation: Triangulation,
        (width, height): (usize, usize),
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let Triangulation { points, origins, twins } = triangulation;
        let (outgoing, face_errors) = (vec![NONE; points.len()], vec![0; origins.len() / 3]);
        let (right, top) = (width as i32 - 1, height as i32 - 1);
        let (free, total_error) = (Vec::new(), 0);
        let mut made =
            Self { points, origins, twins, outgoing, free, face_errors, total_error, right, top };
        let mut poller = Poller::new(control, Stage::Refine, 0, 1);
        for h in 0..made.origins.len() {
            poller.step(1)?;
            made.offer_outgoing(h as u32);
        }
        Ok(made)
    }

    pub(crate) fn copy(&self, control: &dyn Control) -> Result<Self, Cancelled> {
        let poll = || control.poll(Stage::Refine, 0, 1);
        Ok(Self {
            points: collect(self.points.iter().copied(), poll)?,
            origins: collect(self.origins.iter().copied(), poll)?,
            twins: collect(self.twins.iter().copied(), poll)?,
            outgoing: collect(self.outgoing.iter().copied(), poll)?,
            free: collect(self.free.iter().copied(), poll)?,
            face_errors: collect(self.face_errors.iter().copied(), poll)?,
            ..*self
        })
    }

    pub(crate) fn size(&self) -> (usize, usize) {
        (self.right as usize + 1, self.top as usize + 1)
    }

    pub(crate) fn slot_count(&self) -> usize {
        self.origins.len() / 3
    }

    pub(crate) fn vertex_count(&self) -> usize {
        self.outgoing.iter().filter(|&&h| h != NONE).count()
    }

    /// Whether a vertex may be moved or removed: it is in the mesh and no corner of the image.
    pub(crate) fn is_movable(&self, vertex: u32) -> bool {
        self.outgoing[vertex as usize] != NONE && !self.is_corner(self.points[vertex as usize])
    }

    #[inline]
    pub(crate) fn face_error(&self, slot: u32) -> u64 {
        self.face_errors[slot as usize]
    }

    pub(crate) fn error_of(&self, slots: &[u32]) -> u64 {
        slots.iter().map(|&slot| self.face_error(slot)).sum()
    }

    /// Sets the error of a slot's face. The sum of all wraps around while some are `u64::MAX`.
    pub(crate) fn set_face_error(&mut self, slot: u32, error: u64) {
        let before = std::mem::replace(&mut self.face_errors[slot as usize], error);
        self.total_error = self.total_error.wrapping_sub(before).wrapping_add(error);
    }

    pub(crate) fn is_used(&self, slot: u32) -> bool {
        self.origins[3 * slot as usize] != NONE
    }

    #[inline]
    pub(crate) fn corners(&self, slot: u32) -> [Point; 3] {
        self.vertices_of(slot).map(|v| self.points[v as usize])
    }

    #[inline]
    pub(crate) fn vertices_of(&self, slot: u32) -> Face {
        let first = 3 * slot as usize;
        [self.origins[first], self.origins[first + 1], self.origins[first + 2]]
    }

    #[inline]
    pub(crate) fn is_on_border(&self, Point { x, y }: Point) -> bool {
        x == 0 || y == 0 || x == self.right || y == self.top
    }

    #[inline]
    pub(crate) fn is_corner(&self, Point { x, y }: Point) -> bool {
        (x == 0 || x == self.right) && (y == 0 || y == self.top)
    }

    #[inline]
    pub(crate) fn holds(&self, Point { x, y }: Point) -> bool {
        (0..=self.right).contains(&x) && (0..=self.top).contains(&y)
    }

    pub(crate) fn star(&self, vertex: u32, star: &mut Link) {
        star.clear();
        let first = self.outgoing[vertex as usize];
        let mut h = first;
        loop {
            let side = next(h);
            star.triangles.push(h / 3);
            star.vertices.push(self.origins[side as usize]);
            star.outer.push(self.twins[side as usize]);
            let incoming = previous(h);
            h = self.twins[incoming as usize];
            if h == first {
                return;
            }
            if h == NONE {
                star.vertices.push(self.origins[incoming as usize]);
                return;
            }
        }
    }

    /// Removes a vertex; `star` is its [`star`](Self::star) and `fill` triangulates the link, with
    /// these errors. The triangles of the fill take the first slots of the star, in order.
    pub(crate) fn remove(
        &mut self,
        vertex: u32,
        star: &mut Link,
        fill: &[HoleTriangle],
        errors: &[u64],
    ) {
        for (triangle, &slot) in fill.iter().zip(&star.triangles) {
            for (h, &i) in (3 * slot..).zip(triangle) {
                self.origins[h as usize] = star.vertices[i as usize];
            }
        }
        star.index_last_sides(fill);
        for (triangle, &slot) in fill.iter().zip(&star.triangles) {
            let [first, second, third] = *triangle;
            for (h, from, to) in [(3 * slot, first, second), (3 * slot + 1, second, third)] {
                let is_link_edge = to == from + 1;
                let opposite =
                    if is_link_edge { star.outer[from as usize] } else { star.last_side(from, to) };
                self.connect(h, opposite);
            }
            if third - first == star.vertices.len() as u32 - 1 {
                // An open link has no edge from its last vertex to its first: there the border is.
                let opposite = star.outer.get(third as usize).copied().unwrap_or(NONE);
                self.connect(3 * slot + 2, opposite);
            }
        }
        let (filled, freed) = star.triangles.split_at(fill.len());
        for (&slot, &error) in filled.iter().zip(errors) {
            self.offer_outgoing(3 * slot + 2);
            self.set_face_error(slot, error);
        }
        freed.iter().for_each(|&slot| self.free(slot));
        self.outgoing[vertex as usize] = NONE;
    }

    /// The triangle that contains a position of the image, found by walking from `slot`; on an edge
    /// one of both. `None` where the walk leaves the patch that this is.
    pub(crate) fn locate(&self, at: Point, slot: u32) -> Option<u32> {
        let mut h = 3 * slot;
        let mut sides_passed = 0;
        // In a Delaunay triangulation the walk visits no triangle twice.
        while sides_passed < 3 {
            let [a, b] = [h, next(h)].map(|h| self.points[self.origins[h as usize] as usize]);
            if orientation(a, b, at) < 0 {
                h = self.twins[h as usize];
                if h == PATCH_BOUNDARY {
                    return None;
                }
                sides_passed = 0;
            }
            h = next(h);
            sides_passed += 1;
        }
        Some(h / 3)
    }

    /// Gathers the cavity of a position in `slot`: the triangles whose circumcircles contain it.
    ///
    /// They are connected and have no vertex inside, so each is reached over one edge only. At the
    /// border of the image the link is open.
    pub(crate) fn cavity(&self, at: Point, slot: u32, cavity: &mut Link) {
        cavity.clear();
        cavity.triangles.push(slot);
        cavity.pending.extend([3 * slot + 2, 3 * slot + 1, 3 * slot]);
        let mut opening = None;
        while let Some(h) = cavity.pending.pop() {
            let twin = self.twins[h as usize];
            let ends = [h, next(h)].map(|h| self.origins[h as usize]);
            if twin == NONE {
                let [a, b] = ends.map(|v| self.points[v as usize]);
                if orientation(a, b, at) == 0 {
                    opening = Some((cavity.vertices.len(), ends[0]));
                    continue;
                }
            } else if twin != PATCH_BOUNDARY {
                let [a, b, c] = self.corners(twin / 3);
                if in_circle(a, b, c, at) {
                    cavity.triangles.push(twin / 3);
                    cavity.pending.extend([previous(twin), next(twin)]);
                    continue;
                }
            }
            cavity.vertices.push(ends[0]);
            cavity.outer.push(twin);
        }
        if let Some((start, last)) = opening {
            cavity.vertices.rotate_left(start);
            cavity.outer.rotate_left(start);
            cavity.vertices.push(last);
        }
    }

    /// Inserts a vertex that is not in the mesh at a position with this [`cavity`](Self::cavity).
    /// `fan` becomes the slots of its triangles, in the order of the link's edges and of `errors`.
    pub(super) fn insert(
        &mut self,
        vertex: u32,
        at: Point,
        cavity: &Link,
        errors: &[u64],
        fan: &mut Vec<u32>,
    ) {
        self.points[vertex as usize] = at;
        fan.clear();
        fan.extend(&cavity.triangles);
        while fan.len() < cavity.outer.len() {
            fan.push(self.free_slot());
        }
        for (((from, to), &slot), &error) in cavity.edges().zip(fan.iter()).zip(errors) {
            self.origins[3 * slot as usize..][..3].copy_from_slice(&[from, to, vertex]);
            self.set_face_error(slot, error);
        }
        let closed = cavity.is_closed();
        for (i, (&outer, &slot)) in cavity.outer.iter().zip(fan.iter()).enumerate() {
            self.connect(3 * slot, outer);
            let following = match fan.get(i + 1) {
                Some(&following) => 3 * following + 2,
                None if closed => 3 * fan[0] + 2,
                None => NONE,
            };
            self.connect(3 * slot + 1, following);
        }
        if !closed {
            self.connect(3 * fan[0] + 2, NONE);
        }
        self.outgoing[vertex as usize] = 3 * fan[0] + 2;
    }

    pub(super) fn free_slot(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.origins.extend([NONE; 3]);
            self.twins.extend([NONE; 3]);
            self.face_errors.push(0);
            self.slot_count() as u32 - 1
        })
    }

    pub(super) fn free(&mut self, slot: u32) {
        self.origins[3 * slot as usize..][..3].fill(NONE);
        self.set_face_error(slot, 0);
        self.free.push(slot);
    }

    /// Makes two half-edges opposite, and offers the first as the outgoing one of its vertex.
    fn connect(&mut self, h: u32, opposite: u32) {
        self.twins[h as usize] = opposite;
        if opposite != NONE {
            self.twins[opposite as usize] = h;
        }
        self.offer_outgoing(h);
    }

    /// Makes a half-edge the outgoing one of its vertex, unless the vertex is on the border of the
    /// image and the half-edge is not.
    fn offer_outgoing(&mut self, h: u32) {
        let origin = self.origins[h as usize] as usize;
        if self.twins[h as usize] == NONE || !self.is_on_border(self.points[origin]) {
            self.outgoing[origin] = h;
        }
    }

    /// Replaces the diagonal `h`, which has a twin, of its quadrilateral by the other one. `h` then
    /// ends at the former apex of its triangle; `next(h)` and that of the twin keep their ends.
    pub(crate) fn flip(&mut self, h: u32) {
        let twin = self.twins[h as usize];
        let (from_c, from_d) = (previous(h), previous(twin));
        let (outer_ca, outer_db) = (self.twins[from_c as usize], self.twins[from_d as usize]);
        self.origins[h as usize] = self.origins[from_d as usize];
        self.origins[twin as usize] = self.origins[from_c as usize];
        self.connect(h, outer_db);
        self.connect(twin, outer_ca);
        self.connect(from_c, from_d);
        for side in [from_d, next(h), next(twin)] {
            self.offer_outgoing(side);
        }
    }

    pub(crate) fn sorted(&self, control: &dyn Control) -> Result<SortedMesh, Cancelled> {
        let in_mesh = (0..).zip(&self.points).zip(&self.outgoing).filter(|(_, h)| **h != NONE);
        let mut vertices: Vec<(Point, u32)> = in_mesh.map(|((v, &p), _)| (p, v)).collect();
        sort(&mut vertices, &|| control.poll(Stage::Refine, 0, 1))?;
        let mut ranks = vec![NONE; self.points.len()];
        for (rank, &(_, v)) in (0..).zip(&vertices) {
            ranks[v as usize] = rank;
        }
        let used = (0..self.slot_count() as u32).filter(|&slot| self.is_used(slot));
        let ranked = used.map(|slot| self.vertices_of(slot).map(|v| ranks[v as usize]));
        let mut faces: Vec<Face> = ranked.map(smallest_first).collect();
        sort(&mut faces, &|| control.poll(Stage::Refine, 0, 1))?;
        let (points, order) = vertices.into_iter().unzip();
        Ok(SortedMesh { points, faces, order })
    }
}

/// The vertices of a mesh by row, then column, and its faces.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct SortedMesh {
    pub(crate) points: Vec<Point>,
    /// The faces, each beginning with its smallest vertex, in ascending order.
    pub(crate) faces: Vec<Face>,
    /// The index of each vertex in the [`DynamicTriangulation`].
    pub(crate) order: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::image::corner_points;
    use crate::triangulation::hole::HoleFiller;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn dynamic(points: &BTreeSet<Point>, width: i32, height: i32) -> DynamicTriangulation {
        let sorted: Vec<Point> = points.iter().copied().collect();
        let triangulation = Triangulation::new(sorted, &()).unwrap();
        DynamicTriangulation::new(triangulation, (width as usize, height as usize), &()).unwrap()
    }

    /// The triangles are those of a new triangulation, and twins and outgoing half-edges match.
    fn assert_consistent(triangulation: &DynamicTriangulation) {
        let SortedMesh { points, faces, .. } = triangulation.sorted(&()).unwrap();
        assert_eq!(faces, triangulate(&points));
        assert_eq!(triangulation.total_error, faces.len() as u64);
        let at = |h: u32| triangulation.points[triangulation.origins[h as usize] as usize];
        let used = |h: &u32| triangulation.is_used(h / 3);
        for h in (0..triangulation.origins.len() as u32).filter(used) {
            let twin = triangulation.twins[h as usize];
            if twin == NONE {
                assert!([at(h), at(next(h))].iter().all(|&p| triangulation.is_on_border(p)));
            } else {
                assert_eq!(triangulation.twins[twin as usize], h);
                assert_eq!([at(twin), at(next(twin))], [at(next(h)), at(h)]);
            }
        }
        for (v, &h) in triangulation.outgoing.iter().enumerate().filter(|(_, h)| **h != NONE) {
            assert_eq!(triangulation.origins[h as usize] as usize, v);
            let on_border = triangulation.is_on_border(triangulation.points[v]);
            assert_eq!(triangulation.twins[h as usize] == NONE, on_border);
        }
    }

    fn remove(triangulation: &mut DynamicTriangulation, vertex: u32) -> u32 {
        let (mut star, mut filler) = (Link::default(), HoleFiller::default());
        triangulation.star(vertex, &mut star);
        let boundary: Vec<Point> =
            star.vertices.iter().map(|&v| triangulation.points[v as usize]).collect();
        let fill = filler.fill(&boundary);
        triangulation.remove(vertex, &mut star, fill, &vec![1; fill.len()]);
        star.triangles[0]
    }

    fn insert(triangulation: &mut DynamicTriangulation, vertex: u32, at: Point, hint: u32) {
        let (mut cavity, mut fan) = (Link::default(), Vec::new());
        let slot = triangulation.locate(at, hint).unwrap();
        triangulation.cavity(at, slot, &mut cavity);
        triangulation.insert(vertex, at, &cavity, &vec![1; cavity.outer.len()], &mut fan);
    }

    proptest! {
        #[test]
        fn moves_equal_a_new_triangulation(
            (width, height) in (2i32..9, 2i32..9),
            seeds in prop::collection::vec((0i32..9, 0i32..9), 0..20),
            moves in prop::collection::vec((0usize..30, 0i32..9, 0i32..9), 0..12),
        ) {
            let point = |x: i32, y: i32| Point::new(x % width, y % height);
            let corners = corner_points(width as usize, height as usize);
            let mut taken: BTreeSet<Point> =
                seeds.iter().map(|&(x, y)| point(x, y)).chain(corners).collect();
            let mut triangulation = dynamic(&taken, width, height);
            for slot in 0..triangulation.slot_count() as u32 {
                triangulation.set_face_error(slot, 1);
            }
            for (vertex, x, y) in moves {
                let vertex = vertex % triangulation.points.len();
                let (from, to) = (triangulation.points[vertex], point(x, y));
                if triangulation.is_corner(from) {
                    continue;
                }
                let hint = remove(&mut triangulation, vertex as u32);
                assert_consistent(&triangulation);
                taken.remove(&from);
                let to = if taken.insert(to) { to } else { from };
                taken.insert(to);
                insert(&mut triangulation, vertex as u32, to, hint);
                assert_consistent(&triangulation);
            }
        }
    }

    #[test]
    fn polls_after_each_65536_items() {
        let side = 160;
        let lattice = (0..side).flat_map(|y| (0..side).map(move |x| Point::new(x, y)));
        let whole = dynamic(&lattice.collect(), side, side);
        let steps = whole.origins.len() / crate::control::POINTS_PER_POLL;
        assert!(steps >= 2);
        let copied = Recorder::default();
        let sorted = whole.copy(&copied).unwrap().sorted(&()).unwrap();
        assert_eq!(sorted.points, whole.points);
        assert!(copied.reports().len() >= 2 * steps);
    }
}
