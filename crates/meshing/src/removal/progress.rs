//! When greedy removal stops, and how far it has come.

use crate::control::{Cancelled, Control, Stage};
use crate::image::{Image, Point};
use crate::parameters::ErrorBound;
use crate::parameters::choices::ErrorMetric;
use crate::quality::fidelity::Fidelity;
use crate::removal::queue::Entry;

/// When removal ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StopRule {
    /// Vertices to keep.
    pub(crate) size: usize,
    /// A quality that no removal may take from the mesh.
    pub(crate) bound: Option<ErrorBound>,
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
pub(crate) struct Progress<'a> {
    image: &'a Image,
    pub(crate) rule: StopRule,
    /// Vertices to remove, unless a bound ends removal before.
    surplus: usize,
    /// Vertices not removed.
    remaining: usize,
    /// Sum of the errors of all faces.
    pub(crate) error: u64,
    pub(crate) removals: Vec<Removal>,
}

impl<'a> Progress<'a> {
    /// Progress at the start, with `count` vertices.
    pub(crate) fn new(image: &'a Image, rule: StopRule, count: usize, error: u64) -> Self {
        let surplus = count.saturating_sub(rule.size);
        let removals = Vec::with_capacity(surplus);
        Self { image, rule, surplus, remaining: count, error, removals }
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
        match rule.bound {
            None => false,
            Some(ErrorBound::PsnrDb(least)) => {
                Fidelity::of_sum(error, self.image).psnr_db() < least
            }
            // `max_error` finds the first removal that breaks it.
            Some(ErrorBound::MaxError(_)) => false,
            Some(ErrorBound::MeanError(most)) => rule.metric.mean(error, self.image) > most,
        }
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

    /// Progress on a picture of 100 points whose error is 50, with 10 vertices of which 6 may stay.
    fn progress(image: &Image, bound: Option<ErrorBound>, bad_point_removal: bool) -> Progress<'_> {
        let metric = ErrorMetric::MeanCompSe;
        let rule = StopRule { size: 6, bound, metric, bad_point_removal };
        Progress::new(image, rule, 10, 50)
    }

    fn picture() -> Image {
        Image::from_bottom_up(10, 10, 3, vec![vec![7; 100], vec![0; 100]]).unwrap()
    }

    #[test]
    fn stops_at_the_size_unless_a_point_raises_the_error() {
        let image = picture();
        for bad_point_removal in [false, true] {
            let above = progress(&image, None, bad_point_removal);
            assert!([-1, 0, 1, i64::MAX].iter().all(|&change| !above.must_stop(change)));
            let at_size = Progress { remaining: 6, ..above };
            assert!(at_size.must_stop(0) && at_size.must_stop(1));
            assert_eq!(at_size.must_stop(-1), !bad_point_removal);
        }
    }

    #[test]
    fn stops_before_the_first_removal_that_breaks_the_bound() {
        let image = picture();
        let with = |bound| progress(&image, Some(bound), false);
        // Two components of 100 points: the mean error is a two-hundredth of the sum.
        let mean = with(ErrorBound::MeanError(0.25 + 0.05));
        assert!(!mean.must_stop(10) && mean.must_stop(11));
        let psnr_db = Fidelity::of_sum(60, &image).psnr_db();
        let psnr = with(ErrorBound::PsnrDb(psnr_db));
        assert!(!psnr.must_stop(10) && psnr.must_stop(11) && !psnr.must_stop(-50));
        let max = with(ErrorBound::MaxError(3));
        assert!(!max.must_stop(1000));
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
        let image = picture();
        let mut progress = progress(&image, None, true);
        for removed in 0..6 {
            assert_eq!(progress.poll(&Expected(removed.min(4))), Err(Cancelled));
            assert_eq!(progress.surplus_left(), 4_usize.saturating_sub(removed));
            progress.record(Point::new(1, 1), Entry { change: 0, rank: 0, vertex: 0 });
        }
    }
}
