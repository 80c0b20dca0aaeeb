//! Which lattice points belong to a small face, eight rows at a time.
//!
//! The same rule as in [`face_rows`](crate::face_error::face_rows), for faces that touch neither column 0 nor
//! row 0, where it has no exceptions: row `y` of `(ymin, ymax]` holds the columns `(left, right]`.
//! Edges cross rows at multiples of a slope in fixed point, with a table of reciprocals instead of
//! divisions, so the rows do not wait for each other and lie side by side in the lanes of vectors.

use crate::image::Point;
use fearless_simd::{Simd, i32x8, mask32x8, prelude::*};

/// The most columns and rows between two vertices of a small face.
pub(crate) const LARGEST_EXTENT: i32 = 63;

/// Rows side by side.
pub(crate) const ROWS: usize = 8;

/// Binary digits after the point.
const FRACTION: u32 = 19;

/// `ceil(2^FRACTION / rows)` for each number of rows.
const RECIPROCALS: [i32; LARGEST_EXTENT as usize + 1] = {
    let mut reciprocals = [0; LARGEST_EXTENT as usize + 1];
    let mut rows = 1;
    while rows <= LARGEST_EXTENT {
        reciprocals[rows as usize] = ((1 << FRACTION) + rows - 1) / rows;
        rows += 1;
    }
    reciprocals
};

/// The edges of a small face, and its extent.
#[derive(Clone, Copy)]
pub(crate) struct Edges {
    /// From the lowest vertex to the highest, from the lowest to the middle one, and from there to
    /// the highest.
    long: Slope,
    lower: Slope,
    upper: Slope,
    /// How many rows above the lowest vertex the middle one lies.
    middle: i32,
    /// The row of the lowest vertex; the first one with points is the next.
    pub(crate) bottom: i32,
    /// Rows from the lowest vertex to the highest.
    pub(crate) rows: i32,
    /// The least column of a vertex, and how many columns there are to the greatest.
    pub(crate) left: i32,
    pub(crate) columns: i32,
}

/// The places where an edge crosses the rows above its lower end, in fixed point.
///
/// The quotient of `n = 64 rows + columns k` by `rows`, for the `k`-th row, is `n r >> 19` with
/// `r = ceil(2^19 / rows)`: `r` is too large by less than `1`, `n` at most `127 rows`, so the product
/// is too large by less than `127 * 63 * 63 / rows < 2^19 / rows`, and no whole number is reached
/// too early. Adding 64 columns keeps `n` from being negative.
#[derive(Clone, Copy)]
struct Slope {
    place: i32,
    per_row: i32,
    /// The column that the place counts from.
    origin: i32,
}

/// The points of eight rows.
pub(crate) struct Rows {
    /// The first column of each.
    pub(crate) firsts: [i32; ROWS],
    /// How many points follow from there on; none when it is not positive.
    pub(crate) counts: [i32; ROWS],
}

impl Edges {
    /// The edges of a face; `None` when it is not small. Where it touches column 0 or row 0 its
    /// rows are not those of this module.
    #[inline(always)]
    pub(crate) fn new(corners: [Point; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|p| p.x);
        let left = a.min(b).min(c);
        let columns = a.max(b).max(c) - left;
        let [bottom, middle, top] = by_row(corners);
        let rows = top.y - bottom.y;
        (columns <= LARGEST_EXTENT && rows <= LARGEST_EXTENT).then(|| Self {
            long: Slope::new(bottom, top),
            lower: Slope::new(bottom, middle),
            upper: Slope::new(middle, top).after(middle.y - bottom.y),
            middle: middle.y - bottom.y,
            bottom: bottom.y,
            rows,
            left,
            columns,
        })
    }

    /// The points of the rows from the one after `row` rows above the lowest vertex on. Of rows
    /// above the highest vertex they mean nothing.
    #[inline(always)]
    pub(crate) fn rows<S: Simd>(&self, simd: S, row: i32) -> Rows {
        let steps = i32x8::simd_from(simd, [1, 2, 3, 4, 5, 6, 7, 8]) + row;
        let long = self.long.columns(steps);
        let in_lower: mask32x8<S> = steps.simd_le(self.middle);
        let short = in_lower.select(self.lower.columns(steps), self.upper.columns(steps));
        // The long edge is at the left or at the right, in all rows.
        let (left, right) = (long.min(short), long.max(short));
        Rows { firsts: (left + 1).into(), counts: (right - left).into() }
    }
}

