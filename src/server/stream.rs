//! A connection's bytes, with limits on stalls and slow headers, and an orderly end.
//!
//! A socket that is closed while bytes of the client are unread resets the connection, and the
//! client may lose the response it was just sent. A dropped stream therefore reads on for up to
//! a moment and discards what arrives.
//!
//! A connection is closed when the socket accepts no response bytes for the stall timeout. The
//! system buffers up to some megabytes and reports the socket writable only when about a third of
//! that is free again, so a client that reads some tens of kilobytes a second or fewer may be cut.
//! The time of a response as a whole has no limit.
//!
//! An HTTP/1.1 connection whose next request begins to arrive is closed when the request's header is
//! not complete within the header timeout. Between requests it stays open for longer, which hyper
//! measures.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::time::{Sleep, sleep, timeout};

/// Limits on slow clients.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timeouts {
    /// Longest time for a request's header to arrive.
    pub(super) header: Duration,
    /// Longest time between two requests of a connection in HTTP/1.1.
    pub(super) keep_alive: Duration,
    /// Longest time for the socket to accept no bytes of a response.
    pub(super) stall: Duration,
}

/// The requests of a connection, as its service counts them.
#[derive(Debug, Default)]
pub(super) struct Requests {
    /// Whether one has begun.
    pub(super) have_begun: AtomicBool,
    /// Whether they are in HTTP/1.
    pub(super) are_http1: AtomicBool,
    /// Those whose responses have not begun.
    pub(super) open: AtomicUsize,
}

/// A connection.
pub(super) struct Stream {
    /// Taken when dropped.
    socket: Option<TcpStream>,
    stall_timeout: Duration,
    stalled: Option<Pin<Box<Sleep>>>,
    requests: Arc<Requests>,
    header_timeout: Duration,
    /// Runs while the header of a further request arrives.
    header: Option<Pin<Box<Sleep>>>,
    /// How long it is read from after it was closed.
    linger: Duration,
    /// The permit of the connection, held until its socket is closed.
    place: Option<Box<dyn Send>>,
}

impl Stream {
    pub(super) fn new(
        socket: TcpStream,
        timeouts: Timeouts,
        linger: Duration,
        place: Box<dyn Send>,
    ) -> Self {
        Self {
            socket: Some(socket),
            stall_timeout: timeouts.stall,
            stalled: None,
            requests: Arc::default(),
            header_timeout: timeouts.header,
            header: None,
            linger,
            place: Some(place),
        }
    }

    /// The requests of this connection, which its service counts.
    pub(super) fn requests(&self) -> Arc<Requests> {
        Arc::clone(&self.requests)
    }

    fn socket(&mut self) -> io::Result<Pin<&mut TcpStream>> {
        self.socket.as_mut().map(Pin::new).ok_or_else(|| ErrorKind::NotConnected.into())
    }

    /// Passes on the result of a write, or an error when nothing could be written for too long.
    fn unless_stalled<T>(
        &mut self,
        written: Poll<io::Result<T>>,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.stalled = None;
            return written;
        }
        let limit = self.stall_timeout;
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(limit)));
        ready!(stalled.as_mut().poll(context));
        Poll::Ready(Err(ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Stream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let length = buffer.filled().len();
        let read = self.socket()?.poll_read(context, buffer);
        let requests = &self.requests;
        let awaits_header = requests.are_http1.load(Ordering::Acquire)
            && requests.open.load(Ordering::Acquire) == 0;
        if !awaits_header {
            self.header = None;
        } else if buffer.filled().len() > length && self.header.is_none() {
            self.header = Some(Box::pin(sleep(self.header_timeout)));
        }
        let header = self.header.as_mut();
        if header.is_some_and(|header| header.as_mut().poll(context).is_ready()) {
            return Poll::Ready(Err(ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.header = None;
        let written = self.socket()?.poll_write(context, bytes);
        self.unless_stalled(written, context)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = self.socket()?.poll_flush(context);
        self.unless_stalled(flushed, context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.socket()?.poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.header = None;
        let written = self.socket()?.poll_write_vectored(context, slices);
        self.unless_stalled(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.as_ref().is_some_and(AsyncWrite::is_write_vectored)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let (place, limit) = (self.place.take(), self.linger);
        if let (Some(socket), Ok(runtime)) = (self.socket.take(), Handle::try_current()) {
            runtime.spawn(async move {
                let _ = timeout(limit, linger(socket)).await;
                drop(place);
            });
        }
    }
}

/// Closes our half of a connection and reads until the client closes its own.
async fn linger(mut socket: TcpStream) -> io::Result<()> {
    socket.shutdown().await?;
    let mut ignored = vec![0; 16 * 1024];
    while socket.read(&mut ignored).await? > 0 {}
    Ok(())
}
