//! Extension, smoothing and differentiation as one explicit sum over a two-dimensional stencil, or
//! as two with the picture cropped in between.

use pixmesh_meshing::Parameters;
use pixmesh_meshing::parameters::{Boundary, Smoothing, SmoothingDirection};

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
    smoothing_boundary: Boundary,
    double_convolution: bool,
    /// The smoothing kernel, for the direction across a derivative's own.
    across: Kernel,
    /// The same for the derivative's own direction.
    along: Kernel,
    /// What every value of [`Derivatives`] is a multiple of the inverse of.
    pub(crate) divisor: i128,
}

/// One component of `width` columns, row 0 at the bottom.
pub(crate) struct Plane {
    samples: Vec<i128>,
    width: usize,
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
        let across = Kernel::smoothing(parameters.smoothing, parameters.smoothing_order);
        let along = match parameters.smoothing_direction {
            SmoothingDirection::Both => {
                Kernel::smoothing(parameters.smoothing, parameters.smoothing_order)
            }
            SmoothingDirection::Orthogonal => Kernel { weights: vec![1], divisor: 1 },
        };
        Self {
            boundary: parameters.boundary,
            smoothing_boundary: parameters.smoothing_boundary,
            double_convolution: parameters.double_convolution,
            divisor: 4 * across.divisor * across.divisor,
            across,
            along,
        }
    }

    /// Every derivative at every point, row by row from the bottom.
    pub(crate) fn derivatives(&self, plane: &Plane) -> Vec<Derivatives> {
        let (across, along) = (&self.across, &self.along);
        let (none, first, second): (&[i128], &[i128], &[i128]) = (&[1], &[-1, 0, 1], &[1, -2, 1]);
        let fxx = self.derivative(plane, (along, across), (second, 1), (none, 1));
        let fyy = self.derivative(plane, (across, along), (none, 1), (second, 1));
        let fxy = self.derivative(plane, (along, along), (first, 2), (first, 2));
        let fx = self.derivative(plane, (along, across), (first, 2), (none, 1));
        let fy = self.derivative(plane, (across, along), (none, 1), (first, 2));
        let at =
            |i: usize| Derivatives { fxx: fxx[i], fyy: fyy[i], fxy: fxy[i], fx: fx[i], fy: fy[i] };
        (0..plane.samples.len()).map(at).collect()
    }

    /// One derivative everywhere, times [`Self::divisor`]: smoothing kernels in x and y, then
    /// difference kernels with their divisors in x and y.
    fn derivative(
        &self,
        plane: &Plane,
        (smooth_x, smooth_y): (&Kernel, &Kernel),
        (x, x_divisor): (&[i128], i128),
        (y, y_divisor): (&[i128], i128),
    ) -> Vec<i128> {
        let divisor = smooth_x.divisor * smooth_y.divisor * x_divisor * y_divisor;
        let sums = if self.double_convolution {
            let unit = Kernel { weights: vec![1], divisor: 1 };
            let smoothed = plane.filtered(smooth_x, smooth_y, self.smoothing_boundary);
            let (x, y) = (unit.then(x, 1), unit.then(y, 1));
            smoothed.filtered(&x, &y, self.boundary)
        } else {
            plane.filtered(&smooth_x.then(x, 1), &smooth_y.then(y, 1), self.boundary)
        };
        sums.samples.iter().map(|sum| sum * (self.divisor / divisor)).collect()
    }
}

impl Plane {
    pub(crate) fn new(samples: &[u16], width: usize) -> Self {
        Self { samples: samples.iter().map(|&sample| sample.into()).collect(), width }
    }

    /// The weighted sums of the extended component around each point, undivided.
    fn filtered(&self, in_x: &Kernel, in_y: &Kernel, boundary: Boundary) -> Self {
        let sum = |index: usize| {
            let (x, y) = ((index % self.width) as i64, (index / self.width) as i64);
            let mut sum = 0;
            for (dy, wy) in in_y.offsets() {
                for (dx, wx) in in_x.offsets() {
                    sum += wx * wy * self.extended(x + dx, y + dy, boundary);
                }
            }
            sum
        };
        Self { samples: (0..self.samples.len()).map(sum).collect(), width: self.width }
    }

    /// The component's sample, or what stands for it beyond the border.
    fn extended(&self, x: i64, y: i64, boundary: Boundary) -> i128 {
        let (width, height) = (self.width as i64, (self.samples.len() / self.width) as i64);
        let (x, y) = match boundary {
            Boundary::Zero if x < 0 || y < 0 || x >= width || y >= height => return 0,
            Boundary::Zero => (x, y),
            Boundary::Constant => (x.clamp(0, width - 1), y.clamp(0, height - 1)),
            Boundary::Symmetric => (mirrored(x, width), mirrored(y, height)),
        };
        self.samples[(y * width + x) as usize]
    }
}

/// The position inside `0..side` that repeated reflection maps `x` to.
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
