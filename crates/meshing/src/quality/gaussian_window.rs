//! Weighted means under a Gaussian window that slides over an image, row by row.

use crate::control::Cancelled;

/// Columns and rows of the window of structural similarity.
pub(crate) const SIDE: usize = 11;

/// The Gaussian of standard deviation 1.5 at distances 0 to 5, as literals: the exponential
/// function differs in the last bit from one machine to another.
const GAUSSIAN: [f64; SIDE / 2 + 1] = [
    1.0,
    0.800_737_402_916_808_1,
    0.411_112_290_507_187_4,
    0.135_335_283_236_612_7,
    0.028_565_500_784_550_4,
    0.003_865_920_139_472_807_6,
];

const COLUMNS_PER_POLL: usize = 1024;

/// The means of `N` fields at all positions of the window in one row of positions. It keeps one
/// row for each of the window's rows, and no field of the whole image.
pub(crate) struct GaussianWindow<const N: usize> {
    /// Weights of the window's columns, and of its rows; their sum is 1.
    weights: Vec<f64>,
    row_count: usize,
    row: Vec<[f64; N]>,
    /// Means along the last rows; those of row `y` have the index `y % weights.len()`.
    along_rows: Vec<Vec<[f64; N]>>,
    means: Vec<[f64; N]>,
}

impl<const N: usize> GaussianWindow<N> {
    /// A window of `side` columns and rows, odd and at most [`SIDE`], over `width` columns.
    pub(crate) fn new(side: usize, width: usize) -> Self {
        let weight = |i: usize| GAUSSIAN[i.abs_diff(side / 2)];
        let sum: f64 = (0..side).map(weight).sum();
        let means = vec![[0.0; N]; width + 1 - side];
        Self {
            weights: (0..side).map(|i| weight(i) / sum).collect(),
            row_count: 0,
            row: Vec::with_capacity(width),
            along_rows: vec![means.clone(); side],
            means,
        }
    }

    /// Adds the next row. Returns the means under the windows whose last row it is: none as long as
    /// there are fewer rows than the window has.
    pub(crate) fn add_row(
        &mut self,
        row: impl Iterator<Item = [f64; N]>,
        poll: impl Fn() -> Result<(), Cancelled>,
    ) -> Result<&[[f64; N]], Cancelled> {
        let side = self.weights.len();
        let newest = self.row_count % side;
        self.row_count += 1;
        self.row.clear();
        self.row.extend(row);
        let is_full = self.row_count >= side;
        for first in (0..self.means.len()).step_by(COLUMNS_PER_POLL) {
            poll()?;
            let part = first..self.means.len().min(first + COLUMNS_PER_POLL);
            let shifted = (0..side).map(|i| &self.row[part.start + i..part.end + i]);
            average(&self.weights, shifted, &mut self.along_rows[newest][part.clone()]);
            if is_full {
                let oldest_first = (newest + 1..side).chain(0..=newest);
                let rows = oldest_first.map(|row| &self.along_rows[row][part.clone()]);
                average(&self.weights, rows, &mut self.means[part.clone()]);
            }
        }
        Ok(if is_full { &self.means } else { &[] })
    }
}

fn average<'a, const N: usize>(
    weights: &[f64],
    rows: impl Iterator<Item = &'a [[f64; N]]>,
    means: &mut [[f64; N]],
) {
    means.fill([0.0; N]);
    for (weight, row) in weights.iter().zip(rows) {
        for (mean, value) in means.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
            *mean += weight * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_a_gaussian_of_sum_1() {
        let gaussian = |d: i32| (f64::from(-d * d) / 4.5).exp();
        for radius in 0..=5 {
            let side = 2 * radius as usize + 1;
            let window = GaussianWindow::<1>::new(side, side);
            let sum: f64 = (-radius..=radius).map(gaussian).sum();
            for (weight, d) in window.weights.iter().zip(-radius..) {
                assert!((weight - gaussian(d) / sum).abs() < 1e-15, "{d} of {radius}");
            }
        }
    }
}
