//! Derivatives of a smoothed component, row by row.
//!
//! [`Derivatives`] is the specification and serves every choice of parameters. Each derivative is
//! the correlation of the component, extended beyond its border, with one separable stencil: the
//! smoothing kernel convolved with a difference kernel. With double convolution the smoothed
//! component is cropped to the image and extended again before it is differentiated. Stencils hold
//! whole numbers, so up to smoothing order 17 every value of a component of up to 16 bits is exact;
//! beyond, it is rounded in the same way on every machine. A division at the end applies the unit.
//!
//! [`BinomialRow`] is the fast path for binomial smoothing of order 3 in both directions, the
//! default. The test `fast_path_equals_specification` ties the two.

use crate::control::{Cancelled, Poller};
use crate::density::significance::{DerivativeRow, Significance, laplacian, mmsodd};
use crate::parameters::Parameters;
use crate::parameters::choices::{Boundary, Policy, Smoothing, SmoothingDirection};
use fearless_simd::{Level, Simd, dispatch};

#[derive(Clone, Debug, PartialEq)]
struct Stencil {
    x: Vec<f64>,
    y: Vec<f64>,
}

/// The stencils of one derivative: one, or two with a crop in between.
#[derive(Clone, Debug)]
struct Steps {
    smoothing: Option<Stencil>,
    derivative: Stencil,
}

/// The stencils that the parameters ask for, in whole numbers.
#[derive(Clone, Debug)]
pub(crate) struct Filter {
    steps: Vec<Steps>,
    pub(crate) divisor: f64,
    smoothing_boundary: Boundary,
    boundary: Boundary,
}

const IDENTITY: &[f64] = &[1.0];
/// Twice the first derivative.
const FIRST_DIFFERENCE: &[f64] = &[-1.0, 0.0, 1.0];
const SECOND_DIFFERENCE: &[f64] = &[1.0, -2.0, 1.0];

impl Filter {
    /// The stencils of the first derivatives for the vector gradient, of the second derivatives in
    /// x and y and the mixed one for the other policies.
    pub(crate) fn new(parameters: &Parameters) -> Self {
        let kernel = smoothing_kernel(parameters.smoothing, parameters.smoothing_order);
        let sum: f64 = kernel.iter().sum();
        let both = parameters.smoothing_direction == SmoothingDirection::Both;
        let along = if both { kernel.as_slice() } else { IDENTITY };
        // Without smoothing the mixed derivative is multiplied to have the unit of the others.
        let unit = [sum];
        let (mixed_x, mixed_y) = if both { (along, along) } else { (IDENTITY, &unit[..]) };
        let is_first = parameters.policy == Policy::Psc;
        let pure = if is_first { FIRST_DIFFERENCE } else { SECOND_DIFFERENCE };
        // Smoothing along x and y, and a difference along x and y.
        let mut stencils = vec![
            ([along, &kernel], [pure, IDENTITY]),
            ([&kernel, along], [IDENTITY, pure]),
            ([mixed_x, mixed_y], [FIRST_DIFFERENCE, FIRST_DIFFERENCE]),
        ];
        stencils.truncate(if is_first { 2 } else { 3 });
        let stencil = |[x, y]: [&[f64]; 2]| Stencil { x: x.to_vec(), y: y.to_vec() };
        let steps = |(smoothing, difference): ([&[f64]; 2], [&[f64]; 2])| {
            if parameters.double_convolution {
                let smoothing = Some(stencil(smoothing));
                return Steps { smoothing, derivative: stencil(difference) };
            }
            let [x, y] = [0, 1].map(|axis| convolve(smoothing[axis], difference[axis]));
            Steps { smoothing: None, derivative: Stencil { x, y } }
        };
        Self {
            steps: stencils.into_iter().map(steps).collect(),
            divisor: if both { sum * sum } else { sum },
            smoothing_boundary: parameters.smoothing_boundary,
            boundary: parameters.boundary,
        }
    }
}

/// The derivatives of one component, computed from the bottom row upwards.
pub(crate) struct Derivatives<'a> {
    filter: &'a Filter,
    component: &'a [u16],
    width: usize,
    /// With double convolution the last smoothed rows of each derivative.
    smoothed: Vec<SmoothedRows>,
    /// A row of column sums, extended to both sides.
    sums: Vec<f64>,
}

/// The number and the values of three smoothed rows; row `y` is at index `y % 3`.
type SmoothedRows = [Option<(usize, Vec<f64>)>; 3];

impl<'a> Derivatives<'a> {
    pub(crate) fn new(filter: &'a Filter, component: &'a [u16], width: usize) -> Self {
        let smoothed = vec![SmoothedRows::default(); filter.steps.len()];
        Self { filter, component, width, smoothed, sums: Vec::new() }
    }

