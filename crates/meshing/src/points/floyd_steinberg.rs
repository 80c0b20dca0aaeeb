//! The diffusion of one row: Robert W. Floyd and Louis Steinberg, "An adaptive algorithm for spatial
//! greyscale", 1976.
//!
//! Each point waits for the one before, some nanoseconds whatever the width of the machine's
//! vectors, so rows are diffused for several thresholds at once, side by side in the lanes of
//! vectors: fifteen take little longer than one. All lanes do the same operations in the same order
//! as a single number does, so the results are the same to the last bit. To make the wait shorter
//! both outcomes of a decision are computed while it is taken.

use fearless_simd::{Simd, f64x8, mask64x8, prelude::*};

/// A number for each of several thresholds.
pub(crate) trait Numbers: Copy {
    /// What makes them.
    type Maker: Copy;

    /// The same numbers in memory.
    type Stored: Copy;

    fn maker(self) -> Self::Maker;

    /// The same number for every threshold.
    fn splat(maker: Self::Maker, number: f64) -> Self;

    fn load(maker: Self::Maker, stored: &Self::Stored) -> Self;

    fn store(self, stored: &mut Self::Stored);

    fn plus(self, other: Self) -> Self;

    fn times(self, factor: Self) -> Self;

    /// `self - other`
    fn less(self, other: Self) -> Self;

    /// Takes of two pairs of numbers, for each threshold, the second where `self` reaches the
    /// threshold, and the first elsewhere; one bit for each threshold tells which.
    fn choose(self, threshold: Self, pairs: [[Self; 2]; 2]) -> ([Self; 2], u16);
}

impl Numbers for f64 {
    type Maker = ();
    type Stored = Self;

    #[inline(always)]
    fn maker(self) {}

    #[inline(always)]
    fn splat((): (), number: f64) -> Self {
        number
    }

    #[inline(always)]
    fn load((): (), stored: &f64) -> Self {
        *stored
    }

    #[inline(always)]
    fn store(self, stored: &mut f64) {
        *stored = self;
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn times(self, factor: Self) -> Self {
        self * factor
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn choose(self, threshold: Self, pairs: [[Self; 2]; 2]) -> ([Self; 2], u16) {
        let is_chosen = self >= threshold;
        (pairs.map(|[below, reached]| if is_chosen { reached } else { below }), is_chosen.into())
    }
}

/// Numbers for eight thresholds in each of `N` vectors.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd, const N: usize>([f64x8<S>; N]);

impl<S: Simd, const N: usize> Numbers for Lanes<S, N> {
    type Maker = S;
    type Stored = [[f64; 8]; N];

    #[inline(always)]
    fn maker(self) -> S {
        self.0[0].token()
    }

    #[inline(always)]
    fn splat(simd: S, number: f64) -> Self {
        Self([f64x8::splat(simd, number); N])
    }

    #[inline(always)]
    fn load(simd: S, stored: &Self::Stored) -> Self {
        let mut lanes = [f64x8::splat(simd, 0.0); N];
        for (vector, stored) in lanes.iter_mut().zip(stored) {
            *vector = f64x8::from_slice(simd, stored);
        }
        Self(lanes)
    }

    #[inline(always)]
    fn store(self, stored: &mut Self::Stored) {
        for (vector, stored) in self.0.iter().zip(stored) {
            vector.store_slice(stored);
        }
    }

    #[inline(always)]
    fn plus(mut self, other: Self) -> Self {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a += b;
        }
        self
    }

    #[inline(always)]
    fn times(mut self, factor: Self) -> Self {
        for (a, b) in self.0.iter_mut().zip(factor.0) {
            *a *= b;
        }
        self
    }

    #[inline(always)]
    fn less(mut self, other: Self) -> Self {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a -= b;
        }
        self
    }

