//! Accepts connections up to a number, and serves HTTP/1.1 on each with timeouts.
//!
//! HTTP/2 is not spoken: a connection that begins with its preface is told 400 and closed. A
//! connection whose request header does not arrive in time is closed, also an idle one. What comes
//! over the number of connections is told 503 and closed; when many are being told so, the rest is
//! closed untold.
//!
//! A client that goes away while its request is worked on is noticed when its end of the connection
//! is read, and its work is stopped. That is not promised to one that sends bytes of a further
//! request before the answer: these are left unread until then, and the end of the connection
//! behind them, so that the work goes on to its end or its deadline. A client that ends its half of
//! the connection before it has its answer is taken for one that went away, and gets none.

use super::framing::Framing;
use super::stream::Stream;
use crate::problem::{Kind, Problem};
use axum::Router;
use axum::body::Body;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use std::io;
use std::net::TcpListener as StdListener;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

/// The most bytes and lines of a request's header that are read at all. The routes refuse much less
/// than that, with a problem document; beyond these the library answers 431 with nothing more.
const MAX_BUFFER: usize = 128 * 1024;
const MAX_HEADER_LINES: usize = 1100;
/// The most connections over the number that are being told so at a time.
pub(super) const REFUSED_AT_A_TIME: usize = 16;
/// The pause after the system has refused a connection, for instance for want of descriptors.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(50);

/// An address that is listened on, with its routes.
pub(super) struct Listener {
    socket: StdListener,
    routes: Router,
    timeouts: Timeouts,
    places: Arc<Semaphore>,
    refusals: Arc<Semaphore>,
}

/// How slow a client may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timeouts {
    /// Longest time for a request's header to arrive.
    pub(super) header: Duration,
    /// Longest time for nothing of an answer to be taken.
    pub(super) stall: Duration,
}

impl Listener {
    /// Listens for up to `connections` at a time.
    pub(super) fn new(
        socket: StdListener,
        routes: Router,
        connections: usize,
        timeouts: Timeouts,
    ) -> Self {
        let places = Arc::new(Semaphore::new(connections.min(Semaphore::MAX_PERMITS)));
        let refusals = Arc::new(Semaphore::new(REFUSED_AT_A_TIME));
        Self { socket, routes, timeouts, places, refusals }
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
                Ok((connection, _)) => self.admit(connection, &open),
                Err(error) => {
                    tracing::warn!(%error, "a connection could not be accepted");
                    sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
        Ok(Draining(tokio::spawn(open.shutdown())))
    }

    /// Serves a connection when there is a place for it.
    fn admit(&self, connection: TcpStream, open: &GracefulShutdown) {
        let _ = connection.set_nodelay(true);
        let framing = Framing::default();
        let Ok(place) = Arc::clone(&self.places).try_acquire_owned() else {
            self.refuse(connection);
            return;
        };
        let stream = Stream::new(connection, self.timeouts.stall, framing.clone(), place);
        let routes = self.routes.clone();
        let service = hyper::service::service_fn(move |mut request: hyper::Request<Incoming>| {
            request.extensions_mut().insert(framing.clone());
            routes.clone().oneshot(request.map(Body::new))
        });
        let served = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(self.timeouts.header)
            .max_buf_size(MAX_BUFFER)
            .max_headers(MAX_HEADER_LINES)
            .serve_connection(TokioIo::new(stream), service);
        let served = open.watch(served);
        tokio::spawn(async move {
            if let Err(error) = served.await {
                tracing::debug!(%error, "a connection ended early");
            }
        });
    }

    /// Tells a connection that there is no place for it, or closes it when too many are being told.
    fn refuse(&self, connection: TcpStream) {
        if let Ok(place) = Arc::clone(&self.refusals).try_acquire_owned() {
            let stream = Stream::new(connection, self.timeouts.stall, Framing::default(), place);
            tokio::spawn(turn_away(stream, self.timeouts.header));
        }
    }
}

/// Tells a connection over the number that there is no place for it.
async fn turn_away(mut stream: Stream, limit: Duration) {
    let document = Problem::new(Kind::Overloaded, "too many connections are open")
        .setting("--max-connections")
        .retry_after_s(1)
        .document(None);
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
