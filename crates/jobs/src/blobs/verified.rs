//! Whether what lies in the store is what was put there: a disk may give other bytes than it was
//! given, and nobody shall get these as an image or a mesh.

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

/// The bytes, if they are those of the digest.
pub(super) async fn whole(digest: Digest, bytes: Bytes) -> Result<Bytes, QueueError> {
    let checked = spawn_blocking(move || (Digest::of(&bytes) == digest).then_some(bytes)).await;
    checked.map_err(|error| QueueError::Storage(error.to_string()))?.ok_or_else(|| damaged(digest))
}

/// What is left to read of a blob: its chunks from `index` on, as far as `range` needs them.
struct Reading {
    pieces: BoxStream<'static, object_store::Result<Bytes>>,
    buffer: BytesMut,
    blob: ChunkedBlob,
    range: Range<u64>,
    index: u64,
}

/// A part of a blob, chunk by chunk, each checked before it is given out.
///
/// # Errors
/// When the store fails, or does not have as much of the blob.
pub(super) async fn part(
    store: &dyn ObjectStore,
    place: &BlobPath,
    blob: ChunkedBlob,
    range: Range<u64>,
) -> Result<impl Stream<Item = Result<Bytes, QueueError>> + Send + use<>, QueueError> {
    let index = range.start / blob.chunk_bytes();
    let read = blob.chunk(index).start..blob.chunk((range.end - 1) / blob.chunk_bytes()).end;
    let end = read.end;
    let options = GetOptions { range: Some(GetRange::Bounded(read)), ..GetOptions::default() };
    let pieces = match store.get_opts(place, options).await {
        Ok(found) => found.into_stream(),
        // Stores refuse a range behind the end of a blob that has become shorter.
        Err(error) => match store.head(place).await {
            Ok(meta) if meta.size < end => return Err(damaged(blob.digest)),
            _ => return Err(failure(&error)),
        },
    };
    let reading = Reading { pieces, buffer: BytesMut::new(), blob, range, index };
    Ok(stream::try_unfold(reading, |reading| reading.next()))
}

impl Reading {
    /// The next chunk, cut to the range; `None` behind the last one.
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

/// Whether the store has these bytes at a place already; what cannot be read is not the same.
pub(super) async fn is_same(store: &dyn ObjectStore, place: &BlobPath, bytes: &Bytes) -> bool {
    let Ok(found) = store.get(place).await else { return false };
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
    QueueError::Damaged(format!("the blob {digest} holds other bytes"))
}

#[cfg(test)]
mod tests {
    use super::super::chunks::{CHUNK_BYTES, chunk_digests};
    use super::super::{Blobs, place};
    use super::*;

    fn one_chunk(bytes: &[u8]) -> ChunkedBlob {
        ChunkedBlob { digest: Digest::of(bytes), bytes: bytes.len() as u64, chunks: Vec::new() }
    }

    #[tokio::test]
    async fn a_part_is_checked_by_its_own_chunks() {
        let folder = crate::folder_for_test("chunks");
        let blobs = Blobs::in_folder(&folder).unwrap();
        let chunk = CHUNK_BYTES as usize;
        let bytes: Bytes = (0..2 * chunk + 1000).map(|i| ((i * 31) >> 3) as u8).collect();
        let chunks = chunk_digests(&bytes, || Ok(())).unwrap();
        assert_eq!(chunks.len(), 3);
        let blob = ChunkedBlob { chunks, ..one_chunk(&bytes) };
        let hold = blobs.hold().await;
        blobs.put(&hold, blob.digest, bytes.clone()).await.unwrap();
        let end = bytes.len();
        for range in [0..end, 0..1, chunk - 1..chunk + 1, chunk..2 * chunk, end - 1..end, 5..end] {
            let part = range.start as u64..range.end as u64;
            let read = blobs.get_part(blob.clone(), part).await.unwrap();
            assert_eq!(read, bytes[range]);
        }
        let mut changed = bytes.to_vec();
        changed[chunk + 7] ^= 1;
        std::fs::write(folder.join(place(blob.digest).as_ref()), &changed).unwrap();
        let refused = |read: Result<Bytes, QueueError>| matches!(read, Err(QueueError::Damaged(_)));
        assert!(blobs.get_part(blob.clone(), 0..9).await.is_ok(), "another chunk");
        assert!(refused(blobs.get_part(blob.clone(), CHUNK_BYTES..CHUNK_BYTES + 1).await));
        assert!(refused(blobs.get_part(blob.clone(), 0..end as u64).await));
        let mut pieces = blobs.read(blob, 0..end as u64).await.unwrap();
        assert_eq!(pieces.next().await.unwrap().unwrap(), bytes[..chunk]);
        assert!(pieces.next().await.unwrap().is_err(), "the answer breaks off");
    }

    #[tokio::test]
    async fn a_blob_that_was_changed_on_the_disk_is_refused_and_written_anew() {
        let folder = crate::folder_for_test("damaged");
        let blobs = Blobs::in_folder(&folder).unwrap();
        let bytes = Bytes::from_static(b"what was stored");
        let digest = Digest::of(&bytes);
        let hold = blobs.hold().await;
        blobs.put(&hold, digest, bytes.clone()).await.unwrap();
        let path = folder.join(place(digest).as_ref());
        for changed in [&b"what Was stored"[..], b"what was", b"", b"what was stored, and more"] {
            std::fs::write(&path, changed).unwrap();
            assert!(matches!(blobs.get(digest).await, Err(QueueError::Damaged(_))));
            let part = blobs.get_part(one_chunk(&bytes), 0..4).await;
            match changed.starts_with(&bytes) {
                true => assert_eq!(part.unwrap(), b"what"[..]),
                false => assert!(matches!(part, Err(QueueError::Damaged(_))), "{part:?}"),
            }
            blobs.put(&hold, digest, bytes.clone()).await.unwrap();
            assert_eq!(blobs.get(digest).await.unwrap(), bytes);
        }
    }
}
