//! A connection's bytes: shown to the [`Framing`] on their way in, and never left unread at the end.
//!
//! A socket that is closed while bytes of the client are unread resets the connection, and the
//! client may never see the answer it was just sent. So a stream that is dropped reads on for a
//! moment, and throws away what comes.
//!
//! A client that stalls loses its connection: one that for too long does not take as much of an
//! answer as makes the system accept more of it. The system buffers up to some megabytes and says
//! that there is room only when about a third of that is free again, so that also a client that
//! reads steadily, but tens of kilobytes a second or fewer, may be cut. There is no limit on the
//! time that an answer takes in all.

use super::framing::Framing;
use super::preface::Preface;
use super::unreadable;
use std::future::Future;
use std::io::{self, ErrorKind};
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Sleep, sleep, timeout};

/// How long a closed connection is still read from.
const LINGER: Duration = Duration::from_secs(2);

/// A connection.
pub(super) struct Stream {
    /// Taken when dropped.
    socket: Option<TcpStream>,
    framing: Framing,
    preface: Preface,
    stall_timeout: Duration,
    stalled: Option<Pin<Box<Sleep>>>,
    /// What is being sent in place of bytes of the HTTP library.
    replaced: Option<Replaced>,
    /// The connection's place among those open, kept until it is closed.
    place: Option<OwnedSemaphorePermit>,
}

/// Bytes that are sent in place of others.
struct Replaced {
    bytes: Vec<u8>,
    sent: usize,
    /// The number of those others.
    original: usize,
}

impl Stream {
    pub(super) fn new(
        socket: TcpStream,
        stall_timeout: Duration,
        framing: Framing,
        place: OwnedSemaphorePermit,
    ) -> Self {
        Self {
            socket: Some(socket),
            framing,
            preface: Preface::default(),
            stall_timeout,
            stalled: None,
            replaced: None,
            place: Some(place),
        }
    }

    fn socket(&mut self) -> io::Result<Pin<&mut TcpStream>> {
        self.socket.as_mut().map(Pin::new).ok_or_else(|| ErrorKind::NotConnected.into())
    }

    /// Sends what is to be sent in place of `bytes`; `None` when these are sent themselves.
    fn poll_replaced(
        &mut self,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Option<Poll<io::Result<usize>>> {
        let mut replaced = self.replaced.take().or_else(|| {
            let original = bytes.len();
            unreadable::in_place_of(bytes, self.framing.is_countless()).map(|bytes| Replaced {
                bytes,
                sent: 0,
                original,
            })
        })?;
        while replaced.sent < replaced.bytes.len() {
            let socket = match self.socket() {
                Ok(socket) => socket,
                Err(error) => return Some(Poll::Ready(Err(error))),
            };
            match socket.poll_write(context, &replaced.bytes[replaced.sent..]) {
                Poll::Ready(Ok(count)) => replaced.sent += count,
                Poll::Ready(Err(error)) => return Some(Poll::Ready(Err(error))),
                Poll::Pending => {
                    self.replaced = Some(replaced);
                    return Some(Poll::Pending);
                }
            }
        }
        Some(Poll::Ready(Ok(replaced.original)))
    }

    /// Passes on what became of writing, and an error when nothing could be written for too long.
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
        let before = buffer.filled().len();
        ready!(self.socket()?.poll_read(context, buffer))?;
        let arrived = buffer.filled_mut().get_mut(before..).unwrap_or_default();
        self.preface.see(arrived);
        self.framing.see(arrived);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = match self.poll_replaced(context, bytes) {
            Some(written) => written,
            None => self.socket()?.poll_write(context, bytes),
        };
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
        let only = if let [only] = slices { only } else { &io::IoSlice::new(&[]) };
        let written = match self.poll_replaced(context, only) {
            Some(written) => written,
            None => self.socket()?.poll_write_vectored(context, slices),
        };
        self.unless_stalled(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.as_ref().is_some_and(AsyncWrite::is_write_vectored)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let place = self.place.take();
        if let (Some(socket), Ok(runtime)) = (self.socket.take(), Handle::try_current()) {
            runtime.spawn(async move {
                let _ = timeout(LINGER, linger(socket)).await;
                drop(place);
            });
        }
    }
}

/// Ends our half of a connection, and reads what comes until the client ends its own.
async fn linger(mut socket: TcpStream) -> io::Result<()> {
    socket.shutdown().await?;
    let mut ignored = vec![0; 16 * 1024];
    while socket.read(&mut ignored).await? > 0 {}
    Ok(())
}
