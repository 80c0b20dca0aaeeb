//! Choice of sample points by error diffusion: Floyd and Steinberg's halftoning of a density.
//!
//! Yongyi Yang, Miles N. Wernick and Jovan G. Brankov, "A fast approach for accurate
//! content-adaptive mesh generation", 2003, place mesh nodes where Floyd-Steinberg error diffusion
//! of a feature map exceeds a threshold; the threshold that gives the number of points asked for is
//! found by search. Error that has no neighbour to go to is shared among the others (non-leaky),
//! and the first row may start with the errors of the picture mirrored below it.
//!
//! The search tries about ten thresholds. One pass tries seven or fifteen of them at once, those
//! that its next steps are most likely to come to (see `threshold_search`), and the one taken is
//! the one that the steps take.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage, rows_per_poll};
use crate::density::Density;
use crate::parallel::share_out;
use crate::parameters::Parameters;
use crate::parameters::choices::{Scan, Startup};
use crate::points::floyd_steinberg::{Lanes, Numbers, Weights};
use crate::points::threshold_search::ThresholdSearch;
use fearless_simd::{Level, Simd, dispatch};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Most thresholds tried before the one with the nearest number of points is taken.
const MAX_TRIES: usize = 60;

/// Most groups of thresholds tried on different threads: each takes two bytes for each lattice
/// point, and more would rarely save a pass.
const MAX_GROUPS: usize = 2;

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
        return diffusion.marks_of(0);
    }
    let default = if density.fields.len() == 1 { TOLERANCE_ONE_FIELD } else { TOLERANCE_UNION };
    let tolerance = parameters.tolerance.unwrap_or(default);
    let mut search = ThresholdSearch::new(diffusion.first_threshold(), size);
    while diffusion.tries < MAX_TRIES {
        let tries = search.likely_tries(diffusion.thresholds_per_pass());
        let counts = diffusion.run(&tries.thresholds)?;
        let mut next = Some(0);
        while let Some(i) = next {
            if counts[i].abs_diff(size) <= tolerance {
                return diffusion.marks_of(i);
            }
            diffusion.tries += 1;
            let too_many = search.learn(counts[i]);
            next = tries.after(i, too_many).filter(|_| diffusion.tries < MAX_TRIES);
        }
        search.note(&tries.thresholds, &counts);
    }
    diffusion.run(&[search.nearest()])?;
    diffusion.marks_of(0)
}

