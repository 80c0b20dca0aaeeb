//! The hole that a removed vertex leaves, and the triangles that fill it.
//!
//! Removing a vertex of a preferred-directions Delaunay triangulation changes only the triangles at
//! that vertex, and the hole is filled by the triangulation of its boundary. The fill is found
//! without touching the mesh: the triangle at one edge of the boundary has as its third vertex the
//! one whose circle through the edge holds no other; it splits the rest of the boundary in two,
//! each filled in the same way. A hole has six vertices on average.
//!
//! [`fill_small`] fills holes of up to [`MOST_SMALL`] points in arrays of fixed size. It takes
//! quadratic time where the triangles make a fan, so larger holes are split at their middle edge,
//! as lists. The test `arrays_and_lists_fill_alike` ties the two.

use crate::image::Point;
use crate::triangulation::predicates::{in_circle, product};

/// A triangle of the fill: indices of points of the boundary, counter-clockwise and ascending.
///
/// Its side from the last to the first is an edge of the fill, but for one at the last edge.
pub(crate) type HoleTriangle = [u32; 3];

pub(crate) const MOST_SMALL: usize = MOST_TRIANGLES + 2;
pub(crate) const MOST_TRIANGLES: usize = 8;

/// The capacity of its boundary, a power of two: indices are masked instead of checked.
pub(crate) const CAPACITY: usize = 16;

#[derive(Default)]
pub(crate) struct HoleFiller {
    /// Indices of the boundaries that remain of a large hole, one after the other.
    rings: Vec<u32>,
    ring_starts: Vec<usize>,
    pub(crate) triangles: Vec<HoleTriangle>,
}

impl HoleFiller {
    /// The triangles that fill the hole of a boundary of three points or more, counter-clockwise.
    pub(crate) fn fill(&mut self, boundary: &[Point]) -> &[HoleTriangle] {
        self.triangles.clear();
        if boundary.len() <= MOST_SMALL {
            let mut points = [Point::new(0, 0); CAPACITY];
            points[..boundary.len()].copy_from_slice(boundary);
            let triangles = fill_small(&points, boundary.len());
            let found = &triangles[..boundary.len() - 2];
            self.triangles.extend(found.iter().map(|triangle| triangle.map(u32::from)));
        } else {
            self.split_at_middle_edges(boundary);
        }
        &self.triangles
    }

    /// Finds the triangle at the middle edge of each boundary that remains.
    fn split_at_middle_edges(&mut self, boundary: &[Point]) {
        self.rings.clear();
        self.rings.extend(0..boundary.len() as u32);
        self.ring_starts.push(0);
        while let Some(start) = self.ring_starts.pop() {
            let ring = self.rings.split_off(start);
            let middle = ring.len() / 2;
            let (from, to) = (ring[middle - 1], ring[middle]);
            let edge = (boundary[from as usize], boundary[to as usize]);
            let candidates = (middle + 1..ring.len()).chain(0..middle - 1);
            let apex = apex(edge, candidates.map(|at| (at, boundary[ring[at] as usize])));
            let mut corners = [from, to, ring[apex]];
            corners.sort_unstable();
            self.triangles.push(corners);
            if apex > middle {
                self.push_ring(&ring[middle..=apex], &[]);
                self.push_ring(&ring[..middle], &ring[apex..]);
            } else {
                self.push_ring(&ring[apex..middle], &[]);
                self.push_ring(&ring[..=apex], &ring[middle..]);
            }
        }
    }

    /// Keeps a boundary that remains, when it has an inside.
    fn push_ring(&mut self, first: &[u32], second: &[u32]) {
        if first.len() + second.len() > 2 {
            self.ring_starts.push(self.rings.len());
            self.rings.extend(first.iter().chain(second));
        }
    }
}

/// The triangles, two fewer than points, that fill the hole of the first `count` points, which are
/// at least three and at most [`MOST_SMALL`].
#[inline]
pub(crate) fn fill_small(points: &[Point; CAPACITY], count: usize) -> [[u8; 3]; MOST_TRIANGLES] {
    debug_assert!((3..=MOST_SMALL).contains(&count), "{count} points");
    let mut fill = SmallFill {
        points,
        triangles: [[0; 3]; MOST_TRIANGLES],
        found: 0,
        open: [(0, 0); MOST_TRIANGLES],
        open_count: 0,
    };
    fill.split(0, count - 1);
    while fill.open_count > 0 {
        fill.open_count -= 1;
        let (from, to) = fill.open[fill.open_count % MOST_TRIANGLES];
        let edge = (points[to % CAPACITY], points[from % CAPACITY]);
        let between = (from + 1..to).map(|at| (at, points[at % CAPACITY]));
        let apex = apex(edge, between);
        fill.push([from, apex, to]);
        fill.split(apex, to);
        fill.split(from, apex);
    }
    fill.triangles
}

