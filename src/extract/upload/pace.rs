//! A form's body in small pieces, and not for ever without a field.
//!
//! The parser of forms reads on for as long as there are bytes, and while it looks for the end of a
//! part's header, or for the first boundary, searches all it has read at each arrival. So it gets
//! one small piece at a time, which keeps what it has read but not given on short, and between
//! fields only so much in all that searching it again and again costs little: also when the bytes
//! arrive one by one.

use super::meter::{Metered, Refused};
use crate::problem::{Kind, Problem};
use bytes::Bytes;
use http_body::{Body, Frame};
use std::error::Error;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};

/// The longest piece in bytes.
const MAX_PIECE: usize = 16 * 1024;
/// The most bytes that may arrive between two fields: a part's header of 16 KiB, with the whole
/// pieces in which it begins and ends.
const MAX_BETWEEN_FIELDS: usize = 48 * 1024;

/// How many more bytes may arrive before there is a field.
#[derive(Clone, Debug)]
pub(super) struct Allowance(Arc<AtomicUsize>);

impl Allowance {
    /// As many as between two fields.
    pub(super) fn new() -> Self {
        Self(Arc::new(AtomicUsize::new(MAX_BETWEEN_FIELDS)))
    }

    /// The search for a field begins.
    pub(super) fn limit(&self) {
        self.0.store(MAX_BETWEEN_FIELDS, Ordering::Relaxed);
    }

    /// A field was found: its data is bound by other limits.
    pub(super) fn lift(&self) {
        self.0.store(usize::MAX, Ordering::Relaxed);
    }

    /// Uses up `length` bytes of what is left, and says whether there were as many.
    fn use_up(&self, length: usize) -> bool {
        let left = self.0.load(Ordering::Relaxed);
        // A field's data uses nothing up.
        if left != usize::MAX {
            self.0.store(left.saturating_sub(length), Ordering::Relaxed);
        }
        length <= left
    }
}

/// A body that comes in small pieces, and ends with a [`Refused`] when there is no field for too
/// long.
pub(super) struct Paced {
    body: Metered,
    /// What is left of the last frame.
    rest: Bytes,
    allowance: Allowance,
    /// Whether the reader must look at the last piece before there is another.
    pausing: bool,
}

impl Paced {
    pub(super) fn new(body: Metered, allowance: Allowance) -> Self {
        Self { body, rest: Bytes::new(), allowance, pausing: false }
    }

    /// The next piece of the data.
    fn piece(&mut self) -> Result<Frame<Bytes>, Refused> {
        let piece = self.rest.split_to(self.rest.len().min(MAX_PIECE));
        if !self.allowance.use_up(piece.len()) {
            return Err(Refused(no_field()));
        }
        self.pausing = true;
        Ok(Frame::data(piece))
    }
}

impl Body for Paced {
    type Data = Bytes;
    type Error = Box<dyn Error + Send + Sync>;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        if std::mem::take(&mut self.pausing) {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        while self.rest.is_empty() {
            match ready!(Pin::new(&mut self.body).poll_frame(context)).transpose()? {
                None => return Poll::Ready(None),
                Some(frame) => self.rest = frame.into_data().unwrap_or_default(),
            }
        }
        Poll::Ready(Some(self.piece().map_err(Into::into)))
    }
}

fn no_field() -> Problem {
    let detail = format!("{MAX_BETWEEN_FIELDS} bytes of the form hold no field");
    Problem::new(Kind::MultipartMalformed, detail)
}
