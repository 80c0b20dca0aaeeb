//! Clients that send slowly, or vanish: they must cost nothing, and leave nothing behind.

use super::Setting;
use crate::driver::{Outcome, Stream, open_loop, request};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::statistics::percentile;
use crate::work::Work;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

/// Clients of each kind: those that send headers slowly, and bodies.
const SLOW: usize = 1000;
/// Seconds for which they try.
const PERIOD_S: f64 = 300.0;
/// Well-behaved requests per second meanwhile.
const GOOD_PER_S: f64 = 2.0;

pub(super) fn run(setting: &Setting) -> Result {
    let server = Server::start(&["--max-connections", "4096", "--header-timeout", "10s"]);
    let (work, open_before) = (Work::usual(), server.metric("process_open_fds"));
    let period = setting.period(PERIOD_S).max(Duration::from_secs(15));
    let (is_over, opened) = (AtomicBool::new(false), AtomicUsize::new(0));
    let outcomes = thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| crawl(server.public, SLOW / 2, &is_over, &opened));
        }
        scope.spawn(|| vanish(&server, &work, &is_over));
        let make = |number| work.request(number);
        let health = |_| request("health", "GET", "/readyz", b"");
        let streams = [
            Stream { address: server.public, per_second: GOOD_PER_S, make: &make },
            Stream { address: server.operations, per_second: 10.0, make: &health },
        ];
        let outcomes = open_loop(&streams, period);
        is_over.store(true, Ordering::Relaxed);
        outcomes
    });
    server.wait_until_idle();
    let mut left = f64::INFINITY;
    for _ in 0..300 {
        left = server.metric("process_open_fds") - open_before;
        if left <= 2.0 {
            break;
        }
        thread::sleep(Duration::from_millis(100));
    }
    let [good, health] = outcomes.try_into().unwrap();
    let ok =
        |outcomes: &[Outcome]| outcomes.iter().filter(|outcome| outcome.status() == 200).count();
    let health_ms: Vec<f64> = health.iter().map(Outcome::latency_ms).collect();
    Result {
        rows: vec![
            row![
                "slow connections",
                "good requests",
                "200",
                "health",
                "200",
                "health p99, ms",
                "descriptors left"
            ],
            row![
                opened.load(Ordering::Relaxed),
                good.len(),
                ok(&good),
                health.len(),
                ok(&health),
                format!("{:.1}", percentile(&health_ms, 0.99)),
                left,
            ],
        ],
        notes: vec!["A fifth of further requests vanished while they were worked on.".into()],
        ..Result::default()
    }
}

/// Opens connections and sends a byte on each of them now and then, half of them in a header and half in
/// a body, until it is over; opens another one where one was closed.
fn crawl(address: SocketAddr, count: usize, is_over: &AtomicBool, opened: &AtomicUsize) {
    let open = |number: usize| {
        let mut stream = TcpStream::connect(address).ok()?;
        stream.set_nonblocking(true).ok()?;
        let head: &[u8] = if number.is_multiple_of(2) {
            b"POST /v1/meshes HTTP/1.1\r\nHost: "
        } else {
            b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n"
        };
        stream.write_all(head).ok()?;
        opened.fetch_add(1, Ordering::Relaxed);
        Some(stream)
    };
    let mut streams: Vec<Option<TcpStream>> = (0..count).map(open).collect();
    while !is_over.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_secs(1));
        for (number, stream) in streams.iter_mut().enumerate() {
            let alive = stream.as_mut().is_some_and(|stream| stream.write_all(b"a").is_ok());
            if !alive {
                *stream = open(number);
            }
        }
    }
}

/// Sends requests for work and leaves before their answers.
fn vanish(server: &Server, work: &Work, is_over: &AtomicBool) {
    let mut number = 0;
    while !is_over.load(Ordering::Relaxed) {
        if let Ok(mut stream) = TcpStream::connect(server.public) {
            let _ = stream.write_all(&work.request(number).bytes);
        }
        number += 1;
        thread::sleep(Duration::from_secs_f64(5.0 / GOOD_PER_S));
    }
}
