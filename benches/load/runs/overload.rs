//! More and more requests per second, wanted or not, and what must stay quick meanwhile.

use super::capacity::{kernels_rate, rate};
use super::{Setting, driver_s, workers};
use crate::driver::{Outcome, Stream, open_loop, request};
use crate::report::{Curves, Result};
use crate::row;
use crate::server::Server;
use crate::statistics::percentile;
use crate::work::Work;
use std::time::{Duration, Instant};

/// Seconds for each load.
const PERIOD_S: f64 = 300.0;
/// What is offered, in multiples of the capacity.
const LOADS: [f64; 5] = [0.7, 1.0, 2.0, 5.0, 10.0];
/// Those of the short form.
const SHORT_LOADS: [f64; 2] = [0.7, 10.0];
/// Probes per second, of each kind.
const PROBES_PER_S: f64 = 10.0;
/// Seconds of work that the service lets wait.
const QUEUE_S: f64 = 10.0;
/// The same in the short form, so that the queue is full within its short periods.
const SHORT_QUEUE_S: f64 = 1.0;

/// What one load showed.
pub(super) struct Seen {
    pub(super) load: f64,
    pub(super) period: Duration,
    pub(super) work: Vec<Outcome>,
    pub(super) health: Vec<Outcome>,
    pub(super) refusals: Vec<Outcome>,
    /// The part of all processors that the driver took from the service.
    driver: Option<f64>,
}

pub(super) fn run(setting: &Setting) -> Result {
    let queue_s = if setting.is_short { SHORT_QUEUE_S } else { QUEUE_S };
    let server = Server::start(&["--queue-seconds", &queue_s.to_string()]);
    let work = Work::usual();
    let period = if setting.is_short { Duration::from_secs(6) } else { setting.period(PERIOD_S) };
    // Long enough that what waits at its end does not hide what happens during it.
    let period = period.max(Duration::from_secs_f64(2.0 * queue_s));
    let measuring = period.min(Duration::from_secs(30)) / 2;
    rate(&server, &work, 2 * workers(), measuring / 4);
    let kernels = if setting.is_short { Some(kernels_rate(measuring)) } else { None };
    let capacity = rate(&server, &work, 2 * workers(), measuring).rate;
    let solo_ms = rate(&server, &work, 1, measuring).latencies_ms;
    let loads = if setting.is_short { &SHORT_LOADS[..] } else { &LOADS };
    let seen: Vec<Seen> = loads
        .iter()
        .map(|&load| {
            let seen = under_load(&server, &work, load * capacity, load, period);
            // A queue that is still long must not be the next load's.
            server.wait_until_idle();
            seen
        })
        .collect();
    let mut figures = figures(&seen, &solo_ms, queue_s);
    figures.extend(kernels.map(|kernels| ("S1".to_owned(), 100.0 * capacity / kernels)));
    let notes = vec![
        format!(
            "Capacity {capacity:.2} meshes per second; alone p50 {:.0} ms; {} s for each load.",
            percentile(&solo_ms, 0.5),
            period.as_secs(),
        ),
        "Goodput counts what the driver's part of the processors leaves. What runs when a request \
         is let in, and the request itself, come on top of the seconds that the queue may hold."
            .to_owned(),
    ];
    Result { figures, rows: rows(&seen), notes, plots: plots(&seen, capacity) }
}

/// Offers work at a rate, and asks for health and for refusals meanwhile.
pub(super) fn under_load(
    server: &Server,
    work: &Work,
    per_second: f64,
    load: f64,
    period: Duration,
) -> Seen {
    let small = work.request(0);
    let image = &small.bytes[small.bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4..];
    let refusals = [
        request("422", "POST", "/v1/meshes?density=0", image),
        request("415", "POST", "/v1/meshes", b"no picture"),
        request("404", "GET", "/nothing", b""),
    ];
    let probes =
        ["/livez", "/readyz", "/metrics"].map(|target| request("health", "GET", target, b""));
    let make_work = |number: usize| work.request(number);
    let make_probe = |number: usize| probes[number % 3].clone();
    let make_refusal = |number: usize| refusals[number % 3].clone();
    let (public, operations) = (server.public, server.operations);
    let streams = [
        Stream { address: public, per_second, make: &make_work },
        Stream { address: operations, per_second: PROBES_PER_S, make: &make_probe },
        Stream { address: public, per_second: PROBES_PER_S, make: &make_refusal },
    ];
    let (before, start) = (driver_s(), Instant::now());
    let [work, health, refusals] = open_loop(&streams, period).try_into().unwrap();
    let processors_s = start.elapsed().as_secs_f64() * workers() as f64;
    let driver = driver_s().zip(before).map(|(after, before)| (after - before) / processors_s);
    Seen { load, period, work, health, refusals, driver }
}

impl Seen {
    /// The latencies of the requests for work that got a status.
    fn latencies_ms(&self, status: u16) -> Vec<f64> {
        let such = self.work.iter().filter(|outcome| outcome.status() == status);
        such.map(Outcome::latency_ms).collect()
    }

