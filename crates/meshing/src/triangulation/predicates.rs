//! Exact geometric predicates on lattice points: orientation, and the in-circle test of the
//! preferred-directions Delaunay triangulation (PDDT).
//!
//! Christopher Dyken and Michael S. Floater, "Preferred directions for resolving the
//! non-uniqueness of Delaunay triangulations", 2006, give each cocircular quadrilateral the
//! diagonal of the smaller angle with `d1 = (1, 0)`, at a tie with `d2 = (1, 1)`.
//!
//! A symbolic perturbation makes the same choice without angles. Lift every point `p` to the height
//! `|p|^2 - e1 (p.d1)^2 - e2 (p.d2)^2` with infinitesimals `e1 >> e2 > 0`. Where the diagonals `ac`
//! and `bd` of a cocircular quadrilateral cross at `o`, the lifted chord `ac` lies above `q(o)` by
//! `|oa| |oc| q(u)`, where `q` is the quadratic form of the lift and `u` the unit direction of
//! `ac`. Since `|oa| |oc| = |ob| |od|`, the lower hull takes the diagonal of smaller `q(u)`, that
//! is of larger `(u.d1)^2`, at a tie of larger `(u.d2)^2`: the one of smaller angle. The lower hull
//! is the Delaunay triangulation of the lifted points. So no four points are ever cocircular, and
//! the PDDT depends on the points alone.
//!
//! All terms are integer determinants. That of the circle itself has the sign of the sine of the
//! sum of two opposite angles, with fewer multiplications: A. K. Cline and R. L. Renka, "A
//! storage-efficient method for construction of a Thiessen triangulation", 1984.

use crate::image::Point;

/// Twice the signed area of the triangle `abc`, positive counter-clockwise, 0 for collinear points.
///
/// Exact if no two coordinates of the points differ by 2^30 or more; a debug build panics beyond.
///
/// ```
/// use pixmesh_meshing::{Point, orientation};
/// let [a, b, c] = [(0, 0), (4, 0), (0, 3)].map(|(x, y)| Point::new(x, y));
/// assert_eq!((orientation(a, b, c), orientation(a, c, b)), (12, -12));
/// ```
#[inline]
#[must_use]
pub fn orientation(a: Point, b: Point, c: Point) -> i64 {
    let (bx, by) = difference(b, a);
    let (cx, cy) = difference(c, a);
    bx * cy - by * cx
}

/// Whether `d` lies inside the circle of the counter-clockwise triangle `abc`; the preferred
/// directions decide for cocircular points.
///
/// For distinct points there are no ties: of a quadrilateral `a d b c`, whose triangles `abc` and
/// `bad` meet at the edge `ab`, `true` means that `cd` is the diagonal of the triangulation.
///
/// Exact when no two coordinates of the points differ by 2^30 or more; a debug build panics beyond.
///
/// ```
/// use pixmesh_meshing::{Point, in_circle};
/// let [a, b, c] = [(0, 0), (4, 0), (0, 3)].map(|(x, y)| Point::new(x, y));
/// assert!(in_circle(a, b, c, Point::new(3, 2)) && !in_circle(a, b, c, Point::new(5, 5)));
/// ```
#[inline]
#[must_use]
pub fn in_circle(a: Point, b: Point, c: Point, d: Point) -> bool {
    let ((acx, acy), (bcx, bcy)) = (difference(a, c), difference(b, c));
    let ((adx, ady), (bdx, bdy)) = (difference(a, d), difference(b, d));
    // |ac| |bc| |ad| |bd| times the sine of the sum of the angles at c and d in which ab is seen:
    // factors below 2^61 and products below 2^122.
    let (sine_c, cosine_c) = (acx * bcy - acy * bcx, acx * bcx + acy * bcy);
    let (sine_d, cosine_d) = (bdx * ady - bdy * adx, bdx * adx + bdy * ady);
    match product(sine_c, cosine_d) + product(cosine_c, sine_d) {
        0 => preferred(&[difference(a, d), difference(b, d), difference(c, d)]),
        sine => sine < 0,
    }
}

/// The answer for cocircular points, given three of them relative to the fourth: the sign of the
/// first perturbing term that is not 0. Both terms lower the lift, so they count negatively.
#[cold]
fn preferred(rows: &[(i64, i64); 3]) -> bool {
    match determinant(rows, |x, _| x * x) {
        0 => determinant(rows, |x, y| (x + y) * (x + y)) < 0,
        along_d1 => along_d1 < 0,
    }
}

#[inline]
fn difference(p: Point, q: Point) -> (i64, i64) {
    let (x, y) = (i64::from(p.x) - i64::from(q.x), i64::from(p.y) - i64::from(q.y));
    debug_assert!(x.abs().max(y.abs()) < 1 << 30, "{p:?} and {q:?} are too far apart");
    (x, y)
}

/// The determinant of the rows `(x, y, lift(x, y))`, with lifts up to 2^62.
fn determinant(rows: &[(i64, i64); 3], lift: impl Fn(i64, i64) -> i64) -> i128 {
    let [(ax, ay), (bx, by), (cx, cy)] = *rows;
    product(lift(ax, ay), bx * cy - by * cx) - product(lift(bx, by), ax * cy - ay * cx)
        + product(lift(cx, cy), ax * by - ay * bx)
}

/// One multiplication on 64-bit machines.
#[inline]
pub(super) fn product(a: i64, b: i64) -> i128 {
    i128::from(a) * i128::from(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn all_points_of_a_quadrilateral_agree(
            coordinates in prop::array::uniform8(0i32..8),
        ) {
            let [a, b, c, d] = [0, 2, 4, 6].map(|i| Point::new(coordinates[i], coordinates[i + 1]));
            let distinct = a != b && a != c && a != d && b != c && b != d && c != d;
            if distinct && orientation(a, b, c) > 0 {
                // Another edge of the triangle, then the other triangle at the edge ab.
                prop_assert_eq!(in_circle(a, b, c, d), in_circle(b, c, a, d));
                if orientation(b, a, d) > 0 {
                    prop_assert_eq!(in_circle(a, b, c, d), in_circle(b, a, d, c));
                }
            }
        }

        #[test]
        fn in_circle_is_the_sign_of_the_lifted_determinant(
            coordinates in prop::array::uniform8(0i32..4),
            // The last one gives the largest differences allowed.
            scale in prop::sample::select(vec![1, 7, 357_913_941]),
        ) {
            let [a, b, c, d] = [0, 2, 4, 6]
                .map(|i| Point::new(coordinates[i] * scale, coordinates[i + 1] * scale));
            if orientation(a, b, c) > 0 {
                let rows = [difference(a, d), difference(b, d), difference(c, d)];
                let sign = determinant(&rows, |x, y| x * x + y * y);
                let expected = if sign == 0 { preferred(&rows) } else { sign > 0 };
                prop_assert_eq!(in_circle(a, b, c, d), expected);
            }
        }
    }
}
