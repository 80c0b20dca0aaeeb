//! A blob in chunks, each with its own digest.

use pixmesh_engine::digest::Digest;
use pixmesh_meshing::Cancelled;
use std::ops::Range;

/// A blob with the digests of its chunks, by which a part of it is checked without the rest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunkedBlob {
    /// SHA-256 of all bytes, which is the blob's name.
    pub digest: Digest,
    /// Length in bytes.
    pub bytes: u64,
    /// SHA-256 of each [`CHUNK_BYTES`] of it; empty for a blob that is one chunk, whatever its length.
    pub chunks: Vec<Digest>,
}

/// Length of a chunk in bytes; the last one of a blob may be shorter.
pub const CHUNK_BYTES: u64 = 256 << 10;

/// SHA-256 of each chunk of some bytes; empty where there is one chunk.
///
/// # Errors
/// When they are no longer wanted; the question is asked for every chunk.
pub fn chunk_digests(
    bytes: &[u8],
    wanted: impl Fn() -> Result<(), Cancelled>,
) -> Result<Vec<Digest>, Cancelled> {
    if bytes.len() as u64 <= CHUNK_BYTES {
        return Ok(Vec::new());
    }
    let chunks = bytes.chunks(CHUNK_BYTES as usize);
    chunks.map(|chunk| wanted().map(|()| Digest::of(chunk))).collect()
}

impl ChunkedBlob {
    pub(super) fn chunk_bytes(&self) -> u64 {
        if self.chunks.is_empty() { self.bytes.max(1) } else { CHUNK_BYTES }
    }

    /// Where a chunk lies.
    pub(super) fn chunk(&self, index: u64) -> Range<u64> {
        let start = index * self.chunk_bytes();
        start..(start + self.chunk_bytes()).min(self.bytes)
    }

    pub(super) fn digest_of(&self, index: u64) -> Option<Digest> {
        match self.chunks.is_empty() {
            true => Some(self.digest),
            false => self.chunks.get(usize::try_from(index).ok()?).copied(),
        }
    }
}
