//! The diffusion of one row.
//!
//! Robert W. Floyd and Louis Steinberg, "An adaptive algorithm for spatial greyscale", 1976.
//!
//! Each point depends on the point before it, whatever the width of vectors. So a row is diffused
//! for several thresholds at once, in the lanes of vectors: fifteen take little longer than one.
//! All lanes do the same operations in the same order, so results do not depend on their number.
//! Both outcomes of a decision are computed before it is taken, which shortens the dependence.

use crate::control::{Cancelled, Poller};
use fearless_simd::{Simd, prelude::*};
use std::marker::PhantomData;

/// A number for each of several thresholds, in the lanes of `N` vectors.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S, V, const N: usize>([V; N], PhantomData<S>);

impl<S: Simd, V: SimdFloat<S, Element = f64>, const N: usize> Lanes<S, V, N> {
    #[inline(always)]
    pub(crate) fn new(vectors: [V; N]) -> Self {
        Self(vectors, PhantomData)
    }

    #[inline(always)]
    pub(crate) fn splat(simd: S, number: f64) -> Self {
        Self::new([V::splat(simd, number); N])
    }

    pub(crate) fn first(&self) -> f64 {
        self.0[0].as_slice()[0]
    }

    /// `self + number * factor`, rounded twice.
    #[inline(always)]
    fn plus(mut self, number: Self, factor: V) -> Self {
        for (sum, number) in self.0.iter_mut().zip(number.0) {
            *sum += number * factor;
        }
        self
    }

    /// Chooses a point of this value where it reaches the threshold, and sets its bit of `chosen`;
    /// subtracts twice the threshold from the chosen ones. Returns the error that is left and the
    /// value of the next point, which receives the share `ahead` of the error.
    #[inline(always)]
    fn decide(self, next: Self, ahead: V, thresholds: Self, chosen: &mut u16) -> (Self, Self) {
        let (mut error, mut error_if_chosen) = (self, self);
        for (error, threshold) in error_if_chosen.0.iter_mut().zip(thresholds.0) {
            *error -= threshold + threshold;
        }
        let mut next_value = next.plus(self, ahead);
        let next_if_chosen = next.plus(error_if_chosen, ahead);
        let mut bits = 0;
        for i in 0..N {
            let is_chosen = self.0[i].simd_ge(thresholds.0[i]);
            error.0[i] = is_chosen.select(error_if_chosen.0[i], error.0[i]);
            next_value.0[i] = is_chosen.select(next_if_chosen.0[i], next_value.0[i]);
            bits |= (is_chosen.to_bitmask() as u16) << (V::LEN * i);
        }
        *chosen |= bits;
        (error, next_value)
    }
}

/// The shares of a point's error that its neighbours receive: the next point of the row, and the
/// points above the previous one, the point itself and the next one.
#[derive(Clone, Copy)]
struct Shares {
    ahead: f64,
    above_behind: f64,
    above: f64,
    above_ahead: f64,
}

pub(crate) struct Weights {
    /// Of the first point of a row, which has no point behind it.
    first: Shares,
    inner: Shares,
    /// Of the last point of a row, which has no point ahead of it.
    last: Shares,
    ahead_in_last_row: f64,
}

impl Weights {
    /// The shares that lose the error of missing neighbours (leaky), or that give it to the others.
    pub(crate) fn new(leaky: bool) -> Self {
        let parts = |parts: [f64; 4]| {
            let sum: f64 = parts.iter().sum();
            let [ahead, above_behind, above, above_ahead] = parts.map(|part| part / sum);
            Shares { ahead, above_behind, above, above_ahead }
        };
        let inner = parts([7.0, 3.0, 5.0, 1.0]);
        if leaky {
            return Self { first: inner, inner, last: inner, ahead_in_last_row: inner.ahead };
        }
        let first = parts([7.0, 0.0, 5.0, 1.0]);
        Self { first, inner, last: parts([0.0, 3.0, 5.0, 0.0]), ahead_in_last_row: 1.0 }
    }
}

pub(crate) struct RowDiffusion<'a, L> {
    pub(crate) weights: &'a Weights,
    pub(crate) thresholds: L,
    pub(crate) is_serpentine: bool,
    pub(crate) is_leftwards: bool,
    pub(crate) poller: Poller<'a>,
}

