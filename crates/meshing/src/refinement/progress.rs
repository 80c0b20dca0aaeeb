//! Progress of refinement, step by step.

use crate::control::{Cancelled, Control, Stage};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Resolution of the progress within a step.
const UNITS: usize = 1000;

/// Reports the progress of one step as a part of all steps; it never decreases.
pub(super) struct StepProgress<'a> {
    control: &'a dyn Control,
    /// Steps done before, and all steps.
    done: usize,
    count: usize,
    /// Units of this step that have been reported.
    reported: AtomicUsize,
}

impl<'a> StepProgress<'a> {
    /// Reports the beginning of a step.
    pub(super) fn begin(
        control: &'a dyn Control,
        done: usize,
        count: usize,
    ) -> Result<Self, Cancelled> {
        let progress = Self { control, done, count, reported: AtomicUsize::new(0) };
        progress.poll(Stage::Refine, 0, 1)?;
        Ok(progress)
    }
}

impl Control for StepProgress<'_> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        let units = done.min(total) * UNITS / total.max(1);
        let units = self.reported.fetch_max(units, Ordering::Relaxed).max(units);
        self.control.poll(stage, self.done * UNITS + units, self.count * UNITS)
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;

    #[test]
    fn progress_never_decreases() {
        let recorder = Recorder::cancelling_at(6);
        let seven = OnThreads(&recorder, NonZeroUsize::new(7).unwrap());
        let progress = StepProgress::begin(&seven, 2, 5).unwrap();
        assert_eq!(progress.threads().get(), 7);
        for (done, total) in [(0, 0), (5, 10), (3, 10), (60, 100), (12, 10)] {
            progress.poll(Stage::Refine, done, total).unwrap();
        }
        assert_eq!(progress.poll(Stage::Refine, 10, 10), Err(Cancelled));
        let reported = recorder.done(Stage::Refine, 5 * UNITS);
        assert_eq!(reported, [2000, 2000, 2500, 2500, 2600, 3000, 3000]);
    }
}
