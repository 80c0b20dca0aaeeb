//! MMSODD and the Laplacian with the thesis's filter, binomial smoothing of order 3 in both
//! directions, in one sweep over rows.
//!
//! All three second derivatives are then whole numbers of one stencil of 5 by 5 points, sixteen
//! times the derivatives along the axes and 64 times the mixed one. The columns of a row are summed
//! up in three ways, the sums are extended sideways and correlated, and the operator follows at
//! once: five rows of the picture in, one row of the density out, nothing in between kept. Every
//! number up to the root is a whole one that its type holds, so the result is the same as that of
//! [`Filter`](crate::density::filter) to the last bit.

use crate::density::filter::extended_index;
use crate::density::significance::Significance;
use crate::parameters::Parameters;
use crate::parameters::choices::{Boundary, Smoothing, SmoothingDirection};
use fearless_simd::{Level, Simd, dispatch};

/// What derivatives in these units must be divided by.
const DIVISOR: f64 = 16.0;

/// Points that the stencil reaches in each direction.
const RADIUS: usize = 2;

/// The sweep over one component.
pub(crate) struct SecondDerivatives<'a> {
    samples: &'a [u16],
    width: usize,
    height: usize,
    boundary: Boundary,
    level: Level,
    /// Column sums of one row with the weights of smoothing, of the first and of the second
    /// derivative, extended sideways.
    smoothed: Vec<i32>,
    first: Vec<i32>,
    second: Vec<i32>,
    /// What stands for rows beyond the border where these are zero.
    zeros: Vec<u16>,
}

impl<'a> SecondDerivatives<'a> {
    /// A sweep over a component; `None` when the parameters ask for another filter.
    pub(crate) fn new(parameters: &Parameters, samples: &'a [u16], width: usize) -> Option<Self> {
        let is_binomial_of_order_three = parameters.smoothing == Smoothing::Binomial
            && parameters.smoothing_order == 3
            && parameters.smoothing_direction == SmoothingDirection::Both
            && !parameters.double_convolution;
        is_binomial_of_order_three.then(|| Self {
            samples,
            width,
            height: samples.len() / width,
            boundary: parameters.boundary,
            level: Level::new(),
            smoothed: vec![0; width + 2 * RADIUS],
            first: vec![0; width + 2 * RADIUS],
            second: vec![0; width + 2 * RADIUS],
            zeros: vec![0; width],
        })
    }

    /// The operator on row `y`, written to `values`.
    pub(crate) fn evaluate(&mut self, significance: Significance, y: usize, values: &mut [f64]) {
        let rows: [usize; 2 * RADIUS + 1] = std::array::from_fn(|i| i);
        let rows = rows.map(|i| {
            let at = y as isize + i as isize - RADIUS as isize;
            match extended_index(at, self.height, self.boundary) {
                Some(source) => &self.samples[source * self.width..][..self.width],
                None => &self.zeros[..],
            }
        });
        let Self { width, boundary, level, smoothed, first, second, .. } = self;
        let inner = |sums: &mut Vec<i32>| RADIUS..sums.len() - RADIUS;
        let sums = [&mut *smoothed, &mut *first, &mut *second];
        let [to_smooth, to_first, to_second] = sums.map(|sums| {
            let inner = inner(sums);
            &mut sums[inner]
        });
        dispatch!(*level, simd => sum_columns(simd, rows, to_smooth, to_first, to_second));
        for sums in [&mut *smoothed, &mut *first, &mut *second] {
            extend_sideways(sums, *width, *boundary);
        }
        match significance {
            Significance::Mmsodd => {
                dispatch!(*level, simd => mmsodd(simd, smoothed, first, second, values));
            }
            Significance::Mol => {
                dispatch!(*level, simd => laplacian(simd, smoothed, second, values));
            }
        }
    }
}

/// Sums up each column of five rows with three sets of weights.
#[inline(always)]
fn sum_columns<S: Simd>(
    _: S,
    [a, b, c, d, e]: [&[u16]; 2 * RADIUS + 1],
    smoothed: &mut [i32],
    first: &mut [i32],
    second: &mut [i32],
) {
    let count = smoothed.len();
    let [a, b, c, d, e] = [a, b, c, d, e].map(|row| &row[..count]);
    let (first, second) = (&mut first[..count], &mut second[..count]);
    for x in 0..count {
        let [a, b, c, d, e] = [a[x], b[x], c[x], d[x], e[x]].map(i32::from);
        smoothed[x] = b + 2 * c + d;
        first[x] = e - a + 2 * (d - b);
        second[x] = a - 2 * c + e;
    }
}

