//! Error weights that make the squared error follow structural similarity.
//!
//! Where an approximation is close to the image, a squared error lowers the structural similarity
//! in inverse proportion to twice the variance under the window (see `ssim`).

use crate::control::{Cancelled, Control, Stage};
use crate::image::Image;
use crate::parameters::Weights;
use crate::quality::gaussian_window::{GaussianWindow, SIDE};
use crate::quality::ssim::variance_constant;

/// Factor of the constant that raises the variances. The similarity falls less than in proportion
/// where errors are large: without the factor nearly plain areas would take too many vertices.
const REGULARISATION: f64 = 16.0;

/// The weight of a plain area; the least weight is 1.
const LARGEST_WEIGHT: f64 = 255.0;

/// How much a squared error at each pixel lowers the structural similarity, times given weights.
///
/// The window is smaller than usual in images of fewer columns or rows. At the border a pixel has
/// the weight of the nearest position where the window lies inside the image.
pub(crate) fn ssim_weights(
    image: &Image,
    given: Option<&Weights>,
    control: &dyn Control,
) -> Result<Weights, Cancelled> {
    let (width, height) = image.sides();
    let side = SIDE.min((width.min(height) - 1) / 2 * 2 + 1);
    let margin = side / 2;
    let mut windows: Vec<_> =
        image.components().iter().map(|_| GaussianWindow::new(side, width)).collect();
    let c2 = variance_constant(image.precision()) * REGULARISATION;
    let unit = LARGEST_WEIGHT * c2 / image.component_count() as f64;
    let mut weights = Vec::with_capacity(width * height);
    let mut sums = vec![0.0; width + 1 - side];
    for y in 0..height {
        sums.fill(0.0);
        for (c, window) in windows.iter_mut().enumerate() {
            let row = image.row(c, y).iter().map(|&sample| f64::from(sample));
            let means = window.add_row(row.map(|sample| [sample, sample * sample]), || {
                control.poll(Stage::Density, 0, height)
            })?;
            for (sum, [mean, square]) in sums.iter_mut().zip(means) {
                *sum += 1.0 / (2.0 * (square - mean * mean) + c2);
            }
        }
        // Rows of the image up to the middle of the newest window, and above the last window.
        let end = match y + 1 {
            count if count == height => height,
            count if count < side => 0,
            count => count - margin,
        };
        for _ in weights.len() / width..end {
            let nearest = |x: usize| sums[x.saturating_sub(margin).min(sums.len() - 1)];
            let weight = |x: usize| (nearest(x) * unit).round().clamp(1.0, LARGEST_WEIGHT) as u8;
            weights.extend((0..width).map(weight));
        }
    }
    for (weight, &given) in weights.iter_mut().zip(given.map_or(&[][..], Weights::values)) {
        *weight = (u16::from(*weight) * u16::from(given)).div_ceil(u16::from(u8::MAX)) as u8;
    }
    Ok(Weights::from_kernel(width, height, weights))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights by their definition: variances under the whole window at every pixel.
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
    fn computes_the_definition() {
        for (width, height) in [(19, 14), (14, 19), (7, 5), (2, 9)] {
            let plane = |seed: usize| -> Vec<u16> {
                (0..width * height)
                    .map(|i| ((i % width * 7 + i / width * i * seed) % 90 + i * 40 / width) as u16)
                    .map(|sample| sample.min(255))
                    .collect()
            };
            let image = Image::from_bottom_up(width, height, 8, vec![plane(3), plane(8)]).unwrap();
            let weights = ssim_weights(&image, None, &()).unwrap();
            let weights = weights.values();
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
