//! The mesh as the bytes of a response.

use crate::pool::Watch;
use crate::problem::Problem;
use pixmesh_codec::{
    Encodable, EncodeError, EncodeOptions, Format, encode as write, estimated_bytes,
};
use std::io::{self, Write};

/// Bytes written between two polls of the watch: about a tenth of a millisecond's work.
const POLL_BYTES: usize = 1 << 16;

/// A buffer that fails to grow once nobody waits for its bytes.
pub(super) struct Watched<'a> {
    bytes: Vec<u8>,
    /// Its length at the last poll of the watch.
    polled_at: usize,
    watch: &'a Watch,
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.bytes.len() - self.polled_at >= POLL_BYTES {
            self.watch.check().map_err(io::Error::other)?;
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
    watch: &Watch,
) -> Result<Vec<u8>, Problem> {
    let capacity = estimated_bytes(source.mesh, format, options);
    encoded(capacity, watch, |out| write(source, format, options, out, &|| watch.check()))
}

/// The bytes that `write` writes, in a buffer without spare capacity.
pub(super) fn encoded(
    capacity: usize,
    watch: &Watch,
    write: impl FnOnce(&mut Watched<'_>) -> Result<(), EncodeError>,
) -> Result<Vec<u8>, Problem> {
    watch.begin("encode");
    let mut out = Watched { bytes: Vec::with_capacity(capacity), polled_at: 0, watch };
    let written = write(&mut out);
    watch.check()?;
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
        let watch = Watch::new(Instant::now() + Duration::from_secs(60));
        let mut written = 0;
        let refused = encoded(0, &watch, |out| {
            for row in 0..100 {
                if row == 10 {
                    watch.cancel();
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
