//! The runs, one module for each kind of load.

mod baseline;
mod capacity;
mod connections;
mod disk;
mod fair;
mod jobs;
mod memory;
mod mixed;
mod overload;
mod quota;
mod rolling;
mod same;
mod soak;
mod start;
mod tests;

use crate::report::Result;
use crate::server::Server;
use std::time::Duration;

/// One run.
pub(crate) struct Run {
    pub(crate) name: &'static str,
    pub(crate) what: &'static str,
    pub(crate) make: fn(&Setting) -> Result,
}

/// How runs are made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Setting {
    pub(crate) scale: f64,
    pub(crate) is_short: bool,
}

/// All runs, in the order in which they are made.
pub(crate) const RUNS: &[Run] = &[
    Run { name: "start", what: "start and idle memory", make: start::run },
    Run { name: "L1", what: "one client, sizes, methods and densities", make: baseline::run },
    Run { name: "L2", what: "more and more clients that wait for answers", make: capacity::run },
    Run { name: "L3", what: "more and more requests, wanted or not", make: overload::run },
    Run { name: "L4", what: "a mix of sizes, and bad requests", make: mixed::run },
    Run { name: "L5", what: "the largest uploads together, then slow readers", make: memory::run },
    Run { name: "L6", what: "a long time", make: soak::run },
    Run { name: "L7", what: "kill -9 at random moments", make: tests::kills },
    Run { name: "L8", what: "SIGTERM at saturation", make: tests::terms },
    Run { name: "L9", what: "slow and vanishing clients", make: connections::run },
    Run { name: "L10", what: "half a processor, and two", make: quota::run },
    Run { name: "L11", what: "a full disk, and one that cannot be written to", make: disk::run },
    Run { name: "L12", what: "a rolling restart behind a proxy", make: rolling::run },
    Run { name: "fair", what: "one client's load beside another's", make: fair::run },
    Run {
        name: "jobs",
        what: "submissions, and the status of one job among many",
        make: jobs::run,
    },
    Run { name: "same", what: "the same requests again and again", make: same::run },
];

impl Setting {
    /// A period of the full length, scaled; never under half a second.
    pub(crate) fn period(&self, seconds: f64) -> Duration {
        Duration::from_secs_f64((seconds * self.scale).max(0.5))
    }

    /// A number of repetitions, scaled; never under `least`.
    pub(crate) fn count(&self, full: usize, least: usize) -> usize {
        ((full as f64 * self.scale) as usize).max(least)
    }
}

/// Workers of the service: one for each processor.
pub(crate) fn workers() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Processor time that the service has used, in seconds.
pub(crate) fn processor_s(server: &Server) -> f64 {
    server.metric("process_cpu_seconds_total")
}

/// Processor time that this driver has used, in seconds; nothing where the system does not tell.
pub(crate) fn driver_s() -> Option<f64> {
    /// Per second, in what Linux tells programs.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = fields.split_whitespace().skip(11).take(2).map(|field| field.parse::<f64>().ok());
    Some(ticks.sum::<Option<f64>>()? / TICKS)
}

/// A row of a table.
#[macro_export]
macro_rules! row {
    ($($cell:expr),* $(,)?) => { vec![$($cell.to_string()),*] };
}
