//! Pictures and meshes, each under the digest of its bytes.
//!
//! A blob is written to a staged file, synced, and renamed, so that one that is there is whole and
//! on stable storage. Several jobs may have the same one. Whoever stores a blob keeps a [`Hold`]
//! until a job has it: only when there are no holds are blobs that no job has deleted. What is read
//! is what was stored, or it is refused as damaged.

mod verified;

use super::queue::QueueError;
use crate::digest::Digest;
use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::stream::BoxStream;
use object_store::local::LocalFileSystem;
use object_store::path::Path as BlobPath;
use object_store::{GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use std::error::Error;
use std::fs;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::{OwnedRwLockReadGuard, RwLock};

/// The store of blobs.
#[derive(Clone, Debug)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    folder: PathBuf,
    holds: Arc<RwLock<()>>,
}

/// Keeps blobs that no job has yet from being deleted.
#[derive(Debug)]
pub struct Hold(#[allow(dead_code, reason = "it is what is held")] OwnedRwLockReadGuard<()>);

/// Stops everybody from storing blobs while some are deleted.
#[derive(Debug)]
pub struct Clearing<'a> {
    blobs: &'a Blobs,
    _none_held: tokio::sync::RwLockWriteGuard<'a, ()>,
}

impl Blobs {
    /// The blobs in a folder, which is made where there is none.
    ///
    /// # Errors
    /// When the folder cannot be used.
    pub fn in_folder(folder: &Path) -> Result<Self, Box<dyn Error>> {
        fs::create_dir_all(folder)?;
        let store = LocalFileSystem::new_with_prefix(folder)?.with_fsync(true);
        let (store, holds) = (Arc::new(store), Arc::default());
        Ok(Self { store, folder: folder.to_owned(), holds })
    }

    /// Keeps blobs from being deleted before a job has them.
    pub async fn hold(&self) -> Hold {
        Hold(Arc::clone(&self.holds).read_owned().await)
    }

    /// Stores bytes under their digest, and returns when they are on stable storage.
    ///
    /// # Errors
    /// When the storage is full or fails.
    pub async fn put(&self, _: &Hold, digest: Digest, bytes: Bytes) -> Result<(), QueueError> {
        let place = place(digest);
        if verified::is_same(&*self.store, &place, &bytes).await {
            return Ok(());
        }
        self.store.put(&place, bytes.into()).await.map(|_| ()).map_err(|error| failure(&error))
    }

    /// The whole of a blob.
    ///
    /// # Errors
    /// When it is not there, or the storage fails.
    pub async fn get(&self, digest: Digest) -> Result<Bytes, QueueError> {
        let found = self.store.get(&place(digest)).await.map_err(|error| failure(&error))?;
        let bytes = found.bytes().await.map_err(|error| failure(&error))?;
        verified::whole(digest, bytes).await
    }

    /// A part of a blob at once.
    ///
    /// # Errors
    /// When it is not there, or the storage fails.
    pub async fn get_part(&self, digest: Digest, range: Range<u64>) -> Result<Bytes, QueueError> {
        let found = self.store.get_range(&place(digest), range).await;
        found.map_err(|error| failure(&error))
    }

    /// A part of a blob, piece by piece.
    ///
    /// # Errors
    /// When it is not there, or the storage fails.
    pub async fn read(
        &self,
        digest: Digest,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, io::Result<Bytes>>, QueueError> {
        verified::stored(&*self.store, &place(digest), digest).await?;
        let options = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        let found = self.store.get_opts(&place(digest), options).await;
        let found = found.map_err(|error| failure(&error))?;
        Ok(found.into_stream().map(|piece| piece.map_err(io::Error::other)).boxed())
    }

    /// Waits until nobody holds blobs, so that those that no job has can be told.
    pub async fn clear(&self) -> Clearing<'_> {
        Clearing { blobs: self, _none_held: self.holds.write().await }
    }

    /// Every blob there is. Staged files that were never renamed are removed on the way: nobody may
    /// be storing blobs, as nobody is during [`Self::clear`].
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn all(&self) -> io::Result<Vec<Digest>> {
        let mut found = Vec::new();
        for shelf in fs::read_dir(&self.folder)? {
            let shelf = shelf?.path();
            if !shelf.is_dir() {
                continue;
            }
            for file in fs::read_dir(shelf)? {
                let file = file?;
                match file.file_name().to_str().and_then(|name| name.parse().ok()) {
                    Some(digest) => found.push(digest),
                    None => fs::remove_file(file.path())?,
                }
            }
        }
        Ok(found)
    }
}

impl Clearing<'_> {
    /// Deletes a blob, if it is there.
    ///
    /// # Errors
    /// When the storage fails.
    pub async fn delete(&self, digest: Digest) -> Result<(), QueueError> {
        match self.blobs.store.delete(&place(digest)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(failure(&error)),
        }
    }
}

/// Where a blob is: on one of 256 shelves.
fn place(digest: Digest) -> BlobPath {
    let name = digest.to_string();
    BlobPath::from_iter([&name[..2], &name[..]])
}

/// What a failure of the store means, by the system's error somewhere among its causes.
fn failure(error: &object_store::Error) -> QueueError {
    let mut causes = std::iter::successors(Some(error as &dyn Error), |&error| error.source());
    let kind = causes.find_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
    match kind {
        Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge) => {
            QueueError::StorageFull(error.to_string())
        }
        _ => QueueError::Storage(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blobs(name: &str) -> Blobs {
        Blobs::in_folder(&super::super::folder_for_test(name)).unwrap()
    }

    #[tokio::test]
    async fn what_is_put_is_there_in_whole_and_in_part_until_it_is_deleted() {
        let blobs = blobs("blobs");
        let bytes = Bytes::from_static(b"ten bytes!");
        let digest = Digest::of(&bytes);
        let hold = blobs.hold().await;
        for _ in 0..2 {
            blobs.put(&hold, digest, bytes.clone()).await.unwrap();
        }
        drop(hold);
        assert_eq!(blobs.get(digest).await.unwrap(), bytes);
        let part: Vec<_> = blobs.read(digest, 4..9).await.unwrap().collect().await;
        assert_eq!(part.into_iter().collect::<io::Result<Vec<_>>>().unwrap().concat(), b"bytes");
        assert_eq!(blobs.all().unwrap(), [digest]);
        let clearing = blobs.clear().await;
        clearing.delete(digest).await.unwrap();
        clearing.delete(digest).await.unwrap();
        assert!(blobs.get(digest).await.is_err() && blobs.all().unwrap().is_empty());
    }

    #[tokio::test]
    async fn nothing_is_cleared_while_somebody_holds_blobs() {
        let blobs = blobs("holds");
        let hold = blobs.hold().await;
        let soon = std::time::Duration::from_millis(20);
        assert!(tokio::time::timeout(soon, blobs.clear()).await.is_err());
        drop(hold);
        assert!(tokio::time::timeout(soon, blobs.clear()).await.is_ok());
    }

    #[test]
    fn files_that_were_never_renamed_are_removed() {
        let blobs = blobs("staged");
        let shelf = blobs.folder.join("ab");
        fs::create_dir_all(&shelf).unwrap();
        fs::write(shelf.join("abcd#1"), b"half").unwrap();
        assert!(blobs.all().unwrap().is_empty());
        assert!(!shelf.join("abcd#1").exists());
    }
}
