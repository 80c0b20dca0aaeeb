//! The boundary to decoders from other crates.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::wanted::Wanted;
use pixmesh_meshing::Cancelled;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

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
    let result = catch_unwind(AssertUnwindSafe(|| decode(&is_wanted)));
    if refused.into_inner() {
        return Err(Cancelled.into());
    }
    result.unwrap_or_else(|_| Err(format.malformed("the decoder panicked")))
}
