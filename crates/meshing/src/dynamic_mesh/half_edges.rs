//! A preferred-directions Delaunay triangulation whose vertices come and go.
//!
//! Adrian Bowyer, "Computing Dirichlet tessellations", 1981, and David F. Watson, "Computing the
//! n-dimensional Delaunay tessellation", 1981, insert a point by replacing the triangles whose
//! circles hold it, the cavity, by a fan around it. Removal is the reverse: the star of the vertex
//! is replaced by the triangulation of its boundary. As the preferred directions leave no tie, a
//! vertex that is removed and inserted at its old place gives the same triangles again, whatever
//! lies in between. Both cost time in the number of triangles that change, some six.

use crate::image::Point;
use crate::triangulation::hole::HoleTriangle;
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{Face, NONE, next, previous, smallest_first};

/// Stands for the half-edges opposite to those on the edge of a patch.
pub(crate) const FENCE: u32 = NONE - 1;

/// A triangulation in arrays of half-edges, with holes where triangles and vertices are gone.
///
/// Slot `t` has the half-edges `3t`, `3t + 1`, `3t + 2`, counter-clockwise; a slot that is free has
/// [`NONE`] as origins. Vertices keep their numbers; one that is out of the mesh has no outgoing
/// half-edge.
#[derive(Clone)]
pub(crate) struct DynamicTriangulation {
    /// Place of each vertex, `0..width` by `0..height`.
    pub(crate) points: Vec<Point>,
    /// Vertex at which each half-edge begins.
    pub(crate) origins: Vec<u32>,
    /// The opposite half-edge of each, [`NONE`] on the border, [`FENCE`] where a patch ends.
    pub(crate) twins: Vec<u32>,
    /// A half-edge that begins at each vertex; on the border the one with no twin.
    pub(crate) outgoing: Vec<u32>,
    /// Slots that are free.
    pub(super) free: Vec<u32>,
    /// The last column.
    pub(super) right: i32,
    /// The last row.
    pub(super) top: i32,
}

/// A ring of edges around a vertex or a place, counter-clockwise, and the triangles inside; keeps
/// its memory from one to the next.
#[derive(Clone, Default)]
pub(crate) struct Ring {
    /// The slots of the triangles inside.
    pub(crate) triangles: Vec<u32>,
    /// The vertices. An open ring, of a vertex on the border, has one more than edges.
    pub(crate) vertices: Vec<u32>,
    /// The half-edge beyond the edge from each vertex to the next.
    pub(crate) beyond: Vec<u32>,
    /// Half-edges still to be looked beyond, while a cavity grows.
    pending: Vec<u32>,
    /// For each triangle of a fill the places that its last side joins, and the half-edge that it
    /// is, in ascending order.
    bases: Vec<(u32, u32, u32)>,
}

impl Ring {
    fn clear(&mut self) {
        self.triangles.clear();
        self.vertices.clear();
        self.beyond.clear();
    }

    /// Notes the last sides of the triangles that fill the ring, which take its slots in order.
    fn link_inner_sides(&mut self, fill: &[HoleTriangle]) {
        self.bases.clear();
        let slots = fill.iter().zip(&self.triangles);
        self.bases.extend(slots.map(|(triangle, &slot)| (triangle[0], triangle[2], 3 * slot + 2)));
        self.bases.sort_unstable();
    }

    /// The half-edge noted that joins two places.
    fn base_beyond(&self, from: u32, to: u32) -> u32 {
        let found = self.bases.binary_search_by_key(&(from, to), |base| (base.0, base.1));
        found.map_or(NONE, |place| self.bases[place].2)
    }

    /// Tells whether beyond the ring a patch ends.
    pub(crate) fn is_fenced(&self) -> bool {
        self.beyond.contains(&FENCE)
    }

