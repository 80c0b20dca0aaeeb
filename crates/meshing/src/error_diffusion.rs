//! Choice of sample points by error diffusion: Floyd and Steinberg's halftoning of a density.
//!
//! Yongyi Yang, Miles N. Wernick and Jovan G. Brankov, "A fast approach for accurate
//! content-adaptive mesh generation", 2003, place mesh nodes where Floyd-Steinberg error diffusion
//! of a feature map exceeds a threshold; the threshold that gives the number of points asked for is
//! found by search. Error that has no neighbour to go to is shared among the others (non-leaky),
//! and the first row may start with the errors of the picture mirrored below it.
//!
//! One pass costs some nanoseconds a lattice point, each operation waiting for the one before;
//! the search takes about ten passes.

use crate::control::{Cancelled, Control, Stage};
use crate::density::Density;
use crate::method::{Parameters, Scan, Startup};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Most thresholds tried before the one with the nearest number of points is taken.
const MAX_TRIES: usize = 60;

/// Rows diffused between two polls of the control.
const ROWS_PER_POLL: usize = 32;

/// How many points more or fewer than asked end the search, for one field and for several.
const TOLERANCE_ONE_FIELD: usize = 10;
const TOLERANCE_UNION: usize = 15;

/// Marks about `size` of a density's lattice points, `1` at each chosen one, row 0 at the bottom.
///
/// The number differs from `size` by at most the parameters' tolerance, where any threshold
/// reaches that. A density of 0 everywhere has no points.
pub(crate) fn diffuse_to_size(
    density: &Density,
    size: usize,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Vec<u8>, Cancelled> {
    let mut diffusion = Diffusion::new(density, size, parameters, control)?;
    if diffusion.sums.iter().all(|&sum| sum == 0.0) {
        return Ok(diffusion.chosen);
    }
    let default = if density.fields.len() == 1 { TOLERANCE_ONE_FIELD } else { TOLERANCE_UNION };
    let tolerance = parameters.tolerance.unwrap_or(default);
    let mut search = ThresholdSearch::new(diffusion.first_threshold(), size);
    for tries in 0..MAX_TRIES {
        diffusion.tries = tries;
        let count = diffusion.run(search.threshold)?;
        if count.abs_diff(size) <= tolerance {
            return Ok(diffusion.chosen);
        }
        search.learn(count);
    }
    diffusion.run(search.nearest.0)?;
    Ok(diffusion.chosen)
}

/// The search for the threshold that chooses a number of points: doubled or halved until the
/// number changes sides, then bisected.
struct ThresholdSearch {
    size: usize,
    threshold: f64,
    /// Largest threshold known to choose too many points.
    too_low: Option<f64>,
    /// Smallest threshold known to choose too few.
    too_high: Option<f64>,
    /// The threshold with the number of points nearest to `size`, and the difference.
    nearest: (f64, usize),
}

impl ThresholdSearch {
    fn new(threshold: f64, size: usize) -> Self {
        let nearest = (threshold, usize::MAX);
        Self { size, threshold, too_low: None, too_high: None, nearest }
    }

    /// Takes in how many points the threshold chose and moves on to the next one.
    fn learn(&mut self, count: usize) {
        let difference = count.abs_diff(self.size);
        if difference < self.nearest.1 {
            self.nearest = (self.threshold, difference);
        }
        if count > self.size {
            self.too_low = Some(self.threshold);
        } else {
            self.too_high = Some(self.threshold);
        }
        self.threshold = match (self.too_low, self.too_high) {
            (Some(low), Some(high)) => 0.5 * (low + high),
            (Some(low), None) => 2.0 * low,
            (None, Some(high)) => 0.5 * high,
            (None, None) => self.threshold,
        };
    }
}

/// What one pass shares with the next: the density, the options and the buffers.
struct Diffusion<'a> {
    density: &'a Density,
    size: usize,
    serpentine: bool,
    weights: Weights,
    /// Sum of each field.
    sums: Vec<f64>,
    /// Errors that row 0 of each field starts with.
    initial_errors: Vec<Vec<f64>>,
    /// 1 for each lattice point chosen by the last pass.
    chosen: Vec<u8>,
    /// The row in work and the one above, with the errors diffused into them.
    rows: [Vec<f64>; 2],
    control: &'a dyn Control,
    /// Thresholds tried before the one in work.
    tries: usize,
}

