//! How alike two pictures look: the structural similarity index (SSIM).
//!
//! Zhou Wang, Alan C. Bovik, Hamid R. Sheikh, Eero P. Simoncelli: "Image Quality Assessment: From
//! Error Visibility to Structural Similarity", IEEE Transactions on Image Processing 13 (2004), with
//! the paper's window of 11 by 11 points, weighted by a Gaussian of a standard deviation of 1.5, and
//! its constants 0.01 and 0.03. The index of a picture is the mean over all windows that lie inside
//! it, and over its components, each by itself.
//!
//! Cost: for each sample twice eleven products for each of five fields, in rows that are kept for
//! eleven rows. The sums have one order, and the weights are constants, so that every machine gives
//! the same index.

use crate::control::{Cancelled, Control, Stage};
use crate::error::MeshingError;
use crate::image::{Image, ShapeMismatch, largest_sample};

/// Points of a window's side.
const WINDOW: usize = 11;
/// `exp(-d^2 / 4.5)` for the distances from -5 to 5, divided by their sum.
const WEIGHTS: [f64; WINDOW] = [
    0.001_028_380_084_479_11,
    0.007_598_758_135_239_185,
    0.036_000_772_128_430_83,
    0.109_360_689_509_700_02,
    0.213_005_537_711_253_7,
    0.266_011_724_861_794_36,
    0.213_005_537_711_253_7,
    0.109_360_689_509_700_02,
    0.036_000_772_128_430_83,
    0.007_598_758_135_239_185,
    0.001_028_380_084_479_11,
];
/// Squares of the paper's constants K1 and K2, which are multiplied by the largest sample's square.
const K1_SQUARED: f64 = 0.0001;
const K2_SQUARED: f64 = 0.0009;
/// Fields that are averaged: both pictures, their squares, and their product.
const FIELDS: usize = 5;

/// The mean structural similarity of two images of the same shape: 1 for equal ones, at least -1.
///
/// `None` when a side is shorter than the window of 11 points.
///
/// # Errors
/// When the images have different shapes, or the control cancels.
///
/// ```
/// use pixmesh_meshing::{Image, structural_similarity};
///
/// let ramp = Image::from_bottom_up(16, 16, 8, vec![(0..256).map(|i| i as u16).collect()])?;
/// assert_eq!(structural_similarity(&ramp, &ramp, &())?, Some(1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn structural_similarity(
    first: &Image,
    second: &Image,
    control: &dyn Control,
) -> Result<Option<f64>, MeshingError> {
    ShapeMismatch::check(first.shape(), second.shape())?;
    if first.width().min(first.height()) < WINDOW {
        return Ok(None);
    }
    let mut sum = 0.0;
    for c in 0..first.component_count() {
        sum += component_sum(first, second, c, control)?;
    }
    let windows = (first.width() - WINDOW + 1) * (first.height() - WINDOW + 1);
    Ok(Some(sum / (windows * first.component_count()) as f64))
}

/// The sum of the index over the windows of one component.
fn component_sum(
    first: &Image,
    second: &Image,
    c: usize,
    control: &dyn Control,
) -> Result<f64, Cancelled> {
    let (width, height) = (first.width(), first.height());
    let index = Index::new(first.precision());
    let mut rows = vec![[0.0; FIELDS]; WINDOW * (width - WINDOW + 1)];
    let columns = width - WINDOW + 1;
    let mut sum = 0.0;
    for y in 0..height {
        control.poll(Stage::Measure, c * height + y, first.component_count() * height)?;
        let row = &mut rows[y % WINDOW * columns..][..columns];
        average_along(first.row(c, y), second.row(c, y), row);
        if let Some(top) = (y + 1).checked_sub(WINDOW) {
            sum +=
                (0..columns).map(|x| index.of(average_across(&rows, columns, top, x))).sum::<f64>();
        }
    }
    Ok(sum)
}

/// Weighted means of the fields over eleven points of a row, for each place of the window.
fn average_along(first: &[u16], second: &[u16], means: &mut [[f64; FIELDS]]) {
    for (x, mean) in means.iter_mut().enumerate() {
        *mean = [0.0; FIELDS];
        for (i, weight) in WEIGHTS.iter().enumerate() {
            let (a, b) = (f64::from(first[x + i]), f64::from(second[x + i]));
            for (mean, value) in mean.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                *mean += weight * value;
            }
        }
    }
}

/// Weighted means over eleven rows from `top` on, in one column; row `y` lies at `y % 11`.
fn average_across(rows: &[[f64; FIELDS]], columns: usize, top: usize, x: usize) -> [f64; FIELDS] {
    let mut means = [0.0; FIELDS];
    for (i, weight) in WEIGHTS.iter().enumerate() {
        let row = &rows[(top + i) % WINDOW * columns + x];
        for (mean, value) in means.iter_mut().zip(row) {
            *mean += weight * value;
        }
    }
    means
}

/// The paper's constants C1 and C2 for a precision.
struct Index {
    c1: f64,
    c2: f64,
}

impl Index {
    fn new(precision: u8) -> Self {
        let largest = f64::from(largest_sample(precision));
        Self { c1: K1_SQUARED * largest * largest, c2: K2_SQUARED * largest * largest }
    }

