//! Squared errors: the mean over the components, and the squared length of the difference vector.

use crate::face_error::metrics::{Metric, sum_of_differences};

/// The squared error, mean over the components: with it the sum over all points is
/// `components * width * height` times the MSE.
pub(super) struct MeanOverComponents;

/// The squared length of the difference of two sample vectors. It orders removals as the mean does.
pub(super) struct Vector;

/// Sum of squared differences.
fn sum_of_squares(original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
    sum_of_differences(original, approximation, |difference| u64::from(difference).pow(2))
}

impl Metric for MeanOverComponents {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_squares(original, approximation)
    }

    fn per_unit(&self, component_count: usize) -> f64 {
        component_count as f64
    }
}

impl Metric for Vector {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_squares(original, approximation)
    }

    fn per_unit(&self, _: usize) -> f64 {
        1.0
    }
}
