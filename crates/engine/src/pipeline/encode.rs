//! The mesh as the bytes of a response.

use crate::context::Context;
use crate::error::EngineError;
use pixmesh_codec::{
    Encodable, EncodeError, EncodeOptions, Format, encode as write, estimated_bytes,
};
use std::io::{self, Write};

/// Bytes written between two polls of the context: about a tenth of a millisecond's work.
const POLL_BYTES: usize = 1 << 16;

/// A buffer that fails to grow once nobody waits for its bytes.
pub(super) struct Watched<'a> {
    bytes: Vec<u8>,
    /// Its length at the last poll of the context.
    polled_at: usize,
    context: &'a Context,
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.bytes.len() - self.polled_at >= POLL_BYTES {
            self.context.check().map_err(io::Error::other)?;
            self.polled_at = self.bytes.len();
        }
        self.bytes.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The mesh, or the picture rebuilt from it, in a format.
pub(super) fn encode(
    source: &Encodable<'_>,
    format: Format,
    options: &EncodeOptions<'_>,
    context: &Context,
) -> Result<Vec<u8>, EngineError> {
    let capacity = estimated_bytes(source.mesh, format, options);
    encoded(capacity, context, |out| write(source, format, options, out, &|| context.check()))
}

/// The bytes that `write` writes, in a buffer without spare capacity.
pub(super) fn encoded(
    capacity: usize,
    context: &Context,
    write: impl FnOnce(&mut Watched<'_>) -> Result<(), EncodeError>,
) -> Result<Vec<u8>, EngineError> {
    context.begin("encode");
    let mut out = Watched { bytes: Vec::with_capacity(capacity), polled_at: 0, context };
    let written = write(&mut out);
    context.check()?;
    written?;
    let mut bytes = out.bytes;
    bytes.shrink_to_fit();
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn writing_stops_after_a_cancellation() {
        let context = Context::new(Instant::now() + Duration::from_secs(60));
        let mut written = 0;
        let refused = encoded(0, &context, |out| {
            for row in 0..100 {
                if row == 10 {
                    context.cancel();
                }
                out.write_all(&[0; POLL_BYTES])?;
                written += 1;
            }
            Ok(())
        });
        assert!(refused.is_err());
        assert_eq!(written, 10);
    }
}