/// Fills the margins of a row of sums whose inner ones are set.
fn extend_sideways(sums: &mut [i32], width: usize, boundary: Boundary) {
    for i in (0..RADIUS).chain(RADIUS + width..sums.len()) {
        let source = extended_index(i as isize - RADIUS as isize, width, boundary);
        sums[i] = source.map_or(0, |source| sums[RADIUS + source]);
    }
}

/// MMSODD of a row of column sums.
#[inline(always)]
fn mmsodd<S: Simd>(_: S, smoothed: &[i32], first: &[i32], second: &[i32], values: &mut [f64]) {
    let count = values.len();
    let at = |sums: &[i32], x: usize| -> [i32; 5] { std::array::from_fn(|i| sums[x + i]) };
    let reach = count + 2 * RADIUS;
    let (smoothed, first, second) = (&smoothed[..reach], &first[..reach], &second[..reach]);
    for (x, value) in values.iter_mut().enumerate() {
        let [a, _, c, _, e] = at(smoothed, x);
        let xx = f64::from(a - 2 * c + e);
        let [_, b, c, d, _] = at(second, x);
        let yy = f64::from(b + 2 * c + d);
        let [a, b, _, d, e] = at(first, x);
        let xy = f64::from(e - a + 2 * (d - b));
        let difference = xx - yy;
        let root = (difference * difference + 0.25 * (xy * xy)).sqrt();
        *value = ((xx + yy).abs() + root) * 0.5 / DIVISOR;
    }
}

/// The magnitude of the Laplacian of a row of column sums.
#[inline(always)]
fn laplacian<S: Simd>(_: S, smoothed: &[i32], second: &[i32], values: &mut [f64]) {
    let reach = values.len() + 2 * RADIUS;
    let (smoothed, second) = (&smoothed[..reach], &second[..reach]);
    for (x, value) in values.iter_mut().enumerate() {
        let xx = smoothed[x] - 2 * smoothed[x + 2] + smoothed[x + 4];
        let yy = second[x + 1] + 2 * second[x + 2] + second[x + 3];
        *value = f64::from((xx + yy).abs()) / DIVISOR;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::density::filter::{Filter, Order};
    use crate::parameters::Target;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_sweep_is_the_filter_to_the_last_bit(
            width in 2usize..40,
            samples in prop::collection::vec(0u16..=u16::MAX, 80..400),
            boundary in prop::sample::select(Boundary::ALL),
        ) {
            let samples = &samples[..samples.len() / width * width];
            let parameters = Parameters { boundary, ..Parameters::default().target(Target::Size(4)) };
            let mut sweep = SecondDerivatives::new(&parameters, samples, width).unwrap();
            let filter = Filter::new(&parameters);
            for significance in [Significance::Mmsodd, Significance::Mol] {
                let (mut found, mut expected) = (vec![0.0; width], vec![0.0; width]);
                filter.for_each_row(samples, width, Order::Second, |y, row| {
                    significance.evaluate(row, filter.divisor(), &mut expected);
                    sweep.evaluate(significance, y, &mut found);
                    assert_eq!(found, expected);
                    Ok(())
                }).unwrap();
            }
        }
    }

    #[test]
    fn other_filters_are_left_to_themselves() {
        let samples = [0; 9];
        let parameters = Parameters::default().target(Target::Size(4));
        assert!(SecondDerivatives::new(&parameters, &samples, 3).is_some());
        for other in [
            Parameters { smoothing_order: 5, ..parameters.clone() },
            Parameters { smoothing: Smoothing::Mean, ..parameters.clone() },
            Parameters { double_convolution: true, ..parameters.clone() },
            Parameters { smoothing_direction: SmoothingDirection::Orthogonal, ..parameters },
        ] {
            assert!(SecondDerivatives::new(&other, &samples, 3).is_none());
        }
    }
}
