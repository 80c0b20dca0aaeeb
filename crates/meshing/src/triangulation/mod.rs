//! Points to their preferred-directions Delaunay triangulation (PDDT), in flat arrays.
//!
//! The triangulation depends on the points alone, so whichever way is the quickest makes it: a full
//! grid is written down, other points are triangulated by a `sweep` over the rows; where that needs
//! too many flips, or the points do not fill a rectangle, by `divide_and_conquer`, which is slower
//! but takes time `n log n` wherever the points are.

mod column_set;
mod divide_and_conquer;
mod flipping;
mod front;
pub(crate) mod hole;
pub(crate) mod predicates;
mod sweep;

use crate::control::{Cancelled, Control, Stage};
use crate::image::Point;

/// Three indices of vertices, counter-clockwise with `y` up.
pub type Face = [u32; 3];

/// Points, or steps that take as long, between two polls of the control.
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

/// The faces of the preferred-directions Delaunay triangulation of `points`, in any order, with
/// coordinates from 0 to below [`MAX_SIDE`](crate::MAX_SIDE).
///
/// Faces are counter-clockwise triples of indices of `points`, each beginning with its smallest
/// index, in ascending order. They cover the convex hull; collinear points have none. Of points
/// that share a place only the first belongs to faces.
#[must_use]
pub fn triangulate(points: &[Point]) -> Vec<Face> {
    let mut by_row: Vec<u32> = (0..points.len() as u32).collect();
    by_row.sort_unstable_by_key(|&v| (points[v as usize], v));
    by_row.dedup_by_key(|v| points[*v as usize]);
    let sorted = by_row.iter().map(|&v| points[v as usize]).collect();
    // Nobody is there to cancel.
    let Ok(mut triangulation) = Triangulation::new(sorted, &()) else { return Vec::new() };
    for origin in &mut triangulation.origins {
        *origin = by_row[*origin as usize];
    }
    faces(&triangulation.origins, points.len())
}

impl Triangulation {
    /// Triangulates distinct points given by row, then column.
    pub(crate) fn new(points: Vec<Point>, control: &dyn Control) -> Result<Self, Cancelled> {
        let count = points.len();
        control.poll(Stage::Triangulate, 0, count)?;
        let area = rectangle_area(&points);
        if area == Some(count as u64) {
            return Ok(Self::of_full_grid(points));
        }
        let swept = if area.is_some() { sweep::triangulate(&points, control)? } else { None };
        let (origins, twins) = match swept {
            Some(half_edges) => half_edges,
            None => divide_and_conquer::triangulate(&points, control)?,
        };
        control.poll(Stage::Triangulate, count, count)?;
        Ok(Self { points, origins, twins })
    }

    /// The triangulation of every lattice point: each unit square is cut along `(1, 1)`.
    fn of_full_grid(points: Vec<Point>) -> Self {
        let width = points.iter().take_while(|p| p.y == points[0].y).count();
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

    /// The faces, each beginning with its smallest index, in ascending order.
    pub(crate) fn faces(&self) -> Vec<Face> {
        faces(&self.origins, self.points.len())
    }
}

/// The faces of triples of vertices below `vertex_count`, each beginning with its smallest index,
/// in ascending order.
fn faces(origins: &[u32], vertex_count: usize) -> Vec<Face> {
    // A counting sort by the first index, then each of its few faces by the others.
    let triples = origins.chunks_exact(3);
    let faces: Vec<Face> = triples.map(|v| smallest_first([v[0], v[1], v[2]])).collect();
    let mut ends = vec![0u32; vertex_count];
    for &[first, ..] in &faces {
        ends[first as usize] += 1;
    }
    let mut sum = 0;
    for end in &mut ends {
        (*end, sum) = (sum, sum + *end);
    }
    let mut sorted = vec![[0; 3]; faces.len()];
    for face in faces {
        let end = &mut ends[face[0] as usize];
        sorted[*end as usize] = face;
        *end += 1;
    }
    let mut start = 0;
    for end in ends {
        sorted[start..end as usize].sort_unstable();
        start = end as usize;
    }
    sorted
}

/// Rotates a face so that its smallest index comes first.
#[inline]
pub(crate) fn smallest_first([a, b, c]: Face) -> Face {
    // Which one it is cannot be predicted: selections for branches.
    let (is_b, is_c) = ((b < a) & (b < c), (c < a) & (c < b));
    let select = |a, b, c| {
        let a_or_b = if is_b { b } else { a };
        if is_c { c } else { a_or_b }
    };
    [select(a, b, c), select(b, c, a), select(c, a, b)]
}

/// The number of lattice points of the rectangle that points given by row, then column, hold the
/// corners of; `None` when there is none around all of them, of more than one row and column.
fn rectangle_area(points: &[Point]) -> Option<u64> {
    let (&first, &last) = (points.first()?, points.last()?);
    let is_vertex = |corner| points.binary_search(&corner).is_ok();
    let is_rectangle = first.x < last.x
        && first.y < last.y
        && is_vertex(Point::new(last.x, first.y))
        && is_vertex(Point::new(first.x, last.y))
        && points.iter().all(|p| (first.x..=last.x).contains(&p.x));
    let side = |from: i32, to: i32| u64::from(to.abs_diff(from)) + 1;
    is_rectangle.then(|| side(first.x, last.x) * side(first.y, last.y))
}

#[cfg(test)]
mod tests;
