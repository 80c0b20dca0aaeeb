//! One client's load beside another's.

use super::Setting;
use crate::client::Answer;
use crate::keys::KeysFile;
use crate::pictures::{disc, noise};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::statistics::{ms, percentile};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

/// Clients that send large pictures at the same time.
const GREEDY_CLIENTS: usize = 100;
/// How long one of them waits after a refusal: together they fill a link of a gigabit per second.
const PAUSE: Duration = Duration::from_secs(1);
/// Requests of the other key.
const SAMPLES: usize = 2000;

/// Sends small pictures of one key beside one client and beside many clients of another.
pub(super) fn run(setting: &Setting) -> Result {
    let shared = Shared::start(setting.count(SAMPLES, 40));
    let (small, large) = (disc(316, 316, 3), noise(1448));
    let normal = shared.latencies_beside(1, "", &small);
    let beside = shared.latencies_beside(GREEDY_CLIENTS, "density=1", &large);
    let row = |what: &str, latencies: &[Latency]| {
        let of = |part: fn(&Latency) -> f64, share: f64| {
            let values: Vec<f64> = latencies.iter().map(part).collect();
            format!("{:.0}", percentile(&values, share))
        };
        let [took, queue]: [fn(&Latency) -> f64; 2] = [|one| one.ms, |one| one.in_queue_ms];
        row![what, of(took, 0.5), of(took, 0.99), of(queue, 0.5), of(queue, 0.99)]
    };
    let p99 = |latencies: &[Latency]| {
        percentile(&latencies.iter().map(|one| one.ms).collect::<Vec<_>>(), 0.99)
    };
    Result {
        figures: vec![("S12".into(), p99(&beside) / p99(&normal))],
        rows: vec![
            row!["beside", "p50, ms", "p99, ms", "in the queue p50, ms", "in the queue p99, ms"],
            row("one client", &normal),
            row("a hundred clients with large pictures", &beside),
        ],
        notes: vec!["Two workers; each key has one of them.".into()],
        ..Result::default()
    }
}

/// What one request took.
struct Latency {
    ms: f64,
    in_queue_ms: f64,
}

/// A server that two keys use.
struct Shared {
    server: Server,
    greedy: String,
    modest: String,
    samples: usize,
}

impl Shared {
    fn start(samples: usize) -> Self {
        let file = KeysFile::new("fairness");
        let [greedy, modest] =
            ["greedy", "modest"].map(|name| format!("Bearer {}", file.issue(name)));
        let flags = ["--workers", "2", "--keys-file", file.path(), "--sync-deadline", "10s"];
        let quota = ["--key-requests-per-minute", "1000000"];
        let server = Server::start(&[flags.as_slice(), &quota].concat());
        Self { server, greedy, modest, samples }
    }

    /// Sends small pictures of the modest key, one after another.
    fn latencies(&self) -> Vec<Latency> {
        let small = disc(316, 316, 3);
        let headers = [("Authorization", self.modest.as_str())];
        let send = |_| {
            let answer = self.server.mesh("", &headers, &small);
            assert_eq!(answer.status, 200, "none is refused");
            Latency { ms: ms(answer.took), in_queue_ms: in_queue_ms(&answer) }
        };
        (0..self.samples).map(send).collect()
    }

    /// Sends pictures of the greedy key again and again until it is told to stop.
    fn send_greedily(&self, query: &str, image: &[u8], stop: &AtomicBool, served: &AtomicUsize) {
        let headers = [("Authorization", self.greedy.as_str())];
        while !stop.load(Ordering::Relaxed) {
            let answer = self.server.mesh(query, &headers, image);
            assert!([200, 429, 503].contains(&answer.status), "{}", answer.text());
            served.fetch_add(usize::from(answer.status == 200), Ordering::Relaxed);
            if answer.status != 200 {
                thread::sleep(PAUSE);
            }
        }
    }

    /// The latencies of the modest key while the other has so many clients.
    fn latencies_beside(&self, clients: usize, query: &str, image: &[u8]) -> Vec<Latency> {
        let (stop, served) = (AtomicBool::new(false), AtomicUsize::new(0));
        let latencies = thread::scope(|scope| {
            for _ in 0..clients {
                scope.spawn(|| self.send_greedily(query, image, &stop, &served));
            }
            self.server.wait_until("the greedy one has its share", || {
                self.server.metric("pixmesh_jobs_in_progress") >= 1.0
            });
            thread::sleep(PAUSE);
            let latencies = self.latencies();
            stop.store(true, Ordering::Relaxed);
            latencies
        });
        assert!(served.load(Ordering::Relaxed) > 0, "the greedy one was served too");
        latencies
    }
}

/// How long a request waited for a worker and memory.
fn in_queue_ms(answer: &Answer) -> f64 {
    let timing = answer.header("server-timing").strip_prefix("queue;dur=").unwrap();
    timing.split(',').next().unwrap().parse().unwrap()
}
