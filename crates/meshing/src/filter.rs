//! Smoothing and differentiation as one filter.
//!
//! The component is extended beyond its border, smoothed in full precision and differentiated,
//! and only the result is cropped: each derivative is the correlation of the extended component
//! with one separable stencil, the smoothing kernel convolved with a difference kernel along one
//! axis or both. Stencils hold whole numbers, so that every value of a picture of up to 16 bits is
//! an exact multiple of a known unit up to smoothing order 17 (beyond, it is rounded, in the same
//! way on every machine); the unit is applied once, at the end.

use crate::method::{Boundary, Parameters, Smoothing};

/// The smoothing and difference kernels of one set of parameters, in whole numbers.
///
/// All three have the same odd length, `order + 2`, centred at the same sample.
#[derive(Clone, Debug)]
pub(crate) struct Filter {
    /// The smoothing kernel.
    smooth: Vec<f64>,
    /// The smoothing kernel convolved with `[-1, 0, 1]`: twice the first derivative.
    first: Vec<f64>,
    /// The smoothing kernel convolved with `[1, -2, 1]`: the second derivative.
    second: Vec<f64>,
    /// What the filtered values must be divided by: the square of the kernel's sum.
    divisor: f64,
    boundary: Boundary,
}

/// Filtered values of one row, `width` each, in units of `1 / divisor`.
#[derive(Clone, Debug, Default)]
pub(crate) struct DerivativeRow {
    /// Second derivative in x; for [`Order::First`] twice the first derivative in x.
    pub(crate) xx: Vec<f64>,
    /// Second derivative in y; for [`Order::First`] twice the first derivative in y.
    pub(crate) yy: Vec<f64>,
    /// Four times the mixed derivative; empty for [`Order::First`].
    pub(crate) xy: Vec<f64>,
}

/// Which derivatives a pass computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// First derivatives in x and y.
    First,
    /// Second derivatives in x and y and the mixed one.
    Second,
}

impl Filter {
    /// The kernels that the parameters ask for.
    pub(crate) fn new(parameters: &Parameters) -> Self {
        let kernel = smoothing_kernel(parameters.smoothing, parameters.smoothing_order);
        let sum: f64 = kernel.iter().sum();
        Self {
            smooth: convolve(&kernel, &[0.0, 1.0, 0.0]),
            first: convolve(&kernel, &[-1.0, 0.0, 1.0]),
            second: convolve(&kernel, &[1.0, -2.0, 1.0]),
            divisor: sum * sum,
            boundary: parameters.boundary,
        }
    }

    /// What the values of a [`DerivativeRow`] must be divided by.
    pub(crate) fn divisor(&self) -> f64 {
        self.divisor
    }

    /// Filters a component and hands each row's derivatives to `use_row`, from the bottom up.
    pub(crate) fn for_each_row(
        &self,
        component: &[u16],
        width: usize,
        order: Order,
        mut use_row: impl FnMut(usize, &DerivativeRow),
    ) {
        let height = component.len() / width;
        let mut columns = ColumnSums::new(width, self.radius());
        let mut row = DerivativeRow::default();
        for y in 0..height {
            let vertical = |kernel: &[f64], sums: &mut Vec<f64>| {
                self.filter_columns(component, width, y, kernel, sums);
            };
            match order {
                Order::First => {
                    vertical(&self.smooth, &mut columns.smooth);
                    vertical(&self.first, &mut columns.first);
                    correlate(&columns.smooth, &self.first, width, &mut row.xx);
                    correlate(&columns.first, &self.smooth, width, &mut row.yy);
                }
                Order::Second => {
                    vertical(&self.smooth, &mut columns.smooth);
                    vertical(&self.first, &mut columns.first);
                    vertical(&self.second, &mut columns.second);
                    correlate(&columns.smooth, &self.second, width, &mut row.xx);
                    correlate(&columns.second, &self.smooth, width, &mut row.yy);
                    correlate(&columns.first, &self.first, width, &mut row.xy);
                }
            }
            use_row(y, &row);
        }
    }

    /// How many samples the kernels reach to each side.
    fn radius(&self) -> usize {
        self.smooth.len() / 2
    }

