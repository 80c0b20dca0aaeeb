//! Counts a body as it arrives: against the limit of one, and against the memory for all of them.

use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use axum::body::Body;
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use std::error::Error;
use std::fmt;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};
use tokio::sync::Semaphore;

/// Seconds after which a client may try again when bodies take all of their memory.
const RETRY_AFTER_S: u64 = 2;

/// The longest body in bytes, and the setting that says so.
#[derive(Clone, Copy, Debug)]
pub struct BodyLimit {
    /// So many may come.
    pub bytes: u64,
    /// The flag of the setting.
    pub setting: &'static str,
}

impl BodyLimit {
    /// Refuses a body of more bytes.
    pub(super) fn check(self, length: u64) -> Result<(), Problem> {
        let Self { bytes, setting } = self;
        if length <= bytes {
            return Ok(());
        }
        let detail = format!("the body is longer than the limit of {bytes} bytes");
        Err(Problem::new(Kind::BodyTooLarge, detail).setting(setting).limit(bytes, length))
    }
}

/// The memory that all bodies share, in KiB.
#[derive(Clone, Debug)]
pub struct BodyMemory(Arc<Semaphore>);

impl BodyMemory {
    /// Memory for `bytes` of bodies at a time.
    #[must_use]
    pub fn new(bytes: u64) -> Self {
        let kib = usize::try_from(bytes / 1024).unwrap_or(usize::MAX);
        Self(Arc::new(Semaphore::new(kib.clamp(1, Semaphore::MAX_PERMITS))))
    }

    /// A charge of nothing so far.
    pub(super) fn charge(&self) -> Charge {
        Charge { memory: Arc::clone(&self.0), held_kib: AtomicUsize::new(0) }
    }
}

/// The memory that one body takes; freed when dropped.
#[derive(Debug)]
pub struct Charge {
    memory: Arc<Semaphore>,
    held_kib: AtomicUsize,
}

impl Charge {
    /// Charges for `bytes` in all.
    ///
    /// # Errors
    /// `overloaded` when there is no memory for them.
    pub(super) fn grow_or_refuse(&self, bytes: u64) -> Result<(), Problem> {
        if self.grow_to(bytes) { Ok(()) } else { Err(no_memory()) }
    }

    /// Charges for `bytes` in all, and says whether there was memory for them.
    fn grow_to(&self, bytes: u64) -> bool {
        let needed_kib = usize::try_from(bytes.div_ceil(1024)).unwrap_or(usize::MAX);
        let missing_kib = needed_kib.saturating_sub(self.held_kib.load(Ordering::Relaxed));
        let missing = u32::try_from(missing_kib).unwrap_or(u32::MAX);
        match self.memory.try_acquire_many(missing) {
            Ok(permit) => {
                permit.forget();
                self.held_kib.fetch_add(missing_kib, Ordering::Relaxed);
                true
            }
            Err(_) => false,
        }
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.memory.add_permits(self.held_kib.load(Ordering::Relaxed));
    }
}

/// A body that ends with a [`Refused`] when it is too long or there is no memory for it.
pub(super) struct Metered {
    body: Body,
    received: u64,
    limit: BodyLimit,
    charge: Arc<Charge>,
}

impl Metered {
    pub(super) fn new(body: Body, limit: BodyLimit, charge: Arc<Charge>) -> Self {
        Self { body, received: 0, limit, charge }
    }

    /// Counts `length` more bytes.
    fn count(&mut self, length: usize) -> Result<(), Refused> {
        self.received = self.received.saturating_add(length as u64);
        self.limit.check(self.received).map_err(Refused)?;
        if !self.charge.grow_to(self.received) {
            return Err(Refused(no_memory()));
        }
        Ok(())
    }
}

impl http_body::Body for Metered {
    type Data = Bytes;
    type Error = Box<dyn Error + Send + Sync>;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context)).transpose()?;
        let length = frame.as_ref().and_then(Frame::data_ref).map_or(0, Bytes::len);
        self.count(length)?;
        Poll::Ready(frame.map(Ok))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// A refusal on its way through code that only knows errors.
#[derive(Clone, Debug)]
pub(super) struct Refused(pub(super) Problem);

impl fmt::Display for Refused {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.0.kind().slug())
    }
}

impl Error for Refused {}

fn no_memory() -> Problem {
    telemetry::shed(Shed::Memory);
    Problem::new(Kind::Overloaded, "the bodies being received take all memory meant for them")
        .setting("--memory-budget")
        .retry_after_s(RETRY_AFTER_S)
}
