//! How much each lattice point matters: local differential operators of the smoothed picture.

use crate::control::{Cancelled, Control, Stage};
use crate::density::filter::{DerivativeRow, Filter, Order};
use crate::parameters::choices::PscTie;

/// A second-order operator on one component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Significance {
    /// Maximum-magnitude second-order directional derivative: with
    /// `a = (fxx + fyy) / 2` and `b = sqrt((fxx - fyy)^2 / 4 + fxy^2)` it is `|a| + b`.
    Mmsodd,
    /// Magnitude of the Laplacian, `|fxx + fyy|`.
    Mol,
}

impl Significance {
    /// The operator on one row of derivatives, written to `values`.
    pub(crate) fn evaluate(self, row: &DerivativeRow, divisor: f64, values: &mut [f64]) {
        let derivatives = row.xx.iter().zip(&row.yy).zip(&row.xy);
        for (value, ((&xx, &yy), &xy)) in values.iter_mut().zip(derivatives) {
            *value = match self {
                Self::Mmsodd => mmsodd(xx, yy, xy) / divisor,
                Self::Mol => (xx + yy).abs() / divisor,
            };
        }
    }
}

/// MMSODD of derivatives as the filter gives them: `xy` is four times the mixed derivative.
///
/// With a binomial kernel everything under the root is exact, so one rounding of the root and one
/// of the sum are all there are, whatever the order of the operations.
#[inline]
fn mmsodd(xx: f64, yy: f64, xy: f64) -> f64 {
    let difference = xx - yy;
    ((xx + yy).abs() + (difference * difference + 0.25 * (xy * xy)).sqrt()) * 0.5
}

/// The gradient of three or more components taken as one vector field, for every lattice point.
///
/// Silvano Di Zenzo, "A note on the gradient of a multi-image", 1986: the square root of the
/// larger eigenvalue of the sum over components of the gradients' outer products. Where
/// `gxx = gyy` the thesis's published results ignore `gxy`; `tie` tells whether to do so.
pub(crate) fn vector_gradient(
    filter: &Filter,
    components: &[Vec<u16>],
    width: usize,
    tie: PscTie,
    control: &dyn Control,
) -> Result<Vec<f64>, Cancelled> {
    let (mut tensors, height) =
        (vec![[0.0f64; 3]; components[0].len()], components[0].len() / width);
    for (c, component) in components.iter().enumerate() {
        filter.for_each_row(component, width, Order::First, |y, row| {
            poll_row(control, c * height + y, components.len() * height)?;
            let gradients = row.xx.iter().zip(&row.yy);
            for ([gxx, gyy, gxy], (&fx, &fy)) in tensors[y * width..].iter_mut().zip(gradients) {
                *gxx += fx * fx;
                *gyy += fy * fy;
                *gxy += fx * fy;
            }
            Ok(())
        })?;
    }
    // The filter's first derivatives are doubled.
    let divisor = 2.0 * filter.divisor();
    Ok(tensors.iter().map(|&tensor| larger_rate_of_change(tensor, tie) / divisor).collect())
}

/// Rows between two polls of the control.
const ROWS_PER_POLL: usize = 32;

/// Polls the control at the first of every few rows of all components.
pub(crate) fn poll_row(control: &dyn Control, row: usize, rows: usize) -> Result<(), Cancelled> {
    if row.is_multiple_of(ROWS_PER_POLL) { control.poll(Stage::Density, row, rows) } else { Ok(()) }
}

/// Square root of the larger eigenvalue of `[gxx gxy; gxy gyy]`.
fn larger_rate_of_change([gxx, gyy, gxy]: [f64; 3], tie: PscTie) -> f64 {
    let difference = gxx - gyy;
    let spread = if difference == 0.0 && tie == PscTie::Published {
        0.0
    } else {
        (difference * difference + 4.0 * (gxy * gxy)).sqrt()
    };
    ((gxx + gyy + spread) * 0.5).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mmsodd_is_the_larger_of_both_extreme_directional_derivatives() {
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
    fn the_vector_gradient_of_equal_rates_ignores_the_mixed_term_unless_told() {
        assert_eq!(larger_rate_of_change([4.0, 4.0, 4.0], PscTie::Published), 2.0);
        assert_eq!(larger_rate_of_change([4.0, 4.0, 4.0], PscTie::Exact), 8f64.sqrt());
        for tie in [PscTie::Published, PscTie::Exact] {
            assert_eq!(larger_rate_of_change([4.0, 0.0, 0.0], tie), 2.0);
        }
    }
}