/// Thresholds tried at once, what they choose, and how many points each chooses.
type Group<'a> = ((&'a [f64], &'a mut Vec<u16>), &'a mut Vec<usize>);

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
    /// For each lattice point a bit for each threshold of the last pass that chose it, a field for
    /// each of the groups of thresholds that threads try side by side.
    chosen: Vec<Vec<u16>>,
    level: Level,
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
            sums: Vec::new(),
            initial_errors: vec![vec![0.0; width]; density.fields.len()],
            // Not copies of one, which would be read.
            chosen: (0..control.threads().get().min(MAX_GROUPS))
                .map(|_| vec![0; width * density.height])
                .collect(),
            level: Level::new(),
            control,
            tries: 0,
        };
        for field in 0..density.fields.len() {
            let sum = diffusion.sum_of(field)?;
            diffusion.sums.push(sum);
        }
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

    fn poll(&self, control: &dyn Control) -> Result<(), Cancelled> {
        control.poll(Stage::Diffuse, self.tries, MAX_TRIES)
    }

    /// Polls at the first of every few rows.
    fn poll_row(&self, y: usize, control: &dyn Control) -> Result<(), Cancelled> {
        let is_due = y.is_multiple_of(rows_per_poll(self.density.width));
        if is_due { self.poll(control) } else { Ok(()) }
    }

    /// The sum of a field.
    fn sum_of(&self, field: usize) -> Result<f64, Cancelled> {
        let mut sum = 0.0;
        for chunk in self.density.fields[field].chunks(POINTS_PER_POLL) {
            self.poll(self.control)?;
            sum = chunk.iter().fold(sum, |sum, value| sum + value);
        }
        Ok(sum)
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
        let mut row = self.density.row(field, self.density.height - 1).to_vec();
        let (mut above, nothing) = (row.clone(), vec![0.0; self.density.width]);
        for y in (0..self.density.height - 1).rev() {
            self.poll_row(y, self.control)?;
            let densities = if y == 0 { &nothing } else { self.density.row(field, y) };
            let weights = &self.weights;
            let marks = &mut ignored;
            weights.diffuse_row(&row, densities, &mut above, threshold, rightwards, marks);
            std::mem::swap(&mut row, &mut above);
            rightwards ^= self.serpentine;
        }
        Ok(row)
    }

    /// How many thresholds one thread tries in little more time than one: a lane of the last vector
    /// is left.
    fn thresholds_per_group(&self) -> usize {
        if has_wide_vectors(self.level) { 15 } else { 7 }
    }

    /// How many thresholds one pass tries.
    fn thresholds_per_pass(&self) -> usize {
        self.chosen.len() * self.thresholds_per_group()
    }

    /// One pass over every field for each threshold; returns how many points each one chose.
    fn run(&mut self, thresholds: &[f64]) -> Result<Vec<usize>, Cancelled> {
        let mut fields = std::mem::take(&mut self.chosen);
        let per_group = self.thresholds_per_group();
        let this = &*self;
        let mut counts = vec![Vec::new(); thresholds.len().div_ceil(per_group)];
        let groups = thresholds.chunks(per_group).zip(&mut fields).zip(&mut counts);
        let run = |((group, chosen), counts): Group<'_>, control: &dyn Control| {
            this.run_group(group, chosen, control).map(|counted| *counts = counted)
        };
        let result = share_out(groups, this.control, run);
        self.chosen = fields;
        result.map(|()| counts.concat())
    }

    /// One pass over every field for each threshold of a group, fifteen at most.
    fn run_group(
        &self,
        thresholds: &[f64],
        chosen: &mut [u16],
        control: &dyn Control,
    ) -> Result<Vec<usize>, Cancelled> {
        let mut lanes = [f64::INFINITY; 16];
        lanes[..thresholds.len()].copy_from_slice(thresholds);
        let [first, second] = [0, 8].map(|start| std::array::from_fn(|i| lanes[start + i]));
        for field in 0..self.density.fields.len() {
            let level = self.level;
            if thresholds.len() > 8 {
                let both = [first, second];
                dispatch!(level, simd => self.run_field::<_, 2>(simd, field, both, chosen, control))?;
            } else {
                dispatch!(level, simd => self.run_field::<_, 1>(simd, field, [first], chosen, control))?;
            }
        }
        self.counts_of_lanes(chosen, thresholds.len(), control)
    }

    /// One pass over one field, adding its points to those chosen.
    #[inline(always)]
    fn run_field<S: Simd, const N: usize>(
        &self,
        simd: S,
        field: usize,
        thresholds: [[f64; 8]; N],
        chosen: &mut [u16],
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let (width, height) = (self.density.width, self.density.height);
        let thresholds = Lanes::load(simd, &thresholds);
        let starts = self.density.row(field, 0).iter().zip(&self.initial_errors[field]);
        let mut row: Vec<_> = starts.map(|(density, error)| [[density + error; 8]; N]).collect();
        let mut above = vec![[[0.0; 8]; N]; width];
        let mut rightwards = true;
        for (y, chosen) in chosen.chunks_exact_mut(width).enumerate() {
            self.poll_row(y, control)?;
            if field == 0 {
                chosen.fill(0);
            }
            let weights = &self.weights;
            if y + 1 < height {
                let next = self.density.row(field, y + 1);
                weights.diffuse_row(&row, next, &mut above, thresholds, rightwards, chosen);
            } else {
                weights.diffuse_last_row(&row, thresholds, rightwards, chosen);
            }
            std::mem::swap(&mut row, &mut above);
            rightwards ^= self.serpentine;
        }
        Ok(())
    }

    /// How many points have the bit of each lane set.
    fn counts_of_lanes(
        &self,
        chosen: &[u16],
        lanes: usize,
        control: &dyn Control,
    ) -> Result<Vec<usize>, Cancelled> {
        let mut counts = vec![0; lanes];
        // In 16 bits a lane counts up to 2^16 - 1 points.
        for chunk in chosen.chunks(usize::from(u16::MAX)) {
            self.poll(control)?;
            for (lane, count) in counts.iter_mut().enumerate() {
                *count += usize::from(chunk.iter().map(|bits| bits >> lane & 1).sum::<u16>());
            }
        }
        Ok(counts)
    }

    /// 1 for each lattice point that a threshold of the last pass chose, 0 for the others.
    fn marks_of(self, threshold: usize) -> Result<Vec<u8>, Cancelled> {
        let per_group = self.thresholds_per_group();
        let chosen = &self.chosen[threshold / per_group];
        let mut marks = Vec::with_capacity(chosen.len());
        for chunk in chosen.chunks(POINTS_PER_POLL) {
            self.poll(self.control)?;
            marks.extend(chunk.iter().map(|bits| (bits >> (threshold % per_group) & 1) as u8));
        }
        Ok(marks)
    }
}

/// Whether sixteen numbers fill at most four vectors.
fn has_wide_vectors(level: Level) -> bool {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    return level.as_avx2().is_some();
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    return false;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use crate::parameters::Target;
    use std::num::NonZeroUsize;

    #[test]
    fn a_pass_can_be_cancelled_among_its_rows() {
        let field: Vec<f64> = (0..4 * 100).map(|i| f64::from(i % 7) / 6.0).collect();
        let density = Density { width: 4, height: 100, fields: vec![field] };
        let parameters = Parameters::default().target(Target::Size(90));
        for polls in 0..4 {
            let control = Recorder::cancelling_at(polls);
            assert_eq!(diffuse_to_size(&density, 90, &parameters, &control), Err(Cancelled));
        }
        let marks = diffuse_to_size(&density, 90, &parameters, &()).unwrap();
        assert!(marks.iter().map(|&mark| usize::from(mark)).sum::<usize>().abs_diff(90) <= 10);
    }

    #[test]
    fn polls_are_frequent_in_any_shape() {
        for (width, height) in [(4, 100_000), (700, 700), (100_000, 4)] {
            let field = (0..width * height).map(|i| (i % 7) as f64 / 6.0).collect();
            let density = Density { width, height, fields: vec![field] };
            let parameters = Parameters {
                startup: Startup::Classic,
                ..Parameters::default().target(Target::Size(9))
            };
            let mut diffusion = Diffusion::new(&density, 900, &parameters, &()).unwrap();
            let recorder = Recorder::default();
            diffusion.control = &recorder;
            diffusion.run(&[0.1]).unwrap();
            let passes = recorder.done(Stage::Diffuse, MAX_TRIES).len();
            assert!(passes >= width * height / POINTS_PER_POLL, "{width} by {height}: {passes}");
        }
    }

    #[test]
    fn helper_threads_stop_at_a_cancellation() {
        let density = Density { width: 4, height: 100, fields: vec![vec![0.5; 400]] };
        let parameters = Parameters::default().target(Target::Size(90));
        let control = OnThreads(Recorder::cancelling_at(1), NonZeroUsize::new(2).unwrap());
        assert_eq!(diffuse_to_size(&density, 90, &parameters, &control), Err(Cancelled));
    }

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
