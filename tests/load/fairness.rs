//! One client's work beside another's.

use crate::client::Answer;
use crate::keys::KeysFile;
use crate::pictures::{disc, noise};
use crate::server::Server;
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

/// Clients that send large pictures at the same time.
const GREEDY_CLIENTS: usize = 100;
/// How long one of them waits after a refusal: together they fill a link of a gigabit per second.
const PAUSE: Duration = Duration::from_secs(1);
/// Requests whose longest is the 99th percentile.
const SAMPLES: usize = 40;
/// Measurements, of which one must be good: what else the machine does disturbs them.
const ATTEMPTS: usize = 4;

/// What the requests of one client took.
struct Latency {
    longest: Duration,
    longest_in_queue_ms: f64,
}

impl fmt::Display for Latency {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let longest_ms = 1000.0 * self.longest.as_secs_f64();
        write!(out, "{longest_ms:.0} ms, {:.1} ms of them in the queue", self.longest_in_queue_ms)
    }
}

/// A server that two keys use.
struct Shared {
    server: Server,
    greedy: String,
    modest: String,
}

impl Shared {
    fn start() -> Self {
        let file = KeysFile::new("fairness");
        let [greedy, modest] =
            ["greedy", "modest"].map(|name| format!("Bearer {}", file.issue(name)));
        let flags = ["--workers", "2", "--keys-file", file.path(), "--sync-deadline", "10s"];
        let quota = ["--key-requests-per-minute", "1000000"];
        Self { server: Server::start(&[flags.as_slice(), &quota].concat()), greedy, modest }
    }

    /// Sends small pictures of the modest key, one after another.
    fn latency(&self) -> Latency {
        let small = disc(316, 316, 3);
        let headers = [("Authorization", self.modest.as_str())];
        let answers: Vec<Answer> =
            (0..SAMPLES).map(|_| self.server.mesh("", &headers, &small)).collect();
        assert!(answers.iter().all(|answer| answer.status == 200), "none is refused");
        Latency {
            longest: answers.iter().map(|answer| answer.took).max().unwrap(),
            longest_in_queue_ms: answers.iter().map(in_queue_ms).fold(0.0, f64::max),
        }
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

    /// The latency of the modest key while the other has so many clients.
    fn latency_beside(&self, clients: usize, query: &str, image: &[u8]) -> Latency {
        let (stop, served) = (AtomicBool::new(false), AtomicUsize::new(0));
        let latency = thread::scope(|scope| {
            for _ in 0..clients {
                scope.spawn(|| self.send_greedily(query, image, &stop, &served));
            }
            self.server.wait_until("the greedy one has its share", || {
                self.server.metric("pixmesh_jobs_in_progress") >= 1.0
            });
            thread::sleep(Duration::from_secs(1));
            let latency = self.latency();
            stop.store(true, Ordering::Relaxed);
            latency
        });
        assert!(served.load(Ordering::Relaxed) > 0, "the greedy one was served too");
        latency
    }
}

#[test]
fn a_hundred_large_uploads_of_one_key_do_not_hold_up_another() {
    let _alone = crate::alone();
    let shared = Shared::start();
    let (small, large) = (disc(316, 316, 3), noise(1448));
    shared.latency();
    let mut seen = Vec::new();
    let is_fair = (0..ATTEMPTS).any(|_| {
        // Normal is that both keys use the service, each with one client.
        let normal = shared.latency_beside(1, "", &small);
        let beside = shared.latency_beside(GREEDY_CLIENTS, "density=1", &large);
        // There is a worker for it.
        let is_soon_begun = beside.longest_in_queue_ms < 100.0;
        let is_fair = is_soon_begun && beside.longest <= 2 * normal.longest;
        seen.push((normal, beside));
        is_fair
    });
    for (normal, beside) in &seen {
        println!(
            "The longest request of a key beside one client of another took {normal}; beside \
             {GREEDY_CLIENTS} clients {beside}"
        );
    }
    assert!(is_fair, "another key's uploads hold up a request");
    shared.server.wait_until_idle();
}

/// How long a request waited for a worker and memory.
fn in_queue_ms(answer: &Answer) -> f64 {
    let timing = answer.header("server-timing").strip_prefix("queue;dur=").unwrap();
    timing.split(',').next().unwrap().parse().unwrap()
}
