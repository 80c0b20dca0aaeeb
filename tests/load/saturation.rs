//! What the service gives while it is asked for ten times as much as it can do.

use crate::client::{Answer, send};
use crate::pictures::disc;
use crate::server::Server;
use pixmesh_codec::{Limits, decode, write_model};
use pixmesh_meshing::{Method, Target, mesh_image};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Workers of the service, and threads of the program that it is compared with.
const WORKERS: usize = 2;
/// Seconds of work that may wait for the workers.
const QUEUE_SECONDS: f64 = 1.5;
/// The query of the work.
pub(crate) const QUERY: &str = "density=2";

/// The picture of the work: a fifth of a megapixel.
pub(crate) fn picture() -> Vec<u8> {
    disc(512, 384, 3)
}

/// Requests per second that the service serves to as many clients as keep its workers busy.
pub(crate) fn service_rate(server: &Server, period: Duration) -> f64 {
    let image = picture();
    rate(2 * WORKERS, period, || {
        let answer = server.mesh(QUERY, &[], &image);
        // On a busy machine some of them may find the queue full; these are not served.
        assert!([200, 503].contains(&answer.status), "{}", answer.text());
        answer.status == 200
    })
}

/// Pictures per second that the same kernels mesh without a service, on as many threads.
pub(crate) fn kernel_rate(period: Duration) -> f64 {
    let image = picture();
    let parameters = Method::Mgprfs.parameters(Target::Percent(2.0));
    rate(WORKERS, period, || {
        let decoded = decode(&image, &Limits::default()).unwrap();
        let model = mesh_image(&decoded, &parameters, &()).unwrap();
        let mut text = Vec::new();
        write_model(&model.mesh, &mut text).unwrap();
        !text.is_empty()
    })
}

/// How often per second something is done by so many threads, all in all.
fn rate(threads: usize, period: Duration, work: impl Fn() -> bool + Sync) -> f64 {
    let done = AtomicUsize::new(0);
    let began = Instant::now();
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while began.elapsed() < period {
                    done.fetch_add(usize::from(work()), Ordering::Relaxed);
                }
            });
        }
    });
    done.into_inner() as f64 / began.elapsed().as_secs_f64()
}

/// What was seen of a service that is asked for too much.
#[derive(Debug)]
pub(crate) struct Overload {
    /// Requests sent per second.
    pub(crate) offered: f64,
    /// Meshes per second.
    pub(crate) served: f64,
    /// The 99th percentile of the time that health, or a refusal, took.
    pub(crate) health: Duration,
    pub(crate) metrics: Duration,
    pub(crate) refusal: Duration,
    pub(crate) shed: Duration,
}

/// Sends ten times what the service serves, steadily, for a time, and meanwhile asks for what must
/// be quick.
pub(crate) fn overload(server: &Server, capacity: f64, period: Duration) -> Overload {
    let image = picture();
    let (stop, sent, served) = (AtomicBool::new(false), AtomicUsize::new(0), AtomicUsize::new(0));
    // Those whose requests wait in the queue, and enough others for ten times the capacity: each
    // sends on time whatever became of its last request, as far as one connection can.
    let clients = (QUEUE_SECONDS * capacity) as u32 + (2.0 * capacity) as u32 + 20;
    let interval = Duration::from_secs_f64(f64::from(clients) / (10.0 * capacity));
    let began = Instant::now();
    thread::scope(|scope| {
        for number in 0..clients {
            let (stop, sent, served, image) = (&stop, &sent, &served, &image);
            scope.spawn(move || {
                let mut next = began + interval.mul_f64(f64::from(number) / f64::from(clients));
                while !stop.load(Ordering::Relaxed) {
                    thread::sleep(next.saturating_duration_since(Instant::now()));
                    next = (next + interval).max(Instant::now() - interval);
                    sent.fetch_add(1, Ordering::Relaxed);
                    let answer = server.mesh(QUERY, &[], image);
                    assert!([200, 503].contains(&answer.status), "{}", answer.text());
                    served.fetch_add(usize::from(answer.status == 200), Ordering::Relaxed);
                }
            });
        }
        server.wait_until("the queue is full", || {
            server.metric("pixmesh_requests_shed_total{reason=\"queue_full\"}") > 0.0
        });
        let (mut health, mut metrics, mut refusal, mut shed) = (vec![], vec![], vec![], vec![]);
        let measured = Instant::now();
        while measured.elapsed() < period {
            health.push(quick(200, || server.operate("/readyz")));
            health.push(quick(200, || server.operate("/livez")));
            metrics.push(quick(200, || server.operate("/metrics")));
            refusal.push(quick(422, || server.mesh("density=0", &[], &image)));
            refusal.push(quick(415, || server.mesh("", &[], b"no picture")));
            refusal.push(quick(404, || server.get("/nothing")));
            let answer = server.mesh(QUERY, &[], &image);
            if answer.status == 503 {
                shed.push(answer.took);
            }
            thread::sleep(Duration::from_millis(5));
        }
        stop.store(true, Ordering::Relaxed);
        let seconds = began.elapsed().as_secs_f64();
        Overload {
            offered: sent.load(Ordering::Relaxed) as f64 / seconds,
            served: served.load(Ordering::Relaxed) as f64 / seconds,
            health: p99(health),
            metrics: p99(metrics),
            refusal: p99(refusal),
            shed: p99(shed),
        }
    })
}

/// How long an answer took that must have a status.
fn quick(status: u16, ask: impl Fn() -> Answer) -> Duration {
    let answer = ask();
    assert_eq!(answer.status, status, "{}", answer.text());
    answer.took
}

/// The 99th percentile.
fn p99(mut times: Vec<Duration>) -> Duration {
    times.sort();
    let last = times.len().saturating_sub(1);
    times.get(times.len() * 99 / 100).or(times.get(last)).copied().unwrap_or_default()
}

/// A service with a queue that is soon full.
pub(crate) fn start() -> Server {
    let (workers, queue) = (WORKERS.to_string(), QUEUE_SECONDS.to_string());
    let server = Server::start(&["--workers", &workers, "--queue-seconds", &queue]);
    // It learns how long such work takes here.
    send(server.public, "GET", "/", &[], &[]);
    server
}