    /// Correlates the columns of the extended component with a kernel centred at row `y`, then
    /// extends the row of sums to both sides by the kernels' radius.
    fn filter_columns(
        &self,
        component: &[u16],
        width: usize,
        y: usize,
        kernel: &[f64],
        sums: &mut [f64],
    ) {
        let (radius, height) = (self.radius(), component.len() / width);
        sums.fill(0.0);
        for (k, &weight) in kernel.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            let at = y as isize + k as isize - radius as isize;
            let Some(source) = extended_index(at, height, self.boundary) else { continue };
            let samples = &component[source * width..][..width];
            for (sum, &sample) in sums[radius..].iter_mut().zip(samples) {
                *sum += weight * f64::from(sample);
            }
        }
        extend_sideways(sums, radius, width, self.boundary);
    }
}

/// Rows of column sums, extended by the kernels' radius to both sides.
struct ColumnSums {
    smooth: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl ColumnSums {
    fn new(width: usize, radius: usize) -> Self {
        let row = || vec![0.0; width + 2 * radius];
        Self { smooth: row(), first: row(), second: row() }
    }
}

/// The index of the sample that stands at `at` in an axis of `length` extended beyond its ends;
/// `None` for zero.
fn extended_index(at: isize, length: usize, boundary: Boundary) -> Option<usize> {
    let last = length as isize - 1;
    if (0..=last).contains(&at) {
        return Some(at as usize);
    }
    match boundary {
        Boundary::Zero => None,
        Boundary::Constant => Some(at.clamp(0, last) as usize),
        Boundary::Symmetric => {
            let period = at.rem_euclid(2 * last);
            Some(period.min(2 * last - period) as usize)
        }
    }
}

/// Fills the margins of a row whose `width` inner values are set.
fn extend_sideways(row: &mut [f64], radius: usize, width: usize, boundary: Boundary) {
    for i in (0..radius).chain(radius + width..row.len()) {
        let source = extended_index(i as isize - radius as isize, width, boundary);
        row[i] = source.map_or(0.0, |source| row[radius + source]);
    }
}

/// Correlates an extended row with a kernel into `width` values.
fn correlate(extended: &[f64], kernel: &[f64], width: usize, values: &mut Vec<f64>) {
    values.clear();
    values.resize(width, 0.0);
    for (k, &weight) in kernel.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
        for (value, &sum) in values.iter_mut().zip(&extended[k..]) {
            *value += weight * sum;
        }
    }
}

/// The smoothing kernel of an odd order, in whole numbers.
fn smoothing_kernel(smoothing: Smoothing, order: usize) -> Vec<f64> {
    match smoothing {
        Smoothing::Mean => vec![1.0; order],
        Smoothing::Binomial => (1..order).fold(vec![1.0], |row, _| convolve(&row, &[1.0, 1.0])),
    }
}

/// The full convolution of two kernels.
fn convolve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, &x) in a.iter().enumerate() {
        for (j, &y) in b.iter().enumerate() {
            product[i + j] += x * y;
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Target;

    #[test]
    fn order_three_is_the_known_stencil() {
        let filter = Filter::new(&Parameters::new(Target::Size(4)));
        assert_eq!(filter.smooth, [0.0, 1.0, 2.0, 1.0, 0.0]);
        assert_eq!(filter.second, [1.0, 0.0, -2.0, 0.0, 1.0]);
        assert_eq!(
            filter.first.iter().map(|w| -w).collect::<Vec<_>>(),
            [1.0, 2.0, 0.0, -2.0, -1.0]
        );
        assert_eq!(filter.divisor(), 16.0);
    }

    #[test]
    fn boundaries_extend_as_their_names_say() {
        let at = |i, boundary| extended_index(i, 4, boundary);
        assert_eq!(at(-1, Boundary::Zero), None);
        assert_eq!(at(-2, Boundary::Constant), Some(0));
        assert_eq!(at(5, Boundary::Constant), Some(3));
        assert_eq!(at(-1, Boundary::Symmetric), Some(1));
        assert_eq!(at(4, Boundary::Symmetric), Some(2));
        assert_eq!(at(-5, Boundary::Symmetric), Some(1));
        assert_eq!(extended_index(-3, 2, Boundary::Symmetric), Some(1));
    }
}
