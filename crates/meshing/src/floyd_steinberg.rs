//! The diffusion of one row: Robert W. Floyd and Louis Steinberg, "An adaptive algorithm for spatial
//! greyscale", 1976.
//!
//! Each point waits for the one before, some nanoseconds whatever the width of the machine's
//! vectors, so rows are diffused for several thresholds at once, side by side in the lanes of a
//! vector: eight take little longer than one. All lanes do the same operations in the same order
//! as a single number does, so the results are the same to the last bit.

use std::ops::{Add, Mul};
use wide::f64x8;

/// A number for each of several thresholds.
pub(crate) trait Numbers: Copy + Add<Output = Self> + Mul<Output = Self> {
    /// The same number for every threshold.
    fn splat(number: f64) -> Self;

    /// Chooses the point, by one bit for each threshold, or not, and returns the error that leaves.
    fn decide(self, threshold: Self, chosen: &mut u8) -> Self;
}

impl Numbers for f64 {
    #[inline]
    fn splat(number: f64) -> Self {
        number
    }

    #[inline]
    fn decide(self, threshold: Self, chosen: &mut u8) -> Self {
        if self >= threshold {
            *chosen |= 1;
            self - 2.0 * threshold
        } else {
            self
        }
    }
}

impl Numbers for f64x8 {
    #[inline]
    fn splat(number: f64) -> Self {
        Self::splat(number)
    }

    #[inline]
    fn decide(self, threshold: Self, chosen: &mut u8) -> Self {
        let is_chosen = self.simd_ge(threshold);
        *chosen |= is_chosen.to_bitmask() as u8;
        self - (is_chosen & (threshold + threshold))
    }
}

/// The shares of a point's error that go to its neighbours.
#[derive(Clone, Copy)]
struct Shares {
    /// To the next point of the row.
    ahead: f64,
    /// To the point above the previous one.
    above_behind: f64,
    /// To the point above.
    above: f64,
    /// To the point above the next one.
    above_ahead: f64,
}

/// The shares for each kind of place in a row.
pub(crate) struct Weights {
    /// First point of a row: nothing behind it.
    first: Shares,
    inner: Shares,
    /// Last point of a row: nothing ahead of it.
    last: Shares,
    /// To the next point of the topmost row.
    ahead_in_last_row: f64,
}

/// The shares inside the picture.
const FLOYD_STEINBERG: Shares = Shares {
    ahead: 7.0 / 16.0,
    above_behind: 3.0 / 16.0,
    above: 5.0 / 16.0,
    above_ahead: 1.0 / 16.0,
};

impl Weights {
    /// The shares that lose the error without a neighbour, or hand it to the others.
    pub(crate) fn new(leaky: bool) -> Self {
        let inner = FLOYD_STEINBERG;
        if leaky {
            return Self { first: inner, inner, last: inner, ahead_in_last_row: inner.ahead };
        }
        let first = Shares {
            ahead: 7.0 / 13.0,
            above_behind: 0.0,
            above: 5.0 / 13.0,
            above_ahead: 1.0 / 13.0,
        };
        let last =
            Shares { ahead: 0.0, above_behind: 3.0 / 8.0, above: 5.0 / 8.0, above_ahead: 0.0 };
        Self { first, inner, last, ahead_in_last_row: 1.0 }
    }

    /// Diffuses a row of at least two points into itself and the row above, marking chosen points.
    ///
    /// `row` holds the densities of its points with the errors from below; `above` gets those of
    /// the next row, whose densities are `densities_above`. A point of that row receives from the
    /// one below and both its neighbours, in the order of the scan: its sum stays in registers
    /// until the last of them has added its share.
    pub(crate) fn diffuse_row<N: Numbers>(
        &self,
        row: &[N],
        densities_above: &[f64],
        above: &mut [N],
        threshold: N,
        rightwards: bool,
        chosen: &mut [u8],
    ) {
        let last = row.len() - 1;
        let place = |step: usize| if rightwards { step } else { last - step };
        let density_above = |step: usize| N::splat(densities_above[place(step)]);

        let error = row[place(0)].decide(threshold, &mut chosen[place(0)]);
        let mut ahead = error * N::splat(self.first.ahead);
        let mut above_behind = density_above(0) + error * N::splat(self.first.above);
        let mut above_this = density_above(1) + error * N::splat(self.first.above_ahead);

        let share = |share: f64| N::splat(share);
        let Shares { ahead: a, above_behind: b, above: c, above_ahead: d } = self.inner;
        let [a, b, c, d] = [a, b, c, d].map(share);
        for step in 1..last {
            let x = place(step);
            let error = (row[x] + ahead).decide(threshold, &mut chosen[x]);
            ahead = error * a;
            above[place(step - 1)] = above_behind + error * b;
            above_behind = above_this + error * c;
            above_this = density_above(step + 1) + error * d;
        }

        let x = place(last);
        let error = (row[x] + ahead).decide(threshold, &mut chosen[x]);
        above[place(last - 1)] = above_behind + error * N::splat(self.last.above_behind);
        above[x] = above_this + error * N::splat(self.last.above);
    }

    /// Diffuses the topmost row into itself, marking chosen points.
    pub(crate) fn diffuse_last_row<N: Numbers>(
        &self,
        row: &[N],
        threshold: N,
        rightwards: bool,
        chosen: &mut [u8],
    ) {
        let last = row.len() - 1;
        let mut ahead = N::splat(0.0);
        for step in 0..=last {
            let x = if rightwards { step } else { last - step };
            let error = (row[x] + ahead).decide(threshold, &mut chosen[x]);
            ahead = error * N::splat(self.ahead_in_last_row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lane_is_as_a_single_number() {
        let thresholds = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9];
        let density: Vec<f64> = (0..90).map(|i| f64::from(i * i % 37) / 37.0).collect();
        for (leaky, rightwards) in [(false, true), (false, false), (true, true), (true, false)] {
            let weights = Weights::new(leaky);
            let row: Vec<f64x8> = density[..45].iter().map(|&d| f64x8::splat(d)).collect();
            let (densities_above, mut above) = (&density[45..], vec![f64x8::ZERO; 45]);
            let (mut chosen, mut chosen_above) = (vec![0; 45], vec![0; 45]);
            weights.diffuse_row(
                &row,
                densities_above,
                &mut above,
                thresholds.into(),
                rightwards,
                &mut chosen,
            );
            weights.diffuse_last_row(&above, thresholds.into(), !rightwards, &mut chosen_above);
            for (lane, &threshold) in thresholds.iter().enumerate() {
                let mut one_above = vec![0.0; 45];
                let (mut one, mut last) = (vec![0; 45], vec![0; 45]);
                weights.diffuse_row(
                    &density[..45],
                    densities_above,
                    &mut one_above,
                    threshold,
                    rightwards,
                    &mut one,
                );
                weights.diffuse_last_row(&one_above, threshold, !rightwards, &mut last);
                for x in 0..45 {
                    assert_eq!(above[x].to_array()[lane], one_above[x]);
                    assert_eq!(chosen[x] >> lane & 1, one[x]);
                    assert_eq!(chosen_above[x] >> lane & 1, last[x]);
                }
            }
        }
    }
}
