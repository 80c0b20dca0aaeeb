//! The fill of a hole of few vertices near each other, in arrays of fixed size.

use crate::image::Point;
use crate::triangulation::predicates::{in_circle_near, of_cocircular};

/// Room for the vertices of a hole.
pub(crate) const PLACES: usize = 16;

/// Room for its triangles.
pub(crate) const TRIANGLES: usize = 8;

/// The triangles, two fewer than vertices, that fill the hole of the first `count` points, which are
/// at least three and at most ten; their vertices as places, counter-clockwise and ascending.
///
/// Coordinates must be below 2^14.
#[inline]
pub(crate) fn fill_few(points: &[Point; PLACES], count: usize) -> [[u8; 3]; TRIANGLES] {
    let mut fill = Fill { points, triangles: [[0; 3]; TRIANGLES], found: 0 };
    // Parts of the boundary that are still to be filled.
    let mut gaps = [(0, 0); TRIANGLES];
    let mut open = fill.take(0, count - 1, &mut gaps, 0);
    while open > 0 {
        open -= 1;
        let (from, to) = gaps[open % TRIANGLES];
        let apex = apex(points, from, to);
        fill.push([from, apex, to]);
        open = fill.take(apex, to, &mut gaps, open);
        open = fill.take(from, apex, &mut gaps, open);
    }
    fill.triangles
}

/// A fill in work.
struct Fill<'a> {
    points: &'a [Point; PLACES],
    triangles: [[u8; 3]; TRIANGLES],
    found: usize,
}

impl Fill<'_> {
    /// Fills a part of the boundary of three or four points, or adds a larger one to those that are
    /// open; returns how many are.
    #[inline(always)]
    fn take(
        &mut self,
        from: usize,
        to: usize,
        gaps: &mut [(usize, usize); TRIANGLES],
        open: usize,
    ) -> usize {
        match to - from {
            0 | 1 => open,
            2 => {
                self.push([from, from + 1, to]);
                open
            }
            3 => {
                let [a, b, c, d] = [from, from + 1, from + 2, to];
                let [pa, pb, pc, pd] = [a, b, c, d].map(|place| self.points[place % PLACES]);
                let is_inside = in_circle_near(pa, pb, pc, pd);
                self.push([a, if is_inside { b } else { c }, d]);
                self.push([if is_inside { b } else { a }, if is_inside { c } else { b }, {
                    if is_inside { d } else { c }
                }]);
                open
            }
            _ => {
                gaps[open % TRIANGLES] = (from, to);
                open + 1
            }
        }
    }

    #[inline(always)]
    fn push(&mut self, corners: [usize; 3]) {
        self.triangles[self.found % TRIANGLES] = corners.map(|place| place as u8);
        self.found += 1;
    }
}

/// The place between `from` and `to` whose vertex sees the edge between these under the largest
/// angle. Angles are compared by their cotangents, as in [`hole`](crate::triangulation::hole).
#[inline(always)]
fn apex(points: &[Point; PLACES], from: usize, to: usize) -> usize {
    let (a, b) = (points[to % PLACES], points[from % PLACES]);
    let (mut best, mut best_dot, mut best_cross) = (from, 1, 0);
    for place in from + 1..to {
        let c = points[place % PLACES];
        let ((ax, ay), (bx, by)) = ((a.x - c.x, a.y - c.y), (b.x - c.x, b.y - c.y));
        let (dot, cross) = (i64::from(ax * bx + ay * by), i64::from(ax * by - ay * bx));
        let (this, other) = (dot * best_cross, best_dot * cross);
        let mut is_better = (this < other) & (cross > 0);
        if this == other && cross > 0 {
            is_better = of_cocircular(a, b, points[best % PLACES], c);
        }
        best = if is_better { place } else { best };
        best_dot = if is_better { dot } else { best_dot };
        best_cross = if is_better { cross } else { best_cross };
    }
    best
}
