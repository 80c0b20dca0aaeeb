//! Accepts connections up to a number, and serves HTTP/1.1 on each with timeouts.
//!
//! HTTP/2 is not spoken: a connection that begins with its preface is closed. A connection whose
//! request header does not arrive in time is closed, also an idle one. What comes over the number
//! of connections is told 503 and closed.

use super::framing::Framing;
use super::stream::Stream;
use crate::config::Limits;
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
/// The pause after the system has refused a connection, for instance for want of descriptors.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(50);

/// An address that is listened on, with its routes.
pub(super) struct Listener {
    socket: StdListener,
    routes: Router,
    header_timeout: Duration,
    stall_timeout: Duration,
    places: Arc<Semaphore>,
}

impl Listener {
    pub(super) fn new(socket: StdListener, routes: Router, limits: &Limits) -> Self {
        Self {
            socket,
            routes,
            header_timeout: limits.header_timeout.0,
            stall_timeout: limits.body_timeout.0,
            places: Arc::new(Semaphore::new(
                limits.max_connections.get().min(Semaphore::MAX_PERMITS),
            )),
        }
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
            let stream = Stream::new(connection, self.stall_timeout, framing, None);
            tokio::spawn(turn_away(stream, self.header_timeout));
            return;
        };
        let stream = Stream::new(connection, self.stall_timeout, framing.clone(), Some(place));
        let routes = self.routes.clone();
        let service = hyper::service::service_fn(move |mut request: hyper::Request<Incoming>| {
            request.extensions_mut().insert(framing.clone());
            routes.clone().oneshot(request.map(Body::new))
        });
        let served = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(self.header_timeout)
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
