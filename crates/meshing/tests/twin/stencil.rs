//! Extension, smoothing and differentiation as one explicit sum over a two-dimensional stencil.

use pixmesh_meshing::{Boundary, Parameters, Smoothing};

/// Weights around a centre, `weights[i] / divisor` for the offset `i - weights.len() / 2`.
struct Kernel {
    weights: Vec<i128>,
    divisor: i128,
}

/// The derivatives of a smoothed component at one point, each times [`Stencils::divisor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Derivatives {
    pub(crate) fxx: i128,
    pub(crate) fyy: i128,
    pub(crate) fxy: i128,
    pub(crate) fx: i128,
    pub(crate) fy: i128,
}

/// The filters that a set of parameters asks for.
pub(crate) struct Stencils {
    boundary: Boundary,
    smooth: Kernel,
    first: Kernel,
    second: Kernel,
    /// What every value of [`Derivatives`] is a multiple of the inverse of.
    pub(crate) divisor: i128,
}

/// One component of `width` columns, row 0 at the bottom.
#[derive(Clone, Copy)]
pub(crate) struct Plane<'a> {
    pub(crate) samples: &'a [u16],
    pub(crate) width: usize,
}

impl Kernel {
    fn smoothing(kind: Smoothing, order: usize) -> Self {
        let weights = match kind {
            Smoothing::Binomial => pascal_row(order),
            Smoothing::Mean => vec![1; order],
        };
        let divisor = weights.iter().sum();
        Self { weights, divisor }
    }

    /// The kernel that does what `self` and then `other` do.
    fn then(&self, other: &[i128], divisor: i128) -> Self {
        let mut weights = vec![0; self.weights.len() + other.len() - 1];
        for (i, a) in self.weights.iter().enumerate() {
            for (j, b) in other.iter().enumerate() {
                weights[i + j] += a * b;
            }
        }
        Self { weights, divisor: self.divisor * divisor }
    }

    /// The weights with the offsets they belong to.
    fn offsets(&self) -> impl Iterator<Item = (i64, i128)> {
        let radius = (self.weights.len() / 2) as i64;
        self.weights.iter().enumerate().map(move |(i, &weight)| (i as i64 - radius, weight))
    }
}

impl Stencils {
    pub(crate) fn new(parameters: &Parameters) -> Self {
        let smooth = Kernel::smoothing(parameters.smoothing, parameters.smoothing_order);
        let first = smooth.then(&[-1, 0, 1], 2);
        let second = smooth.then(&[1, -2, 1], 1);
        let divisor = first.divisor * first.divisor;
        Self { boundary: parameters.boundary, smooth, first, second, divisor }
    }

    /// Every derivative at every point, row by row from the bottom.
    pub(crate) fn derivatives(&self, plane: Plane<'_>) -> Vec<Derivatives> {
        let (smooth, first, second) = (&self.smooth, &self.first, &self.second);
        let at = |place: usize| {
            let (x, y) = ((place % plane.width) as i64, (place / plane.width) as i64);
            let sum = |in_x, in_y| self.sum(plane, in_x, in_y, x, y);
            Derivatives {
                fxx: sum(second, smooth),
                fyy: sum(smooth, second),
                fxy: sum(first, first),
                fx: sum(first, smooth),
                fy: sum(smooth, first),
            }
        };
        (0..plane.samples.len()).map(at).collect()
    }

    /// The weighted sum of the extended component around `(x, y)`, times [`Self::divisor`].
    fn sum(&self, plane: Plane<'_>, in_x: &Kernel, in_y: &Kernel, x: i64, y: i64) -> i128 {
        let mut sum = 0;
        for (dy, wy) in in_y.offsets() {
            for (dx, wx) in in_x.offsets() {
                sum += wx * wy * plane.extended(x + dx, y + dy, self.boundary);
            }
        }
        sum * (self.divisor / (in_x.divisor * in_y.divisor))
    }
}

impl Plane<'_> {
    /// The component's sample, or what stands for it beyond the border.
    fn extended(self, x: i64, y: i64, boundary: Boundary) -> i128 {
        let (width, height) = (self.width as i64, (self.samples.len() / self.width) as i64);
        let place = match boundary {
            Boundary::Zero if x < 0 || y < 0 || x >= width || y >= height => return 0,
            Boundary::Zero => (x, y),
            Boundary::Constant => (x.clamp(0, width - 1), y.clamp(0, height - 1)),
            Boundary::Symmetric => (mirrored(x, width), mirrored(y, height)),
        };
        i128::from(self.samples[(place.1 * width + place.0) as usize])
    }
}

/// The place inside `0..side` that `x` is the mirror image of, as often as it takes.
fn mirrored(mut x: i64, side: i64) -> i64 {
    loop {
        if x < 0 {
            x = -x;
        } else if x >= side {
            x = 2 * (side - 1) - x;
        } else {
            return x;
        }
    }
}

/// The binomial coefficients of `(a + b)^(order - 1)`.
fn pascal_row(order: usize) -> Vec<i128> {
    let mut row = vec![1];
    for _ in 1..order {
        let shifted = row.iter().skip(1).chain([&0]);
        let sums: Vec<i128> = row.iter().zip(shifted).map(|(a, b)| a + b).collect();
        row.truncate(1);
        row.extend(sums);
    }
    row
}
