//! How far an approximation is from its image: squared error, MSE and PSNR.

use crate::control::{Control, POINTS_PER_POLL, Stage};
use crate::error::MeshingError;
use crate::image::{Image, Shape, ShapeMismatch, largest_sample};

/// The difference between an image and its approximation, as an exact sum.
///
/// ```
/// use pixmesh_meshing::{Fidelity, Image};
///
/// let image = |samples| Image::from_top_down(2, 2, 8, vec![samples]);
/// let (black, dot) = (image(vec![0, 0, 0, 0])?, image(vec![0, 2, 0, 0])?);
/// let fidelity = Fidelity::between(&black, &dot, &())?;
/// assert_eq!((fidelity.squared_error, fidelity.mse()), (4, 1.0));
/// assert!((fidelity.psnr_db() - 48.13).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Fidelity {
    /// Sum of squared differences over all lattice points and components.
    pub squared_error: u64,
    /// Number of differences summed, `components * width * height`.
    pub sample_count: u64,
    /// Bits per sample, 1 to 16.
    pub precision: u8,
}

impl Fidelity {
    /// The fidelity of an approximation whose squared error is known, of an image of this shape.
    #[must_use]
    pub fn new(squared_error: u64, shape: Shape) -> Self {
        let sample_count = (shape.component_count * shape.width * shape.height) as u64;
        Self { squared_error, sample_count, precision: shape.precision }
    }

    /// The fidelity of an approximation whose [`Self::mse`] is known.
    #[must_use]
    pub fn of_mse(mse: f64, shape: Shape) -> Self {
        let none = Self::new(0, shape);
        Self { squared_error: (mse * none.sample_count as f64).round() as u64, ..none }
    }

    /// Compares two images of the same shape sample by sample.
    ///
    /// # Errors
    /// When the images have different shapes, or the control cancels.
    pub fn between(
        first: &Image,
        second: &Image,
        control: &dyn Control,
    ) -> Result<Self, MeshingError> {
        ShapeMismatch::check(first.shape(), second.shape())?;
        fn parts(image: &Image) -> impl Iterator<Item = &[u16]> {
            image.components().iter().flat_map(|samples| samples.chunks(POINTS_PER_POLL))
        }
        let mut squared_error = 0;
        for (a, b) in parts(first).zip(parts(second)) {
            control.poll(Stage::Measure, 0, 1)?;
            let square = |(&a, &b): (&u16, &u16)| u64::from(a.abs_diff(b)).pow(2);
            squared_error += a.iter().zip(b).map(square).sum::<u64>();
        }
        Ok(Self::new(squared_error, first.shape()))
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
/// IEEE 754 fixes the result of every operation used here, so all machines compute the same bound;
/// a logarithm is not such an operation. The bound is larger by one part in 10^12, so that the PSNR
/// of a known squared error admits that squared error.
pub(crate) fn largest_squared_error(least_db: f64, shape: Shape) -> u64 {
    let Fidelity { sample_count, precision, .. } = Fidelity::new(0, shape);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;

    fn gray(samples: [u16; 4]) -> Image {
        Image::from_bottom_up(2, 2, 8, vec![samples.to_vec()]).unwrap()
    }

    fn between(first: &Image, second: &Image) -> Fidelity {
        Fidelity::between(first, second, &()).unwrap()
    }

    #[test]
    fn largest_squared_error_has_the_psnr() {
        let shape = gray([0; 4]).shape();
        for squared_error in (1..3000).chain([65025, 4 * 65025]) {
            let psnr_db = Fidelity::new(squared_error, shape).psnr_db();
            assert_eq!(largest_squared_error(psnr_db, shape), squared_error);
            assert_eq!(largest_squared_error(psnr_db + 1e-6, shape), squared_error - 1);
        }
    }

    #[test]
    fn computes_mse_and_psnr() {
        let same = between(&gray([1, 2, 3, 4]), &gray([1, 2, 3, 4]));
        assert_eq!((same.mse(), same.psnr_db()), (0.0, f64::INFINITY));
        let fidelity = between(&gray([0, 0, 0, 0]), &gray([255, 0, 0, 0]));
        assert_eq!((fidelity.squared_error, fidelity.mse()), (65025, 65025.0 / 4.0));
        assert!((fidelity.psnr_db() - 20.0 * 2f64.log10()).abs() < 1e-12);
        let image =
            |sample| Image::from_bottom_up(3, 5, 8, vec![vec![0; 15], vec![sample; 15]]).unwrap();
        let fidelity = between(&image(7), &image(3));
        assert_eq!((fidelity.squared_error, fidelity.mse()), (15 * 16, 8.0));
    }

    #[test]
    fn polls_for_each_65536_samples() {
        let image = Image::from_bottom_up(512, 300, 8, vec![vec![1; 512 * 300]; 2]).unwrap();
        let recorder = Recorder::default();
        Fidelity::between(&image, &image, &recorder).unwrap();
        assert_eq!(recorder.done(Stage::Measure, 1).len(), 2 * 3);
    }
}
