//! Smoothing and differentiation as one filter, or as two.
//!
//! The component is extended beyond its border, smoothed in full precision and differentiated,
//! and only the result is cropped: each derivative is the correlation of the extended component
//! with one separable stencil, the smoothing kernel convolved with a difference kernel along one
//! axis or both. With double convolution the smoothed component is cropped to the picture first
//! and extended again for the differences. Stencils hold whole numbers, so that every value of a
//! picture of up to 16 bits is an exact multiple of a known unit up to smoothing order 17 (beyond,
//! it is rounded, in the same way on every machine); the unit is applied once, at the end.

use crate::control::Cancelled;
use crate::parameters::Parameters;
use crate::parameters::choices::{Boundary, Smoothing, SmoothingDirection};

/// A kernel of odd length along each axis.
#[derive(Clone, Debug)]
struct Stencil {
    x: Vec<f64>,
    y: Vec<f64>,
}

/// The stencils of one set of parameters, in whole numbers.
#[derive(Clone, Debug)]
pub(crate) struct Filter {
    first_x: Stages,
    first_y: Stages,
    second_x: Stages,
    second_y: Stages,
    mixed: Stages,
    /// What the filtered values must be divided by.
    divisor: f64,
    smoothing_boundary: Boundary,
    boundary: Boundary,
}

/// What makes one derivative of a component: one stencil, or two with a crop in between.
#[derive(Clone, Debug)]
struct Stages {
    smoothing: Option<Stencil>,
    derivative: Stencil,
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

/// No smoothing and no difference.
const IDENTITY: &[f64] = &[1.0];
/// Twice the first derivative.
const FIRST_DIFFERENCE: &[f64] = &[-1.0, 0.0, 1.0];
/// The second derivative.
const SECOND_DIFFERENCE: &[f64] = &[1.0, -2.0, 1.0];

impl Filter {
    /// The stencils that the parameters ask for.
    pub(crate) fn new(parameters: &Parameters) -> Self {
        let kernel = smoothing_kernel(parameters.smoothing, parameters.smoothing_order);
        let sum: f64 = kernel.iter().sum();
        let both = parameters.smoothing_direction == SmoothingDirection::Both;
        let along = if both { kernel.as_slice() } else { IDENTITY };
        // Without smoothing the mixed derivative is brought to the unit of the others.
        let unit = [sum];
        let (mixed_x, mixed_y) = if both { (along, along) } else { (IDENTITY, &unit[..]) };
        let stages = |smooth_x: &[f64], smooth_y: &[f64], x: &[f64], y: &[f64]| {
            Stages::new(parameters.double_convolution, [smooth_x, smooth_y], [x, y])
        };
        Self {
            first_x: stages(along, &kernel, FIRST_DIFFERENCE, IDENTITY),
            first_y: stages(&kernel, along, IDENTITY, FIRST_DIFFERENCE),
            second_x: stages(along, &kernel, SECOND_DIFFERENCE, IDENTITY),
            second_y: stages(&kernel, along, IDENTITY, SECOND_DIFFERENCE),
            mixed: stages(mixed_x, mixed_y, FIRST_DIFFERENCE, FIRST_DIFFERENCE),
            divisor: if both { sum * sum } else { sum },
            smoothing_boundary: parameters.smoothing_boundary,
            boundary: parameters.boundary,
        }
    }

    /// What the values of a [`DerivativeRow`] must be divided by.
    pub(crate) fn divisor(&self) -> f64 {
        self.divisor
    }

