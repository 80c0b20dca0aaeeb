//! The search for the threshold that chooses a number of points: doubled or halved until the number
//! changes sides, then bisected.
//!
//! Several thresholds are tried for the price of one, so the search looks ahead. Which thresholds
//! it may come to depends on whether each one chooses too many points or too few, and that can be
//! guessed: the number of points is almost inversely proportional to the threshold, and between
//! thresholds tried before it is known better still. A wrong guess costs time and changes nothing.

/// The search, and what it has learnt.
pub(crate) struct ThresholdSearch {
    size: usize,
    bracket: Bracket,
    /// The threshold of the steps taken with the number of points nearest to `size`, and the
    /// difference.
    nearest: (f64, usize),
    /// All thresholds tried, ascending, and the points that each one chose.
    known: Vec<(f64, usize)>,
}

/// The threshold to try next, and what is known around it.
#[derive(Clone, Copy)]
struct Bracket {
    threshold: f64,
    /// Largest threshold known to choose too many points.
    too_low: Option<f64>,
    /// Smallest threshold known to choose too few.
    too_high: Option<f64>,
}

/// Thresholds that the next steps of the search may come to; the first one is the next step.
pub(crate) struct Tries {
    pub(crate) thresholds: Vec<f64>,
    /// Which of them follows each one if that chose too many points, and if it chose too few.
    successors: Vec<[Option<usize>; 2]>,
}

/// A step that may come, not yet among the tries.
struct Candidate {
    bracket: Bracket,
    probability: f64,
    /// The try that it follows, and whether that must have chosen too few points.
    after: Option<(usize, bool)>,
}

impl Tries {
    /// The try that follows one that chose too many points or too few, if it is among these.
    pub(crate) fn after(&self, i: usize, too_many: bool) -> Option<usize> {
        self.successors[i][usize::from(!too_many)]
    }
}

impl ThresholdSearch {
    /// A search that begins with a threshold.
    pub(crate) fn new(threshold: f64, size: usize) -> Self {
        let bracket = Bracket { threshold, too_low: None, too_high: None };
        Self { size, bracket, nearest: (threshold, usize::MAX), known: Vec::new() }
    }

    /// The threshold of the steps taken with the number of points nearest to that wanted.
    pub(crate) fn nearest(&self) -> f64 {
        self.nearest.0
    }

    /// The `count` thresholds that the search is most likely to come to next.
    pub(crate) fn likely_tries(&self, count: usize) -> Tries {
        let mut tries = Tries { thresholds: Vec::new(), successors: Vec::new() };
        let first = Candidate { bracket: self.bracket, probability: 1.0, after: None };
        let mut candidates = vec![first];
        while tries.thresholds.len() < count {
            let likeliest = (0..candidates.len())
                .max_by(|&i, &j| candidates[i].probability.total_cmp(&candidates[j].probability));
            let Some(likeliest) = likeliest else { break };
            let Candidate { bracket, probability, after } = candidates.swap_remove(likeliest);
            let this = tries.thresholds.len();
            if let Some((i, too_few)) = after {
                tries.successors[i][usize::from(too_few)] = Some(this);
            }
            tries.thresholds.push(bracket.threshold);
            tries.successors.push([None; 2]);
            let too_many = self.likelihood_of_too_many(bracket.threshold);
            for (likelihood, too_few) in [(too_many, false), (1.0 - too_many, true)] {
                candidates.push(Candidate {
                    bracket: bracket.after(!too_few),
                    probability: probability * likelihood,
                    after: Some((this, too_few)),
                });
            }
        }
        tries
    }

    /// Takes in how many points the threshold of the next step chose, moves on to the one after it,
    /// and tells whether they were too many.
    pub(crate) fn learn(&mut self, count: usize) -> bool {
        let difference = count.abs_diff(self.size);
        if difference < self.nearest.1 {
            self.nearest = (self.bracket.threshold, difference);
        }
        let too_many = count > self.size;
        self.bracket = self.bracket.after(too_many);
        too_many
    }

    /// Notes how many points thresholds chose, whether or not the search came to them.
    pub(crate) fn note(&mut self, thresholds: &[f64], counts: &[usize]) {
        self.known.extend(thresholds.iter().copied().zip(counts.iter().copied()));
        self.known.sort_by(|a, b| a.0.total_cmp(&b.0));
    }

    /// A guess at how likely a threshold is to choose too many points, within `0.0..=1.0`.
    fn likelihood_of_too_many(&self, threshold: f64) -> f64 {
        let (count, error) = self.guess(threshold);
        let off = (count - self.size as f64) / error;
        0.5 + 0.5 * off / (1.0 + off.abs())
    }

