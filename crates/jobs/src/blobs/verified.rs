//! Whether what lies in the store is what was put there: a disk may give other bytes than it was
//! given, and nobody shall get these as an image or a mesh.

use super::failure;
use crate::queue::QueueError;
use bytes::Bytes;
use futures_util::StreamExt;
use object_store::path::Path as BlobPath;
use object_store::{ObjectStore, ObjectStoreExt};
use pixmesh_engine::digest::Digest;
use sha2::{Digest as _, Sha256};
use tokio::task::spawn_blocking;

/// The bytes, if they are those of the digest.
pub(super) async fn whole(digest: Digest, bytes: Bytes) -> Result<Bytes, QueueError> {
    let checked = spawn_blocking(move || (Digest::of(&bytes) == digest).then_some(bytes)).await;
    checked.map_err(|error| QueueError::Storage(error.to_string()))?.ok_or_else(|| damaged(digest))
}

/// Reads a blob through, piece by piece, and refuses it when it is not that of the digest.
pub(super) async fn stored(
    store: &dyn ObjectStore,
    place: &BlobPath,
    digest: Digest,
) -> Result<(), QueueError> {
    let mut pieces = store.get(place).await.map_err(|error| failure(&error))?.into_stream();
    let mut hash = Sha256::new();
    while let Some(piece) = pieces.next().await {
        let piece = piece.map_err(|error| failure(&error))?;
        let hashed = spawn_blocking(move || {
            hash.update(&piece);
            hash
        });
        hash = hashed.await.map_err(|error| QueueError::Storage(error.to_string()))?;
    }
    if Digest::of_pieces(hash) == digest { Ok(()) } else { Err(damaged(digest)) }
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
    use super::super::{Blobs, place};
    use super::*;

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
            assert!(matches!(blobs.read(digest, 0..4).await, Err(QueueError::Damaged(_))));
            blobs.put(&hold, digest, bytes.clone()).await.unwrap();
            assert_eq!(blobs.get(digest).await.unwrap(), bytes);
        }
    }
}