    /// Filters a component and hands each row's derivatives to `use_row`, from the bottom up, until
    /// that cancels.
    pub(crate) fn for_each_row(
        &self,
        component: &[u16],
        width: usize,
        order: Order,
        mut use_row: impl FnMut(usize, &DerivativeRow) -> Result<(), Cancelled>,
    ) -> Result<(), Cancelled> {
        let prepare = |stages| Pass::new(stages, component, width, self);
        let mut passes = match order {
            Order::First => vec![prepare(&self.first_x), prepare(&self.first_y)],
            Order::Second => {
                vec![prepare(&self.second_x), prepare(&self.second_y), prepare(&self.mixed)]
            }
        };
        let mut row = DerivativeRow::default();
        for y in 0..component.len() / width {
            let values = [&mut row.xx, &mut row.yy, &mut row.xy];
            for (pass, values) in passes.iter_mut().zip(values) {
                pass.row(y, values);
            }
            use_row(y, &row)?;
        }
        Ok(())
    }
}

impl Stages {
    /// Smoothing along x and y, then a difference along x and y: as one stencil, or apart.
    fn new(apart: bool, smooth: [&[f64]; 2], difference: [&[f64]; 2]) -> Self {
        let stencil = |[x, y]: [&[f64]; 2]| Stencil { x: x.to_vec(), y: y.to_vec() };
        if apart {
            return Self { smoothing: Some(stencil(smooth)), derivative: stencil(difference) };
        }
        let x = convolve(smooth[0], difference[0]);
        let y = convolve(smooth[1], difference[1]);
        Self { smoothing: None, derivative: Stencil { x, y } }
    }
}

/// One derivative of one component, row by row.
struct Pass<'a> {
    source: Source<'a>,
    stencil: &'a Stencil,
    width: usize,
    boundary: Boundary,
    /// A row of column sums, extended to both sides.
    sums: Vec<f64>,
}

/// What a derivative is taken of.
enum Source<'a> {
    Samples(&'a [u16]),
    Smoothed(Vec<f64>),
}

impl<'a> Pass<'a> {
    /// Prepares a derivative: with double convolution by smoothing the whole component.
    fn new(stages: &'a Stages, component: &'a [u16], width: usize, filter: &Filter) -> Self {
        let source = match &stages.smoothing {
            None => Source::Samples(component),
            Some(stencil) => {
                Source::Smoothed(filtered(component, width, stencil, filter.smoothing_boundary))
            }
        };
        let sums = vec![0.0; width + stencil_margin(&stages.derivative)];
        Self { source, stencil: &stages.derivative, width, boundary: filter.boundary, sums }
    }

    /// The derivative of row `y`.
    fn row(&mut self, y: usize, values: &mut Vec<f64>) {
        let Self { source, stencil, width, boundary, sums } = self;
        match source {
            Source::Samples(samples) => {
                filter_row(samples, *width, y, stencil, *boundary, sums, values);
            }
            Source::Smoothed(smoothed) => {
                filter_row(smoothed, *width, y, stencil, *boundary, sums, values);
            }
        }
    }
}

/// Values that both margins of a row of column sums hold.
fn stencil_margin(stencil: &Stencil) -> usize {
    stencil.x.len() - 1
}

/// A whole component, filtered and cropped.
fn filtered(component: &[u16], width: usize, stencil: &Stencil, boundary: Boundary) -> Vec<f64> {
    let mut sums = vec![0.0; width + stencil_margin(stencil)];
    let (mut all, mut row) = (Vec::with_capacity(component.len()), Vec::new());
    for y in 0..component.len() / width {
        filter_row(component, width, y, stencil, boundary, &mut sums, &mut row);
        all.extend_from_slice(&row);
    }
    all
}

/// Correlates an extended component with a stencil centred in each place of row `y`.
fn filter_row<T: Copy + Into<f64>>(
    component: &[T],
    width: usize,
    y: usize,
    stencil: &Stencil,
    boundary: Boundary,
    sums: &mut [f64],
    values: &mut Vec<f64>,
) {
    let radius = stencil.x.len() / 2;
    sum_columns(component, width, y, &stencil.y, boundary, &mut sums[radius..][..width]);
    extend_sideways(sums, radius, width, boundary);
    correlate(sums, &stencil.x, width, values);
}

/// Correlates the columns of the extended component with a kernel centred at row `y`.
fn sum_columns<T: Copy + Into<f64>>(
    component: &[T],
    width: usize,
    y: usize,
    kernel: &[f64],
    boundary: Boundary,
    sums: &mut [f64],
) {
    let (radius, height) = (kernel.len() / 2, component.len() / width);
    sums.fill(0.0);
    for (k, &weight) in kernel.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
        let at = y as isize + k as isize - radius as isize;
        let Some(source) = extended_index(at, height, boundary) else { continue };
        let samples = &component[source * width..][..width];
        for (sum, &sample) in sums.iter_mut().zip(samples) {
            *sum += weight * sample.into();
        }
    }
}