    #[inline(always)]
    fn choose(self, threshold: Self, pairs: [[Self; 2]; 2]) -> ([Self; 2], u16) {
        let [[mut first, first_reached], [mut second, second_reached]] = pairs;
        let mut chosen = 0;
        for i in 0..N {
            let is_chosen: mask64x8<S> = self.0[i].simd_ge(threshold.0[i]);
            first.0[i] = is_chosen.select(first_reached.0[i], first.0[i]);
            second.0[i] = is_chosen.select(second_reached.0[i], second.0[i]);
            chosen |= (is_chosen.to_bitmask() as u16) << (8 * i);
        }
        ([first, second], chosen)
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
    #[inline(always)]
    pub(crate) fn diffuse_row<N: Numbers>(
        &self,
        row: &[N::Stored],
        densities_above: &[f64],
        above: &mut [N::Stored],
        threshold: N,
        rightwards: bool,
        chosen: &mut [u16],
    ) {
        let (last, maker) = (row.len() - 1, threshold.maker());
        // All of one length, so that one check of a place serves for all.
        let (densities_above, above) = (&densities_above[..=last], &mut above[..=last]);
        let chosen = &mut chosen[..=last];
        let place = |step: usize| if rightwards { step } else { last - step };
        let density_above = |step: usize| N::splat(maker, densities_above[place(step)]);
        let share = |share: f64| N::splat(maker, share);
        let weight = threshold.plus(threshold);

        let value = N::load(maker, &row[place(0)]);
        let mut next = N::load(maker, &row[place(1)]);
        let ahead = share(self.first.ahead);
        let (error, mut value) =
            decide(value, next, ahead, threshold, weight, &mut chosen[place(0)]);
        let mut above_behind = density_above(0).plus(error.times(share(self.first.above)));
        let mut above_this = density_above(1).plus(error.times(share(self.first.above_ahead)));

        let Shares { ahead, above_behind: b, above: c, above_ahead: d } = self.inner;
        let [ahead, b, c, d] = [ahead, b, c, d].map(share);
        for step in 1..last {
            let x = place(step);
            next = N::load(maker, &row[place(step + 1)]);
            let error;
            (error, value) = decide(value, next, ahead, threshold, weight, &mut chosen[x]);
            above_behind.plus(error.times(b)).store(&mut above[place(step - 1)]);
            above_behind = above_this.plus(error.times(c));
            above_this = density_above(step + 1).plus(error.times(d));
        }

        let x = place(last);
        let (error, _) = decide(value, next, ahead, threshold, weight, &mut chosen[x]);
        let behind = error.times(share(self.last.above_behind));
        above_behind.plus(behind).store(&mut above[place(last - 1)]);
        above_this.plus(error.times(share(self.last.above))).store(&mut above[x]);
    }

    /// Diffuses the topmost row into itself, marking chosen points.
    #[inline(always)]
    pub(crate) fn diffuse_last_row<N: Numbers>(
        &self,
        row: &[N::Stored],
        threshold: N,
        rightwards: bool,
        chosen: &mut [u16],
    ) {
        let (last, maker) = (row.len() - 1, threshold.maker());
        let place = |step: usize| if rightwards { step } else { last - step };
        let (weight, ahead) = (threshold.plus(threshold), N::splat(maker, self.ahead_in_last_row));
        let mut value = N::load(maker, &row[place(0)]);
        for step in 0..=last {
            let next = N::load(maker, &row[place((step + 1).min(last))]);
            (_, value) = decide(value, next, ahead, threshold, weight, &mut chosen[place(step)]);
        }
    }
}

/// Chooses a point of this value, which takes `weight` from it, or not; returns the error that
/// leaves, and the value of the next point, whose share of the error is `ahead`.
#[inline(always)]
fn decide<N: Numbers>(
    value: N,
    next: N,
    ahead: N,
    threshold: N,
    weight: N,
    chosen: &mut u16,
) -> (N, N) {
    let error_if_chosen = value.less(weight);
    let next_if = |error: N| next.plus(error.times(ahead));
    let errors = [value, error_if_chosen];
    let nexts = [next_if(value), next_if(error_if_chosen)];
    let ([error, next], bits) = value.choose(threshold, [errors, nexts]);
    *chosen |= bits;
    (error, next)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    #[test]
    fn a_number_that_reaches_the_threshold_exactly_is_chosen() {
        let pairs = [[1.0, 2.0], [3.0, 4.0]];
        for (number, chosen) in [(0.25, ([2.0, 4.0], 1)), (0.25_f64.next_down(), ([1.0, 3.0], 0))] {
            assert_eq!(number.choose(0.25, pairs), chosen);
            dispatch!(Level::new(), simd => {
                let of = |number| Lanes::<_, 1>::splat(simd, number);
                let (lanes, bits) = of(number).choose(of(0.25), pairs.map(|pair| pair.map(of)));
                for (lane, expected) in lanes.into_iter().zip(chosen.0) {
                    let mut stored = [[0.0; 8]];
                    lane.store(&mut stored);
                    assert_eq!(stored, [[expected; 8]]);
                }
                assert_eq!(bits, 0xff * chosen.1);
            });
        }
    }

    #[test]
    fn every_lane_is_as_a_single_number() {
        for (leaky, rightwards) in [(false, true), (false, false), (true, true), (true, false)] {
            let weights = Weights::new(leaky);
            let level = Level::new();
            dispatch!(level, simd => assert_lanes_agree::<_, 1>(simd, &weights, rightwards));
            dispatch!(level, simd => assert_lanes_agree::<_, 2>(simd, &weights, rightwards));
        }
    }

    /// Diffuses two rows of 45 points for `8 N` thresholds together, and for each on its own.
    #[inline(always)]
    fn assert_lanes_agree<S: Simd, const N: usize>(simd: S, weights: &Weights, rightwards: bool) {
        let thresholds: [[f64; 8]; N] =
            std::array::from_fn(|i| std::array::from_fn(|j| 0.03 + 0.06 * (8 * i + j) as f64));
        let density: Vec<f64> = (0..90).map(|i| f64::from(i * i % 37) / 37.0).collect();
        let row: Vec<[[f64; 8]; N]> = density[..45].iter().map(|&d| [[d; 8]; N]).collect();
        let mut above = vec![[[0.0; 8]; N]; 45];
        let mut chosen = [vec![0; 45], vec![0; 45]];
        let several = Lanes::load(simd, &thresholds);
        let [first, second] = &mut chosen;
        let next = &density[45..];
        weights.diffuse_row(&row, next, &mut above, several, rightwards, first);
        weights.diffuse_last_row(&above, several, !rightwards, second);
        for (lane, &threshold) in thresholds.as_flattened().iter().enumerate() {
            let mut one_above = vec![0.0; 45];
            let [mut one, mut last] = [vec![0; 45], vec![0; 45]];
            let row = &density[..45];
            weights.diffuse_row(row, next, &mut one_above, threshold, rightwards, &mut one);
            weights.diffuse_last_row(&one_above, threshold, !rightwards, &mut last);
            for x in 0..45 {
                assert_eq!(above[x].as_flattened()[lane], one_above[x]);
                assert_eq!(chosen[0][x] >> lane & 1, one[x]);
                assert_eq!(chosen[1][x] >> lane & 1, last[x]);
            }
        }
    }
}
