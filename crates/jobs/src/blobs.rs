//! Pictures and meshes, each under the digest of its bytes.
//!
//! A blob is written to a staged file, synced, and renamed, so that one that is there is whole and
//! on stable storage. Several jobs may have the same one. Whoever stores a blob keeps a [`Hold`]
//! until a job has it: only when there are no holds are blobs that no job has deleted. What is read
//! is what was stored, or it is refused as damaged.
//!
//! In a store that nodes share, nobody can wait for all holds. There a blob is young for
//! [`YOUNG`], in which its job is stored, and only older ones are deleted; one that is stored again
//! is made young again.

pub mod chunks;
mod failure;
mod health;
mod location;
mod verified;

pub use location::BlobEngine;

use crate::queue::QueueError;
use bytes::{Bytes, BytesMut};
use chunks::ChunkedBlob;
use failure::failure;
use futures_util::StreamExt;
use futures_util::stream::{self, BoxStream};
use health::Health;
use object_store::aws::AmazonS3Builder;
use object_store::local::LocalFileSystem;
use object_store::path::Path as BlobPath;
use object_store::prefix::PrefixStore;
use object_store::{
    BackoffConfig, ClientOptions, ObjectMeta, ObjectStore, ObjectStoreExt, RetryConfig,
};
use pixmesh_engine::digest::Digest;
use std::error::Error;
use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::sync::{OwnedRwLockReadGuard, RwLock};

/// How long a blob of a shared store is not deleted after it was stored. Half of that is far longer
/// than a job takes to be stored behind it.
const YOUNG: Duration = Duration::from_hours(1);
/// How long a request to a store on the network may take.
const REQUEST_TIME: Duration = Duration::from_secs(60);
/// How long such a store may take to answer a connection.
const CONNECT_TIME: Duration = Duration::from_secs(5);
/// How long a request that fails is made again.
const RETRY_TIME: Duration = Duration::from_secs(10);
/// How often a blob of a shared store is looked for that another node has just stored.
const LOOKS: usize = 5;
/// The pause between two looks.
const PAUSE: Duration = Duration::from_millis(200);

/// The name of a blob that no job has, stored only to see whether that can be done again.
const PROBE: &str = "probe";

