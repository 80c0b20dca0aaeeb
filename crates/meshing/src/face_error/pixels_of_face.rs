//! Which pixels belong to a face.
//!
//! A pixel inside a face belongs to it. A pixel on a horizontal edge belongs to the face below, one
//! on another edge to the face at its left. A vertex at the right end of a horizontal edge belongs
//! to the face below that edge, any other vertex to the face at its left. Where no such face
//! exists, the face above or at the right owns the pixel. The same rule in other words: every
//! pixel moves a little to the left and much less downwards. A face owns the pixels of the rows
//! `(ymin, ymax]` in the columns `(left, right]`, and in column 0 and row 0 those on its border
//! too. So each pixel of the image belongs to exactly one face of a mesh.
//!
//! [`for_each_row`] is the specification. It walks the edges row by row in integers: each step adds
//! the quotient and the remainder of the edge's slope, so an edge takes one division.
//!
//! [`SmallFace`] is the fast form for faces of small extent that touch neither column 0 nor row 0.
//! It finds eight rows at a time in the lanes of vectors. Edges cross rows at multiples of a slope
//! in fixed point, and a table of reciprocals replaces divisions, so no row waits for another.

use crate::image::Point;
use crate::triangulation::predicates::orientation;
use fearless_simd::{Simd, i32x8, mask32x8, prelude::*};
use std::convert::Infallible;

/// Largest number of columns and of rows between two vertices of a small face; `2^k - 1`.
pub(crate) const MAX_EXTENT: i32 = 63;

pub(crate) const ROWS: usize = 8;

const FRACTION_BITS: u32 = 19;

/// `ceil(2^FRACTION_BITS / rows)` by number of rows.
const RECIPROCALS: [i32; MAX_EXTENT as usize + 1] = {
    let mut reciprocals = [0; MAX_EXTENT as usize + 1];
    let mut rows = 1;
    while rows <= MAX_EXTENT {
        reciprocals[rows as usize] = ((1 << FRACTION_BITS) + rows - 1) / rows;
        rows += 1;
    }
    reciprocals
};

/// Calls `use_row(y, first, end)` for each row in which the counter-clockwise face `abc` owns the
/// pixels of the columns `first..end`, from the bottom up.
#[inline(always)]
pub(crate) fn for_each_row(corners: [Point; 3], mut use_row: impl FnMut(i32, i32, i32)) {
    let Ok(()) = try_for_each_row(
        corners,
        #[inline(always)]
        |y, first, end| {
            use_row(y, first, end);
            Ok::<_, Infallible>(())
        },
    );
}

/// [`for_each_row`] up to the first error of `use_row`.
#[inline(always)]
pub(crate) fn try_for_each_row<E>(
    corners: [Point; 3],
    mut use_row: impl FnMut(i32, i32, i32) -> Result<(), E>,
) -> Result<(), E> {
    let [bottom, middle, top] = by_row(corners);
    let middle_is_right = orientation(bottom, middle, top) > 0;
    if bottom.y == 0 && middle.y == 0 {
        let left = bottom.x.min(middle.x);
        use_row(0, left + i32::from(left > 0), bottom.x.max(middle.x) + 1)?;
    }
    let mut long = EdgeWalk::new(bottom, top);
    for (from, to) in [(bottom, middle), (middle, top)] {
        if from.y == to.y {
            continue;
        }
        let mut short = EdgeWalk::new(from, to);
        for y in from.y + 1..=to.y {
            long.step();
            short.step();
            let (left, right) = if middle_is_right { (&long, &short) } else { (&short, &long) };
            // Column 0 belongs to a face that begins there.
            let is_at_zero = left.x == 0 && left.rest == 0 && (right.x > 0 || right.rest > 0);
            let (first, end) = (left.x + i32::from(!is_at_zero), right.x + 1);
            if first < end {
                use_row(y, first, end)?;
            }
        }
    }
    Ok(())
}

struct EdgeWalk {
    /// The column at or left of the crossing.
    x: i32,
    /// Distance from `x` to the crossing, in units of `1 / rows`.
    rest: i32,
    columns_per_row: i32,
    rest_per_row: i32,
    /// Rows between the ends of the edge, at least 1.
    rows: i32,
}

impl EdgeWalk {
    /// Starts in the row of the lower end of an edge that is not horizontal.
    #[inline]
    fn new(from: Point, to: Point) -> Self {
        let (columns, rows) = (to.x - from.x, to.y - from.y);
        Self {
            x: from.x,
            rest: 0,
            columns_per_row: columns.div_euclid(rows),
            rest_per_row: columns.rem_euclid(rows),
            rows,
        }
    }

