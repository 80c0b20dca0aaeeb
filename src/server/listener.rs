//! Accepts connections up to a number and serves HTTP/1.1 and HTTP/2 on each, with timeouts.
//!
//! HTTP/2 is spoken with prior knowledge: a connection that begins with its preface. A connection
//! whose first request does not arrive within the header timeout is closed. Between requests an
//! HTTP/1.1 connection stays open for the keep-alive timeout, which is longer than that of usual
//! proxies, so that a proxy never sends a request on a connection that is being closed; an HTTP/2
//! client that is idle must answer pings. Connections over the number, or over the part of it that
//! one address may have, get 503 and are closed; beyond [`REFUSED_AT_A_TIME`] such refusals at a time
//! they are closed without one.
//! What hyper cannot parse it answers itself, with 400, 414 or 431 and no body.
//!
//! A task is cancelled when its client closes the connection. In HTTP/1.1 that is noticed when the
//! end of the connection is read, which bytes of a further request delay: a client that pipelines
//! keeps its task running to its end or its deadline. A client that closes only its sending half
//! counts as gone and gets no response.

use super::stream::{Requests, Stream, Timeouts};
use crate::access::Shares;
use crate::extract::client_address::Peer;
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Open};
use axum::Router;
use axum::body::Body;
use axum::http::Version;
use hyper::body::Incoming;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto;
use hyper_util::server::graceful::GracefulShutdown;
use std::io;
use std::net::{IpAddr, Ipv6Addr, TcpListener as StdListener};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

/// The most bytes and lines of a request's header that are read at all. The routes refuse much less
/// than that, with a problem document.
const MAX_BUFFER: usize = 128 * 1024;
const MAX_HEADER_LINES: usize = 1100;
/// The most bytes of bodies in HTTP/2 that a connection, and one request, may have unread.
const MAX_UNREAD_OF_CONNECTION: u32 = 256 * 1024;
const MAX_UNREAD_OF_REQUEST: u32 = 128 * 1024;
/// The most requests in progress on one connection in HTTP/2.
const MAX_STREAMS: u32 = 100;
/// The most connections that are refused with a response at a time.
pub(super) const REFUSED_AT_A_TIME: usize = 64;
/// How long a closed connection is still read from.
const LINGER: Duration = Duration::from_secs(2);
/// The same of one that was refused.
const LINGER_REFUSED: Duration = Duration::from_millis(250);
/// The pause after the system has refused a connection, for instance for want of descriptors.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(50);

/// An address that is listened on, with its routes.
pub(super) struct Listener {
    socket: StdListener,
    routes: Router,
    timeouts: Timeouts,
    http: auto::Builder<TokioExecutor>,
    permits: Arc<Semaphore>,
    refusals: Arc<Semaphore>,
    /// What each address has of the connections, and the most that one may have; `None` where that
    /// does not count.
    addresses: Option<(Arc<Shares<IpAddr>>, usize)>,
}

impl Listener {
    /// Listens for up to `connections` at a time.
    pub(super) fn new(
        socket: StdListener,
        routes: Router,
        connections: usize,
        timeouts: Timeouts,
    ) -> Self {
        let permits = Arc::new(Semaphore::new(connections.min(Semaphore::MAX_PERMITS)));
        let refusals = Arc::new(Semaphore::new(REFUSED_AT_A_TIME));
        let addresses = None;
        Self { socket, routes, timeouts, http: http(timeouts), permits, refusals, addresses }
    }

    /// The same with up to `most` connections of one address, all counted.
    pub(super) fn public(self, most: usize) -> Self {
        Self { addresses: Some((Arc::default(), most)), ..self }
    }

