//! When greedy removal stops, and how far it has come.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Point;
use crate::parameters::choices::ErrorMetric;
use crate::removal::queue::Entry;

/// When removal ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StopRule {
    /// Vertices to keep.
    pub(crate) size: usize,
    /// The largest sum of errors that a removal may leave, in the metric's whole numbers.
    pub(crate) bound: Option<u64>,
    /// The error that counts.
    pub(crate) metric: ErrorMetric,
    /// Whether to go on below `size` while a removal lowers the error.
    pub(crate) bad_point_removal: bool,
}

/// A vertex that greedy removal took out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Removal {
    /// Its position.
    pub point: Point,
    /// By how much the sum of errors changed, in the metric's whole numbers.
    pub change: i64,
}

/// How far removal has come, and when it ends.
pub(crate) struct Progress {
    pub(crate) rule: StopRule,
    /// Vertices to remove, unless a bound ends removal before.
    surplus: usize,
    /// Vertices not removed.
    remaining: usize,
    /// Sum of the errors of all faces.
    pub(crate) error: u64,
    pub(crate) removals: Vec<Removal>,
}

impl Progress {
    /// Progress at the start, with `count` vertices.
    pub(crate) fn new(rule: StopRule, count: usize, error: u64) -> Self {
        let surplus = count.saturating_sub(rule.size);
        let removals = Vec::with_capacity(surplus);
        Self { rule, surplus, remaining: count, error, removals }
    }

    /// Vertices still to remove.
    pub(crate) fn surplus_left(&self) -> usize {
        self.remaining.saturating_sub(self.rule.size)
    }

    /// Reports progress to the control.
    pub(crate) fn poll(&self, control: &dyn Control) -> Result<(), Cancelled> {
        control.poll(Stage::Simplify, self.surplus - self.surplus_left(), self.surplus)
    }

    /// Whether a removal with this change must not be made.
    pub(crate) fn must_stop(&self, change: i64) -> bool {
        let rule = self.rule;
        if self.remaining <= rule.size {
            return !(rule.bad_point_removal && change < 0);
        }
        let error = self.error.wrapping_add_signed(change);
        rule.bound.is_some_and(|most| error > most)
    }

    /// Counts the removal of the vertex at `point`.
    pub(crate) fn record(&mut self, point: Point, removed: Entry) {
        self.removals.push(Removal { point, change: removed.change });
        self.error = self.error.wrapping_add_signed(removed.change);
        self.remaining -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Progress with an error of 50 and 10 vertices, of which 6 may stay.
    fn progress(bound: Option<u64>, bad_point_removal: bool) -> Progress {
        let metric = ErrorMetric::MeanCompSe;
        Progress::new(StopRule { size: 6, bound, metric, bad_point_removal }, 10, 50)
    }

    #[test]
    fn stops_at_the_size_unless_a_point_raises_the_error() {
        for bad_point_removal in [false, true] {
            let above = progress(None, bad_point_removal);
            assert!([-1, 0, 1, i64::MAX].iter().all(|&change| !above.must_stop(change)));
            let at_size = Progress { remaining: 6, ..above };
            assert!(at_size.must_stop(0) && at_size.must_stop(1));
            assert_eq!(at_size.must_stop(-1), !bad_point_removal);
        }
    }

    #[test]
    fn stops_before_the_first_removal_that_breaks_the_bound() {
        let progress = progress(Some(60), false);
        assert!(!progress.must_stop(10) && progress.must_stop(11) && !progress.must_stop(-50));
    }

    #[test]
    fn reports_the_removals_made_up_to_the_surplus() {
        struct Expected(usize);
        impl Control for Expected {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                assert_eq!((stage, done, total), (Stage::Simplify, self.0, 4));
                Err(Cancelled)
            }
        }
        let mut progress = progress(None, true);
        for removed in 0..6 {
            assert_eq!(progress.poll(&Expected(removed.min(4))), Err(Cancelled));
            assert_eq!(progress.surplus_left(), 4_usize.saturating_sub(removed));
            progress.record(Point::new(1, 1), Entry { change: 0, rank: 0, vertex: 0 });
        }
    }
}
