//! Whether the store of blobs took what it was last given.

use std::sync::atomic::{AtomicUsize, Ordering};

/// What the store did with the blob that it was last given.
#[derive(Debug, Default)]
pub(super) struct Health {
    /// Bytes of the blob that it did not take, at least 1; 0 when it took it.
    refused: AtomicUsize,
}

impl Health {
    /// Takes down what became of a blob of so many bytes.
    pub(super) fn note(&self, length: usize, was_taken: bool) {
        let refused = if was_taken { 0 } else { length.max(1) };
        self.refused.store(refused, Ordering::Release);
    }

    /// Bytes of the blob that the store did not take, at least 1; 0 when it took it.
    pub(super) fn refused(&self) -> usize {
        self.refused.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Blobs, PROBE, place};
    use bytes::Bytes;
    use pixmesh_engine::digest::Digest;
    use std::fs;

    #[tokio::test]
    async fn a_store_that_took_no_blob_is_ready_when_it_takes_a_probe() {
        for content in [&b"a picture"[..], b""] {
            let folder = crate::folder_for_test("health");
            let blobs = Blobs::in_folder(&folder).unwrap();
            assert!(blobs.is_healthy());
            let bytes = Bytes::from_static(content);
            let digest = Digest::of(&bytes);
            // A folder in its place is one that no file can be renamed to.
            fs::create_dir_all(folder.join(place(digest).as_ref())).unwrap();
            let hold = blobs.hold().await;
            assert!(blobs.put(&hold, digest, bytes).await.is_err());
            assert!(!blobs.is_healthy());
            let in_the_way = folder.join(PROBE);
            fs::create_dir(&in_the_way).unwrap();
            blobs.probe().await;
            assert!(!blobs.is_healthy());
            fs::remove_dir(&in_the_way).unwrap();
            blobs.probe().await;
            assert!(blobs.is_healthy());
            assert!(!in_the_way.exists(), "the probe is not kept");
        }
    }
}
