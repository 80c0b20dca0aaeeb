//! How much each point of a picture matters to its structural similarity.
//!
//! Zhou Wang, Alan C. Bovik, Hamid R. Sheikh and Eero P. Simoncelli, "Image quality assessment: from
//! error visibility to structural similarity", 2004: means, variances and the covariance of two
//! pictures under a Gaussian window of 11 by 11 points, standard deviation 1.5, at each place where the window
//! lies in the picture; the mean of the index over places and components.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Image;
use crate::parameters::Weights;

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

/// The part of the largest sample, squared, that keeps the quotients from 0/0.
const C2: f64 = 0.03;

/// What the constant of the variances is multiplied by for weights. The index falls less than in
/// proportion where errors are large, so that the plain inverse of the variance would spend too many vertices
/// on areas that are almost plain.
const TAMING: f64 = 16.0;

/// The largest weight of a point.
const LARGEST_WEIGHT: f64 = 255.0;

/// How much a squared error at each lattice point lowers the structural similarity, from 1 to 255:
/// the inverse of twice the variance around it, which is what the index divides by where the
/// approximation is near.
pub(crate) fn sensitivity(image: &Image, control: &dyn Control) -> Result<Vec<u8>, Cancelled> {
    let c2 = constant(image);
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

/// What the variances are raised by.
fn constant(image: &Image) -> f64 {
    (C2 * f64::from(image.max_sample())).powi(2)
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

/// Weights that make a metric of the squared error one of the structural similarity, times those
/// given.
pub(crate) fn ssim_weights(
    image: &Image,
    given: Option<&Weights>,
    control: &dyn Control,
) -> Result<Weights, Cancelled> {
    let mut weights = sensitivity(image, control)?;
    for (weight, &given) in weights.iter_mut().zip(given.map_or(&[][..], Weights::values)) {
        *weight = (u16::from(*weight) * u16::from(given)).div_ceil(u16::from(u8::MAX)) as u8;
    }
    Ok(Weights::from_kernel(image.width(), image.height(), weights))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(width: usize, height: usize, of: impl Fn(usize, usize) -> u16) -> Image {
        let samples = (0..width * height).map(|i| of(i % width, i / width)).collect();
        Image::from_bottom_up(width, height, 8, vec![samples]).unwrap()
    }

    #[test]
    fn plain_areas_are_more_sensitive_than_busy_ones() {
        let picture = gray(40, 20, |x, y| if x < 20 { 90 } else { (x * 71 + y * 97) as u16 % 256 });
        let weights = sensitivity(&picture, &()).unwrap();
        assert_eq!(weights[10 * 40 + 3], 255);
        assert!(weights[10 * 40 + 35] < 40);
    }

    /// The weights by their definition: variances under the whole window, at every place anew.
    fn by_definition(image: &Image) -> Vec<f64> {
        let (width, height) = (image.width() as i32, image.height() as i32);
        let radius = 5.min((width.min(height) - 1) / 2);
        let c2 = 16.0 * (0.03 * f64::from(image.max_sample())).powi(2);
        let weight = |x: i32, y: i32| (f64::from(x * x + y * y) / -4.5).exp();
        let window: Vec<(i32, i32)> =
            (-radius..=radius).flat_map(|y| (-radius..=radius).map(move |x| (x, y))).collect();
        let all: f64 = window.iter().map(|&(x, y)| weight(x, y)).sum();
        let variance = |component: &[u16], x: i32, y: i32| {
            let mean_of = |of: fn(f64) -> f64| {
                let terms = window.iter().map(|&(dx, dy)| {
                    let sample = component[((y + dy) * width + x + dx) as usize];
                    weight(dx, dy) * of(sample.into())
                });
                terms.sum::<f64>() / all
            };
            mean_of(|sample| sample * sample) - mean_of(|sample| sample).powi(2)
        };
        (0..width * height)
            .map(|i| {
                let x = (i % width).clamp(radius, width - 1 - radius);
                let y = (i / width).clamp(radius, height - 1 - radius);
                let components = image.components().iter();
                let parts = components.map(|plane| c2 / (2.0 * variance(plane, x, y) + c2));
                let mean = parts.sum::<f64>() / image.component_count() as f64;
                (255.0 * mean).clamp(1.0, 255.0)
            })
            .collect()
    }

    #[test]
    fn weights_are_those_of_the_definition() {
        for (width, height) in [(19, 14), (14, 19), (7, 5), (2, 9)] {
            let plane = |seed: usize| -> Vec<u16> {
                (0..width * height)
                    .map(|i| ((i % width * 7 + i / width * i * seed) % 90 + i * 40 / width) as u16)
                    .map(|sample| sample.min(255))
                    .collect()
            };
            let image = Image::from_bottom_up(width, height, 8, vec![plane(3), plane(8)]).unwrap();
            let weights = sensitivity(&image, &()).unwrap();
            let expected = by_definition(&image);
            assert_eq!(weights.len(), expected.len());
            for (i, (&weight, expected)) in weights.iter().zip(&expected).enumerate() {
                assert!(
                    (f64::from(weight) - expected).abs() <= 0.500_001,
                    "{i}: {weight} {expected}"
                );
            }
        }
    }
}