    pub(crate) fn row(
        &mut self,
        y: usize,
        row: &mut DerivativeRow,
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        let (width, boundary) = (self.width, self.filter.boundary);
        let height = self.component.len() / width;
        let original = |y: usize| &self.component[y * width..][..width];
        let values = [&mut row.xx, &mut row.yy, &mut row.xy];
        for ((steps, smoothed), values) in
            self.filter.steps.iter().zip(&mut self.smoothed).zip(values)
        {
            values.resize(width, 0.0);
            let sums = &mut self.sums;
            let derivative = Correlation { stencil: &steps.derivative, height, boundary };
            let Some(smoothing) = &steps.smoothing else {
                derivative.of_row(original, y, sums, values, poller)?;
                continue;
            };
            let boundary = self.filter.smoothing_boundary;
            let smoothing = Correlation { stencil: smoothing, height, boundary };
            for near in y.saturating_sub(1)..height.min(y + 2) {
                let entry = &mut smoothed[near % 3];
                if entry.as_ref().is_none_or(|(known, _)| *known != near) {
                    let mut values = vec![0.0; width];
                    smoothing.of_row(original, near, sums, &mut values, poller)?;
                    *entry = Some((near, values));
                }
            }
            let smoothed = |y: usize| smoothed[y % 3].as_ref().map_or(&[][..], |(_, row)| row);
            derivative.of_row(smoothed, y, sums, values, poller)?;
        }
        Ok(())
    }
}

struct Correlation<'a> {
    stencil: &'a Stencil,
    height: usize,
    boundary: Boundary,
}

impl Correlation<'_> {
    /// The correlation with the stencil centred at each lattice point of row `y`. Polls between the
    /// weights, because a row of the widest image with the longest stencil takes long.
    fn of_row<'r, T: Copy + Into<f64> + 'r>(
        &self,
        rows: impl Fn(usize) -> &'r [T],
        y: usize,
        sums: &mut Vec<f64>,
        values: &mut [f64],
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        let Self { stencil, height, boundary } = *self;
        let (width, radius) = (values.len(), stencil.x.len() / 2);
        sums.clear();
        sums.resize(width + 2 * radius, 0.0);
        for (k, &weight) in weights(&stencil.y) {
            let at = (y + k) as isize - (stencil.y.len() / 2) as isize;
            let Some(source) = extended_index(at, height, boundary) else { continue };
            poller.step(width)?;
            for (sum, &sample) in sums[radius..].iter_mut().zip(rows(source)) {
                *sum += weight * sample.into();
            }
        }
        extend_sideways(sums, radius, width, boundary);
        values.fill(0.0);
        for (k, &weight) in weights(&stencil.x) {
            poller.step(width)?;
            for (value, &sum) in values.iter_mut().zip(&sums[k..]) {
                *value += weight * sum;
            }
        }
        Ok(())
    }
}

fn weights(kernel: &[f64]) -> impl Iterator<Item = (usize, &f64)> {
    kernel.iter().enumerate().filter(|(_, weight)| **weight != 0.0)
}

/// The index of the sample at position `at` of an axis extended beyond its ends; `None` for zero.
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
fn extend_sideways<T: Copy + Default>(
    row: &mut [T],
    radius: usize,
    width: usize,
    boundary: Boundary,
) {
    for i in (0..radius).chain(radius + width..row.len()) {
        let source = extended_index(i as isize - radius as isize, width, boundary);
        row[i] = source.map_or(T::default(), |source| row[radius + source]);
    }
}

fn smoothing_kernel(smoothing: Smoothing, order: usize) -> Vec<f64> {
    match smoothing {
        Smoothing::Mean => vec![1.0; order],
        Smoothing::Binomial => (1..order).fold(vec![1.0], |row, _| convolve(&row, &[1.0, 1.0])),
    }
}

fn convolve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, &x) in a.iter().enumerate() {
        for (j, &y) in b.iter().enumerate() {
            product[i + j] += x * y;
        }
    }
    product
}

const RADIUS: usize = 2;

/// The fast path: MMSODD or the Laplacian of one row.
///
/// The columns of 5 by 5 points are summed with three sets of weights, and the operator follows
/// from these sums at once. Every number before the root is a whole one that its type holds.
pub(crate) struct BinomialRow {
    boundary: Boundary,
    level: Level,
    /// Column sums, extended sideways: with the weights of smoothing, first and second derivative.
    sums: [Vec<i32>; 3],
    /// The rows beyond a border that is extended by zeros.
    zeros: Vec<u16>,
}

