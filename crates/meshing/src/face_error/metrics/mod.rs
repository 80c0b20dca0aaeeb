//! The errors that greedy removal can be ruled by: one file per metric.
//!
//! A metric turns the difference between a picture's sample vector and its approximation into a
//! whole number, so that sums are exact and removals come in the same order on every machine. The
//! squared error over the components is the thesis's; the others are those of its published
//! program.

mod absolute;
mod luma;
mod squared;
mod ycbcr;

use crate::image::Image;
use crate::parameters::choices::ErrorMetric;

/// An error of sample vectors, in whole numbers.
pub(crate) trait Metric: Sync {
    /// Sum of the errors of a run of lattice points, given component by component.
    fn error(&self, original: &[&[u16]], approximation: &[Vec<u16>]) -> u64;

    /// How many of its whole numbers make one unit of error at one point of an image with so many
    /// components.
    fn per_unit(&self, component_count: usize) -> f64;
}

impl ErrorMetric {
    /// The metric of this name.
    pub(crate) fn metric(self) -> &'static dyn Metric {
        match self {
            // How much a point matters to the similarity is in the image's weights.
            Self::MeanCompSe | Self::Ssim => &squared::MeanOverComponents,
            Self::MeanCompAe => &absolute::MeanOverComponents,
            Self::LumaSe => &luma::Squared,
            Self::LumaAe => &luma::Absolute,
            Self::YcbcrVecSe => &ycbcr::Squared,
            Self::YcbcrVecAe => &ycbcr::Absolute,
            Self::VecSe => &squared::Vector,
        }
    }

    /// Whether the whole numbers are the squared differences, summed over the components.
    pub(crate) fn is_squared_difference(self) -> bool {
        matches!(self, Self::MeanCompSe | Self::VecSe)
    }

    /// The mean error per point that a sum over an image amounts to.
    pub(crate) fn mean(self, sum: u64, image: &Image) -> f64 {
        let per_unit = self.metric().per_unit(image.component_count());
        sum as f64 / (per_unit * image.pixel_count() as f64)
    }
}

/// The mean error per point of an approximation of an image, by a metric; of three components by a
/// metric of one the luma counts.
pub(crate) fn mean_error(image: &Image, approximation: &Image, metric: ErrorMetric) -> f64 {
    let sum = (0..image.height())
        .map(|y| {
            let row = |image: &Image| -> Vec<Vec<u16>> {
                (0..image.component_count()).map(|c| image.row(c, y).to_vec()).collect()
            };
            let (before, after) = (row(image), row(approximation));
            let before: Vec<&[u16]> = before.iter().map(Vec::as_slice).collect();
            metric.metric().error(&before, &after)
        })
        .sum();
    metric.mean(sum, image)
}

/// Sums a function of the differences of all components.
fn sum_of_differences(
    original: &[&[u16]],
    approximation: &[Vec<u16>],
    of_difference: impl Fn(u16) -> u64,
) -> u64 {
    let components = original.iter().zip(approximation);
    components
        .map(|(original, approximation)| {
            let pairs = original.iter().zip(approximation);
            pairs.map(|(&a, &b)| of_difference(a.abs_diff(b))).sum::<u64>()
        })
        .sum()
}

/// Sums a function of the colours before and after.
fn sum_of_colours(
    original: &[&[u16]],
    approximation: &[Vec<u16>],
    of_colours: impl Fn([u16; 3], [u16; 3]) -> u64,
) -> u64 {
    let ([red, green, blue, ..], [red_after, green_after, blue_after, ..]) =
        (original, approximation)
    else {
        return sum_of_differences(original, approximation, |difference| difference.into());
    };
    (0..red.len())
        .map(|i| {
            let after = [red_after[i], green_after[i], blue_after[i]];
            of_colours([red[i], green[i], blue[i]], after)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error of two points of three components, and the whole numbers in a unit.
    fn error(metric: ErrorMetric, points: [([u16; 3], [u16; 3]); 2]) -> f64 {
        let before: Vec<Vec<u16>> =
            (0..3).map(|c| points.map(|point| point.0[c]).to_vec()).collect();
        let after: Vec<Vec<u16>> =
            (0..3).map(|c| points.map(|point| point.1[c]).to_vec()).collect();
        let before: Vec<&[u16]> = before.iter().map(Vec::as_slice).collect();
        metric.metric().error(&before, &after) as f64 / metric.metric().per_unit(3)
    }

    #[test]
    fn each_metric_is_as_computed_by_hand() {
        // The second point is right; of the first red is 30 too low.
        let points = [([130, 50, 20], [100, 50, 20]), ([7, 8, 9], [7, 8, 9])];
        assert_eq!(error(ErrorMetric::MeanCompSe, points), 300.0);
        assert_eq!(error(ErrorMetric::VecSe, points), 900.0);
        assert_eq!(error(ErrorMetric::MeanCompAe, points), 10.0);
        // Luma 70.5 becomes 61.5, both rounded down.
        assert_eq!(error(ErrorMetric::LumaSe, points), 81.0);
        assert_eq!(error(ErrorMetric::LumaAe, points), 9.0);
        // Cb changes by 5.06, Cr by 15: in whole numbers by 5 and 15.
        assert_eq!(error(ErrorMetric::YcbcrVecSe, points), 81.0 + 25.0 + 225.0);
        let length = error(ErrorMetric::YcbcrVecAe, points);
        assert!((length - 331f64.sqrt()).abs() < 1.0 / 256.0, "{length}");
    }

    #[test]
    fn the_largest_errors_of_sixteen_bits_do_not_overflow() {
        let points = [([0, 0, 0], [65_535, 65_535, 65_535]), ([65_535, 0, 65_535], [0, 65_535, 0])];
        for &metric in ErrorMetric::ALL {
            assert!(error(metric, points) > 60_000.0, "{metric}");
        }
    }
}
