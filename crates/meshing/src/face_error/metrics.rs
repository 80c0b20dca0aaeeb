//! The error metrics: how far an approximation is from the image at a pixel, as an integer.
//!
//! Sums of integers are exact, so removals have the same order on every machine. The squared error
//! over the components is that of the thesis; the other metrics are those of its program.
//!
//! YCbCr is that of ITU-R Recommendation BT.601 with the full range of samples, as in JFIF. Each
//! chroma difference is rounded down to an integer, as the luma is.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage};
use crate::density::luma::luma_of;
use crate::image::Image;
use crate::parameters::choices::ErrorMetric;
use std::ops::Range;

/// Integers in a unit of the length of a YCbCr difference.
const STEPS: u64 = 256;

/// `10^6 Cb` and `10^6 Cr` are the sums of red, green and blue times these factors.
const BLUE_DIFFERENCE: [i64; 3] = [-168_736, -331_264, 500_000];
const RED_DIFFERENCE: [i64; 3] = [500_000, -418_688, -81_312];

pub(crate) struct Run<'a> {
    pub(crate) image: &'a Image,
    pub(crate) pixels: Range<usize>,
    /// The weight of each of these pixels; without weights each counts once.
    pub(crate) weights: Option<&'a [u8]>,
}

impl ErrorMetric {
    /// Sum of the errors of an approximation, given component by component, times the weights.
    pub(crate) fn error(self, run: &Run<'_>, approximation: &[Vec<u16>]) -> u64 {
        match self {
            // The structural similarity is in the weights.
            Self::MeanCompSe | Self::VecSe | Self::Ssim => {
                run.sum_components(approximation, |difference| difference.pow(2))
            }
            Self::MeanCompAe => run.sum_components(approximation, |difference| difference),
            Self::LumaSe => run.sum_colors(approximation, |a, b| luma_difference(a, b).pow(2)),
            Self::LumaAe => run.sum_colors(approximation, luma_difference),
            Self::YcbcrVecSe => run.sum_colors(approximation, squared_length),
            Self::YcbcrVecAe => {
                run.sum_colors(approximation, |a, b| (squared_length(a, b) * STEPS * STEPS).isqrt())
            }
        }
    }

    /// Bits by which weighted sums shrink, so that they fit in 64 bits: squared errors above 8 bits
    /// come in units of the square of 8-bit samples.
    pub(crate) fn weighted_shift(self, precision: u8) -> u32 {
        match self {
            Self::MeanCompAe | Self::LumaAe | Self::YcbcrVecAe => 0,
            _ => 2 * u32::from(precision.saturating_sub(8)),
        }
    }

    pub(crate) fn mean(self, sum: u64, image: &Image) -> f64 {
        sum as f64 / (self.per_unit(image.component_count()) * image.pixel_count() as f64)
    }

    /// The largest sum over an image whose mean error per point is at most `most`.
    pub(crate) fn largest_sum(self, most: f64, image: &Image) -> u64 {
        let mut sum = 0;
        for bit in (0..u64::BITS).rev() {
            let larger = sum | 1 << bit;
            sum = if self.mean(larger, image) <= most { larger } else { sum };
        }
        sum
    }

    fn per_unit(self, component_count: usize) -> f64 {
        match self {
            Self::MeanCompSe | Self::MeanCompAe | Self::Ssim => component_count as f64,
            Self::YcbcrVecAe => STEPS as f64,
            Self::LumaSe | Self::LumaAe | Self::YcbcrVecSe | Self::VecSe => 1.0,
        }
    }
}

pub(crate) fn mean_error(
    image: &Image,
    approximation: &Image,
    metric: ErrorMetric,
    control: &dyn Control,
) -> Result<f64, Cancelled> {
    let (count, mut sum) = (image.pixel_count(), 0);
    for first in (0..count).step_by(POINTS_PER_POLL) {
        control.poll(Stage::Measure, first, count)?;
        let pixels = first..count.min(first + POINTS_PER_POLL);
        let part = |samples: &Vec<u16>| samples[pixels.clone()].to_vec();
        let after: Vec<Vec<u16>> = approximation.components().iter().map(part).collect();
        sum += metric.error(&Run { image, pixels, weights: None }, &after);
    }
    Ok(metric.mean(sum, image))
}

