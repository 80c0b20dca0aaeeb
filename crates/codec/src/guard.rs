//! The border to decoders of others.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use pixmesh_meshing::Cancelled;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs a decoder that belongs to others, makes a panic of its own a refusal, and ends what
/// [`WantedBytes`](crate::wanted::WantedBytes) has unwound.
///
/// Some decoders are known to panic on some contradictory files; those that are not refused before
/// must not take their caller down. Whatever the decoder was about to make is dropped with it.
pub(crate) fn guarded<T>(
    format: PictureFormat,
    decode: impl FnOnce() -> Result<T, DecodeError>,
) -> Result<T, DecodeError> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|payload| {
        Err(match payload.downcast_ref::<Cancelled>() {
            Some(&cancelled) => cancelled.into(),
            None => format.malformed("its decoder gave up"),
        })
    })
}
