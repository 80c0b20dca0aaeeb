//! The linear interpolant over a face, rounded to integers exactly.
//!
//! Let `den` be twice the face's area. At a pixel the interpolant is a fraction `num / den`, where
//! `num` is an integer, linear in `x` and `y`. The nearest integer, halves up, is
//! `floor((2 num + den) / (2 den))`. Floating point computes the fraction `(4 num + 1) / (4 den)`
//! instead and rounds it to nearest: a quarter of a step above `num / den`, it rounds halves up and
//! stays at least `1 / (4 den)` away from every tie, far more than the error of two roundings,
//! `2^16 * 2^-52`, as long as `den < 2^33`. Larger faces divide.
//!
//! [`Interpolant`] is the specification, for faces of any size. [`Plane`] is the fast form for
//! small faces over samples of up to 8 bits, eight values at a time.

use crate::image::Point;
use crate::triangulation::predicates::orientation;
use fearless_simd::{Simd, f32x8, i32x8, prelude::*};

/// Adding this to a number below 2^51 rounds it to an integer, which then is in the low bits of the
/// sum; 1.5 * 2^52.
const ROUND_TO_NEAREST: f64 = 6_755_399_441_055_744.0;

/// Adding this to a number below 2^22 rounds it to an integer, and subtracting it leaves that;
/// 1.5 * 2^23.
const ROUND_TO_NEAREST_F32: f32 = 12_582_912.0;

const FLOATING_POINT_LIMIT: i64 = 1 << 33;

pub(crate) const PLANE_PRECISION: u8 = 8;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Interpolant {
    double_area: i64,
    quarter_reciprocal: f64,
    at_origin: i64,
    /// Change of the numerator from one column to the next.
    per_column: i64,
    /// Change of the numerator from one row to the next.
    per_row: i64,
}

impl Interpolant {
    #[inline]
    pub(crate) fn new([a, b, c]: [Point; 3], samples: [u16; 3]) -> Self {
        let double_area = orientation(a, b, c);
        let [za, zb, zc] = samples.map(i64::from);
        let (bx, by) = (i64::from(b.x - a.x), i64::from(b.y - a.y));
        let (cx, cy) = (i64::from(c.x - a.x), i64::from(c.y - a.y));
        let per_column = (zb - za) * cy - (zc - za) * by;
        let per_row = (zc - za) * bx - (zb - za) * cx;
        let at_a = double_area * za;
        let at_origin = at_a - per_column * i64::from(a.x) - per_row * i64::from(a.y);
        let quarter_reciprocal = 0.25 / double_area as f64;
        Self { double_area, quarter_reciprocal, at_origin, per_column, per_row }
    }

    /// Sum of its squared differences from the `samples` of row `y` from column `x` on.
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

    /// Calls `use_value(i, value)` with the rounded interpolant at `(x + i, y)` for `count` pixels.
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

/// The interpolants of a small face's components in lanes: eight pixels of one component, four of
/// two, or two of three or four.
///
/// Every number up to the quotient is an integer below 2^24, which 32-bit floating point holds
/// exactly: vertices are at most 63 columns and rows apart, so `den` is at most `63^2`, the
/// numerators `4 num + 1` at the face's pixels are at most `4 * 255 * 63^2 + 1 < 2^22`, and they
/// change over the face's extent by at most `4 * 255 * 2 * 63 * 63 < 2^23` in each direction. The
/// quotient by `4 den` is below 256, so two roundings leave an error below `255 * 2^-23`, less than
/// half of `1 / (4 * 63^2)`, the least distance of a quotient from a tie. Lanes beyond the end of a
/// row hold numbers that need not be exact and do not count.
#[derive(Clone, Copy)]
pub(crate) struct Plane<S: Simd> {
    pub(crate) simd: S,
    pub(crate) a: Point,
    /// Numerators at the first vertex and at the pixels after it.
    at_a: f32x8<S>,
    pub(crate) per_column: f32x8<S>,
    pub(crate) per_row: f32x8<S>,
    pub(crate) quarter_reciprocal: f32,
    /// Pixels from the first lane's to that of each lane.
    pub(crate) offsets: i32x8<S>,
}

impl<S: Simd> Plane<S> {
    #[inline(always)]
    pub(crate) fn new(
        simd: S,
        [a, b, c]: [Point; 3],
        [za, zb, zc]: [f32x8<S>; 3],
        offsets: i32x8<S>,
    ) -> Self {
        let ((bx, by), (cx, cy)) = ((b.x - a.x, b.y - a.y), (c.x - a.x, c.y - a.y));
        let double_area = (bx * cy - by * cx) as f32;
        let (to_b, to_c) = ((zb - za) * 4.0, (zc - za) * 4.0);
        let per_column = to_b * cy as f32 - to_c * by as f32;
        let per_row = to_c * bx as f32 - to_b * cx as f32;
        let at_a = za * (4.0 * double_area) + 1.0 + per_column * offsets.to_float::<f32x8<S>>();
        let quarter_reciprocal = 0.25 / double_area;
        Self { simd, a, at_a, per_column, per_row, quarter_reciprocal, offsets }
    }

    /// The numerators in row `y` at and after the column of the first vertex.
    #[inline(always)]
    pub(crate) fn row(&self, y: i32) -> f32x8<S> {
        self.at_a + self.per_row * (y - self.a.y) as f32
    }

    #[inline(always)]
    pub(crate) fn rounded(&self, numerators: f32x8<S>) -> f32x8<S> {
        numerators * self.quarter_reciprocal + ROUND_TO_NEAREST_F32 - ROUND_TO_NEAREST_F32
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

    proptest! {
        #[test]
        fn rounds_faces_of_any_size_exactly(
            side in prop::sample::select(&[12u32, 16_384, 1 << 20][..]),
            seeds: [u32; 8],
            samples: [u16; 3],
        ) {
            let at =
                |i: usize| Point::new((seeds[i] % side) as i32, (seeds[i + 1] % side) as i32);
            let mut face = [at(0), at(2), at(4)];
            if orientation(face[0], face[1], face[2]) < 0 {
                face.swap(1, 2);
            }
            let [a, b, c] = face;
            prop_assume!(orientation(a, b, c) > 0);
            let interpolant = Interpolant::new(face, samples);
            let inside = |p: Point| {
                orientation(a, b, p) >= 0 && orientation(b, c, p) >= 0 && orientation(c, a, p) >= 0
            };
            let middle = Point::new((a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3);
            for p in [a, b, c, at(6), middle].into_iter().filter(|&p| inside(p)) {
                assert_eq!(value(&interpolant, p), rounded(face, samples, p), "{face:?} at {p:?}");
            }
        }
    }

    #[test]
    fn rounds_halves_up() {
        let face = [Point::new(0, 0), Point::new(2, 0), Point::new(0, 2)];
        let interpolant = Interpolant::new(face, [0, 1, 2]);
        assert_eq!(value(&interpolant, Point::new(1, 0)), 1);
        assert_eq!(value(&interpolant, Point::new(1, 1)), 2);
        // A face whose numerators have more digits than a floating-point number.
        let side = 1 << 19;
        let face = [Point::new(0, 0), Point::new(side, 0), Point::new(0, side)];
        let interpolant = Interpolant::new(face, [40_000, 40_001, 40_000]);
        assert_eq!(value(&interpolant, Point::new(side / 2, 0)), 40_001);
        assert_eq!(value(&interpolant, Point::new(side / 2 - 1, 0)), 40_000);
    }
}
