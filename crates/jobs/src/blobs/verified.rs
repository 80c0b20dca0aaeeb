//! Verification of stored blobs by their digests: a disk may return other bytes than were written.

use super::chunks::ChunkedBlob;
use super::failure::failure;
use crate::queue::QueueError;
use bytes::{Bytes, BytesMut};
use futures_util::stream::{self, BoxStream};
use futures_util::{Stream, StreamExt};
use object_store::path::Path as BlobPath;
use object_store::{GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use pixmesh_engine::digest::Digest;
use std::ops::Range;
use tokio::task::spawn_blocking;

/// The bytes, if they match the digest.
pub(super) async fn whole(digest: Digest, bytes: Bytes) -> Result<Bytes, QueueError> {
    let checked = spawn_blocking(move || (Digest::of(&bytes) == digest).then_some(bytes)).await;
    checked.map_err(|error| QueueError::Storage(error.to_string()))?.ok_or_else(|| damaged(digest))
}

/// The rest of a blob to read: the chunks from `index` on that overlap `range`.
struct Reading {
    pieces: BoxStream<'static, object_store::Result<Bytes>>,
    buffer: BytesMut,
    blob: ChunkedBlob,
    range: Range<u64>,
    index: u64,
}

/// A part of a blob as a stream of verified chunks.
///
/// # Errors
/// When the store fails, or the blob is shorter.
pub(super) async fn part(
    store: &dyn ObjectStore,
    path: &BlobPath,
    blob: ChunkedBlob,
    range: Range<u64>,
) -> Result<impl Stream<Item = Result<Bytes, QueueError>> + Send + use<>, QueueError> {
    let index = range.start / blob.chunk_bytes();
    let read = blob.chunk(index).start..blob.chunk((range.end - 1) / blob.chunk_bytes()).end;
    let end = read.end;
    let options = GetOptions { range: Some(GetRange::Bounded(read)), ..GetOptions::default() };
    let pieces = match store.get_opts(path, options).await {
        Ok(found) => found.into_stream(),
        // Stores refuse a range beyond the end of a blob that is too short.
        Err(error) => match store.head(path).await {
            Ok(meta) if meta.size < end => return Err(damaged(blob.digest)),
            _ => return Err(failure(&error)),
        },
    };
    let reading = Reading { pieces, buffer: BytesMut::new(), blob, range, index };
    Ok(stream::try_unfold(reading, |reading| reading.next()))
}

impl Reading {
    /// The next chunk, cut to the range; `None` after the last one.
    async fn next(mut self) -> Result<Option<(Bytes, Self)>, QueueError> {
        let chunk = self.blob.chunk(self.index);
        if chunk.start >= self.range.end {
            return Ok(None);
        }
        let length = (chunk.end - chunk.start) as usize;
        while self.buffer.len() < length {
            let piece = self.pieces.next().await.ok_or_else(|| damaged(self.blob.digest))?;
            self.buffer.extend_from_slice(&piece.map_err(|error| failure(&error))?);
        }
        let digest = self.blob.digest_of(self.index).ok_or_else(|| damaged(self.blob.digest))?;
        let bytes = whole(digest, self.buffer.split_to(length).freeze()).await?;
        let start = self.range.start.max(chunk.start) - chunk.start;
        let end = self.range.end.min(chunk.end) - chunk.start;
        self.index += 1;
        Ok(Some((bytes.slice(start as usize..end as usize), self)))
    }
}

/// Whether the store has these bytes under a path.
pub(super) async fn is_same(store: &dyn ObjectStore, path: &BlobPath, bytes: &Bytes) -> bool {
    let Ok(found) = store.get(path).await else { return false };
    if found.meta.size != bytes.len() as u64 {
        return false;
    }
    let (mut pieces, mut rest) = (found.into_stream(), &bytes[..]);
    while let Some(piece) = pieces.next().await {
        match piece.ok().and_then(|piece| rest.strip_prefix(&piece[..])) {
            Some(left) => rest = left,
            None => return false,
        }
    }
    rest.is_empty()
}

fn damaged(digest: Digest) -> QueueError {
    QueueError::Damaged(format!("the blob {digest} is damaged"))
}

#[cfg(test)]
mod tests {
    use super::super::chunks::{CHUNK_BYTES, chunk_digests};
    use super::super::path_of;
    use super::*;
    use crate::testing::blobs;

    fn one_chunk(bytes: &[u8]) -> ChunkedBlob {
        ChunkedBlob { digest: Digest::of(bytes), bytes: bytes.len() as u64, chunks: Vec::new() }
    }

    #[tokio::test]
    async fn part_is_verified_by_its_chunks() {
        let (blobs, _folder) = blobs();
        let chunk = CHUNK_BYTES as usize;
        let bytes: Bytes = (0..2 * chunk + 1000).map(|i| ((i * 31) >> 3) as u8).collect();
        let chunks = chunk_digests(&bytes, || Ok(())).unwrap();
        assert_eq!(chunks.len(), 3);
        let blob = ChunkedBlob { chunks, ..one_chunk(&bytes) };
        let pin = blobs.pin().await;
        blobs.put(&pin, blob.digest, bytes.clone()).await.unwrap();
        let end = bytes.len();
        for range in [0..end, 0..1, chunk - 1..chunk + 1, chunk..2 * chunk, end - 1..end, 5..end] {
            let part = range.start as u64..range.end as u64;
            let read = blobs.get_part(blob.clone(), part).await.unwrap();
            assert_eq!(read, bytes[range]);
        }
        let mut changed = bytes.to_vec();
        changed[chunk + 7] ^= 1;
        std::fs::write(blobs.folder_for_test().join(path_of(blob.digest).as_ref()), &changed)
            .unwrap();
        let refused = |read: Result<Bytes, QueueError>| matches!(read, Err(QueueError::Damaged(_)));
        assert!(blobs.get_part(blob.clone(), 0..9).await.is_ok(), "another chunk");
        assert!(refused(blobs.get_part(blob.clone(), CHUNK_BYTES..CHUNK_BYTES + 1).await));
        assert!(refused(blobs.get_part(blob.clone(), 0..end as u64).await));
        let mut pieces = blobs.read(blob, 0..end as u64).await.unwrap();
        assert_eq!(pieces.next().await.unwrap().unwrap(), bytes[..chunk]);
        assert!(pieces.next().await.unwrap().is_err(), "the stream ends with an error");
    }

    #[tokio::test]
    async fn damaged_blob_is_refused_and_rewritten() {
        let (blobs, _folder) = blobs();
        let bytes = Bytes::from_static(b"what was stored");
        let digest = Digest::of(&bytes);
        let pin = blobs.pin().await;
        blobs.put(&pin, digest, bytes.clone()).await.unwrap();
        let path = blobs.folder_for_test().join(path_of(digest).as_ref());
        for changed in [&b"what Was stored"[..], b"what was", b"", b"what was stored, and more"] {
            std::fs::write(&path, changed).unwrap();
            assert!(matches!(blobs.get(digest).await, Err(QueueError::Damaged(_))));
            let part = blobs.get_part(one_chunk(&bytes), 0..4).await;
            match changed.starts_with(&bytes) {
                true => assert_eq!(part.unwrap(), b"what"[..]),
                false => assert!(matches!(part, Err(QueueError::Damaged(_))), "{part:?}"),
            }
            blobs.put(&pin, digest, bytes.clone()).await.unwrap();
            assert_eq!(blobs.get(digest).await.unwrap(), bytes);
        }
    }
}
