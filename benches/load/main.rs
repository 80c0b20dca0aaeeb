//! Load tests: what the service gives under load, against the levels of `levels.json`.
//!
//! ```text
//! cargo bench --bench load                             every run at full length: five hours
//! cargo bench --bench load -- --scale 0.05             each period a twentieth: a quarter of an hour
//! cargo bench --bench load -- L3 L9 --scale 0.1        some of the runs
//! cargo bench --bench load -- --report docs            writes docs/load.md, and its plots to docs/load
//! cargo test --bench load -- --short                   a minute, unoptimised, with loose levels
//! ```
//!
//! Requests are sent in an open loop wherever latency counts: each at its time, whatever became of those
//! before it, and its latency counts from then. Closed loops would wait with the service and hide what it
//! makes others wait. The results of runs made one after another are kept beside the report, which shows
//! them all. The driver shares the machine with the service, and takes a part of what it measures.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a measurement that cannot go on has failed")]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the figures are what this is for")]
#![allow(dead_code, unreachable_pub, reason = "it shares what the tests have")]

#[path = "../../tests/service/client.rs"]
mod client;
mod driver;
mod group;
#[path = "../../tests/service/keys.rs"]
mod keys;
mod levels;
#[path = "../../tests/service/pictures.rs"]
mod pictures;
#[path = "../../crates/cli/examples/quality/plot.rs"]
mod plot;
mod report;
mod runs;
#[path = "../../tests/service/server.rs"]
mod server;
mod statistics;
mod work;

use clap::Parser;
use levels::Levels;
use report::Report;
use runs::{RUNS, Run, Setting};
use std::panic::catch_unwind;
use std::path::PathBuf;
use std::process::ExitCode;

/// Load tests of the service.
#[derive(Parser)]
struct Flags {
    /// Runs to make, such as L3; all of them when none is named.
    runs: Vec<String>,
    /// Multiplies every period, and the number of repetitions.
    #[arg(long, default_value_t = 1.0)]
    scale: f64,
    /// Folder for the report and its plots.
    #[arg(long, default_value = concat!(env!("CARGO_TARGET_TMPDIR"), "/load"))]
    report: PathBuf,
    /// The short form: a few of the runs, a minute in all, against loose levels; makes no report.
    #[arg(long)]
    short: bool,
    /// What Cargo says to every benchmark.
    #[arg(long, hide = true)]
    bench: bool,
}

/// The runs of the short form, and its scale.
const SHORT: [&str; 4] = ["L1", "L3", "fair", "same"];
const SHORT_SCALE: f64 = 0.01;

fn main() -> ExitCode {
    let flags = Flags::parse();
    let setting = Setting {
        scale: if flags.short { SHORT_SCALE } else { flags.scale },
        is_short: flags.short,
    };
    let levels = Levels::read();
    let chosen = match chosen(&flags) {
        Ok(chosen) => chosen,
        Err(unknown) => {
            eprintln!("there is no run {unknown}: choose of {}", names(RUNS).join(", "));
            return ExitCode::FAILURE;
        }
    };
    let mut report = Report::open(&flags.report);
    let mut is_met = true;
    for run in chosen {
        println!("== {}: {}", run.name, run.what);
        // One that cannot go on is told in the report, and the others are made.
        let result = catch_unwind(|| (run.make)(&setting)).unwrap_or_else(|_| {
            is_met = false;
            let notes =
                vec!["This run ended early, by an error of its own or of the service.".into()];
            report::Result { notes, ..report::Result::default() }
        });
        is_met &= levels.print(&result, flags.short);
        if !flags.short {
            report.keep(run.name, setting.scale, result, &levels);
        }
    }
    if !flags.short {
        println!("{} has the report", report.path().display());
    }
    // At length the report says what is met and what not; the short form is a test.
    if is_met || !flags.short { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The runs that the flags name.
fn chosen(flags: &Flags) -> Result<Vec<&'static Run>, String> {
    let wanted = match (&flags.runs, flags.short) {
        (runs, _) if !runs.is_empty() => runs.clone(),
        (_, true) => SHORT.map(str::to_owned).to_vec(),
        _ => names(RUNS),
    };
    let find = |name: &String| {
        RUNS.iter().find(|run| run.name.eq_ignore_ascii_case(name)).ok_or_else(|| name.clone())
    };
    wanted.iter().map(find).collect()
}

fn names(runs: &[Run]) -> Vec<String> {
    runs.iter().map(|run| run.name.to_owned()).collect()
}