struct SmallFill<'a> {
    points: &'a [Point; CAPACITY],
    triangles: [[u8; 3]; MOST_TRIANGLES],
    found: usize,
    /// The first and the last index of each part of the boundary that is still to be filled.
    open: [(usize, usize); MOST_TRIANGLES],
    open_count: usize,
}

impl SmallFill<'_> {
    /// Fills a part of the boundary of three or four points; keeps a larger one for later.
    #[inline(always)]
    fn split(&mut self, from: usize, to: usize) {
        match to - from {
            0 | 1 => {}
            2 => self.push([from, from + 1, to]),
            3 => self.fill_quadrilateral([from, from + 1, from + 2, to]),
            _ => {
                self.open[self.open_count % MOST_TRIANGLES] = (from, to);
                self.open_count += 1;
            }
        }
    }

    /// Fills a quadrilateral, convex or not. Lifted to the paraboloid, its points are those of a
    /// tetrahedron, whose lower side is the fill; the in-circle determinant decides which it is.
    #[inline(always)]
    fn fill_quadrilateral(&mut self, [a, b, c, d]: [usize; 4]) {
        let [pa, pb, pc, pd] = [a, b, c, d].map(|at| self.points[at % CAPACITY]);
        let is_inside = in_circle(pa, pb, pc, pd);
        let select = |inside, outside| if is_inside { inside } else { outside };
        self.push([a, select(b, c), d]);
        self.push([select(b, a), select(c, b), select(d, c)]);
    }

    #[inline(always)]
    fn push(&mut self, corners: [usize; 3]) {
        debug_assert!(self.found < MOST_TRIANGLES);
        self.triangles[self.found % MOST_TRIANGLES] = corners.map(|at| at as u8);
        self.found += 1;
    }
}