impl<S: Simd, V: SimdFloat<S, Element = f64>, const N: usize> RowDiffusion<'_, Lanes<S, V, N>> {
    #[inline(always)]
    pub(crate) fn start(
        &mut self,
        simd: S,
        values: impl Iterator<Item = f64>,
    ) -> Result<[Vec<Lanes<S, V, N>>; 2], Cancelled> {
        let (mut row, mut above) = (Vec::new(), Vec::new());
        for value in values {
            self.poller.step(1)?;
            row.push(Lanes::splat(simd, value));
            above.push(Lanes::splat(simd, 0.0));
        }
        Ok([row, above])
    }

    /// Diffuses a row into itself and the row above, and marks the chosen points.
    ///
    /// `row` holds the densities of its points plus the errors from below; `above` becomes the same
    /// of the next row, whose densities are `densities_above`. A point of that row receives from
    /// the one below and both its neighbours, in the order of the scan: its sum stays in registers
    /// until the last of them has added its share.
    #[inline(always)]
    pub(crate) fn diffuse(
        &mut self,
        row: &[Lanes<S, V, N>],
        densities_above: &[f64],
        above: &mut [Lanes<S, V, N>],
        chosen: &mut [u16],
    ) -> Result<(), Cancelled> {
        let (last, thresholds, is_leftwards) = (row.len() - 1, self.thresholds, self.is_leftwards);
        self.poller.step(row.len())?;
        self.is_leftwards ^= self.is_serpentine;
        // Slices of one length, so that one bounds check of an index serves for all.
        let (row, densities_above) = (&row[..=last], &densities_above[..=last]);
        let (above, chosen) = (&mut above[..=last], &mut chosen[..=last]);
        let index = |step: usize| if is_leftwards { last - step } else { step };
        let simd = thresholds.0[0].token();
        let density_above = |step: usize| Lanes::splat(simd, densities_above[index(step)]);
        let share = |share: f64| V::splat(simd, share);
        let Weights { first, inner, last: end, .. } = *self.weights;

        let x = index(0);
        let (error, mut value) =
            row[x].decide(row[index(1)], share(first.ahead), thresholds, &mut chosen[x]);
        let mut above_behind = density_above(0).plus(error, share(first.above));
        let mut above_this = density_above(1).plus(error, share(first.above_ahead));

        let [ahead, behind, above_share, above_ahead] =
            [inner.ahead, inner.above_behind, inner.above, inner.above_ahead].map(share);
        for step in 1..last {
            let (x, next) = (index(step), row[index(step + 1)]);
            let error;
            (error, value) = value.decide(next, ahead, thresholds, &mut chosen[x]);
            above[index(step - 1)] = above_behind.plus(error, behind);
            above_behind = above_this.plus(error, above_share);
            above_this = density_above(step + 1).plus(error, above_ahead);
        }

        let x = index(last);
        let (error, _) = value.decide(value, share(end.ahead), thresholds, &mut chosen[x]);
        above[index(last - 1)] = above_behind.plus(error, share(end.above_behind));
        above[x] = above_this.plus(error, share(end.above));
        Ok(())
    }

    #[inline(always)]
    pub(crate) fn diffuse_last(
        &mut self,
        row: &[Lanes<S, V, N>],
        chosen: &mut [u16],
    ) -> Result<(), Cancelled> {
        self.poller.step(row.len())?;
        let (last, thresholds, is_leftwards) = (row.len() - 1, self.thresholds, self.is_leftwards);
        let index = |step: usize| if is_leftwards { last - step } else { step };
        let ahead = V::splat(thresholds.0[0].token(), self.weights.ahead_in_last_row);
        let mut value = row[index(0)];
        for step in 0..=last {
            let next = row[index((step + 1).min(last))];
            (_, value) = value.decide(next, ahead, thresholds, &mut chosen[index(step)]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Stage;
    use fearless_simd::{Level, dispatch, f64x2, f64x8};

    const WIDTH: usize = 45;

    /// The points of two rows that `N` vectors of equal lanes choose, and the errors in the second.
    #[inline(always)]
    fn diffused<S: Simd, V: SimdFloat<S, Element = f64>, const N: usize>(
        simd: S,
        thresholds: [V; N],
        (leaky, is_leftwards): (bool, bool),
    ) -> (Vec<u16>, Vec<Lanes<S, V, N>>) {
        let density: Vec<f64> = (0..2 * WIDTH).map(|i| (i * i % 37) as f64 / 37.0).collect();
        let mut rows = RowDiffusion {
            weights: &Weights::new(leaky),
            thresholds: Lanes::new(thresholds),
            is_serpentine: true,
            is_leftwards,
            poller: Poller::new(&(), Stage::Diffuse, 0, 0),
        };
        let row: Vec<_> = density[..WIDTH].iter().map(|&d| Lanes::splat(simd, d)).collect();
        let (mut above, mut chosen) = (row.clone(), vec![0; 2 * WIDTH]);
        let (first, second) = chosen.split_at_mut(WIDTH);
        rows.diffuse(&row, &density[WIDTH..], &mut above, first).unwrap();
        rows.diffuse_last(&above, second).unwrap();
        (chosen, above)
    }

    #[test]
    fn lanes_equal_single_thresholds() {
        for choices in [(false, true), (false, false), (true, true), (true, false)] {
            dispatch!(Level::new(), simd => {
                let threshold = |i: usize| 0.03 + 0.06 * i as f64;
                let of_eight = |start: usize| std::array::from_fn(|i| threshold(start + i));
                let vectors: [[f64; 8]; 2] = [of_eight(0), of_eight(8)];
                let both = vectors.map(|eight| f64x8::from_slice(simd, &eight));
                let (chosen, above) = diffused(simd, both, choices);
                for lane in 0..16 {
                    let one = [f64x2::splat(simd, threshold(lane))];
                    let (chosen_by_one, above_of_one) = diffused(simd, one, choices);
                    for i in 0..2 * WIDTH {
                        assert_eq!(chosen[i] >> lane & 1, chosen_by_one[i] & 1);
                    }
                    for (lanes, one) in above.iter().zip(&above_of_one) {
                        assert_eq!(lanes.0[lane / 8].as_slice()[lane % 8], one.first());
                    }
                }
            });
        }
    }

    #[test]
    fn values_that_reach_the_threshold_are_chosen() {
        dispatch!(Level::new(), simd => {
            for (value, is_chosen) in [(0.25, true), (0.25_f64.next_down(), false)] {
                let [number, next, threshold] =
                    [value, 1.0, 0.25].map(|v| Lanes::<_, f64x8<_>, 1>::splat(simd, v));
                let mut chosen = 0;
                let half = f64x8::splat(simd, 0.5);
                let (error, next) = number.decide(next, half, threshold, &mut chosen);
                assert_eq!(chosen, if is_chosen { 0xff } else { 0 });
                let expected = if is_chosen { value - 0.5 } else { value };
                assert_eq!((error.first(), next.first()), (expected, 1.0 + 0.5 * expected));
            }
        });
    }
}