    /// The ends of each edge.
    pub(crate) fn edges(&self) -> impl Iterator<Item = (u32, u32)> {
        let ends = self.vertices.iter().skip(1).chain(&self.vertices[..1]);
        self.vertices.iter().copied().zip(ends.copied()).take(self.beyond.len())
    }
}

impl DynamicTriangulation {
    /// The triangulation of an image of `width` columns and `height` rows that these faces make.
    pub(crate) fn new(points: Vec<Point>, faces: &[Face], width: usize, height: usize) -> Self {
        let origins = faces.concat();
        let ends = |h: u32| (origins[h as usize], origins[next(h) as usize]);
        // The half-edges by the vertices at which they begin.
        let mut starts = vec![0u32; points.len() + 1];
        origins.iter().for_each(|&v| starts[v as usize] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::take(start);
            *start = sum;
        }
        let mut by_origin = vec![0; origins.len()];
        for (h, &v) in (0..).zip(&origins) {
            starts[v as usize] -= 1;
            by_origin[starts[v as usize] as usize] = h;
        }
        let opposite = |h: u32| {
            let (from, to) = ends(h);
            let from_end =
                &by_origin[starts[to as usize] as usize..starts[to as usize + 1] as usize];
            from_end.iter().copied().find(|&h| ends(h).1 == from).unwrap_or(NONE)
        };
        let twins = (0..origins.len() as u32).map(opposite).collect();
        let outgoing = vec![NONE; points.len()];
        let (right, top) = (width as i32 - 1, height as i32 - 1);
        let mut made = Self { points, origins, twins, outgoing, free: Vec::new(), right, top };
        for h in 0..made.origins.len() as u32 {
            made.note_outgoing(h);
        }
        made
    }

    /// Number of slots, the free ones counted.
    pub(crate) fn slot_count(&self) -> usize {
        self.origins.len() / 3
    }

    /// Tells whether a slot holds a triangle.
    pub(crate) fn is_used(&self, slot: u32) -> bool {
        self.origins[3 * slot as usize] != NONE
    }

    /// The places of a triangle's vertices.
    #[inline]
    pub(crate) fn corners(&self, slot: u32) -> [Point; 3] {
        self.vertices_of(slot).map(|v| self.points[v as usize])
    }

    /// The faces that a vertex at `place` has when it takes the place of the triangles of a ring.
    pub(crate) fn fan_around(&self, place: Point, ring: &Ring) -> impl Iterator<Item = [Point; 3]> {
        let at = |v: u32| self.points[v as usize];
        ring.edges().map(move |(from, to)| [at(from), at(to), place])
    }

    /// A triangle's vertices.
    #[inline]
    pub(crate) fn vertices_of(&self, slot: u32) -> Face {
        let first = 3 * slot as usize;
        [self.origins[first], self.origins[first + 1], self.origins[first + 2]]
    }

    /// Tells whether a point lies on the border of the image.
    #[inline]
    pub(crate) fn is_on_border(&self, Point { x, y }: Point) -> bool {
        x == 0 || y == 0 || x == self.right || y == self.top
    }

    /// Tells whether a point is a corner of the image.
    #[inline]
    pub(crate) fn is_corner(&self, Point { x, y }: Point) -> bool {
        (x == 0 || x == self.right) && (y == 0 || y == self.top)
    }

    /// Tells whether a point lies in the image.
    #[inline]
    pub(crate) fn holds(&self, Point { x, y }: Point) -> bool {
        (0..=self.right).contains(&x) && (0..=self.top).contains(&y)
    }

    /// Gathers the triangles around a vertex of the mesh.
    pub(crate) fn star(&self, vertex: u32, ring: &mut Ring) {
        ring.clear();
        let first = self.outgoing[vertex as usize];
        let mut spoke = first;
        loop {
            let side = next(spoke);
            ring.triangles.push(spoke / 3);
            ring.vertices.push(self.origins[side as usize]);
            ring.beyond.push(self.twins[side as usize]);
            let incoming = previous(spoke);
            spoke = self.twins[incoming as usize];
            if spoke == first {
                return;
            }
            if spoke == NONE {
                ring.vertices.push(self.origins[incoming as usize]);
                return;
            }
        }
    }