    #[inline]
    fn step(&mut self) {
        self.x += self.columns_per_row;
        self.rest += self.rest_per_row;
        if self.rest >= self.rows {
            self.rest -= self.rows;
            self.x += 1;
        }
    }
}

/// A face of at most [`MAX_EXTENT`] columns and rows: the edges that bound its rows.
#[derive(Clone, Copy)]
pub(crate) struct SmallFace {
    long: Slope,
    lower: Slope,
    upper: Slope,
    /// Rows from the lowest vertex to the middle one.
    middle: i32,
    /// The row of the lowest vertex; the face owns pixels from the next row on.
    pub(crate) bottom: i32,
    pub(crate) rows: i32,
    left: i32,
    pub(crate) columns: i32,
}

/// The columns where an edge crosses the rows above its lower end, in fixed point.
///
/// The quotient of `n = 64 rows + columns k` by `rows`, for the `k`-th row, is `n r >> 19` with
/// `r = ceil(2^19 / rows)`. The reciprocal `r` is too large by less than 1 and `n` is at most
/// `127 rows`, so the product is too large by less than `127 * 63 * 63 / rows < 2^19 / rows`: no
/// integer is reached too early. The 64 columns keep `n` from being negative.
#[derive(Clone, Copy)]
struct Slope {
    at_lower_end: i32,
    per_row: i32,
    origin: i32,
}

pub(crate) struct Rows {
    pub(crate) firsts: [i32; ROWS],
    /// Number of pixels from there on; none when it is not positive.
    pub(crate) counts: [i32; ROWS],
}

impl SmallFace {
    /// The small face of three vertices; `None` when its extent is larger.
    #[inline(always)]
    pub(crate) fn new(corners: [Point; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|p| p.x);
        let left = a.min(b).min(c);
        let columns = a.max(b).max(c) - left;
        let [bottom, middle, top] = by_row(corners);
        let rows = top.y - bottom.y;
        (columns <= MAX_EXTENT && rows <= MAX_EXTENT).then(|| Self {
            long: Slope::new(bottom, top),
            lower: Slope::new(bottom, middle),
            upper: Slope::new(middle, top).counted_from_below(middle.y - bottom.y),
            middle: middle.y - bottom.y,
            bottom: bottom.y,
            rows,
            left,
            columns,
        })
    }

    /// Whether the face touches column 0 or row 0, where [`rows`](Self::rows) are not its own.
    #[inline(always)]
    pub(crate) fn touches_axes(&self) -> bool {
        self.left == 0 || self.bottom == 0
    }

    /// The pixels of eight rows, the first of them `row + 1` rows above the lowest vertex. Those of
    /// rows above the highest vertex mean nothing.
    #[inline(always)]
    pub(crate) fn rows<S: Simd>(&self, simd: S, row: i32) -> Rows {
        let steps = i32x8::simd_from(simd, [1, 2, 3, 4, 5, 6, 7, 8]) + row;
        let long = self.long.columns(steps);
        let in_lower: mask32x8<S> = steps.simd_le(self.middle);
        let short = in_lower.select(self.lower.columns(steps), self.upper.columns(steps));
        // In all rows the long edge is on the same side.
        let (left, right) = (long.min(short), long.max(short));
        Rows { firsts: (left + 1).into(), counts: (right - left).into() }
    }
}

impl Slope {
    /// The slope of an edge from its lower end; that of a horizontal edge means nothing.
    #[inline(always)]
    fn new(from: Point, to: Point) -> Self {
        let (columns, rows) = (to.x - from.x, to.y - from.y);
        let reciprocal = RECIPROCALS[(rows & MAX_EXTENT) as usize];
        let offset = MAX_EXTENT + 1;
        Self {
            at_lower_end: offset * rows * reciprocal,
            per_row: columns * reciprocal,
            origin: from.x - offset,
        }
    }

    /// The same edge for steps that count from a row `rows` below its lower end.
    #[inline(always)]
    fn counted_from_below(self, rows: i32) -> Self {
        // What overflows here comes back when the steps are added.
        let before = self.per_row.wrapping_mul(rows);
        Self { at_lower_end: self.at_lower_end.wrapping_sub(before), ..self }
    }

    #[inline(always)]
    fn columns<S: Simd>(self, steps: i32x8<S>) -> i32x8<S> {
        ((steps * self.per_row + self.at_lower_end) >> FRACTION_BITS) + self.origin
    }
}

