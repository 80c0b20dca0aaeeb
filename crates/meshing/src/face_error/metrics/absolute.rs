//! The absolute error, mean over the components.

use crate::face_error::metrics::{Metric, sum_of_differences};

/// The absolute error, mean over the components.
pub(super) struct MeanOverComponents;

impl Metric for MeanOverComponents {
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64 {
        sum_of_differences(original, approximation, u64::from)
    }

    fn per_unit(&self, component_count: usize) -> f64 {
        component_count as f64
    }
}
