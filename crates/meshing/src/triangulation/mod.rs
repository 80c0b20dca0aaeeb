//! The preferred-directions Delaunay triangulation (PDDT) of points, in flat arrays.
//!
//! The triangulation depends on the points alone, so the fastest of three ways makes it. A full
//! grid is written directly. Other points that hold the corners of a rectangle around them are
//! triangulated by a `sweep` over the rows. Where that takes too many flips, and for other points,
//! `divide_and_conquer` does it: slower in pictures, but in time `n log n` for all points.

mod divide_and_conquer;
mod flipping;
mod front;
pub(crate) mod hole;
pub(crate) mod predicates;
mod sweep;

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Poller, Stage, free};
use crate::image::{MAX_POINTS, MAX_SIDE, Point};

/// Three indices of vertices, counter-clockwise with `y` up.
///
/// ```
/// use pixmesh_meshing::{Face, Point, triangulate};
/// let faces: Vec<Face> = triangulate(&[Point::new(0, 1), Point::new(1, 0), Point::new(0, 0)]);
/// assert_eq!(faces, [[0, 2, 1]]);
/// ```
pub type Face = [u32; 3];

/// No half-edge, vertex or column; the twin of a half-edge on the border.
pub(crate) const NONE: u32 = u32::MAX;

/// How many steps of a [`Poller`] a point, a triangle or a flip counts.
const STEPS_PER_POINT: usize = 64;

type HalfEdges = (Vec<u32>, Vec<u32>);

/// A triangulation of lattice points as arrays of half-edges.
///
/// Triangle `t` has the half-edges `3t`, `3t + 1`, `3t + 2`, counter-clockwise; the half-edge `h`
/// goes from vertex `origins[h]` to that of the next one, with its triangle at the left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Triangulation {
    pub(crate) points: Vec<Point>,
    pub(crate) origins: Vec<u32>,
    /// The opposite half-edge of each, [`NONE`] on the border.
    pub(crate) twins: Vec<u32>,
}

#[inline]
pub(crate) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

