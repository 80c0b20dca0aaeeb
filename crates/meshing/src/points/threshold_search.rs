//! The search for the threshold that chooses a number of points: it doubles or halves the threshold
//! until the number changes from too many to too few or back, then bisects.
//!
//! Several thresholds take little longer than one, so the next steps are tried ahead. Which
//! thresholds they use is estimated: the number of points is almost inversely proportional to the
//! threshold, and the counts so far refine the estimate. A wrong estimate costs time alone.

pub(crate) struct ThresholdSearch {
    size: usize,
    bracket: Bracket,
    /// The threshold so far with the number of points nearest to `size`, and the difference.
    nearest: (f64, usize),
    /// All thresholds tried, ascending, with the number of points that each one chose.
    known: Vec<(f64, usize)>,
}

#[derive(Clone, Copy)]
struct Bracket {
    threshold: f64,
    /// The largest threshold known to choose too many points.
    too_low: Option<f64>,
    /// The smallest threshold known to choose too few.
    too_high: Option<f64>,
}

impl ThresholdSearch {
    pub(crate) fn new(threshold: f64, size: usize) -> Self {
        let bracket = Bracket { threshold, too_low: None, too_high: None };
        Self { size, bracket, nearest: (threshold, usize::MAX), known: Vec::new() }
    }

    pub(crate) fn threshold(&self) -> f64 {
        self.bracket.threshold
    }

    pub(crate) fn nearest(&self) -> f64 {
        self.nearest.0
    }

    /// The threshold of the next step, and those that most likely follow, `count` in all.
    pub(crate) fn likely_thresholds(&self, count: usize) -> Vec<f64> {
        let mut thresholds = Vec::new();
        let mut candidates = vec![(1.0_f64, self.bracket)];
        while thresholds.len() < count {
            let likeliest =
                (0..candidates.len()).max_by(|&i, &j| candidates[i].0.total_cmp(&candidates[j].0));
            let Some(likeliest) = likeliest else { break };
            let (probability, bracket) = candidates.swap_remove(likeliest);
            thresholds.push(bracket.threshold);
            let too_many = self.probability_of_too_many(bracket.threshold);
            candidates.push((probability * too_many, bracket.after(true)));
            candidates.push((probability * (1.0 - too_many), bracket.after(false)));
        }
        thresholds
    }

    /// Makes the next step, whose threshold chose `count` points.
    pub(crate) fn advance(&mut self, count: usize) {
        let difference = count.abs_diff(self.size);
        if difference < self.nearest.1 {
            self.nearest = (self.bracket.threshold, difference);
        }
        self.bracket = self.bracket.after(count > self.size);
    }

    /// Records how many points thresholds chose, whether or not a step used them.
    pub(crate) fn record(&mut self, thresholds: &[f64], counts: &[usize]) {
        self.known.extend(thresholds.iter().copied().zip(counts.iter().copied()));
        self.known.sort_by(|a, b| a.0.total_cmp(&b.0));
    }

    /// An estimate of the probability that a threshold chooses too many points, by an estimate of
    /// how many it chooses and of the error of that number.
    fn probability_of_too_many(&self, threshold: f64) -> f64 {
        /// The relative error, of an extrapolated count and of the difference of two known ones.
        const RELATIVE: f64 = 0.02;
        /// The error in points that adds to it.
        const ABSOLUTE: f64 = 3.0;
        let inverse = 1.0 / threshold;
        let above = self.known.partition_point(|known| known.0 < threshold);
        let below = above.checked_sub(1).and_then(|i| self.known.get(i));
        let (count, error) = match (below, self.known.get(above)) {
            (Some(&(low, many)), Some(&(high, few))) => {
                let (many, few) = (many as f64, few as f64);
                let part = (inverse - 1.0 / high) / (1.0 / low - 1.0 / high);
                (few + (many - few) * part, RELATIVE * (many - few).abs() + ABSOLUTE)
            }
            (below, above) => {
                // The first threshold chooses the right number if no error is lost.
                let first = (self.bracket.threshold, self.size);
                let (known, count) = *below.or(above).unwrap_or(&first);
                let count = count as f64 * known * inverse;
                (count, RELATIVE * count + ABSOLUTE)
            }
        };
        let off = (count - self.size as f64) / error;
        0.5 + 0.5 * off / (1.0 + off.abs())
    }
}

impl Bracket {
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

    /// Points that a threshold chooses: somewhat fewer than if no error were lost, and unevenly so.
    fn count(threshold: f64) -> usize {
        (1000.0 / threshold - 20.0 * (1.0 + (1.0 / threshold).sin())).max(0.0) as usize
    }

    /// The thresholds that the search uses with `per_pass` of them a pass, and how many passes.
    fn steps(first: f64, size: usize, per_pass: usize) -> (Vec<f64>, usize) {
        let mut search = ThresholdSearch::new(first, size);
        let (mut steps, mut passes) = (Vec::new(), 0);
        loop {
            passes += 1;
            let thresholds = search.likely_thresholds(per_pass);
            assert_eq!(thresholds.len(), per_pass);
            let counts: Vec<usize> = thresholds.iter().map(|&t| count(t)).collect();
            while let Some(i) = thresholds.iter().position(|&t| t == search.threshold()) {
                steps.push(thresholds[i]);
                if counts[i].abs_diff(size) <= 3 || steps.len() == 60 {
                    return (steps, passes);
                }
                search.advance(counts[i]);
            }
            search.record(&thresholds, &counts);
        }
    }

    #[test]
    fn thresholds_per_pass_change_no_step() {
        for first in [0.02, 0.1, 0.35, 1.0, 30.0] {
            let (one_by_one, passes) = steps(first, 2_000, 1);
            assert_eq!(passes, one_by_one.len());
            for per_pass in [2, 7, 15] {
                assert_eq!(steps(first, 2_000, per_pass).0, one_by_one);
            }
        }
    }

    #[test]
    fn near_start_takes_two_passes() {
        let (steps, passes) = steps(0.5, 2_000, 15);
        assert!(steps.len() > 6 && passes <= 2, "{passes} passes for {steps:?}");
    }

    #[test]
    fn nearest_is_the_first_of_equally_near_thresholds() {
        let mut search = ThresholdSearch::new(1.0, 100);
        let mut nearest = Vec::new();
        // The thresholds are 1, 2, 4, 3, 3.5 and 3.75.
        for count in [150, 130, 90, 110, 109, 92] {
            search.advance(count);
            nearest.push(search.nearest());
        }
        assert_eq!(nearest, [1.0, 2.0, 4.0, 4.0, 3.5, 3.75]);
    }
}
