//! The significance of lattice points: differential operators of the smoothed image.

use crate::parameters::choices::PscTie;

/// Filtered values of one row, `width` each, in units of `1 / divisor`.
#[derive(Clone, Debug, Default)]
pub(crate) struct DerivativeRow {
    /// Second derivative in x, or twice the first derivative in x.
    pub(crate) xx: Vec<f64>,
    /// Second derivative in y, or twice the first derivative in y.
    pub(crate) yy: Vec<f64>,
    /// Four times the mixed derivative; empty beside first derivatives.
    pub(crate) xy: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Significance {
    Mmsodd,
    Mol,
}

impl Significance {
    pub(crate) fn evaluate(self, row: &DerivativeRow, divisor: f64, values: &mut [f64]) {
        let derivatives = row.xx.iter().zip(&row.yy).zip(&row.xy);
        for (value, ((&xx, &yy), &xy)) in values.iter_mut().zip(derivatives) {
            *value = match self {
                Self::Mmsodd => mmsodd(xx, yy, xy) / divisor,
                Self::Mol => laplacian(xx, yy, xy) / divisor,
            };
        }
    }
}

/// The maximum-magnitude second-order directional derivative, `|a| + b` with `a = (xx + yy) / 2`
/// and `b = sqrt((xx - yy)^2 / 4 + m^2)`, where `xy` is four times the mixed derivative `m`.
///
/// With a binomial kernel everything under the root is exact, so only the root and the sum are
/// rounded, once each, whatever the order of the operations.
#[inline(always)]
pub(crate) fn mmsodd(xx: f64, yy: f64, xy: f64) -> f64 {
    let difference = xx - yy;
    ((xx + yy).abs() + (difference * difference + 0.25 * (xy * xy)).sqrt()) * 0.5
}

#[inline(always)]
pub(crate) fn laplacian(xx: f64, yy: f64, _: f64) -> f64 {
    (xx + yy).abs()
}

/// The sum over components of their gradients' outer products: `xx`, `yy` and `xy`.
pub(crate) type GradientTensor = [f64; 3];

pub(crate) fn add_gradients(row: &DerivativeRow, tensors: &mut [GradientTensor]) {
    for ([xx, yy, xy], (&fx, &fy)) in tensors.iter_mut().zip(row.xx.iter().zip(&row.yy)) {
        *xx += fx * fx;
        *yy += fy * fy;
        *xy += fx * fy;
    }
}

/// The length of the gradient of several components taken as one vector field.
///
/// Silvano Di Zenzo, "A note on the gradient of a multi-image", 1986: the square root of the larger
/// eigenvalue of the tensor `[xx xy; xy yy]`. `tie` says whether to ignore `xy` where `xx = yy`.
pub(crate) fn vector_gradient([xx, yy, xy]: GradientTensor, tie: PscTie) -> f64 {
    let difference = xx - yy;
    let spread = if difference == 0.0 && tie == PscTie::Published {
        0.0
    } else {
        (difference * difference + 4.0 * (xy * xy)).sqrt()
    };
    ((xx + yy + spread) * 0.5).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mmsodd_is_the_largest_directional_derivative() {
        for (fxx, fyy, fxy) in
            [(3.0, -1.0, 0.5), (-4.0, -4.0, 2.0), (0.0, 0.0, 1.0), (5.0, 1.0, 0.0)]
        {
            let directional = |degree: u32| {
                let angle = f64::from(degree).to_radians();
                let (sin, cos) = angle.sin_cos();
                (cos * cos * fxx + 2.0 * sin * cos * fxy + sin * sin * fyy).abs()
            };
            let brute = (0..180).map(directional).fold(0.0, f64::max);
            assert!((mmsodd(fxx, fyy, 4.0 * fxy) - brute).abs() < 1e-3);
        }
    }

    #[test]
    fn vector_gradient_of_equal_rates_follows_the_tie() {
        assert_eq!(vector_gradient([4.0, 4.0, 4.0], PscTie::Published), 2.0);
        assert_eq!(vector_gradient([4.0, 4.0, 4.0], PscTie::Exact), 8f64.sqrt());
        for tie in [PscTie::Published, PscTie::Exact] {
            assert_eq!(vector_gradient([4.0, 0.0, 0.0], tie), 2.0);
        }
    }
}
