//! Choice of sample points by error diffusion: Floyd and Steinberg's halftoning of a density.
//!
//! Yongyi Yang, Miles N. Wernick and Jovan G. Brankov, "A fast approach for accurate
//! content-adaptive mesh generation", 2003, set mesh nodes where Floyd-Steinberg error diffusion of
//! a feature map exceeds a threshold, and search the threshold that gives the number of points
//! asked for. Error that has no neighbour to receive it is shared among the others (non-leaky), and
//! the first row may start with the errors of the picture mirrored below it.
//!
//! One pass tries several thresholds, those that the search will most likely use next (see
//! `threshold_search`). The result is the one of a search that tries one after the other.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Poller, Stage};
use crate::density::Density;
use crate::parallel::share_out;
use crate::parameters::Parameters;
use crate::parameters::choices::{Scan, Startup};
use crate::points::floyd_steinberg::{Lanes, RowDiffusion, Weights};
use crate::points::threshold_search::ThresholdSearch;
use fearless_simd::{Level, Simd, dispatch, f64x2, f64x8, prelude::*};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The most thresholds tried; then the one with the nearest number of points is taken.
const MAX_TRIES: usize = 60;

/// The most groups of thresholds, each tried on one thread. A group takes two bytes for each
/// lattice point, and more than two groups rarely save a pass.
const MAX_GROUPS: usize = 2;

/// The difference in points that ends the search, for one field and for several.
const TOLERANCE_ONE_FIELD: usize = 10;
const TOLERANCE_UNION: usize = 15;

/// Marks about `size` of a density's lattice points, `1` at each chosen one, row 0 at the bottom.
///
/// The number differs from `size` by at most the parameters' tolerance if any threshold reaches
/// that. A density of 0 everywhere has no points.
pub(crate) fn diffuse_to_size(
    density: &Density,
    size: usize,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Vec<u8>, Cancelled> {
    let mut diffusion = Diffusion::new(density, size, parameters, control)?;
    if diffusion.sums.iter().all(|&sum| sum == 0.0) {
        return diffusion.marks_of(0);
    }
    let default = if density.fields.len() == 1 { TOLERANCE_ONE_FIELD } else { TOLERANCE_UNION };
    let tolerance = parameters.tolerance.unwrap_or(default);
    let mut search = ThresholdSearch::new(diffusion.first_threshold(), size);
    while diffusion.tries < MAX_TRIES {
        let per_pass = diffusion.chosen.len() * diffusion.group_size;
        let thresholds = search.likely_thresholds(per_pass);
        let counts = diffusion.run(&thresholds)?;
        while diffusion.tries < MAX_TRIES
            && let Some(i) = thresholds.iter().position(|&t| t == search.threshold())
        {
            if counts[i].abs_diff(size) <= tolerance {
                return diffusion.marks_of(i);
            }
            diffusion.tries += 1;
            search.advance(counts[i]);
        }
        search.record(&thresholds, &counts);
    }
    diffusion.run(&[search.nearest()])?;
    diffusion.marks_of(0)
}

struct Diffusion<'a> {
    density: &'a Density,
    size: usize,
    is_serpentine: bool,
    weights: Weights,
    sums: Vec<f64>,
    initial_errors: Vec<Vec<f64>>,
    /// For each group of thresholds and each lattice point one bit for each threshold of the last
    /// pass, set where it chose the point.
    chosen: Vec<Vec<u16>>,
    /// How many thresholds a thread tries in little more time than one; one lane is not used.
    group_size: usize,
    level: Level,
    control: &'a dyn Control,
    tries: usize,
}

impl<'a> Diffusion<'a> {
    fn new(
        density: &'a Density,
        size: usize,
        parameters: &Parameters,
        control: &'a dyn Control,
    ) -> Result<Self, Cancelled> {
        let (width, groups) = (density.width, control.threads().get().min(MAX_GROUPS));
        let level = Level::new();
        let has_wide_vectors = dispatch!(level, simd => lanes_of_vectors(simd)) >= 4;
        let mut diffusion = Self {
            density,
            size,
            is_serpentine: parameters.scan == Scan::Serpentine,
            weights: Weights::new(parameters.leaky),
            sums: Vec::new(),
            initial_errors: Vec::new(),
            // Each allocated as zeros, which costs nothing until it is written.
            chosen: (0..groups).map(|_| vec![0; width * density.height]).collect(),
            group_size: if has_wide_vectors { 15 } else { 7 },
            level,
            control,
            tries: 0,
        };
        for field in &density.fields {
            let (mut poller, mut sum) = (diffusion.poller(control), 0.0);
            for chunk in field.chunks(POINTS_PER_POLL) {
                poller.step(chunk.len())?;
                sum = chunk.iter().fold(sum, |sum, value| sum + value);
            }
            diffusion.sums.push(sum);
        }
        for field in 0..density.fields.len() {
            let errors = match parameters.startup {
                Startup::Classic => vec![0.0; width],
                Startup::Mirroring => {
                    dispatch!(level, simd => diffusion.mirrored_errors(simd, field))?
                }
                Startup::Random => {
                    let reach = diffusion.first_threshold();
                    random_errors(width, reach, parameters.seed, field as u64)
                }
            };
            diffusion.initial_errors.push(errors);
        }
        Ok(diffusion)
    }