/// The index of the point, of candidates with their indices, that makes the triangle of the
/// triangulation with the edge from `a` to `b`: left of that edge, with no other one in its circle.
///
/// That is the point that sees the edge under the largest angle. Angles are compared by their
/// cotangents, fractions computed once for each point; preferred directions decide equal ones.
#[inline(always)]
fn apex((a, b): (Point, Point), candidates: impl Iterator<Item = (usize, Point)>) -> usize {
    let (mut best, mut best_point, mut best_dot, mut best_cross) = (0, a, 1, 0);
    for (index, c) in candidates {
        let (ax, ay) = (i64::from(a.x - c.x), i64::from(a.y - c.y));
        let (bx, by) = (i64::from(b.x - c.x), i64::from(b.y - c.y));
        let (dot, cross) = (ax * bx + ay * by, ax * by - ay * bx);
        let (this, other) = (product(dot, best_cross), product(best_dot, cross));
        let mut is_better = (this < other) & (cross > 0);
        if this == other && cross > 0 {
            is_better = in_circle(a, b, best_point, c);
        }
        best = if is_better { index } else { best };
        best_point = if is_better { c } else { best_point };
        best_dot = if is_better { dot } else { best_dot };
        best_cross = if is_better { cross } else { best_cross };
    }
    // The inside of a boundary is left of each of its edges, so there is such a point.
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triangulation::predicates::orientation;
    use crate::triangulation::triangulate;

    #[test]
    fn cuts_a_square_along_the_preferred_direction() {
        let square = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| Point::new(x, y));
        for rotation in 0..4 {
            let mut boundary = square;
            boundary.rotate_left(rotation);
            let mut filler = HoleFiller::default();
            let triangles = filler.fill(&boundary);
            assert_eq!(triangles.len(), 2);
            for triangle in triangles {
                let corners = triangle.map(|at| boundary[at as usize]);
                assert!(corners.contains(&square[0]) && corners.contains(&square[2]));
            }
        }
    }

    /// The boundary of the hole that a vertex leaves, from its faces.
    fn boundary_around(v: u32, points: &[Point]) -> Vec<Point> {
        let sides: std::collections::BTreeMap<u32, u32> = triangulate(points)
            .into_iter()
            .filter_map(|[a, b, c]| {
                [(a, b, c), (b, c, a), (c, a, b)].into_iter().find(|face| face.0 == v)
            })
            .map(|(_, from, to)| (from, to))
            .collect();
        let first = *sides.keys().next().unwrap();
        std::iter::successors(Some(first), |v| sides.get(v).copied().filter(|&v| v != first))
            .map(|v| points[v as usize])
            .collect()
    }

    /// Fills a boundary as lists, in ascending order.
    fn fill_as_list(boundary: &[Point]) -> Vec<HoleTriangle> {
        let mut filler = HoleFiller::default();
        filler.split_at_middle_edges(boundary);
        filler.triangles.sort_unstable();
        filler.triangles
    }

    /// A lattice of 7 by 7 points, some of them kept, among them the corners and the centre.
    fn scattered(kept: &[bool], scale: i32) -> Vec<Point> {
        let lattice = (0..7).flat_map(|y| (0..7).map(move |x| (x, y)));
        let is_kept = |((x, y), kept): ((i32, i32), &bool)| {
            let is_kept = *kept || (x, y) == (3, 3) || (x % 6, y % 6) == (0, 0);
            is_kept.then_some(Point::new(x * scale, y * scale))
        };
        lattice.zip(kept).filter_map(is_kept).collect()
    }

    proptest::proptest! {
        #[test]
        fn arrays_and_lists_fill_alike(
            kept in proptest::collection::vec(proptest::bool::weighted(0.4), 49),
            scale in proptest::sample::select(vec![1, 3, 2700, 2731, 170_000]),
        ) {
            let points = scattered(&kept, scale);
            let centre = Point::new(3 * scale, 3 * scale);
            let v = points.iter().position(|&p| p == centre).unwrap() as u32;
            let boundary = boundary_around(v, &points);
            let mut found = HoleFiller::default().fill(&boundary).to_vec();
            found.sort_unstable();
            proptest::prop_assert_eq!(found, fill_as_list(&boundary));
        }

        #[test]
        fn fills_large_holes_by_the_triangulation_of_the_rest(
            (radius, thickness) in (3i32..20, 1i32..6),
            kept in proptest::collection::vec(proptest::bool::weighted(0.7), 41 * 41),
        ) {
            let centre = Point::new(20, 20);
            let in_ring = |p: &Point| {
                let squared = (p.x - 20).pow(2) + (p.y - 20).pow(2);
                let kept = kept[(p.y * 41 + p.x) as usize];
                (kept && (radius.pow(2)..=(radius + thickness).pow(2)).contains(&squared))
                    || *p == centre
                    || (p.x % 40 == 0 && p.y % 40 == 0)
            };
            let lattice = (0..41).flat_map(|y| (0..41).map(move |x| Point::new(x, y)));
            let points: Vec<Point> = lattice.filter(in_ring).collect();
            let v = points.iter().position(|&p| p == centre).unwrap() as u32;
            let boundary = boundary_around(v, &points);
            let rest: Vec<Point> = points.into_iter().filter(|&p| p != centre).collect();
            let mut filler = HoleFiller::default();
            let faces: Vec<[Point; 3]> =
                triangulate(&rest).iter().map(|face| face.map(|v| rest[v as usize])).collect();
            for triangle in filler.fill(&boundary) {
                let [a, b, c] = triangle.map(|at| boundary[at as usize]);
                let is_face = [[a, b, c], [b, c, a], [c, a, b]].iter().any(|f| faces.contains(f));
                proptest::prop_assert!(is_face);
            }
        }
    }

    #[test]
    fn fills_the_inside_of_a_concave_boundary() {
        let boundary = [(0, 0), (6, 0), (3, 1), (6, 6), (0, 6)].map(|(x, y)| Point::new(x, y));
        let mut filler = HoleFiller::default();
        let triangles = filler.fill(&boundary);
        let double_area: i64 = triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|at| boundary[at as usize]);
                assert!(orientation(a, b, c) > 0);
                orientation(a, b, c)
            })
            .sum();
        assert_eq!(double_area, 72 - 18);
    }
}