impl Slope {
    /// The slope of an edge, from its lower end; of a horizontal one it means nothing.
    #[inline(always)]
    fn new(from: Point, to: Point) -> Self {
        let (columns, rows) = (to.x - from.x, to.y - from.y);
        let reciprocal = RECIPROCALS[(rows & LARGEST_EXTENT) as usize];
        let ahead = LARGEST_EXTENT + 1;
        Self {
            place: ahead * rows * reciprocal,
            per_row: columns * reciprocal,
            origin: from.x - ahead,
        }
    }

    /// The same edge, whose lower end lies so many rows above the one that steps count from.
    #[inline(always)]
    fn after(self, rows: i32) -> Self {
        // Whatever overflows comes back when the steps are added.
        Self { place: self.place.wrapping_sub(self.per_row.wrapping_mul(rows)), ..self }
    }

    /// The columns at or left of the crossings.
    #[inline(always)]
    fn columns<S: Simd>(self, steps: i32x8<S>) -> i32x8<S> {
        ((steps * self.per_row + self.place) >> FRACTION) + self.origin
    }
}

/// The vertices of a face by row, without branches, which would be taken at random.
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
    use crate::face_error::face_rows::for_each_row;
    use crate::triangulation::predicates::orientation;
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    /// Compares all rows of a face with those of the exact walk.
    #[inline(always)]
    fn assert_same_rows<S: Simd>(simd: S, corners: [Point; 3]) {
        let edges = Edges::new(corners).unwrap();
        let mut found = Vec::new();
        for first_row in (0..edges.rows).step_by(ROWS) {
            let rows = edges.rows(simd, first_row);
            for i in 0..ROWS.min((edges.rows - first_row) as usize) {
                if rows.counts[i] > 0 {
                    let y = edges.bottom + first_row + 1 + i as i32;
                    found.push((y, rows.firsts[i], rows.firsts[i] + rows.counts[i]));
                }
            }
        }
        let mut expected = Vec::new();
        for_each_row(corners, |y, first, end| expected.push((y, first, end)));
        assert_eq!(found, expected);
    }

    #[test]
    fn every_edge_of_every_small_extent_is_crossed_as_in_the_exact_walk() {
        let extent = LARGEST_EXTENT;
        for (rows, columns) in (1..=extent).flat_map(|r| (-extent..=extent).map(move |c| (r, c))) {
            let (low, high) = (Point::new(64, 1), Point::new(64 + columns, 1 + rows));
            let beside = if columns < 0 { high.x.max(1) } else { low.x };
            // The edge with a vertex at the left of it, level with its upper end.
            let third = Point::new(beside.min(high.x - 1).max(high.x.max(64) - extent), high.y);
            if orientation(low, high, third) > 0 {
                dispatch!(Level::new(), simd => assert_same_rows(simd, [low, high, third]));
            }
        }
    }

    proptest! {
        #[test]
        fn small_faces_have_the_rows_of_the_exact_walk(places in prop::array::uniform6(1i32..65)) {
            let mut corners = [0, 2, 4].map(|i| Point::new(places[i], places[i + 1]));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            if orientation(corners[0], corners[1], corners[2]) > 0 {
                dispatch!(Level::new(), simd => assert_same_rows(simd, corners));
            }
        }
    }

    #[test]
    fn faces_beyond_the_largest_extent_are_not_small() {
        let face = |columns, rows| {
            Edges::new([Point::new(1, 1), Point::new(1 + columns, 1), Point::new(1, 1 + rows)])
        };
        assert!(face(LARGEST_EXTENT, LARGEST_EXTENT).is_some());
        assert!(face(LARGEST_EXTENT + 1, 1).is_none() && face(1, LARGEST_EXTENT + 1).is_none());
    }
}
