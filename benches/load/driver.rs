//! Sends requests in time, and notes what became of each.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::runtime::Builder;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until, timeout};

/// The longest time for an answer.
const PATIENCE: Duration = Duration::from_secs(30 * 60);

/// A request as it is sent.
#[derive(Clone, Debug)]
pub(crate) struct Request {
    /// What it is counted under.
    pub(crate) class: &'static str,
    pub(crate) bytes: Arc<[u8]>,
}

/// What became of a request.
#[derive(Clone, Debug)]
pub(crate) struct Outcome {
    pub(crate) class: &'static str,
    /// When it was due, from the beginning of the loop.
    pub(crate) due: Duration,
    /// From when it was due to the end of its answer.
    pub(crate) latency: Duration,
    /// `None` where there was no whole answer.
    pub(crate) answer: Option<Reply>,
}

/// An answer.
#[derive(Clone, Debug)]
pub(crate) struct Reply {
    pub(crate) status: u16,
    head: String,
}

impl Outcome {
    pub(crate) fn status(&self) -> u16 {
        self.answer.as_ref().map_or(0, |answer| answer.status)
    }

    pub(crate) fn latency_ms(&self) -> f64 {
        crate::statistics::ms(self.latency)
    }
}

impl Reply {
    /// A header's value; empty when the header is not there.
    pub(crate) fn header(&self, name: &str) -> &str {
        let named = |line: &'_ str| -> bool {
            line.split_once(':').is_some_and(|(known, _)| known.eq_ignore_ascii_case(name))
        };
        let line = self.head.lines().find(|line| named(line)).unwrap_or_default();
        line.split_once(':').map_or("", |(_, value)| value.trim())
    }
}

/// A request that asks for the connection to be closed.
pub(crate) fn request(class: &'static str, method: &str, target: &str, body: &[u8]) -> Request {
    let length = body.len();
    let head = format!(
        "{method} {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
         Content-Length: {length}\r\n\r\n"
    );
    Request { class, bytes: [head.as_bytes(), body].concat().into() }
}

/// Sends a request and reads its answer.
async fn exchange(address: SocketAddr, bytes: &[u8]) -> io::Result<Reply> {
    let mut stream = TcpStream::connect(address).await?;
    stream.set_nodelay(true)?;
    // A refusal may come, and the connection end, before everything is sent.
    let sent = stream.write_all(bytes).await;
    let mut answer = Vec::new();
    let read = stream.read_to_end(&mut answer).await;
    parsed(&answer).ok_or_else(|| {
        let error = sent.and(read.map(drop)).err();
        error.unwrap_or_else(|| io::ErrorKind::UnexpectedEof.into())
    })
}

/// The answer, if all of it came.
fn parsed(bytes: &[u8]) -> Option<Reply> {
    let end = bytes.windows(4).position(|window| window == b"\r\n\r\n")?;
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let reply = Reply { status, head };
    let length: usize = reply.header("content-length").parse().unwrap_or(0);
    (bytes.len() - end - 4 >= length).then_some(reply)
}

/// Sends a request that was due at an instant.
async fn send(address: SocketAddr, request: Request, began: Instant, due: Instant) -> Outcome {
    let exchanged = timeout(PATIENCE, exchange(address, &request.bytes)).await;
    let answer = exchanged.ok().and_then(Result::ok);
    Outcome { class: request.class, due: due - began, latency: due.elapsed(), answer }
}

/// A stream of requests at a constant rate.
pub(crate) struct Stream<'a> {
    pub(crate) address: SocketAddr,
    pub(crate) per_second: f64,
    /// The request of each number.
    pub(crate) make: &'a dyn Fn(usize) -> Request,
}

/// Sends streams of requests side by side for a time, each request when it is due, and waits for the
/// answers. Returns what became of them, stream by stream.
pub(crate) fn open_loop(streams: &[Stream<'_>], period: Duration) -> Vec<Vec<Outcome>> {
    let runtime = Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let began = Instant::now();
        let mut sent = JoinSet::new();
        for (due, stream, number) in timetable(streams, period) {
            let due = began + due;
            sleep_until(due).await;
            let Stream { address, make, .. } = &streams[stream];
            let outcome = send(*address, make(number), began, due);
            sent.spawn(async move { (stream, outcome.await) });
        }
        let mut outcomes: Vec<Vec<Outcome>> = streams.iter().map(|_| Vec::new()).collect();
        for (stream, outcome) in sent.join_all().await {
            outcomes[stream].push(outcome);
        }
        outcomes
    })
}

/// When which request of which stream is due.
fn timetable(streams: &[Stream<'_>], period: Duration) -> Vec<(Duration, usize, usize)> {
    let mut times = Vec::new();
    for (stream, Stream { per_second, .. }) in streams.iter().enumerate() {
        let count = (per_second * period.as_secs_f64()).ceil() as usize;
        let due = |number| Duration::from_secs_f64(number as f64 / per_second);
        times.extend((0..count).map(|number| (due(number), stream, number)));
    }
    times.sort();
    times
}

/// Sends some requests at the same time, and waits for the answers.
pub(crate) fn together(address: SocketAddr, requests: &[Request]) -> Vec<Outcome> {
    let runtime = Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let began = Instant::now();
        let send = |request: &Request| send(address, request.clone(), began, began);
        futures_util::future::join_all(requests.iter().map(send)).await
    })
}

/// Keeps so many clients busy for a time, each sending its next request after the answer to its last.
pub(crate) fn closed_loop(
    address: SocketAddr,
    clients: usize,
    period: Duration,
    make: &(dyn Fn(usize) -> Request + Sync),
) -> Vec<Outcome> {
    let runtime = Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let began = Instant::now();
        let client = |client: usize| async move {
            let mut outcomes = Vec::new();
            while began.elapsed() < period {
                let request = make(outcomes.len() * clients + client);
                outcomes.push(send(address, request, began, Instant::now()).await);
            }
            outcomes
        };
        let clients = (0..clients).map(client);
        futures_util::future::join_all(clients).await.concat()
    })
}
