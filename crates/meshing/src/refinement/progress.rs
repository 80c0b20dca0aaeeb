//! Progress of refinement, step by step.

use crate::control::{Cancelled, Control, Stage, Translated};
use std::sync::atomic::{AtomicUsize, Ordering};

const UNITS: usize = 1000;

/// Reports the beginning of a step after `steps_done` of `count` steps. Returns a control that
/// reports progress of the step as progress of all steps, which never decreases.
pub(super) fn begin_step(
    control: &dyn Control,
    steps_done: usize,
    count: usize,
) -> Result<impl Control, Cancelled> {
    let reported = AtomicUsize::new(0);
    let translate = move |stage, done: usize, total: usize| {
        let units = done.min(total) * UNITS / total.max(1);
        let units = reported.fetch_max(units, Ordering::Relaxed).max(units);
        (stage, steps_done * UNITS + units, count * UNITS)
    };
    let step = Translated { control, translate };
    step.poll(Stage::Refine, 0, 1)?;
    Ok(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use std::num::NonZeroUsize;

    #[test]
    fn progress_never_decreases() {
        let recorder = Recorder::cancelling_at(6);
        let seven = OnThreads(&recorder, NonZeroUsize::new(7).unwrap());
        let progress = begin_step(&seven, 2, 5).unwrap();
        assert_eq!(progress.threads().get(), 7);
        for (done, total) in [(0, 0), (5, 10), (3, 10), (60, 100), (12, 10)] {
            progress.poll(Stage::Refine, done, total).unwrap();
        }
        assert_eq!(progress.poll(Stage::Refine, 10, 10), Err(Cancelled));
        drop(progress);
        let reported = recorder.done(Stage::Refine, 5 * UNITS);
        assert_eq!(reported, [2000, 2000, 2500, 2500, 2600, 3000, 3000]);
    }
}
