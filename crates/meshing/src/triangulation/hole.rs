//! The hole that a removed vertex leaves, and the triangles that fill it.
//!
//! Removing a vertex of a preferred-directions Delaunay triangulation changes only the triangles at
//! that vertex, and the hole is filled by the triangulation of its boundary. The fill is found
//! without touching the mesh: the triangle at one edge of the boundary has as its third vertex the
//! one whose circle through the edge holds no other; it splits the rest of the boundary in two,
//! each filled in the same way. A hole has six vertices on average, and for so few the next edge
//! is always the side of the triangle before. With many vertices that takes quadratic time where
//! the triangles make a fan, so larger boundaries are split at their middle edge, as lists, and so
//! are those that reach too far for 64 bits.

use crate::image::Point;
use crate::triangulation::predicates::{in_circle, orientation};

/// A triangle of the fill: its vertices as places on the boundary, counter-clockwise and ascending.
///
/// Its side from the last to the first is one of the fill's edges, except for the triangle at the
/// boundary's last edge.
pub(crate) type HoleTriangle = [u32; 3];

/// A part of the boundary that is still to be filled: the places from `from` to `to`.
#[derive(Clone, Copy)]
struct Gap {
    from: u32,
    to: u32,
}

/// Boundaries of more vertices than this are split at their middle edge.
const LARGE: usize = 32;

/// Fills holes; keeps its memory from one to the next.
#[derive(Default)]
pub(crate) struct HoleFiller {
    gaps: Vec<Gap>,
    /// Places of the boundaries that remain of a large hole, one after the other.
    rings: Vec<u32>,
    /// Where each of these begins.
    ring_starts: Vec<usize>,
    triangles: Vec<HoleTriangle>,
}

impl HoleFiller {
    /// The triangles that fill the hole with the given boundary of at least three points,
    /// counter-clockwise.
    pub(crate) fn fill(&mut self, boundary: &[Point]) -> &[HoleTriangle] {
        self.triangles.clear();
        if let [_, _, _] = boundary {
            self.triangles.push([0, 1, 2]);
        } else if let [_, _, _, _] = boundary {
            self.fill_quadrilateral(boundary, Gap { from: 0, to: 3 });
        } else if boundary.len() > LARGE || !is_narrow(boundary) {
            self.split_at_middle_edges(boundary);
        } else {
            self.split_at_bases(boundary);
        }
        &self.triangles
    }

    /// Finds the triangle at each gap's base, from the boundary's last edge on.
    fn split_at_bases(&mut self, boundary: &[Point]) {
        self.gaps.push(Gap { from: 0, to: boundary.len() as u32 - 1 });
        while let Some(Gap { from, to }) = self.gaps.pop() {
            let apex = apex_of_narrow(boundary, from, to);
            self.triangles.push([from, apex, to]);
            for gap in [Gap { from: apex, to }, Gap { from, to: apex }] {
                match gap.to - gap.from {
                    0 | 1 => {}
                    2 => self.triangles.push([gap.from, gap.from + 1, gap.to]),
                    3 => self.fill_quadrilateral(boundary, gap),
                    _ => self.gaps.push(gap),
                }
            }
        }
    }