impl BinomialRow {
    /// Buffers for rows of `width` samples; `None` when the parameters ask for another filter.
    pub(crate) fn new(parameters: &Parameters, width: usize) -> Option<Self> {
        let is_served = parameters.smoothing == Smoothing::Binomial
            && parameters.smoothing_order == 3
            && parameters.smoothing_direction == SmoothingDirection::Both
            && !parameters.double_convolution;
        is_served.then(|| Self {
            boundary: parameters.boundary,
            level: Level::new(),
            sums: [0; 3].map(|zero| vec![zero; width + 2 * RADIUS]),
            zeros: vec![0; width],
        })
    }

    pub(crate) fn evaluate(
        &mut self,
        significance: Significance,
        samples: &[u16],
        y: usize,
        values: &mut [f64],
    ) {
        let (width, boundary, level) = (values.len(), self.boundary, self.level);
        let rows = std::array::from_fn(|i| {
            let at = y as isize + i as isize - RADIUS as isize;
            match extended_index(at, samples.len() / width, boundary) {
                Some(source) => &samples[source * width..][..width],
                None => &self.zeros[..],
            }
        });
        let sums = &mut self.sums;
        dispatch!(level, simd => sum_five_rows(simd, rows, sums));
        sums.iter_mut().for_each(|row| extend_sideways(row, RADIUS, width, boundary));
        match significance {
            Significance::Mmsodd => dispatch!(level, simd => operate(simd, sums, values, mmsodd)),
            Significance::Mol => dispatch!(level, simd => operate(simd, sums, values, laplacian)),
        }
    }
}

#[inline(always)]
fn sum_five_rows<S: Simd>(_: S, [a, b, c, d, e]: [&[u16]; 5], sums: &mut [Vec<i32>; 3]) {
    let width = a.len();
    let [b, c, d, e] = [b, c, d, e].map(|row| &row[..width]);
    let [smoothed, first, second] = sums.each_mut().map(|row| &mut row[RADIUS..][..width]);
    for x in 0..width {
        let [a, b, c, d, e] = [a[x], b[x], c[x], d[x], e[x]].map(i32::from);
        smoothed[x] = b + 2 * c + d;
        first[x] = e - a + 2 * (d - b);
        second[x] = a - 2 * c + e;
    }
}

