//! Errors in the YCbCr space, where luma and the two chroma differences are apart.
//!
//! ITU-R Recommendation BT.601, with the full range of samples as in JFIF, and each chroma
//! difference rounded down to a whole number as the luma is.

use crate::density::luma::luma_of;
use crate::face_error::metrics::{Metric, sum_of_colours};

/// The squared length of the difference of two colours.
pub(super) struct Squared;

/// The length of the difference of two colours, in steps of `1 / 256`, rounded down.
pub(super) struct Absolute;

/// Steps of the length to a unit.
const STEPS: u64 = 256;

/// Cb and Cr times 10^6 are these weights' sums with red, green and blue.
const BLUE_DIFFERENCE: [i64; 3] = [-168_736, -331_264, 500_000];
const RED_DIFFERENCE: [i64; 3] = [500_000, -418_688, -81_312];

/// Luma and the chroma differences of a colour, in whole numbers.
fn ycbcr(colour: [u16; 3]) -> [i64; 3] {
    let chroma = |weights: [i64; 3]| {
        let products =
            weights.iter().zip(colour).map(|(&weight, sample)| weight * i64::from(sample));
        products.sum::<i64>().div_euclid(1_000_000)
    };
    [luma_of(colour).into(), chroma(BLUE_DIFFERENCE), chroma(RED_DIFFERENCE)]
}

/// The squared length of the difference.
fn squared_length(before: [u16; 3], after: [u16; 3]) -> u64 {
    let (before, after) = (ycbcr(before), ycbcr(after));
    before.iter().zip(after).map(|(&a, b)| a.abs_diff(b).pow(2)).sum()
}

impl Metric for Squared {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_colours(original, approximation, squared_length)
    }

    fn per_unit(&self, _: usize) -> f64 {
        1.0
    }
}

impl Metric for Absolute {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_colours(original, approximation, |before, after| {
            (squared_length(before, after) * STEPS * STEPS).isqrt()
        })
    }

    fn per_unit(&self, _: usize) -> f64 {
        STEPS as f64
    }
}