/// The store of blobs.
#[derive(Clone, Debug)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    /// Where this process alone keeps them; `None` in a store that nodes share.
    folder: Option<PathBuf>,
    holds: Arc<RwLock<()>>,
    health: Arc<Health>,
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
        let (store, folder) = (Arc::new(store), Some(folder.to_owned()));
        Ok(Self { store, folder, holds: Arc::default(), health: Arc::default() })
    }

    /// The blobs in a store that nodes share.
    ///
    /// # Errors
    /// When the store cannot be used, or is none that nodes share.
    pub async fn shared(engine: &BlobEngine) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let store: Arc<dyn ObjectStore> = match engine {
            BlobEngine::File => return Err("--blobs file is a store of one node".into()),
            BlobEngine::Folder(path) => {
                let named = |error| format!("--blobs {engine}: {error}");
                fs::create_dir_all(path).map_err(|error| named(error.to_string()))?;
                let store = LocalFileSystem::new_with_prefix(path);
                Arc::new(store.map_err(|error| named(error.to_string()))?.with_fsync(true))
            }
            BlobEngine::S3(address) => s3(address).await?,
        };
        let (holds, health) = (Arc::default(), Arc::default());
        let blobs = Self { store, folder: None, holds, health };
        // A name that nobody has shows whether the store answers and takes the credentials.
        match blobs.meta(Digest::of(b"")).await {
            Ok(_) => Ok(blobs),
            Err(error) => Err(format!("--blobs {engine}: {error}").into()),
        }
    }

    /// Whether nodes share them.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        self.folder.is_none()
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
        let known = self.meta(digest).await?;
        let is_fresh = known.is_some_and(|meta| !self.is_shared() || age(&meta) < YOUNG / 2);
        if is_fresh && verified::is_same(&*self.store, &place(digest), &bytes).await {
            return Ok(());
        }
        let length = bytes.len();
        let put = self.store.put(&place(digest), bytes.into()).await;
        self.health.note(length, put.is_ok());
        put.map(|_| ()).map_err(|error| self.failure(&error))
    }

    /// What is known of a blob; `None` when it is not there.
    async fn meta(&self, digest: Digest) -> Result<Option<ObjectMeta>, QueueError> {
        match self.store.head(&place(digest)).await {
            Ok(meta) => Ok(Some(meta)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failure(&error)),
        }
    }

    /// The whole of a blob.
    ///
    /// # Errors
    /// When it is not there, or the storage fails.
    pub async fn get(&self, digest: Digest) -> Result<Bytes, QueueError> {
        let mut looks = if self.is_shared() { LOOKS } else { 1 };
        loop {
            looks -= 1;
            let found = match self.store.get(&place(digest)).await {
                Ok(found) => match found.bytes().await {
                    // Another node may have put it once more meanwhile.
                    Err(_) if looks > 0 => continue,
                    found => found,
                },
                Err(object_store::Error::NotFound { .. }) if looks > 0 => {
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
                Err(error) => Err(error),
            };
            let bytes = found.map_err(|error| self.failure(&error))?;
            return verified::whole(digest, bytes).await;
        }
    }

    /// A part of a blob at once.
    ///
    /// # Errors
    /// When it is not there or is damaged, or the storage fails.
    pub async fn get_part(
        &self,
        blob: ChunkedBlob,
        range: Range<u64>,
    ) -> Result<Bytes, QueueError> {
        let mut part = BytesMut::with_capacity((range.end - range.start) as usize);
        let mut pieces = self.checked(blob, range).await?;
        while let Some(piece) = pieces.next().await {
            part.extend_from_slice(&piece?);
        }
        Ok(part.freeze())
    }

    /// A part of a blob, chunk by chunk. The first chunk is checked at once; a later one that is
    /// damaged is an error in the stream.
    ///
    /// # Errors
    /// When the blob is not there or its first chunk is damaged, or the storage fails.
    pub async fn read(
        &self,
        blob: ChunkedBlob,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, io::Result<Bytes>>, QueueError> {
        let mut pieces = self.checked(blob, range).await?;
        let first = pieces.next().await.transpose()?;
        let rest = pieces.map(|piece| piece.map_err(io::Error::other));
        Ok(stream::iter(first.map(Ok)).chain(rest).boxed())
    }

    /// The checked chunks of a part.
    async fn checked(
        &self,
        blob: ChunkedBlob,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, Result<Bytes, QueueError>>, QueueError> {
        let place = place(blob.digest);
        let pieces = verified::part(&*self.store, &place, blob, range).await;
        let pieces = pieces.map_err(|error| self.told(error))?;
        let blobs = self.clone();
        Ok(pieces.map(move |piece| piece.map_err(|error| blobs.told(error))).boxed())
    }

    /// Waits until nobody holds blobs, so that those that no job has can be told.
    pub async fn clear(&self) -> Clearing<'_> {
        Clearing { blobs: self, _none_held: self.holds.write().await }
    }

    /// Every blob there is, of those that this process alone keeps. Staged files that were never
    /// renamed are removed on the way: nobody may be storing blobs, as nobody is during
    /// [`Self::clear`].
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn all(&self) -> io::Result<Vec<Digest>> {
        let mut found = Vec::new();
        let Some(folder) = &self.folder else { return Ok(found) };
        for shelf in fs::read_dir(folder)? {
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

impl Blobs {
    /// Whether the store took what it was last given.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        self.health.refused() == 0
    }

    /// Where the store did not take its last blob: whether it takes as many bytes now. Without this
    /// one that nobody gives anything to, because it is not ready, would never be ready again.
    pub async fn probe(&self) {
        let length = self.health.refused();
        if length == 0 {
            return;
        }
        let path = BlobPath::from(PROBE);
        let was_taken = self.store.put(&path, vec![0; length].into()).await.is_ok();
        let _ = self.store.delete(&path).await;
        self.health.note(length, was_taken);
    }
}

impl Clearing<'_> {
    /// Deletes a blob, if it is there, and says whether it is so no more: one that is young in a
    /// store that nodes share stays, since somebody may have stored it for a job to come.
    ///
    /// # Errors
    /// When the storage fails.
    pub async fn delete(&self, digest: Digest) -> Result<bool, QueueError> {
        if self.blobs.is_shared() {
            let known = self.blobs.meta(digest).await?;
            if known.is_some_and(|meta| age(&meta) < YOUNG) {
                return Ok(false);
            }
        }
        match self.blobs.store.delete(&place(digest)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(true),
            Err(error) => Err(self.blobs.failure(&error)),
        }
    }
}

/// A bucket of an S3-compatible store, whose credentials, region and endpoint are in the variables
/// that Amazon's programs have.
async fn s3(address: &str) -> Result<Arc<dyn ObjectStore>, Box<dyn Error + Send + Sync>> {
    // The one provider of cryptography of this program; a second call changes nothing.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let endpoint = std::env::var("AWS_ENDPOINT_URL").unwrap_or_default();
    let options = ClientOptions::new()
        .with_timeout(REQUEST_TIME)
        .with_connect_timeout(CONNECT_TIME)
        .with_allow_http(endpoint.starts_with("http://"));
    let retry = RetryConfig {
        backoff: BackoffConfig::default(),
        max_retries: 3,
        retry_timeout: RETRY_TIME,
    };
    let builder = AmazonS3Builder::from_env().with_url(address);
    let store = builder.with_client_options(options).with_retry(retry).build();
    let store = store.map_err(|error| format!("--blobs {address}: {error}"))?;
    if let Some(Err(error)) = store.list(None).next().await {
        return Err(format!("--blobs {address}: {error}").into());
    }
    let path = address.trim_start_matches("s3://").split_once('/').map_or("", |(_, path)| path);
    Ok(match path.trim_matches('/') {
        "" => Arc::new(store),
        prefix => Arc::new(PrefixStore::new(store, prefix)),
    })
}

/// How long ago a blob was stored, by the clocks of the store and of this machine.
fn age(meta: &ObjectMeta) -> Duration {
    SystemTime::from(meta.last_modified).elapsed().unwrap_or_default()
}

/// Where a blob is: on one of 256 shelves.
fn place(digest: Digest) -> BlobPath {
    let name = digest.to_string();
    BlobPath::from_iter([&name[..2], &name[..]])
}

impl Blobs {
    /// What a failure of the store means.
    fn failure(&self, error: &object_store::Error) -> QueueError {
        self.told(failure(error))
    }

    /// The same of one that nodes share, told as such.
    fn told(&self, error: QueueError) -> QueueError {
        match error {
            QueueError::Storage(text) if self.is_shared() => QueueError::Blobs(text),
            error => error,
        }
    }
}

#[cfg(test)]
impl Blobs {
    /// The same blobs as if other nodes had them, too.
    pub(crate) fn as_if_shared(&self) -> Self {
        Self { folder: None, ..self.clone() }
    }

    /// Where this process alone keeps them.
    pub(crate) fn folder_for_test(&self) -> &Path {
        self.folder.as_deref().unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

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
        let blob = ChunkedBlob { digest, bytes: 10, chunks: Vec::new() };
        let part: Vec<_> = blobs.read(blob, 4..9).await.unwrap().collect().await;
        assert_eq!(part.into_iter().collect::<io::Result<Vec<_>>>().unwrap().concat(), b"bytes");
        assert_eq!(blobs.all().unwrap(), [digest]);
        let clearing = blobs.clear().await;
        clearing.delete(digest).await.unwrap();
        clearing.delete(digest).await.unwrap();
        assert!(blobs.get(digest).await.is_err() && blobs.all().unwrap().is_empty());
    }

    /// Makes a blob one that was stored so long ago.
    fn grow_old(blobs: &Blobs, digest: Digest, minutes: u64) -> SystemTime {
        let path = blobs.folder.as_ref().unwrap().join(place(digest).as_ref());
        let then = SystemTime::now() - Duration::from_mins(minutes);
        fs::File::options().write(true).open(&path).unwrap().set_modified(then).unwrap();
        fs::metadata(path).unwrap().modified().unwrap()
    }

    fn stored_at(blobs: &Blobs, digest: Digest) -> SystemTime {
        let path = blobs.folder.as_ref().unwrap().join(place(digest).as_ref());
        fs::metadata(path).unwrap().modified().unwrap()
    }

    #[tokio::test]
    async fn a_young_blob_of_a_shared_store_is_not_deleted() {
        let blobs = blobs("young");
        let shared = blobs.as_if_shared();
        assert!(shared.is_shared() && !blobs.is_shared());
        let bytes = Bytes::from_static(b"for a job to come");
        let digest = Digest::of(&bytes);
        shared.put(&shared.hold().await, digest, bytes.clone()).await.unwrap();
        for (minutes, is_gone) in [(0, false), (59, false), (61, true), (0, true)] {
            if !blobs.all().unwrap().is_empty() {
                grow_old(&blobs, digest, minutes);
            }
            assert_eq!(shared.clear().await.delete(digest).await.unwrap(), is_gone, "{minutes}");
            assert_eq!(blobs.all().unwrap().is_empty(), is_gone);
        }
        blobs.put(&blobs.hold().await, digest, bytes).await.unwrap();
        assert!(blobs.clear().await.delete(digest).await.unwrap(), "one's own are never too young");
        assert!(blobs.all().unwrap().is_empty());
    }

    #[tokio::test]
    async fn a_blob_stored_again_is_written_again_only_where_it_must_be_young() {
        let blobs = blobs("again");
        let shared = blobs.as_if_shared();
        let bytes = Bytes::from_static(b"twice");
        let digest = Digest::of(&bytes);
        blobs.put(&blobs.hold().await, digest, bytes.clone()).await.unwrap();
        for (store, minutes, is_written) in
            [(&blobs, 50, false), (&shared, 20, false), (&shared, 40, true)]
        {
            let before = grow_old(&blobs, digest, minutes);
            store.put(&store.hold().await, digest, bytes.clone()).await.unwrap();
            assert_eq!(stored_at(&blobs, digest) != before, is_written, "{minutes}");
        }
    }

    #[tokio::test]
    async fn a_blob_that_another_node_stores_this_moment_is_waited_for() {
        let blobs = blobs("late");
        let mut is_found = false;
        // A busy machine may take as long as all looks together for something else.
        for try_ in 0..20 {
            let bytes = Bytes::from(format!("late {try_}"));
            let digest = Digest::of(&bytes);
            let shared = blobs.as_if_shared();
            let getting = tokio::spawn(async move { shared.get(digest).await });
            tokio::time::sleep(PAUSE / 2).await;
            assert!(!getting.is_finished(), "it looks again");
            blobs.put(&blobs.hold().await, digest, bytes.clone()).await.unwrap();
            is_found = getting.await.unwrap().is_ok_and(|found| found == bytes);
            if is_found {
                break;
            }
        }
        assert!(is_found);
    }

    #[tokio::test]
    async fn a_blob_that_nobody_else_can_store_is_not_waited_for() {
        let (blobs, digest) = (blobs("alone"), Digest::of(b"nowhere"));
        let mut quickest = Duration::MAX;
        for _ in 0..20 {
            let began = std::time::Instant::now();
            assert!(blobs.get(digest).await.is_err());
            quickest = quickest.min(began.elapsed());
        }
        assert!(quickest < PAUSE, "{quickest:?}");
    }

    #[tokio::test]
    async fn failures_are_told_by_their_cause_and_by_whose_store_it_is() {
        let blobs = blobs("failures");
        let told = |blobs: &Blobs, kind: ErrorKind| {
            let source = Box::new(io::Error::from(kind));
            blobs.failure(&object_store::Error::Generic { store: "test", source })
        };
        for kind in [ErrorKind::StorageFull, ErrorKind::QuotaExceeded, ErrorKind::FileTooLarge] {
            assert!(matches!(told(&blobs, kind), QueueError::StorageFull(_)), "{kind}");
            assert!(
                matches!(told(&blobs.as_if_shared(), kind), QueueError::StorageFull(_)),
                "{kind}"
            );
        }
        let kind = ErrorKind::PermissionDenied;
        assert!(matches!(told(&blobs, kind), QueueError::Storage(_)));
        assert!(matches!(told(&blobs.as_if_shared(), kind), QueueError::Blobs(_)));
    }

    #[tokio::test]
    async fn nothing_is_cleared_while_somebody_holds_blobs() {
        let blobs = blobs("holds");
        let hold = blobs.hold().await;
        let soon = Duration::from_millis(20);
        assert!(tokio::time::timeout(soon, blobs.clear()).await.is_err());
        drop(hold);
        assert!(tokio::time::timeout(Duration::from_secs(60), blobs.clear()).await.is_ok());
    }

    #[test]
    fn files_that_were_never_renamed_are_removed() {
        let blobs = blobs("staged");
        let shelf = blobs.folder.clone().unwrap().join("ab");
        fs::create_dir_all(&shelf).unwrap();
        fs::write(shelf.join("abcd#1"), b"half").unwrap();
        assert!(blobs.all().unwrap().is_empty());
        assert!(!shelf.join("abcd#1").exists());
    }
}
