//! The rounded interpolants of a small face over samples of up to 8 bits, eight at a time.
//!
//! As [`Interpolant`](crate::face_error::interpolant) computes them, but in 32-bit floating point. Every number
//! up to the quotient is a whole one below 2^24 and so exact: with vertices at most 63 columns and
//! rows apart, twice the area `den` is at most `63^2`, the numerators `4 num + 1` of the face's points
//! at most `4 * 255 * 63^2 + 1 < 2^22`, and their change over the face's extent in each direction at
//! most `4 * 255 * 2 * 63 * 63 < 2^23`. The quotient by `4 den` is below 256, so two roundings leave an
//! error below `255 * 2^-23`, less than half of `1 / (4 * 63^2)`, the least distance of a quotient
//! from a tie. Lanes beyond the end of a row hold numbers that need not be exact and do not count.

use crate::image::Point;
use fearless_simd::{Simd, f32x8, i32x8, prelude::*};

/// The largest number of bits of such samples.
pub(crate) const PRECISION: u8 = 8;

/// Adding this to a number below 2^22 rounds it to a whole number, taking it away leaves that.
const ROUND_TO_NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

/// The planes of a face's components: the numerators of their interpolants.
#[derive(Clone, Copy)]
pub(crate) struct Plane<S: Simd> {
    pub(crate) simd: S,
    /// The first vertex.
    pub(crate) a: Point,
    /// Numerators at the first vertex and the points after it.
    at_a: f32x8<S>,
    pub(crate) per_column: f32x8<S>,
    pub(crate) per_row: f32x8<S>,
    pub(crate) quarter_reciprocal: f32,
    /// How many points after the first one each lane stands.
    pub(crate) offsets: i32x8<S>,
}

impl<S: Simd> Plane<S> {
    /// The planes of the samples at the vertices of a counter-clockwise small face.
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

    /// The interpolants with these numerators, rounded.
    #[inline(always)]
    pub(crate) fn rounded(&self, numerators: f32x8<S>) -> f32x8<S> {
        numerators * self.quarter_reciprocal + ROUND_TO_NEAREST - ROUND_TO_NEAREST
    }
}
