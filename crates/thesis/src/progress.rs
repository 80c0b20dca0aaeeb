//! Progress on standard error, when that is a terminal, and what must be said at any rate.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::{self, Write};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A bar of the meshes of the current picture; it vanishes in the end.
pub struct Progress {
    bar: ProgressBar,
    /// Pictures begun.
    begun: AtomicUsize,
    /// Pictures in all.
    all: usize,
}

impl Progress {
    /// A bar for a number of pictures.
    #[must_use]
    pub fn new(all: usize) -> Self {
        let bar = ProgressBar::new(0);
        let template = "{msg} {wide_bar} {pos} of {len} meshes, {eta} to go";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self { bar, begun: AtomicUsize::new(0), all }
    }

    /// Names the picture that comes next.
    pub fn begin_picture(&self, name: &str) {
        let number = 1 + self.begun.fetch_add(1, Ordering::Relaxed);
        self.bar.set_message(format!("{name} ({number} of {})", self.all));
    }

    /// Starts the bar of the picture: meshes that are there, and those to make.
    pub fn expect(&self, there: usize, to_make: usize) {
        self.bar.set_length((there + to_make) as u64);
        self.bar.set_position(there as u64);
        // The meshes that are there took no time, by which the rest must not be estimated.
        self.bar.reset_eta();
    }

    /// Counts a mesh.
    pub fn advance(&self) {
        self.bar.inc(1);
    }

    /// Writes a line beside the bar.
    pub fn say(&self, line: &str) {
        // Nobody is left to tell when standard error is closed.
        self.bar.suspend(|| writeln!(io::stderr(), "{line}")).unwrap_or_default();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
