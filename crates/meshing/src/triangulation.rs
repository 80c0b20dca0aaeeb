//! Points to their preferred-directions Delaunay triangulation (PDDT), in flat arrays.
//!
//! spade inserts the points one by one, each search beginning at the last one, in an order that
//! keeps near points together without ever following a line for long: its bulk loading takes time
//! quadratic in the number of collinear points around the middle, this order does not. The result
//! is a Delaunay triangulation; flipping the edges that the preferred directions decide otherwise
//! makes it the PDDT, which depends on the points alone.

use crate::control::{Cancelled, Control, Stage, Unattended};
use crate::hilbert::hilbert_index;
use crate::mesh::{Face, Point};
use crate::predicates::in_circle;
use spade::{DelaunayTriangulation, Point2, Triangulation as _};

/// Insertions between two polls of the control.
const POINTS_PER_POLL: usize = 1024;

/// No half-edge: what stands opposite to a border edge.
pub(crate) const NONE: u32 = u32::MAX;

/// A triangulation of lattice points as arrays of half-edges.
///
/// Triangle `t` has the half-edges `3t`, `3t + 1`, `3t + 2`, counter-clockwise; the half-edge `h`
/// goes from vertex `origins[h]` to that of the next one, with its triangle at the left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Triangulation {
    /// The vertices.
    pub(crate) points: Vec<Point>,
    /// Vertex at which each half-edge begins.
    pub(crate) origins: Vec<u32>,
    /// The opposite half-edge of each, [`NONE`] on the border.
    pub(crate) twins: Vec<u32>,
}

