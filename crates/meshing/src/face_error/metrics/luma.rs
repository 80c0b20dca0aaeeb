//! Errors of the luma alone: what the eye sees of a difference, were the picture gray.

use crate::density::luma::luma_of;
use crate::face_error::metrics::{Metric, sum_of_colours};

/// The squared error of the luma.
pub(super) struct Squared;

/// The absolute error of the luma.
pub(super) struct Absolute;

/// The difference of the luma, an integer like the luma itself.
fn difference(before: [u16; 3], after: [u16; 3]) -> u64 {
    luma_of(before).abs_diff(luma_of(after)).into()
}

impl Metric for Squared {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_colours(original, approximation, |before, after| difference(before, after).pow(2))
    }

    fn per_unit(&self, _: usize) -> f64 {
        1.0
    }
}

impl Metric for Absolute {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_colours(original, approximation, difference)
    }

    fn per_unit(&self, _: usize) -> f64 {
        1.0
    }
}