impl Run<'_> {
    fn sum_components(&self, after: &[Vec<u16>], of_difference: impl Fn(u64) -> u64) -> u64 {
        let components = self.image.components().iter().zip(after);
        let of_component = |(before, after): (&Vec<u16>, &Vec<u16>)| {
            let pairs = before[self.pixels.clone()].iter().zip(after);
            self.sum(pairs.map(|(a, &b)| of_difference(a.abs_diff(b).into())))
        };
        components.map(of_component).sum()
    }

    /// Sums a function of the colors before and after; without colors the absolute differences.
    fn sum_colors(&self, after: &[Vec<u16>], of_colors: impl Fn([u16; 3], [u16; 3]) -> u64) -> u64 {
        let [red, green, blue, ..] = after else {
            return self.sum_components(after, |difference| difference);
        };
        let before = [0, 1, 2].map(|c| &self.image.components()[c][self.pixels.clone()]);
        let after = [red, green, blue].map(Vec::as_slice);
        let at = |rows: [&[u16]; 3], i: usize| rows.map(|row| row[i]);
        self.sum((0..self.pixels.len()).map(|i| of_colors(at(before, i), at(after, i))))
    }

    fn sum(&self, errors: impl Iterator<Item = u64>) -> u64 {
        match self.weights {
            None => errors.sum(),
            Some(weights) => errors.zip(weights).map(|(error, &w)| error * u64::from(w)).sum(),
        }
    }
}

fn luma_difference(before: [u16; 3], after: [u16; 3]) -> u64 {
    luma_of(before).abs_diff(luma_of(after)).into()
}

fn squared_length(before: [u16; 3], after: [u16; 3]) -> u64 {
    let (before, after) = (ycbcr(before), ycbcr(after));
    before.iter().zip(after).map(|(&a, b)| a.abs_diff(b).pow(2)).sum()
}

fn ycbcr(color: [u16; 3]) -> [i64; 3] {
    let chroma = |factors: [i64; 3]| {
        let products = factors.iter().zip(color).map(|(f, sample)| f * i64::from(sample));
        products.sum::<i64>().div_euclid(1_000_000)
    };
    [luma_of(color).into(), chroma(BLUE_DIFFERENCE), chroma(RED_DIFFERENCE)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error of an image of four pixels of three components, in units of the metric.
    fn error(metric: ErrorMetric, pixels: [([u16; 3], [u16; 3]); 2]) -> f64 {
        let samples = |c: usize| pixels.map(|(before, _)| before[c]).repeat(2);
        let image = Image::from_bottom_up(2, 2, 16, (0..3).map(samples).collect()).unwrap();
        let after: Vec<Vec<u16>> =
            (0..3).map(|c| pixels.map(|(_, after)| after[c]).to_vec()).collect();
        let error = |weights| metric.error(&Run { image: &image, pixels: 2..4, weights }, &after);
        assert_eq!(error(Some(&[3, 3])), 3 * error(None), "{metric}");
        assert_eq!(error(Some(&[0, 1])) + error(Some(&[1, 0])), error(None), "{metric}");
        error(None) as f64 / metric.per_unit(3)
    }

    #[test]
    fn matches_metrics_computed_by_hand() {
        // The second pixel is right; the red of the first is 30 too low.
        let pixels = [([130, 50, 20], [100, 50, 20]), ([7, 8, 9], [7, 8, 9])];
        assert_eq!(error(ErrorMetric::MeanCompSe, pixels), 300.0);
        assert_eq!(error(ErrorMetric::VecSe, pixels), 900.0);
        assert_eq!(error(ErrorMetric::MeanCompAe, pixels), 10.0);
        // Luma 70.5 becomes 61.5, both rounded down.
        assert_eq!(error(ErrorMetric::LumaSe, pixels), 81.0);
        assert_eq!(error(ErrorMetric::LumaAe, pixels), 9.0);
        // Cb changes by 5.06 and Cr by 15: by the integers 5 and 15.
        assert_eq!(error(ErrorMetric::YcbcrVecSe, pixels), 81.0 + 25.0 + 225.0);
        let length = error(ErrorMetric::YcbcrVecAe, pixels);
        assert!((length - 331f64.sqrt()).abs() < 1.0 / 256.0, "{length}");
    }

    #[test]
    fn largest_errors_of_16_bits_do_not_overflow() {
        let pixels = [([0, 0, 0], [65_535, 65_535, 65_535]), ([65_535, 0, 65_535], [0, 65_535, 0])];
        for &metric in ErrorMetric::ALL {
            assert!(error(metric, pixels) > 60_000.0, "{metric}");
        }
    }

    #[test]
    fn mean_of_an_image_is_that_of_its_pixels() {
        let image =
            |samples: [u16; 4]| Image::from_bottom_up(2, 2, 8, vec![samples.into()]).unwrap();
        let [before, after] = [image([1, 2, 3, 4]), image([1, 4, 3, 8])];
        assert_eq!(mean_error(&before, &after, ErrorMetric::MeanCompSe, &()), Ok(5.0));
        assert_eq!(mean_error(&before, &after, ErrorMetric::MeanCompAe, &()), Ok(1.5));
    }
}