impl<'a> Diffusion<'a> {
    fn new(
        density: &'a Density,
        size: usize,
        parameters: &Parameters,
        control: &'a dyn Control,
    ) -> Result<Self, Cancelled> {
        let width = density.width;
        let mut diffusion = Self {
            density,
            size,
            serpentine: parameters.scan == Scan::Serpentine,
            weights: Weights::new(parameters.leaky),
            sums: density.fields.iter().map(|field| field.iter().sum()).collect(),
            initial_errors: vec![vec![0.0; width]; density.fields.len()],
            chosen: vec![0; width * density.height],
            rows: [vec![0.0; width], vec![0.0; width]],
            control,
            tries: 0,
        };
        for field in 0..density.fields.len() {
            match parameters.startup {
                Startup::Classic => {}
                Startup::Mirroring => {
                    diffusion.initial_errors[field] = diffusion.mirrored_errors(field)?;
                }
                Startup::Random => {
                    let reach = diffusion.first_threshold();
                    diffusion.initial_errors[field] =
                        random_errors(width, reach, parameters.seed, field as u64);
                }
            }
        }
        Ok(diffusion)
    }

    /// Polls the control at the first of every few rows.
    fn poll(&self, y: usize) -> Result<(), Cancelled> {
        match y % ROWS_PER_POLL {
            0 => self.control.poll(Stage::Diffuse, self.tries, MAX_TRIES),
            _ => Ok(()),
        }
    }

    /// The threshold at which, all density being turned into points of weight `2 threshold`, the
    /// first field that is not 0 everywhere gives the number asked for.
    fn first_threshold(&self) -> f64 {
        let sum = self.sums.iter().find(|&&sum| sum > 0.0);
        sum.copied().unwrap_or_default() / (2.0 * self.size as f64)
    }

    /// The errors that row 0 receives from the picture mirrored at it: rows `height - 1` down to 1
    /// diffused once, each into the next.
    fn mirrored_errors(&mut self, field: usize) -> Result<Vec<f64>, Cancelled> {
        let count = self.density.fields.len() as f64;
        let threshold = count * self.sums[field] / (2.0 * self.size as f64);
        let mut ignored = vec![0; self.density.width];
        let mut rightwards = true;
        let [mut row, mut above] = std::mem::take(&mut self.rows);
        row.copy_from_slice(self.density.row(field, self.density.height - 1));
        for y in (0..self.density.height - 1).rev() {
            self.poll(y)?;
            if y == 0 {
                above.fill(0.0);
            } else {
                above.copy_from_slice(self.density.row(field, y));
            }
            self.weights.diffuse_row(&mut row, &mut above, threshold, rightwards, &mut ignored);
            std::mem::swap(&mut row, &mut above);
            rightwards ^= self.serpentine;
        }
        let errors = row.clone();
        self.rows = [row, above];
        Ok(errors)
    }

    /// One pass over every field; returns how many points were chosen.
    fn run(&mut self, threshold: f64) -> Result<usize, Cancelled> {
        self.chosen.fill(0);
        for field in 0..self.density.fields.len() {
            self.run_field(field, threshold)?;
        }
        Ok(self.chosen.iter().map(|&chosen| usize::from(chosen)).sum())
    }

    /// One pass over one field, adding its points to those chosen.
    fn run_field(&mut self, field: usize, threshold: f64) -> Result<(), Cancelled> {
        let (width, height) = (self.density.width, self.density.height);
        let [mut row, mut above] = std::mem::take(&mut self.rows);
        row.copy_from_slice(self.density.row(field, 0));
        for (value, error) in row.iter_mut().zip(&self.initial_errors[field]) {
            *value += error;
        }
        let mut rightwards = true;
        for y in 0..height {
            self.poll(y)?;
            let chosen = &mut self.chosen[y * width..][..width];
            if y + 1 < height {
                above.copy_from_slice(self.density.row(field, y + 1));
                self.weights.diffuse_row(&mut row, &mut above, threshold, rightwards, chosen);
            } else {
                self.weights.diffuse_last_row(&row, threshold, rightwards, chosen);
            }
            std::mem::swap(&mut row, &mut above);
            rightwards ^= self.serpentine;
        }
        self.rows = [row, above];
        Ok(())
    }
}