    fn poller<'c>(&self, control: &'c dyn Control) -> Poller<'c> {
        Poller::new(control, Stage::Diffuse, self.tries, MAX_TRIES)
    }

    /// The threshold at which the first field that is not 0 everywhere gives the number of points
    /// asked for if no error is lost: a point takes twice the threshold from the sum.
    fn first_threshold(&self) -> f64 {
        let sum = self.sums.iter().find(|&&sum| sum > 0.0);
        sum.copied().unwrap_or_default() / (2.0 * self.size as f64)
    }

    /// The errors that row 0 receives from the picture mirrored at it: rows `height - 1` down to 1
    /// diffused once, each into the next.
    #[inline(always)]
    fn mirrored_errors<S: Simd>(&mut self, simd: S, field: usize) -> Result<Vec<f64>, Cancelled> {
        let (density, count) = (self.density, self.density.fields.len() as f64);
        let threshold = count * self.sums[field] / (2.0 * self.size as f64);
        let mut rows = self.rows(Lanes::<_, f64x2<S>, 1>::splat(simd, threshold), self.control);
        let nothing = vec![0.0; density.width];
        let below =
            (1..density.height - 1).rev().map(|y| density.row(field, y)).chain([&nothing[..]]);
        let mut ignored = vec![0; density.width];
        let top = density.row(field, density.height - 1).iter().copied();
        let [mut row, mut above] = rows.start(simd, top)?;
        for densities in below {
            rows.diffuse(&row, densities, &mut above, &mut ignored)?;
            std::mem::swap(&mut row, &mut above);
        }
        Ok(row.iter().map(Lanes::first).collect())
    }

    fn rows<'c, L>(&'c self, thresholds: L, control: &'c dyn Control) -> RowDiffusion<'c, L> {
        RowDiffusion {
            weights: &self.weights,
            thresholds,
            is_serpentine: self.is_serpentine,
            is_leftwards: false,
            poller: self.poller(control),
        }
    }

    /// The passes of all thresholds, in groups; returns how many points each one chose.
    fn run(&mut self, thresholds: &[f64]) -> Result<Vec<usize>, Cancelled> {
        let mut chosen = std::mem::take(&mut self.chosen);
        let this = &*self;
        let groups: Vec<&[f64]> = thresholds.chunks(self.group_size).collect();
        let mut counts = vec![Vec::new(); groups.len()];
        let shares = groups.into_iter().zip(chosen.iter_mut().zip(&mut counts));
        let result = share_out(shares, this.control, |(group, (chosen, counts)), control| {
            *counts = this.run_group(group, chosen, control)?;
            Ok(())
        });
        self.chosen = chosen;
        result.map(|()| counts.concat())
    }

    /// One pass over every field for up to fifteen thresholds; returns how many points each chose.
    fn run_group(
        &self,
        thresholds: &[f64],
        chosen: &mut [u16],
        control: &dyn Control,
    ) -> Result<Vec<usize>, Cancelled> {
        let mut lanes = [f64::INFINITY; 16];
        lanes[..thresholds.len()].copy_from_slice(thresholds);
        let (first, second) = lanes.split_at(8);
        let level = self.level;
        for field in 0..self.density.fields.len() {
            if thresholds.len() > 8 {
                dispatch!(level, simd => {
                    let both = [f64x8::from_slice(simd, first), f64x8::from_slice(simd, second)];
                    self.run_field(simd, field, both, chosen, control)
                })?;
            } else {
                dispatch!(level, simd => {
                    self.run_field(simd, field, [f64x8::from_slice(simd, first)], chosen, control)
                })?;
            }
        }
        let (mut poller, mut counts) = (self.poller(control), vec![0; thresholds.len()]);
        // In 16 bits a lane counts up to 2^16 - 1 points.
        for chunk in chosen.chunks(usize::from(u16::MAX)) {
            poller.step(chunk.len())?;
            for (lane, count) in counts.iter_mut().enumerate() {
                *count += usize::from(chunk.iter().map(|bits| bits >> lane & 1).sum::<u16>());
            }
        }
        Ok(counts)
    }

    #[inline(always)]
    fn run_field<S: Simd, const N: usize>(
        &self,
        simd: S,
        field: usize,
        thresholds: [f64x8<S>; N],
        chosen: &mut [u16],
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let (density, height) = (self.density, self.density.height);
        let mut rows = self.rows(Lanes::new(thresholds), control);
        let bottom = density.row(field, 0).iter().zip(&self.initial_errors[field]);
        let [mut row, mut above] = rows.start(simd, bottom.map(|(a, b)| a + b))?;
        for (y, chosen) in chosen.chunks_exact_mut(density.width).enumerate() {
            if field == 0 {
                chosen.fill(0);
            }
            if y + 1 < height {
                rows.diffuse(&row, density.row(field, y + 1), &mut above, chosen)?;
            } else {
                rows.diffuse_last(&row, chosen)?;
            }
            std::mem::swap(&mut row, &mut above);
        }
        Ok(())
    }

    /// 1 for each lattice point that a threshold of the last pass chose, 0 for the others.
    fn marks_of(self, threshold: usize) -> Result<Vec<u8>, Cancelled> {
        let (group, lane) = (threshold / self.group_size, threshold % self.group_size);
        let mut poller = self.poller(self.control);
        let mut marks = Vec::with_capacity(self.chosen[group].len());
        for chunk in self.chosen[group].chunks(POINTS_PER_POLL) {
            poller.step(chunk.len())?;
            marks.extend(chunk.iter().map(|bits| (bits >> lane & 1) as u8));
        }
        Ok(marks)
    }
}