    /// Accepts connections until `stop`, and returns those that are still open.
    ///
    /// # Errors
    /// When the runtime cannot watch the socket.
    pub(super) async fn serve(self, stop: CancellationToken) -> io::Result<Draining> {
        let socket = TcpListener::from_std(self.socket.try_clone()?)?;
        let open = GracefulShutdown::new();
        loop {
            let accepted = tokio::select! {
                accepted = socket.accept() => accepted,
                () = stop.cancelled() => break,
            };
            match accepted {
                Ok((connection, peer)) => self.admit(connection, peer.ip(), &open),
                Err(error) => {
                    tracing::warn!(%error, "accept failed");
                    sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
        Ok(Draining(tokio::spawn(open.shutdown())))
    }

    /// Serves a connection if the limit on connections allows.
    fn admit(&self, connection: TcpStream, peer: IpAddr, open: &GracefulShutdown) {
        let _ = connection.set_nodelay(true);
        let place = match self.place(peer) {
            Ok(place) => place,
            Err(refusal) => return self.refuse(connection, refusal),
        };
        let stream = Stream::new(connection, self.timeouts, LINGER, Box::new(place));
        let routes = self.routes.clone();
        let requests = stream.requests();
        let counted = Arc::clone(&requests);
        let service = hyper::service::service_fn(move |mut request: hyper::Request<Incoming>| {
            request.extensions_mut().insert(Peer(peer));
            let open = OpenRequest::begin(&counted, request.version() < Version::HTTP_2);
            let response = routes.clone().oneshot(request.map(Body::new));
            async move {
                let _open = open;
                response.await
            }
        });
        let connection = self.http.serve_connection(TokioIo::new(stream), service).into_owned();
        let served = open.watch(connection);
        let header_timeout = self.timeouts.header;
        tokio::spawn(async move {
            let mut served = pin!(served);
            let ended = match timeout(header_timeout, &mut served).await {
                Err(_) if !requests.have_begun.load(Ordering::Acquire) => return,
                Err(_) => served.await,
                Ok(ended) => ended,
            };
            if let Err(error) = ended {
                tracing::debug!(%error, "connection closed with an error");
            }
        });
    }

    /// What a connection of this address holds while it is open.
    fn place(&self, peer: IpAddr) -> Result<impl Send + use<>, Refusal> {
        let share = match &self.addresses {
            Some((shares, most)) => {
                Some(shares.take(&network(peer), *most).ok_or(Refusal::Address)?)
            }
            None => None,
        };
        let permit = Arc::clone(&self.permits).try_acquire_owned().map_err(|_| Refusal::Total)?;
        let counted = share.is_some().then(Open::connection);
        Ok((permit, share, counted))
    }

    /// Refuses a connection with 503, or closes it when many are being refused.
    fn refuse(&self, connection: TcpStream, refusal: Refusal) {
        telemetry::connection_refused(refusal.reason());
        if let Ok(permit) = Arc::clone(&self.refusals).try_acquire_owned() {
            let stream = Stream::new(connection, self.timeouts, LINGER_REFUSED, Box::new(permit));
            tokio::spawn(turn_away(stream, refusal, self.timeouts.header));
        }
    }
}

/// A request whose response has not begun.
struct OpenRequest(Arc<Requests>);

impl OpenRequest {
    fn begin(requests: &Arc<Requests>, is_http1: bool) -> Self {
        requests.have_begun.store(true, Ordering::Release);
        requests.are_http1.store(is_http1, Ordering::Release);
        requests.open.fetch_add(1, Ordering::AcqRel);
        Self(Arc::clone(requests))
    }
}

impl Drop for OpenRequest {
    fn drop(&mut self) {
        self.0.open.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Why a connection is refused.
#[derive(Clone, Copy, Debug)]
enum Refusal {
    /// As many are open as may be.
    Total,
    /// Its address has its part of them.
    Address,
}

impl Refusal {
    /// The label of the metric.
    fn reason(self) -> &'static str {
        match self {
            Self::Total => "total",
            Self::Address => "address",
        }
    }

    fn problem(self) -> Problem {
        let (detail, setting) = match self {
            Self::Total => ("too many connections are open: try again", "--max-connections"),
            Self::Address => (
                "too many connections of your address are open: close some",
                "--connections-per-address",
            ),
        };
        Problem::new(Kind::Overloaded, detail).setting(setting).retry_after_s(1)
    }
}

/// The address that counts: of IPv6 the network of 64 bits, all of which one client may have.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let network = address.to_bits() & !u128::from(u64::MAX);
            Ipv6Addr::from_bits(network).into()
        }
        address => address,
    }
}

/// How requests are read and responses written.
fn http(timeouts: Timeouts) -> auto::Builder<TokioExecutor> {
    let mut http = auto::Builder::new(TokioExecutor::new());
    http.http1()
        .timer(TokioTimer::new())
        .header_read_timeout(timeouts.keep_alive)
        .max_buf_size(MAX_BUFFER)
        .max_headers(MAX_HEADER_LINES);
    http.http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(timeouts.header)
        .keep_alive_timeout(timeouts.header)
        .max_header_list_size(MAX_BUFFER as u32)
        .max_concurrent_streams(MAX_STREAMS)
        .initial_connection_window_size(MAX_UNREAD_OF_CONNECTION)
        .initial_stream_window_size(MAX_UNREAD_OF_REQUEST);
    http
}

/// Answers a connection over a limit with 503.
async fn turn_away(mut stream: Stream, refusal: Refusal, limit: Duration) {
    let document = refusal.problem().document(None);
    let answer = format!(
        "HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/problem+json\r\n\
         content-length: {}\r\nretry-after: 1\r\nconnection: close\r\n\r\n{document}",
        document.len()
    );
    let _ = timeout(limit, async {
        stream.write_all(answer.as_bytes()).await?;
        stream.shutdown().await
    })
    .await;
}

/// The connections that are still open after the listener has stopped.
pub(super) struct Draining(JoinHandle<()>);

impl Draining {
    /// Waits for them to end, and says whether they did in time.
    pub(super) async fn finish(&mut self, limit: Duration) -> bool {
        self.0.is_finished() || timeout(limit, pin!(&mut self.0)).await.is_ok()
    }
}