    /// A guess at how many points a threshold chooses, and how far off that may be.
    fn guess(&self, threshold: f64) -> (f64, f64) {
        /// Part of the number that it may be off, from other thresholds and between two known ones.
        const FAR: f64 = 0.02;
        const BETWEEN: f64 = 0.02;
        /// Points that it may be off in any case.
        const LEAST: f64 = 3.0;
        let inverse = 1.0 / threshold;
        let at = self.known.partition_point(|known| known.0 < threshold);
        let (below, above) =
            (at.checked_sub(1).and_then(|i| self.known.get(i)), self.known.get(at));
        let scaled = |(known, count): (f64, usize)| {
            let count = count as f64 * known * inverse;
            (count, FAR * count + LEAST)
        };
        match (below, above) {
            (Some(&(low, many)), Some(&(high, few))) => {
                let (many, few) = (many as f64, few as f64);
                let part = (inverse - 1.0 / high) / (1.0 / low - 1.0 / high);
                (few + (many - few) * part, BETWEEN * (many - few).abs() + LEAST)
            }
            (Some(&known), None) | (None, Some(&known)) => scaled(known),
            // The first threshold is the one that chooses the right number if no error is lost.
            (None, None) => scaled((self.bracket.threshold, self.size)),
        }
    }
}

impl Bracket {
    /// What is known after the threshold chose too many points, or too few.
    fn after(self, too_many: bool) -> Self {
        let Self { threshold, mut too_low, mut too_high } = self;
        if too_many {
            too_low = Some(threshold);
        } else {
            too_high = Some(threshold);
        }
        let threshold = match (too_low, too_high) {
            (Some(low), Some(high)) => 0.5 * (low + high),
            (Some(low), None) => 2.0 * low,
            (None, Some(high)) => 0.5 * high,
            (None, None) => threshold,
        };
        Self { threshold, too_low, too_high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points that a threshold chooses: a few less than if no error were lost, and unevenly so.
    fn count(threshold: f64) -> usize {
        (1000.0 / threshold - 20.0 * (1.0 + (1.0 / threshold).sin())).max(0.0) as usize
    }

    /// The same, less smooth and by what every machine computes alike.
    fn uneven_count(threshold: f64) -> usize {
        let points = 1000.0 / threshold;
        let wave = (2.0 * (0.03 * points).fract() - 1.0).abs();
        (points * (0.99 - 0.02 * wave)) as usize
    }

    /// The thresholds that the search comes to, and in how many passes.
    fn steps(first: f64, size: usize, per_pass: usize) -> (Vec<f64>, usize) {
        steps_by(count, first, size, per_pass)
    }

    fn steps_by(
        count: fn(f64) -> usize,
        first: f64,
        size: usize,
        per_pass: usize,
    ) -> (Vec<f64>, usize) {
        let mut search = ThresholdSearch::new(first, size);
        let (mut steps, mut passes) = (Vec::new(), 0);
        loop {
            passes += 1;
            let tries = search.likely_tries(per_pass);
            let counts: Vec<usize> = tries.thresholds.iter().map(|&t| count(t)).collect();
            let mut next = Some(0);
            while let Some(i) = next {
                steps.push(tries.thresholds[i]);
                if counts[i].abs_diff(size) <= 3 || steps.len() == 60 {
                    return (steps, passes);
                }
                next = tries.after(i, search.learn(counts[i]));
            }
            search.note(&tries.thresholds, &counts);
        }
    }

    #[test]
    fn looking_ahead_changes_no_step() {
        for first in [0.02, 0.1, 0.35, 1.0, 30.0] {
            let (one_by_one, passes) = steps(first, 2_000, 1);
            assert_eq!(passes, one_by_one.len());
            for per_pass in [2, 7, 15] {
                assert_eq!(steps(first, 2_000, per_pass).0, one_by_one);
            }
        }
    }

    /// A guess that is changed for a better one makes these numbers smaller.
    #[test]
    fn guesses_save_as_many_passes_as_ever() {
        let passes = [1, 2, 3, 5, 7, 15].map(|per_pass| {
            let sizes = (1..60).map(|i| 30 * i * i).chain([4, 5, 7, 2_000_000]);
            let searches = sizes.flat_map(|size| [0.01, 0.3, 0.5, 0.7, 20.0].map(|at| (size, at)));
            searches
                .map(|(size, at)| {
                    let first = at * 1000.0 / size as f64;
                    steps_by(uneven_count, first, size, per_pass).1
                })
                .sum::<usize>()
        });
        assert_eq!(passes, [5430, 3046, 2274, 1725, 1509, 1267]);
    }

    #[test]
    fn the_nearest_threshold_is_the_first_of_those_that_chose_the_number_nearest_to_that_wanted() {
        let mut search = ThresholdSearch::new(1.0, 100);
        let mut nearest = Vec::new();
        // The thresholds are 1, 2, 4, 3, 3.5 and 3.75.
        for count in [150, 130, 90, 110, 109, 92] {
            search.learn(count);
            nearest.push(search.nearest());
        }
        assert_eq!(nearest, [1.0, 2.0, 4.0, 4.0, 3.5, 3.75]);
    }

    #[test]
    fn two_passes_are_enough_where_the_first_threshold_is_near() {
        let (steps, passes) = steps(0.5, 2_000, 15);
        assert!(steps.len() > 6 && passes <= 2, "{passes} passes for {steps:?}");
    }
}
