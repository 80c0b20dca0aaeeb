//! How many meshes per second there are at most, beside what the kernels do alone.

use super::{Setting, workers};
use crate::driver::{Outcome, closed_loop};
use crate::report::{Curves, Result};
use crate::row;
use crate::server::Server;
use crate::statistics::percentile;
use crate::work::{Work, mesh_alone, picture_of};
use pixmesh_meshing::{Method, Target};
use std::iter;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Seconds for each number of clients, and for the kernels alone.
const PERIOD_S: f64 = 60.0;
/// In so many parts, by turns: a machine that others use too is not always as fast.
const ROUNDS: u32 = 3;

pub(super) fn run(setting: &Setting) -> Result {
    let (server, work) = (Server::start(&[]), Work::usual());
    let period = setting.period(PERIOD_S) / ROUNDS;
    let numbers = iter::successors(Some(1), |clients| Some(2 * clients));
    let mut all: Vec<(usize, Measured)> = numbers
        .take_while(|&clients| clients <= 4 * workers())
        .map(|clients| (clients, Measured::default()))
        .collect();
    let mut alone = 0.0;
    for _ in 0..ROUNDS {
        alone += kernels_rate(period) / f64::from(ROUNDS);
        for (clients, measured) in &mut all {
            let Measured { rate, latencies_ms } = rate(&server, &work, *clients, period);
            measured.rate += rate / f64::from(ROUNDS);
            measured.latencies_ms.extend(latencies_ms);
        }
    }
    let curve: Vec<_> =
        all.iter().map(|(clients, measured)| (*clients as f64, measured.rate)).collect();
    let best = curve.iter().map(|&(_, rate)| rate).fold(0.0, f64::max);
    let mut rows = vec![row!["clients", "meshes per s", "p50, ms", "p99, ms"]];
    rows.extend(all.iter().map(|(clients, measured)| {
        row![
            clients,
            format!("{:.2}", measured.rate),
            format!("{:.0}", percentile(&measured.latencies_ms, 0.5)),
            format!("{:.0}", percentile(&measured.latencies_ms, 0.99)),
        ]
    }));
    Result {
        figures: vec![("S1".into(), 100.0 * best / alone)],
        rows,
        notes: vec![format!(
            "The kernels alone, on {} threads: {alone:.2} meshes per second.",
            workers()
        )],
        plots: vec![Curves {
            name: "capacity".into(),
            title: "Meshes per second".into(),
            x: "clients".into(),
            y: "per second".into(),
            is_logarithmic: false,
            curves: vec![
                ("service".into(), curve.clone()),
                ("kernels alone".into(), curve.iter().map(|&(x, _)| (x, alone)).collect()),
            ],
        }],
    }
}

/// What a closed loop saw.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) rate: f64,
    pub(super) latencies_ms: Vec<f64>,
}

/// Meshes per second for so many clients, each of which waits for its answer.
pub(super) fn rate(server: &Server, work: &Work, clients: usize, period: Duration) -> Measured {
    let began = Instant::now();
    let outcomes = closed_loop(server.public, clients, period, &|number| work.request(number));
    let seconds = began.elapsed().as_secs_f64();
    for outcome in &outcomes {
        assert!([200, 503].contains(&outcome.status()), "{outcome:?}");
    }
    let served = outcomes.iter().filter(|outcome| outcome.status() == 200);
    let latencies_ms: Vec<f64> = served.map(Outcome::latency_ms).collect();
    Measured { rate: latencies_ms.len() as f64 / seconds, latencies_ms }
}

/// Meshes per second without a service, on as many threads as it has workers.
pub(super) fn kernels_rate(period: Duration) -> f64 {
    let pictures: Vec<Vec<u8>> = (0..16).map(|seed| picture_of(0.2, seed)).collect();
    let parameters = Method::Mgprfs.parameters(Target::Percent(2.0));
    let (done, began) = (AtomicUsize::new(0), Instant::now());
    thread::scope(|scope| {
        for _ in 0..workers() {
            scope.spawn(|| {
                while began.elapsed() < period {
                    let number = done.fetch_add(1, Ordering::Relaxed);
                    mesh_alone(&pictures[number % pictures.len()], &parameters);
                }
            });
        }
    });
    done.into_inner() as f64 / began.elapsed().as_secs_f64()
}
