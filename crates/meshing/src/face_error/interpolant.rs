//! The linear interpolant of one component over a face, rounded to integers exactly.
//!
//! With `den` twice the face's area the interpolant at a lattice point is a fraction `num / den`,
//! and `num` is a whole number, linear in `x` and `y`. The nearest integer, halves up, is
//! `floor((2 num + den) / (2 den))`. Instead of dividing, the fraction `(4 num + 1) / (4 den)` is
//! computed in floating point and rounded to nearest: a quarter of a step above `num / den`, it
//! rounds as wanted at halves and keeps at least `1 / (4 den)` away from every tie, far more than
//! the error of two roundings, `2^16 * 2^-52`, as long as `den < 2^33`. Larger faces divide.

use crate::image::Point;
use crate::triangulation::predicates::orientation;

/// Adding this to a number below 2^51 rounds it to a whole number, which then stands in the low
/// bits of the sum.
const ROUND_TO_NEAREST: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52

/// Faces of at most this double area are computed in floating point.
const FLOATING_POINT_LIMIT: i64 = 1 << 33;

/// One component's interpolant over one face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interpolant {
    /// Twice the area of the face, the denominator.
    double_area: i64,
    /// `1 / (4 double_area)`.
    quarter_reciprocal: f64,
    /// The numerator at `(0, 0)`.
    at_origin: i64,
    /// Change of the numerator from one column to the next.
    per_column: i64,
    /// Change of the numerator from one row to the next.
    per_row: i64,
}

impl Interpolant {
    /// The interpolant of `samples` at the vertices of a counter-clockwise face.
    #[inline]
    pub(crate) fn new([a, b, c]: [Point; 3], samples: [u16; 3]) -> Self {
        let double_area = orientation(a, b, c);
        Self::with_double_area([a, b, c], samples, double_area, 0.25 / double_area as f64)
    }

    /// The same, for a face whose double area and the quarter of its reciprocal are known.
    #[inline]
    pub(crate) fn with_double_area(
        [a, b, c]: [Point; 3],
        samples: [u16; 3],
        double_area: i64,
        quarter_reciprocal: f64,
    ) -> Self {
        let [za, zb, zc] = samples.map(i64::from);
        let (bx, by) = (i64::from(b.x - a.x), i64::from(b.y - a.y));
        let (cx, cy) = (i64::from(c.x - a.x), i64::from(c.y - a.y));
        let per_column = (zb - za) * cy - (zc - za) * by;
        let per_row = (zc - za) * bx - (zb - za) * cx;
        let at_a = double_area * za;
        let at_origin = at_a - per_column * i64::from(a.x) - per_row * i64::from(a.y);
        Self { double_area, quarter_reciprocal, at_origin, per_column, per_row }
    }

    /// Sum of the squared differences between the rounded interpolant and the `samples` of row
    /// `y` from column `x` on.
    #[inline(always)]
    pub(crate) fn squared_error(&self, x: i32, y: i32, samples: &[u16]) -> u64 {
        let mut sum = 0;
        self.for_each_value(
            x,
            y,
            samples.len(),
            #[inline(always)]
            |i, value| {
                let difference = (value - i32::from(samples[i])).unsigned_abs();
                sum += u64::from(difference * difference);
            },
        );
        sum
    }

    /// Writes the rounded interpolant of row `y` from column `x` on.
    #[inline(always)]
    pub(crate) fn fill(&self, x: i32, y: i32, samples: &mut [u16]) {
        self.for_each_value(x, y, samples.len(), |i, value| samples[i] = value as u16);
    }

