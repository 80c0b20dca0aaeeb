//! Heights in whole steps of 16 bits.

use crate::heights::Heights;
use thiserror::Error;

/// The largest number of steps.
const MOST_STEPS: f64 = 65_535.0;

/// A bound on the error is this many steps, where no step is given.
const STEPS_PER_BOUND: f64 = 8.0;

/// What is wanted of the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// The height of a step, over 0.
    pub step: Option<f64>,
    /// The largest error of the mesh's heights.
    pub bound: Option<f64>,
}

/// How heights become whole numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// The height of the sample 0.
    pub base: f64,
    /// The height from a sample to the next.
    pub step: f64,
    /// The largest difference of a height from that of its sample.
    pub rounding: f64,
}

/// Heights that fit no 16 bits.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum StepError {
    /// There are more steps than 16 bits count.
    #[error(
        "heights from {least} to {most} are too far apart for 65535 steps of {step}: give a step \
         of at least {smallest}"
    )]
    TooMany {
        /// The lowest height.
        least: f64,
        /// The highest.
        most: f64,
        /// The step.
        step: f64,
        /// The smallest step that fits.
        smallest: f64,
    },
    /// Every sample is missing.
    #[error("the elevation model has no height at all: each sample is NaN or of the nodata value")]
    Empty,
}

impl Heights {
    /// Chooses steps: the one given, for whole numbers that of their scale, else an eighth of the
    /// bound, and without a bound the smallest that fits.
    ///
    /// # Errors
    /// When the heights take more than 65,535 steps, or there is none.
    pub fn in_steps(&self, wish: Wish) -> Result<Steps, StepError> {
        let range = self.all().flatten().fold(None, |range, height| match range {
            None => Some((height, height)),
            Some((least, most)) => Some((height.min(least), height.max(most))),
        });
        let (least, most) = range.ok_or(StepError::Empty)?;
        if self.elevation().is_plain && wish.step.is_none() {
            return Ok(Steps { base: 0.0, step: 1.0, rounding: 0.0 });
        }
        let smallest = (most - least) / MOST_STEPS;
        let own = self.elevation().scale.abs();
        let step = match wish {
            Wish { step: Some(step), .. } => step,
            _ if self.are_whole() && own >= smallest => own,
            Wish { bound: Some(bound), .. } if bound > 0.0 => bound / STEPS_PER_BOUND,
            _ if smallest > 0.0 => smallest,
            _ => 1.0,
        };
        if step < smallest || !(smallest.is_finite() && step.is_finite()) {
            return Err(StepError::TooMany { least, most, step, smallest });
        }
        let mut steps = Steps { base: least, step, rounding: 0.0 };
        let error = |height: f64| {
            let sample = steps.sample(Some(height)).unwrap_or_default();
            (steps.height(sample.into()) - height).abs()
        };
        steps.rounding = self.all().flatten().map(error).fold(0.0, f64::max);
        // Binary fractions round the heights of a decimal scale.
        if steps.rounding < 1e-9 * step {
            steps.rounding = 0.0;
        }
        Ok(steps)
    }
}

impl Steps {
    /// The sample of a height.
    #[must_use]
    pub fn sample(&self, height: Option<f64>) -> Option<u16> {
        height.map(|height| ((height - self.base) / self.step + 0.5).floor() as u16)
    }

    /// The height of a sample, whole or not.
    #[must_use]
    pub fn height(&self, sample: f64) -> f64 {
        self.base + sample * self.step
    }

    /// How many steps a mesh of the samples may be from them, so that it is at most `bound` from the
    /// heights; `None` where rounding alone is more.
    #[must_use]
    pub fn within(&self, bound: f64) -> Option<f64> {
        Some((bound - self.rounding) / self.step).filter(|&steps| steps >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tags::Elevation;
    use proptest::prelude::*;
    use std::io::Cursor;
    use tiff::decoder::Decoder;
    use tiff::encoder::TiffEncoder;
    use tiff::encoder::colortype::Gray64Float;

    fn heights(samples: &[f64]) -> Heights {
        let mut file = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut file).unwrap();
        encoder.write_image::<Gray64Float>(samples.len() as u32, 1, samples).unwrap();
        let mut decoder = Decoder::new(Cursor::new(file.into_inner())).unwrap();
        let elevation = Elevation::open(&mut decoder).unwrap().unwrap();
        elevation.heights(&mut decoder).unwrap()
    }

    proptest! {
        #[test]
        fn samples_are_as_near_as_the_rounding_says(
            samples in prop::collection::vec(-1e6..1e6, 1..40),
            step in prop::option::of(40.0..1000.0),
            bound in prop::option::of(300.0..1000.0),
        ) {
            let heights = heights(&samples);
            let steps = heights.in_steps(Wish { step, bound }).unwrap();
            prop_assert!(steps.rounding <= 0.5001 * steps.step);
            for &height in &samples {
                let sample = steps.sample(Some(height)).unwrap();
                let found = steps.height(sample.into());
                prop_assert!((found - height).abs() <= steps.rounding + 1e-9 * steps.step);
            }
            let within = steps.within(1e4).unwrap();
            prop_assert!((within * steps.step + steps.rounding - 1e4).abs() < 1e-6);
            prop_assert_eq!(steps.within(-1.0), None);
        }
    }

    #[test]
    fn heights_that_fit_no_steps_are_refused() {
        let wish = Wish::default();
        let of = |samples: &[f64]| heights(samples).in_steps(wish);
        assert_eq!(of(&[f64::NAN, f64::INFINITY]), Err(StepError::Empty));
        assert!(matches!(of(&[-1e308, 1e308]), Err(StepError::TooMany { .. })));
        let far = heights(&[0.0, 1e30]).in_steps(Wish { bound: Some(1.0), ..wish });
        assert!(matches!(far, Err(StepError::TooMany { .. })));
        assert_eq!(of(&[7.5, 7.5]), Ok(Steps { base: 7.5, step: 1.0, rounding: 0.0 }));
    }
}
