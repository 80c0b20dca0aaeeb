//! Structural similarity (SSIM) of two images.
//!
//! Zhou Wang, Alan C. Bovik, Hamid R. Sheikh, Eero P. Simoncelli: "Image Quality Assessment: From
//! Error Visibility to Structural Similarity", IEEE Transactions on Image Processing 13 (2004),
//! with the paper's Gaussian window of 11 by 11 pixels and its constants 0.01 and 0.03. The index
//! of two images is the mean over all windows that lie inside them, and over their components.
//!
//! The cost is 22 products for each sample and each of five fields, in memory for eleven rows. The
//! weights are constants and the sums have a fixed order, so every machine gives the same index.

use crate::control::{Control, Stage};
use crate::error::MeshingError;
use crate::image::{Image, ShapeMismatch, largest_sample};
use crate::quality::gaussian_window::{GaussianWindow, SIDE};

/// The mean structural similarity of two images of the same shape: 1 for equal ones, at least -1.
///
/// `None` when a side is shorter than the window of 11 pixels.
///
/// # Errors
/// When the images have different shapes, or the control cancels.
///
/// ```
/// use pixmesh_meshing::{Image, structural_similarity};
///
/// let ramp = Image::from_top_down(16, 16, 8, vec![(0..256).collect()])?;
/// assert_eq!(structural_similarity(&ramp, &ramp, &())?, Some(1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn structural_similarity(
    first: &Image,
    second: &Image,
    control: &dyn Control,
) -> Result<Option<f64>, MeshingError> {
    ShapeMismatch::check(first.shape(), second.shape())?;
    let (width, height) = first.sides();
    if width.min(height) < SIDE {
        return Ok(None);
    }
    let total = first.component_count() * height;
    let c1 = (0.01 * f64::from(largest_sample(first.precision()))).powi(2);
    let index = Index { c1, c2: variance_constant(first.precision()) };
    let mut sum = 0.0;
    for c in 0..first.component_count() {
        let mut window = GaussianWindow::new(SIDE, width);
        for y in 0..height {
            let poll = || control.poll(Stage::Measure, c * height + y, total);
            let pairs = first.row(c, y).iter().zip(second.row(c, y));
            let means = window.add_row(pairs.map(fields), poll)?;
            sum += means.iter().map(|&means| index.of(means)).sum::<f64>();
        }
    }
    let windows = (width - SIDE + 1) * (height - SIDE + 1);
    Ok(Some(sum / (windows * first.component_count()) as f64))
}

fn fields((&a, &b): (&u16, &u16)) -> [f64; 5] {
    let (a, b) = (f64::from(a), f64::from(b));
    [a, b, a * a, b * b, a * b]
}

struct Index {
    c1: f64,
    c2: f64,
}

impl Index {
    fn of(&self, [a, b, aa, bb, ab]: [f64; 5]) -> f64 {
        let (variance_a, variance_b, covariance) = (aa - a * a, bb - b * b, ab - a * b);
        let similarity = (2.0 * a * b + self.c1) * (2.0 * covariance + self.c2);
        similarity / ((a * a + b * b + self.c1) * (variance_a + variance_b + self.c2))
    }
}

