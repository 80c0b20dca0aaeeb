//! Chunks of blobs, each with a digest.

use pixmesh_engine::digest::Digest;
use pixmesh_meshing::Cancelled;
use std::ops::Range;

/// A blob with the digests of its chunks, which verify a part of it without the rest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunkedBlob {
    /// SHA-256 of all bytes: the name of the blob.
    pub digest: Digest,
    /// Length in bytes.
    pub bytes: u64,
    /// SHA-256 of each chunk of [`CHUNK_BYTES`]; empty if the blob is one chunk, whatever its
    /// length.
    pub chunks: Vec<Digest>,
}

/// Length of a chunk in bytes. The last chunk of a blob may be shorter.
pub const CHUNK_BYTES: u64 = 256 << 10;

/// SHA-256 of each chunk; empty if there is one chunk.
///
/// # Errors
/// When `wanted`, which is called for every chunk, returns an error.
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

    /// The bytes of a chunk.
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
