//! Structural similarity, and how much each point of a picture matters to it.
//!
//! Zhou Wang, Alan C. Bovik, Hamid R. Sheikh and Eero P. Simoncelli, "Image quality assessment: from
//! error visibility to structural similarity", 2004: means, variances and the covariance of two
//! pictures under a Gaussian window of 11 by 11 points, standard deviation 1.5, at each place where the window
//! lies in the picture; the mean of the index over places and components.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Image;
use crate::metrics::ShapeMismatch;

/// Columns and rows of the window; smaller pictures have a smaller one, of odd size.
const WINDOW: usize = 11;

/// The Gaussian of standard deviation 1.5 at distances 0 to 5: written out, as the exponential function
/// is not the same to the last bit on every machine.
const GAUSSIAN: [f64; 6] = [
    1.0,
    0.800_737_402_916_808_1,
    0.411_112_290_507_187_4,
    0.135_335_283_236_612_7,
    0.028_565_500_784_550_4,
    0.003_865_920_139_472_807_6,
];

/// Parts of the largest sample, squared, that keep the quotients from 0/0.
const C1: f64 = 0.01;
const C2: f64 = 0.03;

/// What the constant of the variances is multiplied by for weights. The index falls less than in
/// proportion where errors are large, so that the plain inverse of the variance would spend too many vertices
/// on areas that are almost plain.
const TAMING: f64 = 16.0;

/// The largest weight of a point.
const LARGEST_WEIGHT: f64 = 255.0;

/// The mean structural similarity of two pictures of the same shape: 1 for equal ones, less for
/// others.
///
/// # Errors
/// When width, height, number of components or precision differ.
pub fn ssim(first: &Image, second: &Image) -> Result<f64, ShapeMismatch> {
    ShapeMismatch::check(first, second)?;
    let (c1, c2) = constants(first);
    let window = Window::new(first);
    let (mut sum, mut count) = (0.0, 0);
    for (a, b) in first.components().iter().zip(second.components()) {
        let plane = |of: &dyn Fn(f64, f64) -> f64| {
            let values: Vec<f64> = a.iter().zip(b).map(|(&a, &b)| of(a.into(), b.into())).collect();
            window.means(&values)
        };
        let (mean_a, mean_b) = (plane(&|a, _| a), plane(&|_, b| b));
        let (aa, bb, ab) = (plane(&|a, _| a * a), plane(&|_, b| b * b), plane(&|a, b| a * b));
        for i in 0..mean_a.len() {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (va, vb, covariance) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
            let likeness = (2.0 * ma * mb + c1) * (2.0 * covariance + c2);
            sum += likeness / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        }
        count += mean_a.len();
    }
    Ok(sum / count as f64)
}

/// How much a squared error at each lattice point lowers the structural similarity, from 1 to 255:
/// the inverse of twice the variance around it, which is what the index divides by where the
/// approximation is near.
pub(crate) fn sensitivity(image: &Image, control: &dyn Control) -> Result<Vec<u8>, Cancelled> {
    let (_, c2) = constants(image);
    let c2 = c2 * TAMING;
    let window = Window::new(image);
    let (columns, rows) = window.places();
    let margin = window.weights.len() / 2;
    let mut sums = vec![0.0; columns * rows];
    for component in image.components() {
        control.poll(Stage::Density, 0, 1)?;
        let values: Vec<f64> = component.iter().map(|&sample| sample.into()).collect();
        let squares: Vec<f64> = values.iter().map(|value| value * value).collect();
        let (means, means_of_squares) = (window.means(&values), window.means(&squares));
        for (sum, (mean, square)) in sums.iter_mut().zip(means.iter().zip(&means_of_squares)) {
            *sum += 1.0 / (2.0 * (square - mean * mean) + c2);
        }
    }
    // A plain picture's points have the largest weight there is.
    let unit = LARGEST_WEIGHT * c2 / image.component_count() as f64;
    let at = |i: usize| {
        let (x, y) = (i % image.width(), i / image.width());
        let nearest = |place: usize, count: usize| place.saturating_sub(margin).min(count - 1);
        let sum = sums[nearest(y, rows) * columns + nearest(x, columns)];
        (sum * unit).round().clamp(1.0, LARGEST_WEIGHT) as u8
    };
    Ok((0..image.pixel_count()).map(at).collect())
}