/// Errors drawn evenly from `-reach..reach`, from the seed's stream for a field.
fn random_errors(width: usize, reach: f64, seed: u64, field: u64) -> Vec<f64> {
    let mut stream = ChaCha8Rng::seed_from_u64(seed);
    stream.set_stream(field);
    // 53 random bits, as many as a fraction in 0..1 has.
    let fraction = |bits: u64| (bits >> 11) as f64 / (1u64 << 53) as f64;
    (0..width).map(|_| (2.0 * fraction(stream.next_u64()) - 1.0) * reach).collect()
}

impl Density {
    /// Row `y` of a field.
    fn row(&self, field: usize, y: usize) -> &[f64] {
        &self.fields[field][y * self.width..][..self.width]
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
struct Weights {
    /// First point of a row: nothing behind it.
    first: Shares,
    inner: Shares,
    /// Last point of a row: nothing ahead of it.
    last: Shares,
    /// To the next point of the topmost row.
    ahead_in_last_row: f64,
}

/// Robert W. Floyd and Louis Steinberg, "An adaptive algorithm for spatial greyscale", 1976.
const FLOYD_STEINBERG: Shares = Shares {
    ahead: 7.0 / 16.0,
    above_behind: 3.0 / 16.0,
    above: 5.0 / 16.0,
    above_ahead: 1.0 / 16.0,
};

impl Weights {
    /// The shares that lose the error without a neighbour, or hand it to the others.
    fn new(leaky: bool) -> Self {
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
    fn diffuse_row(
        &self,
        row: &mut [f64],
        above: &mut [f64],
        threshold: f64,
        rightwards: bool,
        chosen: &mut [u8],
    ) {
        let last = row.len() - 1;
        let place = |step: usize| if rightwards { step } else { last - step };
        let mut ahead = 0.0;
        for step in 0..=last {
            let shares = match step {
                0 => self.first,
                _ if step == last => self.last,
                _ => self.inner,
            };
            let x = place(step);
            let error = decide(row[x] + ahead, threshold, &mut chosen[x]);
            ahead = error * shares.ahead;
            above[x] += error * shares.above;
            if step > 0 {
                above[place(step - 1)] += error * shares.above_behind;
            }
            if step < last {
                above[place(step + 1)] += error * shares.above_ahead;
            }
        }
    }

    /// Diffuses the topmost row into itself, marking chosen points.
    fn diffuse_last_row(&self, row: &[f64], threshold: f64, rightwards: bool, chosen: &mut [u8]) {
        let last = row.len() - 1;
        let mut ahead = 0.0;
        for step in 0..=last {
            let x = if rightwards { step } else { last - step };
            let error = decide(row[x] + ahead, threshold, &mut chosen[x]);
            ahead = error * self.ahead_in_last_row;
        }
    }
}

/// Chooses a point or not, and returns the error that leaves.
#[inline]
fn decide(value: f64, threshold: f64, chosen: &mut u8) -> f64 {
    if value >= threshold {
        *chosen = 1;
        value - 2.0 * threshold
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_errors_are_those_of_the_seed_and_the_field_and_within_reach() {
        let errors = random_errors(1000, 0.25, 7, 0);
        assert_eq!(errors, random_errors(1000, 0.25, 7, 0));
        assert_ne!(errors, random_errors(1000, 0.25, 8, 0));
        assert_ne!(errors, random_errors(1000, 0.25, 7, 1));
        assert!(errors.iter().all(|error| error.abs() <= 0.25));
        let mean = errors.iter().sum::<f64>() / 1000.0;
        assert!(mean.abs() < 0.02, "{mean}");
    }
}