/// An operator of the second derivatives that a row of column sums gives.
#[inline(always)]
fn operate<S: Simd>(
    _: S,
    sums: &[Vec<i32>; 3],
    values: &mut [f64],
    operator: impl Fn(f64, f64, f64) -> f64,
) {
    let extended = values.len() + 2 * RADIUS;
    let [smoothed, first, second] = sums.each_ref().map(|row| &row[..extended]);
    let five = |sums: &[i32], x: usize| -> [i32; 5] { std::array::from_fn(|i| sums[x + i]) };
    for (x, value) in values.iter_mut().enumerate() {
        let [a, _, c, _, e] = five(smoothed, x);
        let xx = a - 2 * c + e;
        let [_, b, c, d, _] = five(second, x);
        let yy = b + 2 * c + d;
        let [a, b, _, d, e] = five(first, x);
        let xy = e - a + 2 * (d - b);
        // The binomial weights 1, 2, 1 sum to 4 along each axis.
        *value = operator(xx.into(), yy.into(), xy.into()) / 16.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::parameters::Target;
    use proptest::prelude::*;

    fn parameters() -> Parameters {
        Parameters::default().target(Target::Size(4))
    }

    /// All derivatives of a component, divided by their unit.
    fn second_derivatives(
        parameters: &Parameters,
        component: &[u16],
        width: usize,
    ) -> [Vec<f64>; 3] {
        let filter = Filter::new(parameters);
        let mut derivatives = Derivatives::new(&filter, component, width);
        let (mut all, mut row) = ([Vec::new(), Vec::new(), Vec::new()], DerivativeRow::default());
        for y in 0..component.len() / width {
            derivatives.row(y, &mut row, &mut poller()).unwrap();
            for (all, row) in all.iter_mut().zip([&row.xx, &row.yy, &row.xy]) {
                all.extend(row.iter().map(|value| value / filter.divisor));
            }
        }
        all
    }

    #[test]
    fn orthogonal_smoothing_keeps_the_own_direction_sharp() {
        let orthogonal =
            Parameters { smoothing_direction: SmoothingDirection::Orthogonal, ..parameters() };
        let impulse: Vec<u16> = (0..81).map(|i| if i == 4 * 9 + 4 { 64 } else { 0 }).collect();
        let [xx, yy, xy] = second_derivatives(&orthogonal, &impulse, 9);
        assert_eq!(xx[4 * 9 + 2..][..5], [0.0, 32.0, -64.0, 32.0, 0.0]);
        assert_eq!(xx[3 * 9 + 2..][..5], [0.0, 16.0, -32.0, 16.0, 0.0]);
        assert_eq!([yy[3 * 9 + 4], yy[4 * 9 + 4], yy[4 * 9 + 3]], [32.0, -64.0, -32.0]);
        // Four times the mixed derivative, unsmoothed.
        assert_eq!([xy[3 * 9 + 3], xy[3 * 9 + 4], xy[3 * 9 + 5]], [64.0, 0.0, -64.0]);
    }

    #[test]
    fn double_convolution_differs_at_the_border_only() {
        for smoothing_direction in [SmoothingDirection::Both, SmoothingDirection::Orthogonal] {
            let once = Parameters { smoothing_direction, ..parameters() };
            let twice = Parameters { double_convolution: true, ..once.clone() };
            let samples: Vec<u16> = (0..81).map(|i| 50 + i * i % 97).collect();
            let one = second_derivatives(&once, &samples, 9);
            let two = second_derivatives(&twice, &samples, 9);
            // Filters at right angles to each other do not depend on each other's border.
            assert_eq!(one != two, smoothing_direction == SmoothingDirection::Both);
            let is_inner = |i: &usize| (2..7).contains(&(i % 9)) && (2..7).contains(&(i / 9));
            for (one, two) in one.iter().zip(&two) {
                (0..81).filter(is_inner).for_each(|i| assert_eq!(one[i], two[i], "{i}"));
            }
        }
    }

    #[test]
    fn both_convolutions_have_their_own_boundary() {
        use Boundary::{Constant, Symmetric, Zero};
        let second = |smoothing_boundary, boundary| {
            let own = parameters();
            let twice =
                Parameters { double_convolution: true, smoothing_boundary, boundary, ..own };
            second_derivatives(&twice, &[80; 36], 6)[0][2 * 6..][..6].to_vec()
        };
        assert_eq!(second(Constant, Symmetric), [0.0; 6]);
        assert_eq!(second(Constant, Zero), [-80.0, 0.0, 0.0, 0.0, 0.0, -80.0]);
        assert_eq!(second(Zero, Constant), [20.0, -20.0, 0.0, 0.0, -20.0, 20.0]);
    }

    #[test]
    fn boundaries_extend_as_named() {
        let at = |i, boundary| extended_index(i, 4, boundary);
        assert_eq!(at(-1, Boundary::Zero), None);
        assert_eq!(at(-2, Boundary::Constant), Some(0));
        assert_eq!(at(5, Boundary::Constant), Some(3));
        assert_eq!(at(-1, Boundary::Symmetric), Some(1));
        assert_eq!(at(4, Boundary::Symmetric), Some(2));
        assert_eq!(at(-5, Boundary::Symmetric), Some(1));
        assert_eq!(extended_index(-3, 2, Boundary::Symmetric), Some(1));
    }

    proptest! {
        #[test]
        fn fast_path_equals_specification(
            width in 2usize..40,
            samples in prop::collection::vec(0u16..=u16::MAX, 80..400),
            boundary in prop::sample::select(Boundary::ALL),
        ) {
            let samples = &samples[..samples.len() / width * width];
            let parameters = Parameters { boundary, ..parameters() };
            let mut fast = BinomialRow::new(&parameters, width).unwrap();
            let filter = Filter::new(&parameters);
            let mut derivatives = Derivatives::new(&filter, samples, width);
            let (mut found, mut expected) = (vec![0.0; width], vec![0.0; width]);
            let mut row = DerivativeRow::default();
            for y in 0..samples.len() / width {
                derivatives.row(y, &mut row, &mut poller()).unwrap();
                for significance in [Significance::Mmsodd, Significance::Mol] {
                    significance.evaluate(&row, filter.divisor, &mut expected);
                    fast.evaluate(significance, samples, y, &mut found);
                    prop_assert_eq!(&found, &expected);
                }
            }
        }
    }

    #[test]
    fn fast_path_refuses_other_filters() {
        let parameters = parameters();
        assert!(BinomialRow::new(&parameters, 3).is_some());
        for other in [
            Parameters { smoothing_order: 5, ..parameters.clone() },
            Parameters { smoothing: Smoothing::Mean, ..parameters.clone() },
            Parameters { double_convolution: true, ..parameters.clone() },
            Parameters { smoothing_direction: SmoothingDirection::Orthogonal, ..parameters },
        ] {
            assert!(BinomialRow::new(&other, 3).is_none());
        }
    }
}