    /// Meshes per second: of what was due and answered within the period and the queue that it leaves.
    fn goodput(&self) -> f64 {
        let ends = self.work.iter().filter(|outcome| outcome.status() == 200);
        let within = ends.filter(|outcome| outcome.due + outcome.latency <= self.period);
        within.count() as f64 / self.period.as_secs_f64()
    }

    /// The latencies of health and metrics.
    pub(super) fn health_ms(&self) -> Vec<f64> {
        self.health.iter().map(Outcome::latency_ms).collect()
    }

    /// Health and metrics that did not answer 200.
    pub(super) fn health_failures(&self) -> usize {
        self.health.iter().filter(|outcome| outcome.status() != 200).count()
    }

    /// The latencies of everything that was refused.
    pub(super) fn refusals_ms(&self) -> Vec<f64> {
        let refused = self.refusals.iter().map(Outcome::latency_ms);
        refused.chain(self.latencies_ms(503)).collect()
    }
}

fn figures(seen: &[Seen], solo_ms: &[f64], queue_s: f64) -> Vec<(String, f64)> {
    let (steady, last) = (&seen[0], &seen[seen.len() - 1]);
    let peak = seen.iter().map(Seen::goodput).fold(0.0, f64::max);
    let over = seen.iter().filter(|seen| seen.load > 1.0);
    let least = over.clone().map(Seen::goodput).fold(f64::INFINITY, f64::min);
    let slowest = over.map(|seen| percentile(&seen.latencies_ms(200), 0.99)).fold(0.0, f64::max);
    let steady_ms = steady.latencies_ms(200);
    let health = last.health_ms();
    vec![
        ("S2".into(), 100.0 * least / peak),
        ("S3".into(), percentile(&health, 0.99)),
        ("S3b".into(), percentile(&health, 0.999)),
        ("S3c".into(), last.health_failures() as f64),
        ("S4".into(), percentile(&last.refusals_ms(), 0.99)),
        ("S5".into(), percentile(&steady_ms, 0.5) / percentile(solo_ms, 0.5)),
        ("S5b".into(), percentile(&steady_ms, 0.99) / percentile(solo_ms, 0.5)),
        ("S6".into(), (slowest - percentile(solo_ms, 0.99)) / 1e3 - queue_s),
    ]
}

fn rows(seen: &[Seen]) -> Vec<Vec<String>> {
    let mut rows = vec![row![
        "load",
        "offered per s",
        "meshes per s",
        "turned away per s",
        "failed",
        "p50, ms",
        "p90, ms",
        "p99, ms",
        "p99.9, ms",
        "health p99, ms",
        "refusals p99, ms",
        "driver, % of processors",
    ]];
    rows.extend(seen.iter().map(|seen| {
        let seconds = seen.period.as_secs_f64();
        let served = seen.latencies_ms(200);
        let shed = seen.latencies_ms(503).len();
        let failed = seen.work.len() - served.len() - shed;
        let p = |share| format!("{:.0}", percentile(&served, share));
        row![
            format!("{} x", seen.load),
            format!("{:.1}", seen.work.len() as f64 / seconds),
            format!("{:.2}", seen.goodput()),
            format!("{:.1}", shed as f64 / seconds),
            failed,
            p(0.5),
            p(0.9),
            p(0.99),
            p(0.999),
            format!("{:.1}", percentile(&seen.health_ms(), 0.99)),
            format!("{:.1}", percentile(&seen.refusals_ms(), 0.99)),
            seen.driver.map_or("–".into(), |share| format!("{:.0}", 100.0 * share)),
        ]
    }));
    rows
}

fn plots(seen: &[Seen], capacity: f64) -> Vec<Curves> {
    let curve = |label: &str, of: &dyn Fn(&Seen) -> f64| {
        (label.to_owned(), seen.iter().map(|seen| (seen.load, of(seen))).collect())
    };
    let plot = |name: &str, title: &str, y: &str, is_logarithmic, curves| Curves {
        name: name.into(),
        title: title.into(),
        x: "load, in multiples of the capacity".into(),
        y: y.into(),
        is_logarithmic,
        curves,
    };
    vec![
        plot(
            "goodput",
            "Goodput under load",
            "per second",
            false,
            vec![curve("meshes", &Seen::goodput), curve("capacity", &|_| capacity)],
        ),
        plot(
            "latency",
            "Latency under load",
            "ms",
            true,
            vec![
                curve("meshes p50", &|seen| percentile(&seen.latencies_ms(200), 0.5)),
                curve("meshes p99", &|seen| percentile(&seen.latencies_ms(200), 0.99)),
                curve("refusals p99", &|seen| percentile(&seen.refusals_ms(), 0.99)),
                curve("health p99", &|seen| percentile(&seen.health_ms(), 0.99)),
            ],
        ),
    ]
}
