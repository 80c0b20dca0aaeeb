//! Which lattice points belong to a face.
//!
//! A point inside a face belongs to it. A point on a horizontal edge belongs to the face below, on
//! another edge to the face at the left; a vertex that ends a horizontal edge at its right belongs
//! to the face below that edge, any other to the face at its left; where there is none, to the one
//! above or at the right. That is the same as moving every point a little to the left and much less
//! downwards: a face owns the points of rows `(ymin, ymax]` in columns `(left, right]`, and in
//! column 0 and row 0 those on its border too. So each point of the image belongs to exactly one
//! face of a mesh.
//!
//! Edges are walked row by row in whole numbers: each step adds the quotient and the remainder of
//! the edge's slope, so one division serves a whole edge.

use crate::image::Point;

/// Calls `use_row(y, first, end)` for each row of the counter-clockwise face `abc` that holds
/// points of it, with columns `first..end`, from the bottom up.
#[inline(always)]
pub(crate) fn for_each_row([a, b, c]: [Point; 3], mut use_row: impl FnMut(i32, i32, i32)) {
    let (bottom, middle, top, middle_is_right) = sorted_by_row(a, b, c);
    if bottom.y == 0 && middle.y == 0 {
        lowest_row(bottom.x.min(middle.x), bottom.x.max(middle.x), &mut use_row);
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
            let (first, end) = columns(left, right);
            if first < end {
                use_row(y, first, end);
            }
        }
    }
}

/// The columns right of `left`, up to and with `right`; column 0 too where the face begins there.
#[inline]
fn columns(left: &EdgeWalk, right: &EdgeWalk) -> (i32, i32) {
    let begins_at_zero = left.x == 0 && left.rest == 0 && (right.x > 0 || right.rest > 0);
    (left.x + 1 - i32::from(begins_at_zero), right.x + 1)
}

/// Row 0 of a face whose horizontal edge from `left` to `right` lies in it.
#[inline]
fn lowest_row(left: i32, right: i32, use_row: &mut impl FnMut(i32, i32, i32)) {
    let first = if left == 0 { 0 } else { left + 1 };
    use_row(0, first, right + 1);
}

/// The vertices from the bottom up, and whether the middle one lies right of the line through the
/// others.
#[inline]
fn sorted_by_row(a: Point, b: Point, c: Point) -> (Point, Point, Point, bool) {
    // Rotating keeps the face counter-clockwise: then the second vertex is right of the line from
    // the first, lowest one to the third, and the third left of the line to the second.
    let (bottom, next, last) = if a.y <= b.y && a.y <= c.y {
        (a, b, c)
    } else if b.y <= c.y {
        (b, c, a)
    } else {
        (c, a, b)
    };
    if next.y <= last.y { (bottom, next, last, true) } else { (bottom, last, next, false) }
}

/// The place where an edge crosses a row, as column and remainder.
struct EdgeWalk {
    /// The column at or left of the crossing.
    x: i32,
    /// How far beyond `x` the crossing lies, in units of `1 / rows`.
    rest: i32,
    /// Whole columns to go on with each row.
    columns_per_row: i32,
    /// What remains of them, in units of `1 / rows`.
    rest_per_row: i32,
    /// Rows that the edge spans, at least 1.
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

    /// Goes on to the next row.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::corner_points;
    use crate::triangulation::predicates::orientation;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// The face that the rule in words gives a lattice point to: the one that holds the point
    /// moved by `(-1, -e)` infinitesimals, or to the right or upwards where there is no left or
    /// below.
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
        fn every_lattice_point_belongs_to_the_one_face_that_the_rule_names(
            width in 2i32..10,
            height in 2i32..10,
            seeds in prop::collection::vec((0i32..10, 0i32..10), 0..25),
        ) {
            let inner = seeds.iter().map(|&(x, y)| Point::new(x % width, y % height));
            let corners = corner_points(width as usize, height as usize);
            let points: Vec<Point> = inner.chain(corners).collect::<BTreeSet<_>>().into_iter().collect();
            let faces = triangulate(&points);
            let mut owners = vec![None; (width * height) as usize];
            for (f, face) in faces.iter().enumerate() {
                for_each_row(face.map(|v| points[v as usize]), |y, first, end| {
                    for x in first..end {
                        let place = &mut owners[(y * width + x) as usize];
                        assert_eq!(place.replace(f), None, "({x}, {y}) is owned twice");
                    }
                });
            }
            for (place, found) in (0..).zip(owners) {
                let p = Point::new(place % width, place / width);
                prop_assert_eq!(found, Some(owner(&points, &faces, p)));
            }
        }
    }
}
