//! How far an approximation is from its picture: squared error, MSE and PSNR.

use crate::image::{Image, Shape, ShapeMismatch, largest_sample};

/// The difference between a picture and its approximation, as an exact sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Fidelity {
    /// Sum of squared differences over all lattice points and components.
    pub squared_error: u64,
    /// Number of differences summed, `components * width * height`.
    pub sample_count: u64,
    /// Bits per sample, 1 to 16.
    pub precision: u8,
}

impl Fidelity {
    /// Compares two images of the same shape sample by sample.
    ///
    /// # Errors
    /// When width, height, number of components or precision differ.
    pub fn between(first: &Image, second: &Image) -> Result<Self, ShapeMismatch> {
        ShapeMismatch::check(first.shape(), second.shape())?;
        let pairs = first.components().iter().zip(second.components());
        Ok(Self::of_sum(pairs.map(|(a, b)| sum_of_squares(a, b)).sum(), first))
    }

    /// The fidelity of an approximation of `image` whose squared error is known.
    pub(crate) fn of_sum(squared_error: u64, image: &Image) -> Self {
        Self::of_shape(squared_error, image.shape())
    }

    /// The same for an image of this shape.
    pub(crate) fn of_shape(squared_error: u64, shape: Shape) -> Self {
        let sample_count = (shape.component_count * shape.width * shape.height) as u64;
        Self { squared_error, sample_count, precision: shape.precision }
    }

    /// Mean squared error over all lattice points and components.
    #[must_use]
    pub fn mse(&self) -> f64 {
        self.squared_error as f64 / self.sample_count as f64
    }

    /// Peak signal-to-noise ratio in decibels, `20 log10((2^precision - 1) / sqrt(MSE))`;
    /// [`f64::INFINITY`] for a perfect copy.
    #[must_use]
    pub fn psnr_db(&self) -> f64 {
        if self.squared_error == 0 {
            return f64::INFINITY;
        }
        20.0 * (f64::from(largest_sample(self.precision)) / self.mse().sqrt()).log10()
    }
}

/// The largest squared error of an image of this shape whose PSNR is at least this many decibels.
///
/// Uses operations that IEEE 754 rounds alike on every machine, so the result depends on neither
/// the machine nor its logarithm; a squared error larger by one part in 10^12 is still taken, so
/// that the PSNR of a known squared error admits that squared error.
pub(crate) fn largest_squared_error(least_db: f64, shape: Shape) -> u64 {
    let Fidelity { sample_count, precision, .. } = Fidelity::of_shape(0, shape);
    let decades = (least_db / 10.0).floor();
    // The Taylor series of 10^x for 0 <= x < 1.
    let x = (least_db / 10.0 - decades) * std::f64::consts::LN_10;
    let (mut power, mut term) = (1.0, 1.0);
    for i in 1..40 {
        term *= x / f64::from(i);
        power += term;
    }
    for _ in 0..decades as u32 {
        power *= 10.0;
    }
    let peak = f64::from(largest_sample(precision));
    (sample_count as f64 * (peak * peak) / power * (1.0 + 1e-12)) as u64
}

/// Sum of squared differences of two components.
fn sum_of_squares(a: &[u16], b: &[u16]) -> u64 {
    let square = |(&a, &b): (&u16, &u16)| u64::from(a.abs_diff(b)).pow(2);
    a.iter().zip(b).map(square).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(samples: [u16; 4]) -> Image {
        Image::from_bottom_up(2, 2, 8, vec![samples.to_vec()]).unwrap()
    }

    #[test]
    fn largest_squared_error_has_the_psnr() {
        let shape = gray([0; 4]).shape();
        for squared_error in (1..3000).chain([65025, 4 * 65025]) {
            let psnr_db = Fidelity::of_shape(squared_error, shape).psnr_db();
            assert_eq!(largest_squared_error(psnr_db, shape), squared_error);
            assert_eq!(largest_squared_error(psnr_db + 1e-6, shape), squared_error - 1);
        }
    }

    #[test]
    fn a_perfect_copy_has_infinite_psnr() {
        let fidelity = Fidelity::between(&gray([1, 2, 3, 4]), &gray([1, 2, 3, 4])).unwrap();
        assert_eq!(fidelity.mse(), 0.0);
        assert_eq!(fidelity.psnr_db(), f64::INFINITY);
    }

    #[test]
    fn psnr_of_a_known_error_is_as_computed_by_hand() {
        let fidelity = Fidelity::between(&gray([0, 0, 0, 0]), &gray([255, 0, 0, 0])).unwrap();
        assert_eq!(fidelity.squared_error, 65025);
        assert_eq!(fidelity.mse(), 65025.0 / 4.0);
        assert!((fidelity.psnr_db() - 20.0 * 2f64.log10()).abs() < 1e-12);
    }

    #[test]
    fn the_mean_is_over_all_points_and_components() {
        let image =
            |sample| Image::from_bottom_up(3, 5, 8, vec![vec![0; 15], vec![sample; 15]]).unwrap();
        let fidelity = Fidelity::between(&image(7), &image(3)).unwrap();
        assert_eq!((fidelity.squared_error, fidelity.mse()), (15 * 16, 8.0));
    }

    #[test]
    fn images_of_different_shape_are_not_compared() {
        let wide = Image::from_bottom_up(3, 2, 8, vec![vec![0; 6]]).unwrap();
        let error = Fidelity::between(&gray([0; 4]), &wide).unwrap_err();
        assert!(error.to_string().contains("2x2") && error.to_string().contains("3x2"));
    }
}
