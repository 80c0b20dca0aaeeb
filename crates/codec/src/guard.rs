//! The boundary to decoders from other crates.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::wanted::Wanted;
use pixmesh_meshing::Cancelled;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Whether the calling thread runs a decoder from another crate, whose panics become errors.
///
/// A panic hook can tell by it that a file made a decoder panic and that nothing in this process is
/// broken.
#[must_use]
pub fn in_guarded_decoder() -> bool {
    GUARDED.get()
}

/// Runs a decoder from another crate and turns its panics into errors.
///
/// Some decoders panic on some contradictory files; such a file must not end the caller. The decoder
/// gets a `wanted` that remembers its first refusal. A decoder may take the read error of
/// [`WantedBytes`](crate::wanted::WantedBytes) for the end of the file and return a picture: after a
/// refusal the result is [`DecodeError::Cancelled`], whatever the decoder returned.
pub(crate) fn guarded<T>(
    format: PictureFormat,
    wanted: &Wanted<'_>,
    decode: impl FnOnce(&Wanted<'_>) -> Result<T, DecodeError>,
) -> Result<T, DecodeError> {
    let refused = AtomicBool::new(false);
    let is_wanted = || {
        if refused.load(Ordering::Relaxed) {
            return Err(Cancelled);
        }
        wanted().inspect_err(|_| refused.store(true, Ordering::Relaxed))
    };
    GUARDED.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| decode(&is_wanted)));
    GUARDED.set(false);
    if refused.into_inner() {
        return Err(Cancelled.into());
    }
    result.unwrap_or_else(|_| Err(format.malformed("the decoder panicked")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wanted::always;
    use std::cell::Cell;

    #[test]
    fn panics_become_errors_and_hooks_can_tell() {
        let inside = Cell::new(false);
        let result: Result<(), _> = guarded(PictureFormat::Gif, &always, |_| {
            inside.set(in_guarded_decoder());
            panic!("a decoder's defect")
        });
        let refused = PictureFormat::Gif.malformed("the decoder panicked");
        assert_eq!((result, inside.get(), in_guarded_decoder()), (Err(refused), true, false));
    }

    #[test]
    fn a_picture_made_after_a_refusal_is_dropped() {
        let polls = Cell::new(0);
        let polled = AtomicBool::new(false);
        let refuse = || {
            assert!(!polled.swap(true, Ordering::Relaxed), "polled after the refusal");
            Err(Cancelled)
        };
        let result = guarded(PictureFormat::Jpeg, &refuse, |wanted| {
            while polls.get() < 3 {
                assert!(wanted().is_err());
                polls.set(polls.get() + 1);
            }
            Ok("gray filled in")
        });
        assert_eq!(result, Err(Cancelled.into()));
    }
}
