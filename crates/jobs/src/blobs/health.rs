//! Whether the last write of a blob succeeded.

use std::sync::atomic::{AtomicUsize, Ordering};

/// The result of the last write.
#[derive(Debug, Default)]
pub(super) struct Health {
    /// Bytes of the blob, at least 1, if the write failed; else 0.
    failed_bytes: AtomicUsize,
}

impl Health {
    /// Stores the result of writing a blob of a length in bytes.
    pub(super) fn note(&self, length: usize, is_stored: bool) {
        let failed = if is_stored { 0 } else { length.max(1) };
        self.failed_bytes.store(failed, Ordering::Release);
    }

    /// The length of the blob, at least 1, if the write failed; else 0.
    pub(super) fn failed_bytes(&self) -> usize {
        self.failed_bytes.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PROBE, path_of};
    use crate::testing::blobs;
    use bytes::Bytes;
    use pixmesh_engine::digest::Digest;
    use std::fs;

    #[tokio::test]
    async fn failed_store_is_healthy_after_a_probe() {
        for content in [&b"a picture"[..], b""] {
            let (blobs, _folder) = blobs();
            assert!(blobs.is_healthy());
            let bytes = Bytes::from_static(content);
            let digest = Digest::of(&bytes);
            // No file can be renamed to the name of a folder.
            fs::create_dir_all(blobs.folder_for_test().join(path_of(digest).as_ref())).unwrap();
            let pin = blobs.pin().await;
            assert!(blobs.put(&pin, digest, bytes).await.is_err());
            assert!(!blobs.is_healthy());
            let in_the_way = blobs.folder_for_test().join(PROBE);
            fs::create_dir(&in_the_way).unwrap();
            blobs.probe().await;
            assert!(!blobs.is_healthy());
            fs::remove_dir(&in_the_way).unwrap();
            blobs.probe().await;
            assert!(blobs.is_healthy());
            assert!(!in_the_way.exists(), "the probe is deleted");
        }
    }
}