    /// Fills a quadrilateral, convex or not: the sign of the determinant that tells on which side of
    /// a circle a point lies also tells which diagonal lies inside.
    ///
    /// The four lifted points are the corners of a tetrahedron, the lower side of which is the
    /// fill, and the sign tells which two edges of it are seen from below.
    fn fill_quadrilateral(&mut self, boundary: &[Point], Gap { from, to }: Gap) {
        let [a, b, c, d] = [from, from + 1, from + 2, to];
        let [pa, pb, pc, pd] = [a, b, c, d].map(|place| boundary[place as usize]);
        if in_circle(pa, pb, pc, pd) {
            self.triangles.extend([[a, b, d], [b, c, d]]);
        } else {
            self.triangles.extend([[a, c, d], [a, b, c]]);
        }
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
            let others = ring[middle + 1..].iter().chain(&ring[..middle - 1]).copied();
            let apex = apex(boundary, boundary[from as usize], boundary[to as usize], others);
            let mut corners = [from, to, apex];
            corners.sort_unstable();
            self.triangles.push(corners);
            let at = ring.iter().position(|&place| place == apex).unwrap_or_default();
            if at > middle {
                self.push_ring(&ring[middle..=at], &[]);
                self.push_ring(&ring[..middle], &ring[at..]);
            } else {
                self.push_ring(&ring[at..middle], &[]);
                self.push_ring(&ring[..=at], &ring[middle..]);
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

    /// Takes triangles known from elsewhere as the last fill.
    pub(crate) fn take(&mut self, triangles: impl Iterator<Item = HoleTriangle>) {
        self.triangles.clear();
        self.triangles.extend(triangles);
    }

    /// The triangles of the last fill.
    pub(crate) fn triangles(&self) -> &[HoleTriangle] {
        &self.triangles
    }
}

/// Coordinates that differ by less than this have angles that compare in 64 bits: the products of
/// two differences are below 2^30, sums of two below 2^31, products of these below 2^62.
const NARROW: i32 = 1 << 15;

/// Tells whether all points are near enough to each other for [`apex_of_narrow`].
#[inline]
fn is_narrow(boundary: &[Point]) -> bool {
    let first = boundary[0];
    let reach =
        boundary.iter().fold(0, |reach, p| reach | (p.x - first.x).abs() | (p.y - first.y).abs());
    reach < NARROW / 2
}

/// The place between `from` and `to` whose vertex sees the edge between these under the largest
/// angle, which is the one in whose circle through the edge no other vertex lies.
///
/// Angles are compared by their cotangents, fractions whose two parts are computed once for each
/// vertex; the preferred directions decide between equal ones.
#[inline]
fn apex_of_narrow(boundary: &[Point], from: u32, to: u32) -> u32 {
    let (a, b) = (boundary[to as usize], boundary[from as usize]);
    let (mut best, mut best_dot, mut best_cross) = (from, 1, 0);
    for (place, &c) in (from + 1..to).zip(&boundary[from as usize + 1..to as usize]) {
        let (ax, ay) = (i64::from(a.x - c.x), i64::from(a.y - c.y));
        let (bx, by) = (i64::from(b.x - c.x), i64::from(b.y - c.y));
        let (dot, cross) = (ax * bx + ay * by, ax * by - ay * bx);
        if cross <= 0 {
            continue;
        }
        let (this, other) = (dot * best_cross, best_dot * cross);
        if this < other || this == other && in_circle(a, b, boundary[best as usize], c) {
            (best, best_dot, best_cross) = (place, dot, cross);
        }
    }
    // The inside of a boundary is left of each of its edges, so there is such a vertex.
    best
}

/// The place whose vertex makes the triangle of the triangulation with the edge from `a` to `b`:
/// left of that edge, and no other such vertex in its circle.
#[inline]
fn apex(boundary: &[Point], a: Point, b: Point, places: impl Iterator<Item = u32>) -> u32 {
    let mut best = None;
    for place in places {
        let candidate = boundary[place as usize];
        let is_better = |best: u32| in_circle(a, b, boundary[best as usize], candidate);
        if orientation(a, b, candidate) > 0 && best.is_none_or(is_better) {
            best = Some(place);
        }
    }
    // The inside of a boundary is left of each of its edges, so there is such a vertex.
    best.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triangulation::triangulate;

    #[test]
    fn a_square_is_cut_along_the_preferred_direction() {
        let square = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| Point::new(x, y));
        for rotation in 0..4 {
            let mut boundary = square;
            boundary.rotate_left(rotation);
            let mut filler = HoleFiller::default();
            let triangles = filler.fill(&boundary);
            assert_eq!(triangles.len(), 2);
            for triangle in triangles {
                let corners = triangle.map(|place| boundary[place as usize]);
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

    proptest::proptest! {
        #[test]
        fn large_boundaries_are_filled_as_small_ones_are(
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
            let [mut by_bases, mut by_middle_edges] = [HoleFiller::default(), HoleFiller::default()];
            by_bases.split_at_bases(&boundary);
            by_middle_edges.split_at_middle_edges(&boundary);
            by_bases.triangles.sort_unstable();
            by_middle_edges.triangles.sort_unstable();
            proptest::prop_assert_eq!(by_bases.triangles, by_middle_edges.triangles);
        }
    }

    proptest::proptest! {
        #[test]
        fn boundaries_of_few_vertices_are_filled_as_all_others_are(
            kept in proptest::collection::vec(proptest::bool::weighted(0.4), 49),
            scale in proptest::sample::select(vec![1, 3, 2700]),
        ) {
            let centre = Point::new(3 * scale, 3 * scale);
            let lattice = (0..7).flat_map(|y| (0..7).map(move |x| (x, y)));
            let points: Vec<Point> = lattice
                .zip(&kept)
                .filter(|&((x, y), &kept)| kept || (x, y) == (3, 3) || (x % 6, y % 6) == (0, 0))
                .map(|((x, y), _)| Point::new(x * scale, y * scale))
                .collect();
            let v = points.iter().position(|&p| p == centre).unwrap() as u32;
            let boundary = boundary_around(v, &points);
            if boundary.len() <= crate::triangulation::small_hole::TRIANGLES + 2 {
                let mut places = [centre; crate::triangulation::small_hole::PLACES];
                places[..boundary.len()].copy_from_slice(&boundary);
                let found = crate::triangulation::small_hole::fill_few(&places, boundary.len());
                let mut found: Vec<HoleTriangle> =
                    found[..boundary.len() - 2].iter().map(|t| t.map(u32::from)).collect();
                let mut expected = HoleFiller::default().fill(&boundary).to_vec();
                found.sort_unstable();
                expected.sort_unstable();
                proptest::prop_assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn boundaries_are_narrow_where_coordinates_differ_by_less_than_two_to_the_14() {
        let near = NARROW / 2 - 1;
        for (x, y) in [(0, 0), (7, 900_000), (900_000, 7), (1_000_000, 1_000_000)] {
            let at = |dx: i32, dy: i32| Point::new(x + dx, y + dy);
            let is_narrow_to = |dx, dy| is_narrow(&[at(0, 0), at(1, 0), at(dx, dy), at(0, 1)]);
            for (dx, dy) in [(1, 0), (0, 1), (1, 1), (-1, 0), (0, -1), (1, -1)] {
                assert!(is_narrow_to(dx * near, dy * near), "{dx} {dy}");
                assert!(!is_narrow_to(dx * (near + 1), dy * (near + 1)), "{dx} {dy}");
                assert!(!is_narrow_to(dx * 40_000, dy * 40_000), "{dx} {dy}");
            }
        }
    }

    proptest::proptest! {
        #[test]
        fn boundaries_that_reach_far_are_filled_as_near_ones_of_the_same_shape_are(
            kept in proptest::collection::vec(proptest::bool::weighted(0.3), 49),
            scale in proptest::sample::select(vec![2730, 2731, 10_000, 21_845, 170_000]),
        ) {
            let lattice = (0..7).flat_map(|y| (0..7).map(move |x| (x, y)));
            let points: Vec<Point> = lattice
                .zip(&kept)
                .filter(|&((x, y), &kept)| kept || (x, y) == (3, 3) || (x % 6, y % 6) == (0, 0))
                .map(|((x, y), _)| Point::new(x, y))
                .collect();
            let v = points.iter().position(|&p| p == Point::new(3, 3)).unwrap() as u32;
            let near = boundary_around(v, &points);
            let far: Vec<Point> = near.iter().map(|p| Point::new(p.x * scale, p.y * scale)).collect();
            let [near, far] = [near, far].map(|boundary| {
                let mut triangles = HoleFiller::default().fill(&boundary).to_vec();
                triangles.sort_unstable();
                triangles
            });
            proptest::prop_assert_eq!(near, far);
        }
    }

    #[test]
    fn a_concave_boundary_is_filled_inside_only() {
        let boundary = [(0, 0), (6, 0), (3, 1), (6, 6), (0, 6)].map(|(x, y)| Point::new(x, y));
        let mut filler = HoleFiller::default();
        let triangles = filler.fill(&boundary);
        let double_area: i64 = triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|place| boundary[place as usize]);
                assert!(orientation(a, b, c) > 0);
                orientation(a, b, c)
            })
            .sum();
        assert_eq!(double_area, 72 - 18);
    }
}
