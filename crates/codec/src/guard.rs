//! The border to decoders of others.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use std::panic::{UnwindSafe, catch_unwind};

/// Runs a decoder that belongs to others, and makes a panic of its own a refusal.
///
/// Some decoders are known to panic on some contradictory files; those that are not refused before
/// must not take their caller down.
pub(crate) fn guarded<T>(
    format: PictureFormat,
    decode: impl FnOnce() -> Result<T, DecodeError> + UnwindSafe,
) -> Result<T, DecodeError> {
    catch_unwind(decode).unwrap_or_else(|_| Err(format.malformed("its decoder gave up")))
}