    /// Takes a vertex out and fills its hole; `ring` is its [`star`](Self::star) and `fill` the
    /// triangulation of the ring's vertices. The triangles of the fill take the first slots of the
    /// star, in order.
    pub(crate) fn remove(&mut self, vertex: u32, ring: &mut Ring, fill: &[HoleTriangle]) {
        for (triangle, &slot) in fill.iter().zip(&ring.triangles) {
            for (h, &place) in (3 * slot..).zip(triangle) {
                self.origins[h as usize] = ring.vertices[place as usize];
            }
        }
        ring.link_inner_sides(fill);
        for (triangle, &slot) in fill.iter().zip(&ring.triangles) {
            let [first, second, third] = *triangle;
            for (h, from, to) in [(3 * slot, first, second), (3 * slot + 1, second, third)] {
                let opposite = if to == from + 1 {
                    ring.beyond[from as usize]
                } else {
                    ring.base_beyond(from, to)
                };
                self.connect(h, opposite);
            }
            if third - first == ring.vertices.len() as u32 - 1 {
                // An open ring has no edge from its last vertex to its first: there the border is.
                self.connect(
                    3 * slot + 2,
                    ring.beyond.get(third as usize).copied().unwrap_or(NONE),
                );
            }
        }
        for triangle in 0..fill.len() {
            self.note_outgoing(3 * ring.triangles[triangle] + 2);
        }
        for &slot in &ring.triangles[fill.len()..] {
            self.origins[3 * slot as usize..][..3].fill(NONE);
            self.free.push(slot);
        }
        self.outgoing[vertex as usize] = NONE;
    }

    /// The triangle that holds `place`, found by walking from `slot`; on an edge one of both.
    pub(crate) fn locate(&self, place: Point, slot: u32) -> u32 {
        self.locate_in_patch(place, slot).unwrap_or(slot)
    }

    /// The same; `None` where the walk leaves the patch that this is.
    pub(crate) fn locate_in_patch(&self, place: Point, slot: u32) -> Option<u32> {
        let mut h = 3 * slot;
        let mut seen = 0;
        // In a Delaunay triangulation the walk passes no triangle twice.
        while seen < 3 {
            let [a, b] = [h, next(h)].map(|h| self.points[self.origins[h as usize] as usize]);
            if orientation(a, b, place) < 0 {
                h = self.twins[h as usize];
                if h == FENCE {
                    return None;
                }
                seen = 0;
            }
            h = next(h);
            seen += 1;
        }
        Some(h / 3)
    }

    /// Gathers the triangles that `place`, which is no vertex, would replace: `slot` holds it.
    ///
    /// The circle of each holds the place. They are connected and hold no vertex inside, so each is
    /// reached over one edge only. On the border the ring is open.
    pub(crate) fn cavity(&self, place: Point, slot: u32, ring: &mut Ring) {
        ring.clear();
        ring.triangles.push(slot);
        ring.pending.extend([3 * slot + 2, 3 * slot + 1, 3 * slot]);
        let mut opening = None;
        while let Some(h) = ring.pending.pop() {
            let twin = self.twins[h as usize];
            let ends = [h, next(h)].map(|h| self.origins[h as usize]);
            if twin == NONE {
                let [a, b] = ends.map(|v| self.points[v as usize]);
                if orientation(a, b, place) == 0 {
                    opening = Some((ring.vertices.len(), ends[0]));
                    continue;
                }
            } else if twin != FENCE {
                let [a, b, c] = self.corners(twin / 3);
                if in_circle(a, b, c, place) {
                    ring.triangles.push(twin / 3);
                    ring.pending.extend([previous(twin), next(twin)]);
                    continue;
                }
            }
            ring.vertices.push(ends[0]);
            ring.beyond.push(twin);
        }
        if let Some((gap, last)) = opening {
            ring.vertices.rotate_left(gap);
            ring.beyond.rotate_left(gap);
            ring.vertices.push(last);
        }
    }