    /// Calls `use_value(i, value)` with the rounded interpolant at `(x + i, y)` for `count` points
    /// of the face.
    #[inline(always)]
    fn for_each_value(&self, x: i32, y: i32, count: usize, mut use_value: impl FnMut(usize, i32)) {
        let start = self.at_origin + self.per_column * i64::from(x) + self.per_row * i64::from(y);
        if self.double_area > FLOATING_POINT_LIMIT {
            for i in 0..count {
                let numerator = start + self.per_column * i as i64;
                let rounded = (2 * numerator + self.double_area).div_euclid(2 * self.double_area);
                use_value(i, rounded as i32);
            }
            return;
        }
        let (first, step) = ((4 * start + 1) as f64, (4 * self.per_column) as f64);
        for i in 0..count {
            let value = (first + step * i as f64) * self.quarter_reciprocal;
            use_value(i, (value + ROUND_TO_NEAREST).to_bits() as i32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, in 128 bits.
    fn rounded([a, b, c]: [Point; 3], samples: [u16; 3], p: Point) -> i128 {
        let double_area = i128::from(orientation(a, b, c));
        let weights = [orientation(b, c, p), orientation(c, a, p), orientation(a, b, p)];
        let numerator: i128 =
            weights.iter().zip(samples).map(|(&w, z)| i128::from(w) * i128::from(z)).sum();
        (2 * numerator + double_area).div_euclid(2 * double_area)
    }

    /// The value that the interpolant gives at one point.
    fn value(interpolant: &Interpolant, p: Point) -> i128 {
        let mut sample = [0];
        interpolant.fill(p.x, p.y, &mut sample);
        sample[0].into()
    }

    fn check(side: i32, seeds: [u32; 8], samples: [u16; 3]) {
        let at = |i: usize| {
            Point::new((seeds[i] % side as u32) as i32, (seeds[i + 1] % side as u32) as i32)
        };
        let mut face = [at(0), at(2), at(4)];
        if orientation(face[0], face[1], face[2]) < 0 {
            face.swap(1, 2);
        }
        let [a, b, c] = face;
        if orientation(a, b, c) == 0 {
            return;
        }
        let interpolant = Interpolant::new(face, samples);
        let inside = |p: Point| {
            orientation(a, b, p) >= 0 && orientation(b, c, p) >= 0 && orientation(c, a, p) >= 0
        };
        let middle = Point::new((a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3);
        for p in [a, b, c, at(6), middle].into_iter().filter(|&p| inside(p)) {
            assert_eq!(value(&interpolant, p), rounded(face, samples, p), "{face:?} at {p:?}");
        }
    }

    proptest! {
        #[test]
        fn interpolants_of_small_faces_are_rounded_exactly(seeds: [u32; 8], samples: [u16; 3]) {
            check(12, seeds, samples);
        }

        #[test]
        fn interpolants_of_large_faces_are_rounded_exactly(seeds: [u32; 8], samples: [u16; 3]) {
            check(16_384, seeds, samples);
        }

        #[test]
        fn interpolants_of_huge_faces_are_rounded_exactly(seeds: [u32; 8], samples: [u16; 3]) {
            check(1 << 20, seeds, samples);
        }
    }

    #[test]
    fn a_run_of_points_has_the_value_of_each() {
        let samples = [65_535, 3, 40_000];
        let sides = [(12, 12), (70_000, 70_000), (1_000_000, 1_000_000), (20_000, 1_000_000)];
        for (width, height) in sides {
            let corners = [(0, 0), (width, 0), (2, height)].map(|(x, y)| Point::new(x, y));
            let mut run = [0; 7];
            Interpolant::new(corners, samples).fill(1, 1, &mut run);
            let expected =
                [1, 2, 3, 4, 5, 6, 7].map(|x| rounded(corners, samples, Point::new(x, 1)));
            assert_eq!(run.map(i128::from), expected, "{width} by {height}");
        }
    }

    #[test]
    fn halves_are_rounded_up() {
        let face = [Point::new(0, 0), Point::new(2, 0), Point::new(0, 2)];
        let interpolant = Interpolant::new(face, [0, 1, 2]);
        assert_eq!(value(&interpolant, Point::new(1, 0)), 1);
        assert_eq!(value(&interpolant, Point::new(1, 1)), 2);
        // Of a face so large that its numerators have more digits than a floating-point number.
        let side = 1 << 19;
        let face = [Point::new(0, 0), Point::new(side, 0), Point::new(0, side)];
        let interpolant = Interpolant::new(face, [40_000, 40_001, 40_000]);
        assert_eq!(value(&interpolant, Point::new(side / 2, 0)), 40_001);
        assert_eq!(value(&interpolant, Point::new(side / 2 - 1, 0)), 40_000);
    }
}