#[inline(always)]
fn lanes_of_vectors<S: Simd>(_: S) -> usize {
    S::f64s::LEN
}

/// Errors drawn evenly from `-reach..reach`, from the seed's stream for a field.
fn random_errors(width: usize, reach: f64, seed: u64, field: u64) -> Vec<f64> {
    let mut stream = ChaCha8Rng::seed_from_u64(seed);
    stream.set_stream(field);
    // The 53 random bits that a fraction in 0..1 has.
    let fraction = |bits: u64| (bits >> 11) as f64 / (1u64 << 53) as f64;
    (0..width).map(|_| (2.0 * fraction(stream.next_u64()) - 1.0) * reach).collect()
}

impl Density {
    fn row(&self, field: usize, y: usize) -> &[f64] {
        &self.fields[field][y * self.width..][..self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use crate::parameters::Target;
    use std::num::NonZeroUsize;

    #[test]
    fn cancels_at_any_poll() {
        let field: Vec<f64> = (0..4 * 100).map(|i| f64::from(i % 7) / 6.0).collect();
        let density = Density { width: 4, height: 100, fields: vec![field] };
        let parameters = Parameters::default().target(Target::Size(90));
        let recorder = Recorder::default();
        let marks = diffuse_to_size(&density, 90, &parameters, &recorder).unwrap();
        assert!(marks.iter().map(|&mark| usize::from(mark)).sum::<usize>().abs_diff(90) <= 10);
        for poll in 0..recorder.reports().len() {
            let control = Recorder::cancelling_at(poll);
            assert_eq!(diffuse_to_size(&density, 90, &parameters, &control), Err(Cancelled));
        }
        // The helper thread stops, too. Two threads need fewer passes and poll less often.
        let control = OnThreads(Recorder::cancelling_at(1), NonZeroUsize::new(2).unwrap());
        assert_eq!(diffuse_to_size(&density, 90, &parameters, &control), Err(Cancelled));
    }

    #[test]
    fn polls_are_frequent_in_any_shape() {
        for (width, height) in [(4, 100_000), (700, 700), (100_000, 4)] {
            let field = (0..width * height).map(|i| (i % 7) as f64 / 6.0).collect();
            let density = Density { width, height, fields: vec![field] };
            for startup in [Startup::Classic, Startup::Mirroring] {
                let parameters =
                    Parameters { startup, ..Parameters::default().target(Target::Size(9)) };
                let recorder = Recorder::default();
                let mut diffusion = Diffusion::new(&density, 900, &parameters, &recorder).unwrap();
                diffusion.run(&[0.1]).unwrap();
                diffusion.marks_of(0).unwrap();
                let polls = recorder.done(Stage::Diffuse, MAX_TRIES).len();
                // The sum, the mirrored pass, the pass, the counts and the marks.
                let passes = if startup == Startup::Mirroring { 5 } else { 4 };
                let least = passes * width * height / (2 * POINTS_PER_POLL);
                assert!(polls >= least, "{width} by {height}: {polls} of {least}");
            }
        }
    }

    #[test]
    fn random_errors_follow_seed_and_field_within_reach() {
        let errors = random_errors(1000, 0.25, 7, 0);
        assert_eq!(errors, random_errors(1000, 0.25, 7, 0));
        assert_ne!(errors, random_errors(1000, 0.25, 8, 0));
        assert_ne!(errors, random_errors(1000, 0.25, 7, 1));
        assert!(errors.iter().all(|error| error.abs() <= 0.25));
        let mean = errors.iter().sum::<f64>() / 1000.0;
        assert!(mean.abs() < 0.02, "{mean}");
    }
}