    /// Puts a vertex that is out of the mesh at a place whose [`cavity`](Self::cavity) `ring` is,
    /// and pushes the slots of the fan's triangles, in the order of the ring's edges, to `fan`.
    pub(crate) fn insert(&mut self, vertex: u32, place: Point, ring: &Ring, fan: &mut Vec<u32>) {
        self.points[vertex as usize] = place;
        fan.clear();
        fan.extend(&ring.triangles);
        while fan.len() < ring.beyond.len() {
            fan.push(self.free_slot());
        }
        for ((from, to), &slot) in ring.edges().zip(fan.iter()) {
            self.origins[3 * slot as usize..][..3].copy_from_slice(&[from, to, vertex]);
        }
        let closed = ring.vertices.len() == ring.beyond.len();
        for (i, (&beyond, &slot)) in ring.beyond.iter().zip(fan.iter()).enumerate() {
            self.connect(3 * slot, beyond);
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

    /// Undoes the last change, which took a vertex out: `ring` is its star and `fill_count` the number
    /// of triangles of the fill. `fan` becomes the slots of the star.
    pub(crate) fn put_back(
        &mut self,
        vertex: u32,
        ring: &Ring,
        fill_count: usize,
        fan: &mut Vec<u32>,
    ) {
        let freed = ring.triangles.len() - fill_count;
        self.free.truncate(self.free.len() - freed);
        self.insert(vertex, self.points[vertex as usize], ring, fan);
    }

    /// Makes one more vertex, which is out of the mesh, and tells its number.
    pub(crate) fn add_vertex(&mut self, place: Point) -> u32 {
        self.points.push(place);
        self.outgoing.push(NONE);
        self.points.len() as u32 - 1
    }

    /// A slot for one more triangle.
    pub(super) fn free_slot(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.origins.extend([NONE; 3]);
            self.twins.extend([NONE; 3]);
            self.slot_count() as u32 - 1
        })
    }

    /// Makes two half-edges opposite, and the first of them the way out of its vertex where it may
    /// be.
    fn connect(&mut self, h: u32, opposite: u32) {
        self.twins[h as usize] = opposite;
        if opposite != NONE {
            self.twins[opposite as usize] = h;
        }
        self.note_outgoing(h);
    }

    /// Makes a half-edge the way out of its vertex, unless that lies on the border and the
    /// half-edge does not.
    fn note_outgoing(&mut self, h: u32) {
        let origin = self.origins[h as usize] as usize;
        if self.twins[h as usize] == NONE || !self.is_on_border(self.points[origin]) {
            self.outgoing[origin] = h;
        }
    }

    /// Replaces the diagonal `h`, which has a twin, of its quadrilateral by the other one; the
    /// half-edge `h` then ends at what was the apex of its triangle, `next(h)` and the twin's next
    /// one keep their ends.
    pub(crate) fn flip(&mut self, h: u32) {
        let twin = self.twins[h as usize];
        let (from_c, from_d) = (previous(h), previous(twin));
        let (beyond_ca, beyond_db) = (self.twins[from_c as usize], self.twins[from_d as usize]);
        self.origins[h as usize] = self.origins[from_d as usize];
        self.origins[twin as usize] = self.origins[from_c as usize];
        self.connect(h, beyond_db);
        self.connect(twin, beyond_ca);
        self.connect(from_c, from_d);
        for side in [from_d, next(h), next(twin)] {
            self.note_outgoing(side);
        }
    }

