//! Work on all cores with a progress bar, and the line that tells its result.

use crate::CliError;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pixmesh_engine::Context;
use serde_json::Value;
use std::io::{self, IsTerminal, Write};
use std::num::NonZeroUsize;
use std::thread;
use std::time::Duration;

/// How results are told.
#[derive(Args, Clone, Debug)]
pub struct Telling {
    /// Tell the result as one line of JSON on standard output; on standard error if the result goes
    /// to standard output
    #[arg(long)]
    pub json: bool,
    /// Show no progress, and tell no result
    #[arg(short, long)]
    pub quiet: bool,
}

/// Steps of the bar, and the time between two looks at the work.
const STEPS: u64 = 1000;
const LOOK: Duration = Duration::from_millis(50);

impl Telling {
    /// Whether somebody watches.
    fn is_watched(&self) -> bool {
        !self.quiet && !self.json && io::stderr().is_terminal()
    }

    /// Does the work on all cores. Its progress is shown on a terminal.
    pub fn work<T: Send>(&self, work: impl FnOnce(&Context) -> T + Send) -> T {
        let cores = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let context = Context::on_threads(cores);
        if !self.is_watched() {
            return work(&context);
        }
        let bar = ProgressBar::new(STEPS);
        let template = "{msg:11} {wide_bar} {percent:>3} %, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        thread::scope(|scope| {
            let worker = scope.spawn(|| work(&context));
            while !worker.is_finished() {
                if let Some(progress) = context.progress() {
                    bar.set_message(progress.stage);
                    bar.set_position((progress.whole * STEPS as f64) as u64);
                }
                thread::park_timeout(LOOK);
            }
            bar.finish_and_clear();
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// Tells a result: as JSON where that is asked for, else as a line on a terminal.
    ///
    /// # Errors
    /// When standard output cannot be written.
    pub fn tell(&self, facts: &Value, line: &str, to_errors: bool) -> Result<(), CliError> {
        if self.json && !to_errors {
            return print(&facts.to_string());
        }
        let text = if self.json { facts.to_string() } else { line.to_owned() };
        if self.json || self.is_watched() {
            // A line that nobody can read is no reason to fail.
            let _ = writeln!(io::stderr(), "{text}");
        }
        Ok(())
    }
}

/// Prints a line on standard output.
///
/// # Errors
/// When that cannot be written.
pub fn print(line: &str) -> Result<(), CliError> {
    crate::files::write(None, format!("{line}\n").as_bytes())
}