/// The paper's constant C2, which keeps quotients of variances from 0/0.
pub(crate) fn variance_constant(precision: u8) -> f64 {
    (0.03 * f64::from(largest_sample(precision))).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;

    fn gray(side: usize, sample: impl Fn(usize, usize) -> usize) -> Image {
        let samples = (0..side * side).map(|i| sample(i % side, i / side) as u16).collect();
        Image::from_bottom_up(side, side, 8, vec![samples]).unwrap()
    }

    fn index(first: &Image, second: &Image) -> f64 {
        structural_similarity(first, second, &()).unwrap().unwrap()
    }

    #[test]
    fn constant_images_compare_by_their_means() {
        let (dark, bright) = (gray(12, |_, _| 100), gray(12, |_, _| 150));
        let c1 = 0.0001 * 255.0 * 255.0;
        let expected = (2.0 * 100.0 * 150.0 + c1) / (100.0 * 100.0 + 150.0 * 150.0 + c1);
        assert!((index(&dark, &bright) - expected).abs() < 1e-9);
    }

    #[test]
    fn opposite_structure_is_dissimilar_and_noise_is_not() {
        let wave = |x: usize, y: usize| 80 * ((x / 2 + y / 2) % 2);
        let waves = gray(32, |x, y| 100 + wave(x, y));
        let opposite = gray(32, |x, y| 180 - wave(x, y));
        let noisy = gray(32, |x, y| 100 + wave(x, y) + (x * 7 + y * 5) % 3);
        assert!(index(&waves, &opposite) < -0.9);
        assert!(index(&waves, &noisy) > 0.99);
        assert_eq!(index(&waves, &waves), 1.0);
        assert_eq!(index(&waves, &opposite), index(&opposite, &waves));
    }

    /// The index of two images as the paper defines it, window by window.
    fn index_by_definition(first: &Image, second: &Image) -> f64 {
        let largest = f64::from(first.max_sample());
        let (c1, c2) = ((0.01 * largest).powi(2), (0.03 * largest).powi(2));
        let gaussian = |d: usize| (-(d as f64 - 5.0).powi(2) / 4.5).exp();
        let total = (0..11).map(gaussian).sum::<f64>().powi(2);
        let (mut sum, mut count) = (0.0, 0.0);
        for c in 0..first.component_count() {
            for (left, top) in (0..=first.width() - 11)
                .flat_map(|x| (0..=first.height() - 11).map(move |y| (x, y)))
            {
                let mean = |value: &dyn Fn(f64, f64) -> f64| {
                    let points = (0..11).flat_map(|y| (0..11).map(move |x| (x, y)));
                    let weighted = points.map(|(x, y)| {
                        let [a, b] =
                            [first, second].map(|p| f64::from(p.sample(c, left + x, top + y)));
                        gaussian(x) * gaussian(y) * value(a, b)
                    });
                    weighted.sum::<f64>() / total
                };
                let (a, b) = (mean(&|a, _| a), mean(&|_, b| b));
                let (aa, bb) = (mean(&|x, _| (x - a).powi(2)), mean(&|_, x| (x - b).powi(2)));
                let ab = mean(&|x, y| (x - a) * (y - b));
                let similarity = (2.0 * a * b + c1) * (2.0 * ab + c2);
                sum += similarity / ((a * a + b * b + c1) * (aa + bb + c2));
                count += 1.0;
            }
        }
        sum / count
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(24))]
        #[test]
        fn computes_the_definition(
            (width, height, count) in (11usize..20, 11usize..20, 1usize..4),
            precision in 1u8..=16,
            seeds in proptest::array::uniform2(0usize..10_000),
        ) {
            let picture = |seed: usize| {
                let noise = |i: usize| ((i + seed).wrapping_mul(40_503) >> 3) as u16;
                let sample = |i: usize| noise(i) >> (16 - precision);
                let plane = |c: usize| (0..width * height).map(|i| sample(i * (c + 1))).collect();
                let components = (0..count).map(plane).collect();
                Image::from_bottom_up(width, height, precision, components).unwrap()
            };
            let [first, second] = seeds.map(picture);
            let (found, expected) = (index(&first, &second), index_by_definition(&first, &second));
            proptest::prop_assert!((found - expected).abs() < 1e-9, "{} for {}", found, expected);
            proptest::prop_assert!((index(&first, &first) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn images_smaller_than_the_window_have_no_index() {
        let small = gray(10, |x, _| x);
        assert_eq!(structural_similarity(&small, &small, &()), Ok(None));
    }

    #[test]
    fn polls_in_every_row_and_within_wide_rows() {
        for (width, polls_per_row) in [(12, 1), (4000, 4)] {
            let components = vec![vec![5; width * 14]; 3];
            let image = Image::from_bottom_up(width, 14, 8, components).unwrap();
            let recorder = Recorder::default();
            structural_similarity(&image, &image, &recorder).unwrap();
            let rows: Vec<usize> = (0..polls_per_row * 42).map(|i| i / polls_per_row).collect();
            assert_eq!(recorder.done(Stage::Measure, 42), rows);
        }
    }
}