/// The index of the sample that stands at `at` in an axis of `length` extended beyond its ends;
/// `None` for zero.
pub(crate) fn extended_index(at: isize, length: usize, boundary: Boundary) -> Option<usize> {
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
    use crate::parameters::Target;

    fn parameters() -> Parameters {
        Parameters::default().target(Target::Size(4))
    }

    /// All derivatives of a component, divided by their unit.
    fn derivatives(parameters: &Parameters, component: &[u16], width: usize) -> [Vec<f64>; 3] {
        let filter = Filter::new(parameters);
        let mut all = [Vec::new(), Vec::new(), Vec::new()];
        let collect = |_: usize, row: &DerivativeRow| {
            for (all, row) in all.iter_mut().zip([&row.xx, &row.yy, &row.xy]) {
                all.extend(row.iter().map(|value| value / filter.divisor()));
            }
            Ok(())
        };
        filter.for_each_row(component, width, Order::Second, collect).unwrap();
        all
    }

    /// A 9 by 9 picture that is black but for one sample of 64 in the middle.
    fn impulse() -> Vec<u16> {
        let mut samples = vec![0; 81];
        samples[4 * 9 + 4] = 64;
        samples
    }

    #[test]
    fn order_three_is_the_known_stencil() {
        let filter = Filter::new(&parameters());
        assert_eq!(filter.second_x.derivative.x, [1.0, 0.0, -2.0, 0.0, 1.0]);
        assert_eq!(filter.second_x.derivative.y, [1.0, 2.0, 1.0]);
        assert_eq!(filter.mixed.derivative.x, [-1.0, -2.0, 0.0, 2.0, 1.0]);
        assert_eq!(filter.mixed.derivative.y, filter.mixed.derivative.x);
        assert_eq!(filter.divisor(), 16.0);
    }

    #[test]
    fn orthogonal_smoothing_leaves_the_derivative_s_own_direction_sharp() {
        let orthogonal =
            Parameters { smoothing_direction: SmoothingDirection::Orthogonal, ..parameters() };
        let [xx, yy, xy] = derivatives(&orthogonal, &impulse(), 9);
        assert_eq!(xx[4 * 9 + 2..][..5], [0.0, 32.0, -64.0, 32.0, 0.0]);
        assert_eq!(xx[3 * 9 + 2..][..5], [0.0, 16.0, -32.0, 16.0, 0.0]);
        assert_eq!([yy[3 * 9 + 4], yy[4 * 9 + 4], yy[4 * 9 + 3]], [32.0, -64.0, -32.0]);
        // Four times the mixed derivative, unsmoothed.
        assert_eq!([xy[3 * 9 + 3], xy[3 * 9 + 4], xy[3 * 9 + 5]], [64.0, 0.0, -64.0]);
    }

    #[test]
    fn two_passes_differ_from_one_at_the_border_only() {
        for smoothing_direction in [SmoothingDirection::Both, SmoothingDirection::Orthogonal] {
            let once = Parameters { smoothing_direction, ..parameters() };
            let twice = Parameters { double_convolution: true, ..once.clone() };
            let samples: Vec<u16> = (0..81).map(|i| 50 + i * i % 97).collect();
            let (one, two) = (derivatives(&once, &samples, 9), derivatives(&twice, &samples, 9));
            // At right angles to each other the two filters do not see each other's border.
            assert_eq!(one != two, smoothing_direction == SmoothingDirection::Both);
            for (one, two) in one.iter().zip(&two) {
                for i in (0..81).filter(|i| (2..7).contains(&(i % 9)) && (2..7).contains(&(i / 9)))
                {
                    assert_eq!(one[i], two[i], "{i}");
                }
            }
        }
    }

    #[test]
    fn each_pass_extends_as_its_own_boundary_says() {
        // A flat picture stays flat where it is extended by itself, and shows its border elsewhere.
        let flat = [80; 36];
        let second = |smoothing_boundary, boundary| {
            let twice = Parameters {
                double_convolution: true,
                smoothing_boundary,
                boundary,
                ..parameters()
            };
            derivatives(&twice, &flat, 6)[0][2 * 6..][..6].to_vec()
        };
        assert_eq!(second(Boundary::Constant, Boundary::Symmetric), [0.0; 6]);
        assert_eq!(second(Boundary::Constant, Boundary::Zero), [-80.0, 0.0, 0.0, 0.0, 0.0, -80.0]);
        assert_eq!(
            second(Boundary::Zero, Boundary::Constant),
            [20.0, -20.0, 0.0, 0.0, -20.0, 20.0]
        );
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