/// The half-edge after `h` in its triangle.
#[inline]
pub(crate) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The half-edge before `h` in its triangle.
#[inline]
pub(crate) fn previous(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// The faces of the preferred-directions Delaunay triangulation of `points`, which are distinct
/// lattice points, in any order, and hold the corners of a rectangle around all of them.
///
/// Faces are counter-clockwise triples of indices of `points`, each beginning with its smallest
/// index, in ascending order.
#[must_use]
pub fn triangulate(points: &[Point]) -> Vec<Face> {
    let mut by_row: Vec<u32> = (0..points.len() as u32).collect();
    by_row.sort_unstable_by_key(|&v| points[v as usize]);
    let sorted = by_row.iter().map(|&v| points[v as usize]).collect();
    // Nobody is there to cancel.
    let Ok(mut triangulation) = Triangulation::new(sorted, &Unattended) else { return Vec::new() };
    for origin in &mut triangulation.origins {
        *origin = by_row[*origin as usize];
    }
    triangulation.faces()
}

impl Triangulation {
    /// Triangulates distinct points that hold the corners of a rectangle around all of them, given
    /// by row, then column.
    pub(crate) fn new(points: Vec<Point>, control: &dyn Control) -> Result<Self, Cancelled> {
        let count = points.len();
        control.poll(Stage::Triangulate, 0, count)?;
        if let Some(width) = full_grid_width(&points) {
            return Ok(Self::of_full_grid(points, width));
        }
        let mut triangulation = Self::delaunay(points, control)?;
        triangulation.prefer_directions();
        control.poll(Stage::Triangulate, count, count)?;
        Ok(triangulation)
    }

    /// A Delaunay triangulation by spade.
    fn delaunay(points: Vec<Point>, control: &dyn Control) -> Result<Self, Cancelled> {
        let mut delaunay = DelaunayTriangulation::<Site>::new();
        let mut hint = None;
        for (done, v) in insertion_order(&points).into_iter().enumerate() {
            if done % POINTS_PER_POLL == 1 {
                control.poll(Stage::Triangulate, done, points.len())?;
            }
            let site = Site { v, point: points[v as usize] };
            let inserted = match hint {
                Some(hint) => delaunay.insert_with_hint(site, hint),
                None => delaunay.insert(site),
            };
            // Coordinates of a lattice are finite and within spade's range.
            hint = inserted.ok().or(hint);
        }
        control.poll(Stage::Triangulate, points.len(), points.len())?;
        Ok(Self::from_spade(points, &delaunay))
    }

    /// spade's triangulation in flat arrays.
    fn from_spade(points: Vec<Point>, delaunay: &DelaunayTriangulation<Site>) -> Self {
        let mut numbers = vec![NONE; 2 * delaunay.num_undirected_edges()];
        let mut origins = Vec::with_capacity(3 * delaunay.num_inner_faces());
        for face in delaunay.inner_faces() {
            for edge in face.adjacent_edges() {
                numbers[edge.fix().index()] = origins.len() as u32;
                origins.push(edge.from().data().v);
            }
        }
        let mut twins = vec![NONE; origins.len()];
        for edge in delaunay.directed_edges() {
            let h = numbers[edge.fix().index()];
            if h != NONE {
                twins[h as usize] = numbers[edge.rev().fix().index()];
            }
        }
        Self { points, origins, twins }
    }

    /// The triangulation of every lattice point: each unit square is cut along `(1, 1)`.
    fn of_full_grid(points: Vec<Point>, width: usize) -> Self {
        let height = points.len() / width;
        let (width, squares) = (width as u32, (width - 1) * (height - 1));
        let mut origins = Vec::with_capacity(6 * squares);
        let mut twins = Vec::with_capacity(6 * squares);
        for y in 0..height as u32 - 1 {
            for x in 0..width - 1 {
                let (v, h) = (y * width + x, origins.len() as u32);
                let row = 6 * (width - 1);
                let opposite = |exists, h| if exists { h } else { NONE };
                origins.extend([v, v + 1, v + width + 1]);
                twins.push(opposite(y > 0, h.wrapping_sub(row).wrapping_add(4)));
                twins.push(opposite(x + 2 < width, h + 6 + 5));
                twins.push(h + 3);
                origins.extend([v, v + width + 1, v + width]);
                twins.push(h + 2);
                twins.push(opposite(y + 2 < height as u32, h + row));
                twins.push(opposite(x > 0, h.wrapping_sub(6).wrapping_add(1)));
            }
        }
        Self { points, origins, twins }
    }

    /// Flips edges until each quadrilateral has the diagonal of the PDDT.
    ///
    /// Of a Delaunay triangulation only diagonals of cocircular quadrilaterals are flipped.
    fn prefer_directions(&mut self) {
        let inner = |h: &u32| self.twins[*h as usize] != NONE && *h < self.twins[*h as usize];
        let mut suspects: Vec<u32> = (0..self.origins.len() as u32).filter(inner).collect();
        while let Some(h) = suspects.pop() {
            let twin = self.twins[h as usize];
            if twin == NONE {
                continue;
            }
            let [a, b, c, d] = [h, next(h), previous(h), previous(twin)]
                .map(|h| self.points[self.origins[h as usize] as usize]);
            if in_circle(a, b, c, d) {
                self.flip(h, twin);
                suspects.extend([h, next(h), twin, next(twin)]);
            }
        }
    }

    /// Replaces the diagonal `h` of its quadrilateral by the other one.
    ///
    /// With `h` from `a` to `b`, `c` at its left and `d` at its right, the triangles `a b c` and
    /// `b a d` become `d b c` in the slots of the first and `c a d` in those of the second, which
    /// leaves `b c` and `a d` where they are.
    fn flip(&mut self, h: u32, twin: u32) {
        let (from_c, from_d) = (previous(h), previous(twin));
        let (beyond_ca, beyond_db) = (self.twins[from_c as usize], self.twins[from_d as usize]);
        self.origins[h as usize] = self.origins[from_d as usize];
        self.link(h, beyond_db);
        self.origins[twin as usize] = self.origins[from_c as usize];
        self.link(twin, beyond_ca);
        self.link(from_c, from_d);
    }

    /// Makes two half-edges opposite to each other.
    #[inline]
    pub(crate) fn link(&mut self, h: u32, twin: u32) {
        self.twins[h as usize] = twin;
        if twin != NONE {
            self.twins[twin as usize] = h;
        }
    }

    /// The faces, each beginning with its smallest index, in ascending order.
    pub(crate) fn faces(&self) -> Vec<Face> {
        let corners = self.origins.chunks_exact(3);
        let mut faces: Vec<Face> = corners.map(|v| smallest_first([v[0], v[1], v[2]])).collect();
        faces.sort_unstable();
        faces
    }
}

/// Rotates a face so that its smallest index comes first.
pub(crate) fn smallest_first([a, b, c]: Face) -> Face {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// The width of the lattice that the points fill, when they do, given by row, then column.
fn full_grid_width(points: &[Point]) -> Option<usize> {
    let last = points.last()?;
    let (width, height) = (last.x as usize + 1, last.y as usize + 1);
    (points[0] == Point::new(0, 0) && width * height == points.len()).then_some(width)
}

/// The order in which to insert: the corners, so that every other point falls into a triangle,
/// then along a Hilbert curve.
fn insertion_order(points: &[Point]) -> Vec<u32> {
    let (width, height) = points.iter().fold((0, 0), |(w, h), p| (p.x.max(w), p.y.max(h)));
    let is_corner = |p: Point| (p.x == 0 || p.x == width) && (p.y == 0 || p.y == height);
    let key = |v: &u32| {
        let point = points[*v as usize];
        (!is_corner(point), hilbert_index(point))
    };
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_cached_key(key);
    order
}

/// A point on its way through spade, with its index.
#[derive(Clone, Copy)]
struct Site {
    v: u32,
    point: Point,
}

impl spade::HasPosition for Site {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        Point2::new(f64::from(self.point.x), f64::from(self.point.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::corner_points;
    use std::collections::BTreeSet;
    use std::time::Instant;

    fn with_corners(
        points: impl IntoIterator<Item = (i32, i32)>,
        width: i32,
        height: i32,
    ) -> Vec<Point> {
        let inner = points.into_iter().map(|(x, y)| Point::new(x, y));
        let corners = corner_points(width as usize, height as usize);
        inner.chain(corners).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Half-edges pair up, and every triangle turns counter-clockwise.
    fn assert_consistent(triangulation: &Triangulation) {
        let Triangulation { points, origins, twins } = triangulation;
        for h in 0..origins.len() as u32 {
            let twin = twins[h as usize];
            if twin != NONE {
                assert_eq!(twins[twin as usize], h);
                assert_eq!(origins[twin as usize], origins[next(h) as usize]);
            }
        }
        for face in origins.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|i| points[face[i] as usize]);
            assert!(crate::predicates::orientation(a, b, c) > 0);
        }
    }

    #[test]
    fn a_full_grid_built_directly_is_the_one_that_insertion_gives() {
        for (width, height) in [(2, 2), (2, 5), (6, 2), (7, 4)] {
            let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            let points = with_corners(all, width, height);
            let direct = Triangulation::of_full_grid(points.clone(), width as usize);
            assert_consistent(&direct);
            let mut inserted = Triangulation::delaunay(points, &Unattended).unwrap();
            inserted.prefer_directions();
            assert_consistent(&inserted);
            assert_eq!(direct.faces(), inserted.faces());
        }
    }

    #[test]
    fn collinear_points_around_the_middle_take_no_longer_than_others() {
        let (width, height) = (16_384, 3);
        let start = Instant::now();
        let row = Triangulation::new(
            with_corners((0..width).map(|x| (x, 1)), width, height),
            &Unattended,
        )
        .unwrap();
        assert_consistent(&row);
        let vertical = (0..width).map(|y| (1, y));
        assert_consistent(
            &Triangulation::new(with_corners(vertical, height, width), &Unattended).unwrap(),
        );
        let diagonal = (0..4096).map(|i| (i, i));
        assert_consistent(
            &Triangulation::new(with_corners(diagonal, 4096, 4096), &Unattended).unwrap(),
        );
        let seconds = start.elapsed().as_secs_f64();
        assert!(seconds < 5.0, "{seconds} s");
    }
}