#[inline]
pub(crate) fn previous(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// The faces of the preferred-directions Delaunay triangulation of points in any order.
///
/// Faces are counter-clockwise triples of indices of `points`, each beginning with its smallest
/// index, in ascending order. They cover the convex hull; collinear points have none. Of equal
/// points only the first belongs to faces. A point with a coordinate beyond [`MAX_SIDE`], positive
/// or negative, belongs to none, nor does any point of more than [`MAX_POINTS`].
///
/// ```
/// use pixmesh_meshing::{Point, triangulate};
/// let points = [(0, 0), (4, 0), (1, 2), (0, 4), (4, 4)].map(|(x, y)| Point::new(x, y));
/// assert_eq!(triangulate(&points), [[0, 1, 2], [0, 2, 3], [1, 4, 2], [2, 4, 3]]);
/// ```
#[must_use]
pub fn triangulate(points: &[Point]) -> Vec<Face> {
    // This control never cancels.
    triangulate_with(points, &()).unwrap_or_default()
}

/// The same, under a control.
///
/// # Errors
/// When the control cancels.
pub fn triangulate_with(points: &[Point], control: &dyn Control) -> Result<Vec<Face>, Cancelled> {
    if points.len() > MAX_POINTS {
        return Ok(Vec::new());
    }
    let is_valid = |p: Point| p.x.unsigned_abs().max(p.y.unsigned_abs()) <= MAX_SIDE as u32;
    let mut by_row: Vec<u32> = (0..points.len() as u32).collect();
    by_row.retain(|&v| is_valid(points[v as usize]));
    by_row.sort_unstable_by_key(|&v| (points[v as usize], v));
    by_row.dedup_by_key(|v| points[*v as usize]);
    let sorted = by_row.iter().map(|&v| points[v as usize]).collect();
    let mut triangulation = Triangulation::new(sorted, control)?;
    for origin in &mut triangulation.origins {
        *origin = by_row[*origin as usize];
    }
    faces(&triangulation.origins, points.len(), control)
}

impl Triangulation {
    /// Triangulates distinct points given by row, then column.
    pub(crate) fn new(points: Vec<Point>, control: &dyn Control) -> Result<Self, Cancelled> {
        let count = points.len();
        control.poll(Stage::Triangulate, 0, count)?;
        let area = rectangle_area(&points, control)?;
        if area == Some(count as u64) {
            return Self::of_full_grid(points, control);
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
    fn of_full_grid(points: Vec<Point>, control: &dyn Control) -> Result<Self, Cancelled> {
        let width = points.iter().take_while(|p| p.y == points[0].y).count();
        let height = points.len() / width;
        let row = 6 * (width - 1);
        let mut origins = Vec::with_capacity(row * (height - 1));
        let mut twins = Vec::with_capacity(row * (height - 1));
        let mut poller = Poller::new(control, Stage::Triangulate, 0, points.len());
        for y in 0..height - 1 {
            poller.done = y * width;
            for x in 0..width - 1 {
                poller.step(1)?;
                let (v, h) = (y * width + x, origins.len());
                let square = [v, v + 1, v + width + 1, v, v + width + 1, v + width];
                origins.extend(square.map(|v| v as u32));
                let twin = |exists, h| if exists { h as u32 } else { NONE };
                twins.extend([
                    twin(y > 0, (h + 4).wrapping_sub(row)),
                    twin(x + 2 < width, h + 11),
                    twin(true, h + 3),
                    twin(true, h + 2),
                    twin(y + 2 < height, h + row),
                    twin(x > 0, h.wrapping_sub(5)),
                ]);
            }
        }
        Ok(Self { points, origins, twins })
    }

    /// The faces, each beginning with its smallest index, in ascending order.
    pub(crate) fn faces(&self, control: &dyn Control) -> Result<Vec<Face>, Cancelled> {
        faces(&self.origins, self.points.len(), control)
    }

    /// The points alone: frees the half-edges with polls in between.
    pub(crate) fn into_points(self, control: &dyn Control) -> Result<Vec<Point>, Cancelled> {
        let count = self.points.len();
        let poller = &mut Poller::new(control, Stage::Triangulate, count, count);
        free(self.origins, poller)?;
        free(self.twins, poller)?;
        Ok(self.points)
    }
}

/// The faces of triples of vertices below `vertex_count`, each beginning with its smallest index,
/// in ascending order: a counting sort by the first index, then a sort of the faces that share one.
fn faces(
    origins: &[u32],
    vertex_count: usize,
    control: &dyn Control,
) -> Result<Vec<Face>, Cancelled> {
    let poll = || control.poll(Stage::Triangulate, vertex_count, vertex_count);
    let mut faces = Vec::with_capacity(origins.len() / 3);
    let mut ends = vec![0u32; vertex_count];
    for chunk in origins.chunks(3 * POINTS_PER_POLL) {
        poll()?;
        for v in chunk.chunks_exact(3) {
            let face = smallest_first([v[0], v[1], v[2]]);
            ends[face[0] as usize] += 1;
            faces.push(face);
        }
    }
    let mut sum = 0;
    for chunk in ends.chunks_mut(POINTS_PER_POLL) {
        poll()?;
        for end in chunk {
            (*end, sum) = (sum, sum + *end);
        }
    }
    let mut sorted = vec![[0; 3]; faces.len()];
    for chunk in faces.chunks(POINTS_PER_POLL) {
        poll()?;
        for &face in chunk {
            let end = &mut ends[face[0] as usize];
            sorted[*end as usize] = face;
            *end += 1;
        }
    }
    let mut start = 0;
    for chunk in ends.chunks(POINTS_PER_POLL) {
        poll()?;
        for &end in chunk {
            sorted[start..end as usize].sort_unstable();
            start = end as usize;
        }
    }
    free(faces, &mut Poller::new(control, Stage::Triangulate, vertex_count, vertex_count))?;
    Ok(sorted)
}

#[inline]
pub(crate) fn smallest_first([a, b, c]: Face) -> Face {
    // The position of the smallest is random, so selections replace branches.
    let (is_b, is_c) = ((b < a) & (b < c), (c < a) & (c < b));
    let select = |a, b, c| {
        let a_or_b = if is_b { b } else { a };
        if is_c { c } else { a_or_b }
    };
    [select(a, b, c), select(b, c, a), select(c, a, b)]
}

/// The number of lattice points of the rectangle around points given by row, then column, if it has
/// more than one row and column and its corners are among the points.
fn rectangle_area(points: &[Point], control: &dyn Control) -> Result<Option<u64>, Cancelled> {
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else { return Ok(None) };
    let is_vertex = |corner| points.binary_search(&corner).is_ok();
    let mut is_rectangle = first.x < last.x
        && first.y < last.y
        && is_vertex(Point::new(last.x, first.y))
        && is_vertex(Point::new(first.x, last.y));
    for chunk in points.chunks(POINTS_PER_POLL) {
        control.poll(Stage::Triangulate, 0, points.len())?;
        is_rectangle &= chunk.iter().all(|p| (first.x..=last.x).contains(&p.x));
    }
    let side = |from: i32, to: i32| u64::from(to.abs_diff(from)) + 1;
    Ok(is_rectangle.then(|| side(first.x, last.x) * side(first.y, last.y)))
}

#[cfg(test)]
mod tests;
