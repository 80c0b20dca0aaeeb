//! A mix for a long time: the process must not grow.

use super::mixed::Mix;
use super::{Setting, workers};
use crate::driver::{Stream, open_loop};
use crate::report::{Curves, Result};
use crate::row;
use crate::server::Server;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Seconds of the soak.
const PERIOD_S: f64 = 3600.0;
/// The part of it after which memory is compared with that at the end: five minutes of an hour.
const WARM: f64 = 1.0 / 12.0;
/// The part of the workers' time that the mix takes.
const LOAD: f64 = 0.8;
/// Samples of the resident memory.
const SAMPLES: u32 = 200;

pub(super) fn run(setting: &Setting) -> Result {
    let server = Server::start(&["--sync-deadline", "2m"]);
    let mix = Mix::new(6.0);
    let per_second = LOAD * workers() as f64 / mix.mean_s(&server);
    let period = setting.period(PERIOD_S).max(Duration::from_secs(30));
    let is_over = AtomicBool::new(false);
    let (samples, outcomes) = thread::scope(|scope| {
        let watch = scope.spawn(|| watch(&server, period / SAMPLES, &is_over));
        let make = |number| mix.request(number);
        let stream = Stream { address: server.public, per_second, make: &make };
        let outcomes = open_loop(&[stream], period).remove(0);
        is_over.store(true, Ordering::Relaxed);
        (watch.join().unwrap(), outcomes)
    });
    let warm_s = period.as_secs_f64() * WARM;
    // Work in progress takes memory: what is compared is the most of a twelfth of the time.
    let most = |from: f64| {
        let within = samples.iter().filter(|(at, _)| (from..from + warm_s).contains(at));
        within.map(|&(_, mib)| mib).fold(0.0, f64::max)
    };
    let (warm, end) = (most(warm_s), most(period.as_secs_f64() - warm_s));
    let served = outcomes.iter().filter(|outcome| outcome.status() == 200).count();
    Result {
        figures: vec![("S8".into(), end - warm - (warm * 0.1).max(64.0))],
        rows: vec![
            row![
                "seconds",
                "requests",
                "meshes",
                "resident early, MiB",
                "resident at the end, MiB"
            ],
            row![
                period.as_secs(),
                outcomes.len(),
                served,
                format!("{warm:.0}"),
                format!("{end:.0}")
            ],
        ],
        plots: vec![Curves {
            name: "soak".into(),
            title: "Resident memory over a long run".into(),
            x: "seconds".into(),
            y: "MiB".into(),
            is_logarithmic: false,
            curves: vec![("resident".into(), samples)],
        }],
        ..Result::default()
    }
}

/// The resident memory in MiB, now and then, until it is over.
fn watch(server: &Server, pause: Duration, is_over: &AtomicBool) -> Vec<(f64, f64)> {
    let (began, mut samples) = (Instant::now(), Vec::new());
    while !is_over.load(Ordering::Relaxed) {
        let mib = server.memory_kib("VmRSS") as f64 / 1024.0;
        samples.push((began.elapsed().as_secs_f64(), mib));
        thread::sleep(pause);
    }
    samples
}
