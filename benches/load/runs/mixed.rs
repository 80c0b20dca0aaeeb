//! A mix as a public service has it: many small pictures, some large ones, and what is no good.

use super::{Setting, workers};
use crate::driver::{Outcome, Request, Stream, open_loop, request, together};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::statistics::percentile;
use crate::work::Work;
use std::time::{Duration, Instant};

/// Seconds of the mix.
const PERIOD_S: f64 = 600.0;
/// The part of the workers' time that it takes.
const LOAD: f64 = 0.7;
/// The method of the large ones, which would outlast the deadline with the default.
const LARGE: &str = "method=med&density=1";

/// Requests of all classes, and which comes when.
pub(super) struct Mix {
    small: Work,
    medium: Work,
    large: Work,
    bad: Vec<Request>,
}

impl Mix {
    /// A mix whose largest pictures have so many megapixels.
    pub(super) fn new(largest: f64) -> Self {
        let sizes = [0.1, 0.2, 0.4, 1.0];
        let small = sizes.map(|size| Work::new("0.1 to 1 MP", size, "density=2", 4));
        let bad = [
            ("/v1/meshes?density=0", &b"P5\n2 2\n255\n0000"[..]),
            ("/v1/meshes", b"no picture"),
            ("/v1/meshes", b"\x89PNG\r\n\x1a\ncut off"),
            ("/v1/meshes", b"P5\n16000 16000\n255\n"),
            ("/v1/meshes?method=none", b"P5\n2 2\n255\n0000"),
        ];
        Self {
            small: Work::all(&small),
            medium: Work::new("4 to 12 MP", 6.0, LARGE, 3),
            large: Work::new("40 MP", largest, LARGE, 1),
            bad: bad.map(|(target, body)| request("bad", "POST", target, body)).to_vec(),
        }
    }

    /// The request of a number: of each hundred 90 are small, 9 medium and one large, and every
    /// twenty-first is no good.
    pub(super) fn request(&self, number: usize) -> Request {
        if number % 21 == 20 {
            return self.bad[number / 21 % self.bad.len()].clone();
        }
        match number * 37 % 100 {
            0 => self.large.request(number),
            1..=9 => self.medium.request(number),
            _ => self.small.request(number),
        }
    }

    /// Seconds that a request takes on average, alone.
    pub(super) fn mean_s(&self, server: &Server) -> f64 {
        let solo = |work: &Work, count: usize| {
            let began = Instant::now();
            for number in 0..count {
                let outcome = &together(server.public, &[work.request(number)])[0];
                assert_eq!(outcome.status(), 200, "{outcome:?}");
            }
            began.elapsed().as_secs_f64() / count as f64
        };
        0.95 * (0.9 * solo(&self.small, 8)
            + 0.09 * solo(&self.medium, 2)
            + 0.01 * solo(&self.large, 1))
    }
}

pub(super) fn run(setting: &Setting) -> Result {
    let largest = if setting.scale < 0.2 { 12.0 } else { 40.0 };
    let server = Server::start(&["--memory-budget", "4GiB", "--sync-deadline", "2m"]);
    let mix = Mix::new(largest);
    let per_second = LOAD * workers() as f64 / mix.mean_s(&server);
    let make = |number| mix.request(number);
    let stream = Stream { address: server.public, per_second, make: &make };
    let period = setting.period(PERIOD_S).max(Duration::from_secs(20));
    let outcomes = open_loop(&[stream], period).remove(0);
    let mut rows =
        vec![row!["class", "requests", "200", "503", "4xx", "none", "p50, ms", "p99, ms"]];
    for class in ["0.1 to 1 MP", "4 to 12 MP", "40 MP", "bad"] {
        rows.push(class_row(class, &outcomes));
    }
    let bad: Vec<f64> =
        outcomes.iter().filter(|outcome| outcome.class == "bad").map(Outcome::latency_ms).collect();
    server.wait_until_idle();
    Result {
        rows,
        notes: vec![format!(
            "{per_second:.2} requests per second for {} s, {:.0} % of the workers' time; the largest \
             had {largest} megapixels; bad requests were refused within {:.1} ms (p99).",
            period.as_secs(),
            100.0 * LOAD,
            percentile(&bad, 0.99),
        )],
        ..Result::default()
    }
}

fn class_row(class: &str, outcomes: &[Outcome]) -> Vec<String> {
    let of_class: Vec<_> = outcomes.iter().filter(|outcome| outcome.class == class).collect();
    let count = |matches: &dyn Fn(u16) -> bool| {
        of_class.iter().filter(|outcome| matches(outcome.status())).count()
    };
    let latencies: Vec<f64> = of_class.iter().map(|outcome| outcome.latency_ms()).collect();
    row![
        class,
        of_class.len(),
        count(&|status| status == 200),
        count(&|status| status == 503),
        count(&|status| (400..500).contains(&status)),
        count(&|status| status == 0),
        format!("{:.0}", percentile(&latencies, 0.5)),
        format!("{:.0}", percentile(&latencies, 0.99)),
    ]
}