    /// The index of a window from its means, those of squares and that of products.
    fn of(&self, [a, b, aa, bb, ab]: [f64; FIELDS]) -> f64 {
        let (variance_a, variance_b, covariance) = (aa - a * a, bb - b * b, ab - a * b);
        let likeness = (2.0 * a * b + self.c1) * (2.0 * covariance + self.c2);
        likeness / ((a * a + b * b + self.c1) * (variance_a + variance_b + self.c2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(side: usize, sample: impl Fn(usize, usize) -> u16) -> Image {
        let samples = (0..side * side).map(|i| sample(i % side, i / side)).collect();
        Image::from_bottom_up(side, side, 8, vec![samples]).unwrap()
    }

    fn index(first: &Image, second: &Image) -> f64 {
        structural_similarity(first, second, &()).unwrap().unwrap()
    }

    #[test]
    fn the_weights_are_the_gaussian_of_the_paper() {
        let gaussian = |d: i32| (f64::from(-d * d) / 4.5).exp();
        let sum: f64 = (-5..=5).map(gaussian).sum();
        for (weight, d) in WEIGHTS.iter().zip(-5..=5) {
            assert!((weight - gaussian(d) / sum).abs() < 1e-15, "{d}");
        }
        assert!((WEIGHTS.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn flat_pictures_are_as_alike_as_their_means() {
        let (dark, bright) = (gray(12, |_, _| 100), gray(12, |_, _| 150));
        let c1 = 0.0001 * 255.0 * 255.0;
        let expected = (2.0 * 100.0 * 150.0 + c1) / (100.0 * 100.0 + 150.0 * 150.0 + c1);
        assert!((index(&dark, &bright) - expected).abs() < 1e-9);
    }

    #[test]
    fn the_opposite_structure_is_unlike_and_a_little_noise_is_not() {
        let waves = gray(32, |x, y| (100 + 80 * ((x / 2 + y / 2) % 2)) as u16);
        let opposite = gray(32, |x, y| (180 - 80 * ((x / 2 + y / 2) % 2)) as u16);
        let noisy =
            gray(32, |x, y| (100 + 80 * ((x / 2 + y / 2) % 2) + (x * 7 + y * 5) % 3) as u16);
        assert!(index(&waves, &opposite) < -0.9);
        assert!(index(&waves, &noisy) > 0.99);
        assert_eq!(index(&waves, &waves), 1.0);
        assert_eq!(index(&waves, &opposite), index(&opposite, &waves));
    }

    #[test]
    fn one_window_of_a_known_pair_is_as_computed_from_the_definition() {
        let (first, second) =
            (gray(11, |x, y| (x * y) as u16), gray(11, |x, y| (x + 9 * y) as u16));
        let mean = |value: &dyn Fn(usize, usize) -> f64| {
            let points = (0..11).flat_map(|y| (0..11).map(move |x| (x, y)));
            points.map(|(x, y)| WEIGHTS[x] * WEIGHTS[y] * value(x, y)).sum::<f64>()
        };
        let a = |x: usize, y: usize| (x * y) as f64;
        let b = |x: usize, y: usize| (x + 9 * y) as f64;
        let (mean_a, mean_b) = (mean(&a), mean(&b));
        let variance_a = mean(&|x, y| (a(x, y) - mean_a).powi(2));
        let variance_b = mean(&|x, y| (b(x, y) - mean_b).powi(2));
        let covariance = mean(&|x, y| (a(x, y) - mean_a) * (b(x, y) - mean_b));
        let (c1, c2) = (6.5025, 58.5225);
        let expected = (2.0 * mean_a * mean_b + c1) * (2.0 * covariance + c2)
            / ((mean_a * mean_a + mean_b * mean_b + c1) * (variance_a + variance_b + c2));
        assert!((index(&first, &second) - expected).abs() < 1e-9);
    }

    /// The index of two pictures of one shape as the paper defines it, window by window.
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
                let likeness = (2.0 * a * b + c1) * (2.0 * ab + c2);
                sum += likeness / ((a * a + b * b + c1) * (aa + bb + c2));
                count += 1.0;
            }
        }
        sum / count
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(24))]
        #[test]
        fn the_index_of_whole_pictures_is_that_of_its_definition(
            (width, height, count) in (11usize..20, 11usize..20, 1usize..4),
            precision in 1u8..=16,
            seeds in proptest::array::uniform2(0usize..10_000),
        ) {
            let picture = |seed: usize| {
                let sample = |i: usize| ((i + seed).wrapping_mul(40_503) >> 3) as u16 >> (16 - precision);
                let plane = |c: usize| (0..width * height).map(|i| sample(i * (c + 1))).collect();
                Image::from_bottom_up(width, height, precision, (0..count).map(plane).collect()).unwrap()
            };
            let [first, second] = seeds.map(picture);
            let (found, expected) = (index(&first, &second), index_by_definition(&first, &second));
            proptest::prop_assert!((found - expected).abs() < 1e-9, "{} for {}", found, expected);
            proptest::prop_assert!((index(&first, &first) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn pictures_smaller_than_the_window_have_no_index() {
        let small = gray(10, |x, _| x as u16);
        assert_eq!(structural_similarity(&small, &small, &()), Ok(None));
    }

    #[test]
    fn rows_of_all_components_are_counted_as_they_are_compared() {
        #[derive(Default)]
        struct Told(std::sync::Mutex<Vec<(Stage, usize, usize)>>);
        impl Control for Told {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                self.0.lock().unwrap().push((stage, done, total));
                Ok(())
            }
        }
        let image = Image::from_bottom_up(12, 14, 8, vec![vec![5; 12 * 14]; 3]).unwrap();
        let told = Told::default();
        structural_similarity(&image, &image, &told).unwrap();
        let expected: Vec<_> = (0..42).map(|row| (Stage::Measure, row, 42)).collect();
        assert_eq!(told.0.into_inner().unwrap(), expected);
    }
}
