//! Progress on the terminal and the time of each stage.

use indicatif::{ProgressBar, ProgressStyle};
use pixmesh_meshing::{Cancelled, Control, Stage};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Shows the progress of the kernels on standard error, when that is a terminal, and notes how
/// long each stage takes.
pub struct Attendant {
    bar: ProgressBar,
    timings: Mutex<Timings>,
}

/// Steps of the bar.
const STEPS: u64 = 1000;

/// The stages so far and the running one.
#[derive(Default)]
struct Timings {
    ended: Vec<(Stage, Duration)>,
    running: Option<(Stage, Instant)>,
}

impl Attendant {
    /// An attendant who waits for the first stage.
    #[must_use]
    pub fn new() -> Self {
        let bar = ProgressBar::new(STEPS);
        let template = "{msg:11} {wide_bar} {percent:>3} %, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self { bar, timings: Mutex::default() }
    }

    /// Ends the running stage, clears the bar, and returns the time that each stage took.
    #[must_use]
    pub fn finish(self) -> Vec<(Stage, Duration)> {
        self.bar.finish_and_clear();
        let mut timings = self.timings.into_inner().unwrap_or_else(PoisonError::into_inner);
        timings.end();
        timings.ended
    }

    /// Takes note of a stage that begins.
    fn begin(&self, stage: Stage) {
        let mut timings = self.timings.lock().unwrap_or_else(PoisonError::into_inner);
        if timings.running.is_some_and(|(running, _)| running == stage) {
            return;
        }
        timings.end();
        timings.running = Some((stage, Instant::now()));
        self.bar.set_message(stage.name());
    }
}

impl Default for Attendant {
    fn default() -> Self {
        Self::new()
    }
}

impl Timings {
    /// Moves the running stage to those that ended.
    fn end(&mut self) {
        if let Some((stage, since)) = self.running.take() {
            self.ended.push((stage, since.elapsed()));
        }
    }
}

impl Control for Attendant {
    fn poll(&self, stage: Stage, done: usize, _: usize) -> Result<(), Cancelled> {
        if done == 0 {
            self.begin(stage);
        }
        Ok(())
    }

    fn whole(&self, fraction: f64) {
        self.bar.set_position((fraction * STEPS as f64) as u64);
    }
}