/// The vertices of a face by row, without branches: their outcomes would be random.
#[inline(always)]
fn by_row(corners: [Point; 3]) -> [Point; 3] {
    let [a, b, c] = corners.map(|p| u64::from(p.y as u32) << 32 | u64::from(p.x as u32));
    let (low, high) = (a.min(b), a.max(b));
    let (low, middle, high) = (low.min(c), low.max(c.min(high)), high.max(c));
    [low, middle, high].map(|p| Point::new(p as i32, (p >> 32) as i32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face_error::pixels_of_face::for_each_row;
    use crate::image::corner_points;
    use crate::triangulation::triangulate;
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// The face that owns a pixel by the rule in words: the one that holds the pixel after a move
    /// by `(-1, -e)` infinitesimals, or to the right or upwards where there is no left or below.
    fn owner(points: &[Point], faces: &[[u32; 3]], p: Point) -> usize {
        let horizontal = if p.x == 0 { 1 } else { -1 };
        let vertical = if p.y == 0 { 1 } else { -1 };
        let inside = |a: Point, b: Point| {
            // Orientation of (a, b, p + (h e, v e^2)), sign by sign.
            let first = -i64::from(b.y - a.y) * horizontal;
            let second = i64::from(b.x - a.x) * vertical;
            [orientation(a, b, p), first, second].into_iter().find(|&term| term != 0) > Some(0)
        };
        let holds = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| points[v as usize]);
            inside(a, b) && inside(b, c) && inside(c, a)
        };
        let owners: Vec<usize> = (0..faces.len()).filter(|&f| holds(&faces[f])).collect();
        assert_eq!(owners.len(), 1, "{p:?} has the owners {owners:?}");
        owners[0]
    }

    proptest! {
        #[test]
        fn each_pixel_belongs_to_the_face_of_the_rule(
            width in 2i32..10,
            height in 2i32..10,
            seeds in prop::collection::vec((0i32..10, 0i32..10), 0..25),
        ) {
            let inner = seeds.iter().map(|&(x, y)| Point::new(x % width, y % height));
            let corners = corner_points(width as usize, height as usize);
            let points: BTreeSet<Point> = inner.chain(corners).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let faces = triangulate(&points);
            let mut owners = vec![None; (width * height) as usize];
            for (f, face) in faces.iter().enumerate() {
                for_each_row(face.map(|v| points[v as usize]), |y, first, end| {
                    for x in first..end {
                        let owner = &mut owners[(y * width + x) as usize];
                        assert_eq!(owner.replace(f), None, "({x}, {y}) is owned twice");
                    }
                });
            }
            for (pixel, found) in (0..).zip(owners) {
                let p = Point::new(pixel % width, pixel / width);
                prop_assert_eq!(found, Some(owner(&points, &faces, p)));
            }
        }
    }

    /// Compares all rows of a face with those of the walk.
    #[inline(always)]
    fn assert_same_rows<S: Simd>(simd: S, corners: [Point; 3]) {
        let face = SmallFace::new(corners).unwrap();
        let mut found = Vec::new();
        for first_row in (0..face.rows).step_by(ROWS) {
            let rows = face.rows(simd, first_row);
            for i in 0..ROWS.min((face.rows - first_row) as usize) {
                if rows.counts[i] > 0 {
                    let y = face.bottom + first_row + 1 + i as i32;
                    found.push((y, rows.firsts[i], rows.firsts[i] + rows.counts[i]));
                }
            }
        }
        let mut expected = Vec::new();
        for_each_row(corners, |y, first, end| expected.push((y, first, end)));
        assert_eq!(found, expected);
    }

    #[test]
    fn small_face_crosses_every_edge_as_the_walk() {
        let extent = MAX_EXTENT;
        for (rows, columns) in (1..=extent).flat_map(|r| (-extent..=extent).map(move |c| (r, c))) {
            let (low, high) = (Point::new(64, 1), Point::new(64 + columns, 1 + rows));
            let beside = if columns < 0 { high.x.max(1) } else { low.x };
            // A third vertex at the left of the edge, level with its upper end.
            let third = Point::new(beside.min(high.x - 1).max(high.x.max(64) - extent), high.y);
            if orientation(low, high, third) > 0 {
                dispatch!(Level::new(), simd => assert_same_rows(simd, [low, high, third]));
            }
        }
    }

    proptest! {
        #[test]
        fn small_face_has_the_rows_of_the_walk(numbers in prop::array::uniform6(1i32..65)) {
            let mut corners = [0, 2, 4].map(|i| Point::new(numbers[i], numbers[i + 1]));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            if orientation(corners[0], corners[1], corners[2]) > 0 {
                dispatch!(Level::new(), simd => assert_same_rows(simd, corners));
            }
        }
    }

    #[test]
    fn larger_faces_are_not_small() {
        let face = |columns, rows| {
            SmallFace::new([Point::new(1, 1), Point::new(1 + columns, 1), Point::new(1, 1 + rows)])
        };
        assert!(face(MAX_EXTENT, MAX_EXTENT).is_some());
        assert!(face(MAX_EXTENT + 1, 1).is_none() && face(1, MAX_EXTENT + 1).is_none());
    }
}