    /// The places of the vertices, by row, then column, the faces in ascending order, each
    /// beginning with its smallest vertex, and for each vertex its number here.
    pub(crate) fn mesh(&self) -> (Vec<Point>, Vec<Face>, Vec<u32>) {
        let mut order: Vec<u32> =
            (0..self.points.len() as u32).filter(|&v| self.outgoing[v as usize] != NONE).collect();
        order.sort_unstable_by_key(|&v| self.points[v as usize]);
        let mut numbers = vec![NONE; self.points.len()];
        for (number, &v) in (0..).zip(&order) {
            numbers[v as usize] = number;
        }
        let used = (0..self.slot_count() as u32).filter(|&slot| self.is_used(slot));
        let number = |slot| smallest_first(self.vertices_of(slot).map(|v| numbers[v as usize]));
        let mut faces: Vec<Face> = used.map(number).collect();
        faces.sort_unstable();
        (order.iter().map(|&v| self.points[v as usize]).collect(), faces, order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::corner_points;
    use crate::triangulation::hole::HoleFiller;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn dynamic(points: &BTreeSet<Point>, width: i32, height: i32) -> DynamicTriangulation {
        let sorted: Vec<Point> = points.iter().copied().collect();
        let faces = triangulate(&sorted);
        DynamicTriangulation::new(sorted, &faces, width as usize, height as usize)
    }

    /// The triangles are those of the vertices triangulated afresh, and all links are in order.
    fn assert_triangulated_afresh(triangulation: &DynamicTriangulation) {
        let (points, faces, _) = triangulation.mesh();
        assert_eq!(faces, triangulate(&points));
        let at = |h: u32| triangulation.points[triangulation.origins[h as usize] as usize];
        for h in 0..triangulation.origins.len() as u32 {
            let twin = triangulation.twins[h as usize];
            if triangulation.origins[h as usize] == NONE {
                continue;
            }
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

    /// Takes a vertex out, by the star and the fill of its hole.
    fn remove(triangulation: &mut DynamicTriangulation, vertex: u32) -> u32 {
        let (mut ring, mut filler) = (Ring::default(), HoleFiller::default());
        triangulation.star(vertex, &mut ring);
        let boundary: Vec<Point> =
            ring.vertices.iter().map(|&v| triangulation.points[v as usize]).collect();
        triangulation.remove(vertex, &mut ring, filler.fill(&boundary));
        ring.triangles[0]
    }

    fn insert(triangulation: &mut DynamicTriangulation, vertex: u32, place: Point, hint: u32) {
        let (mut ring, mut fan) = (Ring::default(), Vec::new());
        let slot = triangulation.locate(place, hint);
        triangulation.cavity(place, slot, &mut ring);
        triangulation.insert(vertex, place, &ring, &mut fan);
    }

    proptest! {
        #[test]
        fn moved_vertices_leave_the_triangulation_of_their_places(
            (width, height) in (2i32..9, 2i32..9),
            seeds in prop::collection::vec((0i32..9, 0i32..9), 0..20),
            moves in prop::collection::vec((0usize..30, 0i32..9, 0i32..9), 0..12),
        ) {
            let place = |x: i32, y: i32| Point::new(x % width, y % height);
            let corners = corner_points(width as usize, height as usize);
            let points: BTreeSet<Point> =
                seeds.iter().map(|&(x, y)| place(x, y)).chain(corners).collect();
            let mut triangulation = dynamic(&points, width, height);
            let mut taken = points;
            for (vertex, x, y) in moves {
                let vertex = vertex % triangulation.points.len();
                let (from, to) = (triangulation.points[vertex], place(x, y));
                if triangulation.is_corner(from) {
                    continue;
                }
                let hint = remove(&mut triangulation, vertex as u32);
                assert_triangulated_afresh(&triangulation);
                taken.remove(&from);
                let to = if taken.insert(to) { to } else { from };
                taken.insert(to);
                insert(&mut triangulation, vertex as u32, to, hint);
                assert_triangulated_afresh(&triangulation);
            }
        }
    }
}