/// What the quotients' parts are raised by.
fn constants(image: &Image) -> (f64, f64) {
    let largest = f64::from(image.max_sample());
    ((C1 * largest).powi(2), (C2 * largest).powi(2))
}

/// A Gaussian window over a picture.
struct Window {
    width: usize,
    height: usize,
    /// Weights of columns, and of rows, which sum up to 1.
    weights: Vec<f64>,
}

impl Window {
    fn new(image: &Image) -> Self {
        let (width, height) = (image.width(), image.height());
        let size = WINDOW.min((width.min(height) - 1) / 2 * 2 + 1);
        let weight = |i: usize| GAUSSIAN[i.abs_diff(size / 2)];
        let sum: f64 = (0..size).map(weight).sum();
        Self { width, height, weights: (0..size).map(|i| weight(i) / sum).collect() }
    }

    /// Columns and rows of places where the window lies in the picture.
    fn places(&self) -> (usize, usize) {
        let less = self.weights.len() - 1;
        (self.width - less, self.height - less)
    }

    /// The weighted means of a plane at all places.
    fn means(&self, plane: &[f64]) -> Vec<f64> {
        let (columns, rows) = self.places();
        let along_rows: Vec<f64> = plane
            .chunks_exact(self.width)
            .flat_map(|row| {
                row.windows(self.weights.len())
                    .map(|part| part.iter().zip(&self.weights).map(|(v, w)| v * w).sum::<f64>())
            })
            .collect();
        (0..rows * columns)
            .map(|i| {
                let column = along_rows[i..].iter().step_by(columns);
                column.zip(&self.weights).map(|(v, w)| v * w).sum()
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;

    fn gray(width: usize, height: usize, of: impl Fn(usize, usize) -> u16) -> Image {
        let samples = (0..width * height).map(|i| of(i % width, i / width)).collect();
        Image::new(width, height, 8, vec![samples]).unwrap()
    }

    #[test]
    fn equal_pictures_have_similarity_1_and_inverted_ones_less_than_0() {
        let picture = gray(20, 15, |x, y| ((x * 37 + y * 91) % 256) as u16);
        let inverted = gray(20, 15, |x, y| 255 - ((x * 37 + y * 91) % 256) as u16);
        assert!((ssim(&picture, &picture).unwrap() - 1.0).abs() < 1e-12);
        assert!(ssim(&picture, &inverted).unwrap() < -0.5);
        assert!(ssim(&picture, &gray(20, 14, |_, _| 0)).is_err());
    }

    #[test]
    fn the_similarity_of_two_plain_pictures_is_as_computed_by_hand() {
        // Variances and covariance are 0: (2 * 100 * 120 + c1) / (100^2 + 120^2 + c1).
        let c1 = 2.55f64 * 2.55;
        let expected = (24_000.0 + c1) / (24_400.0 + c1);
        for size in [2, 3, 11, 30] {
            let (a, b) = (gray(size, size, |_, _| 100), gray(size, size, |_, _| 120));
            assert!((ssim(&a, &b).unwrap() - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn plain_areas_are_more_sensitive_than_busy_ones() {
        let picture = gray(40, 20, |x, y| if x < 20 { 90 } else { (x * 71 + y * 97) as u16 % 256 });
        let weights = sensitivity(&picture, &Unattended).unwrap();
        assert_eq!(weights[10 * 40 + 3], 255);
        assert!(weights[10 * 40 + 35] < 40);
    }
}
