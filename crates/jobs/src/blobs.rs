//! The store of blobs: pictures and meshes, each under the digest of its bytes.
//!
//! In a folder, a blob is written to a temporary file, synced and renamed, so that every blob is
//! complete and on stable storage. Several jobs may use the same blob. A task that stores a blob
//! keeps a [`Pin`] until a job uses it, and the [`Collector`], which deletes unused blobs, waits
//! until there are no pins. Bytes that do not match their digest are refused as damaged.
//!
//! Pins do not reach other nodes. In a store that nodes share, the queue tells which blobs may be
//! deleted: a node marks a blob in the queue before it stores it.

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
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::local::LocalFileSystem;
use object_store::path::Path as BlobPath;
use object_store::prefix::PrefixStore;
use object_store::{
    BackoffConfig, ClientOptions, ObjectMeta, ObjectStore, ObjectStoreExt, RetryConfig,
};
use pixmesh_engine::digest::Digest;
use std::error::Error;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedRwLockReadGuard, RwLock};
use tokio::task::spawn_blocking;
use uuid::Uuid;

/// How long a request to a store on the network may take.
const REQUEST_TIME: Duration = Duration::from_secs(60);
/// How long connecting to such a store may take.
const CONNECT_TIME: Duration = Duration::from_secs(5);
/// How long a failed request is retried.
const RETRY_TIME: Duration = Duration::from_secs(10);
/// How often a blob of a shared store is read that another node may have just stored.
const READS: usize = 5;
/// The pause between two reads.
const PAUSE: Duration = Duration::from_millis(200);

/// The name of a blob that is written only to test the store.
const PROBE: &str = "probe";

/// The store of blobs.
#[derive(Clone, Debug)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    /// The folder of one process; `None` in a store that nodes share.
    folder: Option<PathBuf>,
    /// The folder of a store of files, whoever uses it.
    root: Option<PathBuf>,
    pins: Arc<RwLock<()>>,
    health: Arc<Health>,
}

/// While a pin exists, this process deletes no blobs.
#[derive(Debug)]
pub struct Pin(#[allow(dead_code, reason = "a guard")] OwnedRwLockReadGuard<()>);

/// The right to delete blobs. While it exists, this process stores none.
#[derive(Debug)]
pub struct Collector<'a> {
    blobs: &'a Blobs,
    _no_pins: tokio::sync::RwLockWriteGuard<'a, ()>,
    _no_backup: Option<File>,
}

impl Blobs {
    /// The blobs in a folder, which is created if there is none.
    ///
    /// # Errors
    /// When the folder cannot be used.
    pub fn in_folder(folder: &Path) -> Result<Self, Box<dyn Error>> {
        fs::create_dir_all(folder)?;
        let store = LocalFileSystem::new_with_prefix(folder)?.with_fsync(true);
        let (store, folder) = (Arc::new(store), Some(folder.to_owned()));
        let root = folder.clone();
        Ok(Self { store, folder, root, pins: Arc::default(), health: Arc::default() })
    }

    /// The blobs in a store that nodes share.
    ///
    /// # Errors
    /// When the store cannot be used, or is not shared.
    pub async fn shared(engine: &BlobEngine) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let store = Self::store(engine).map_err(|error| format!("--blobs {engine}: {error}"))?;
        try_out(&*store).await.map_err(|error| format!("--blobs {engine}: {error}"))?;
        let root = match engine {
            BlobEngine::Folder(path) => Some(path.clone()),
            BlobEngine::File | BlobEngine::Bucket(_) => None,
        };
        let (pins, health) = (Arc::default(), Arc::default());
        Ok(Self { store, folder: None, root, pins, health })
    }

    fn store(engine: &BlobEngine) -> Result<Arc<dyn ObjectStore>, Box<dyn Error + Send + Sync>> {
        Ok(match engine {
            BlobEngine::File => return Err("this is a store of one node".into()),
            BlobEngine::Folder(path) => {
                fs::create_dir_all(path)?;
                Arc::new(LocalFileSystem::new_with_prefix(path)?.with_fsync(true))
            }
            BlobEngine::Bucket(address) => bucket(address)?,
        })
    }

    /// Whether nodes share the store.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        self.folder.is_none()
    }

    /// Waits until no blobs are being deleted.
    pub async fn pin(&self) -> Pin {
        Pin(Arc::clone(&self.pins).read_owned().await)
    }

    /// Stores bytes under their digest, on stable storage.
    ///
    /// # Errors
    /// When the storage is full or fails.
    pub async fn put(&self, _: &Pin, digest: Digest, bytes: Bytes) -> Result<(), QueueError> {
        let exists = self.meta(digest).await?.is_some();
        if exists && verified::is_same(&*self.store, &path_of(digest), &bytes).await {
            return self.sync_name(digest).await;
        }
        let length = bytes.len();
        let put = self.store.put(&path_of(digest), bytes.into()).await;
        self.health.note(length, put.is_ok());
        put.map(|_| ()).map_err(|error| self.failure(&error))
    }

    /// Syncs the name of a blob: whoever stores it at the same time may not have come so far.
    async fn sync_name(&self, digest: Digest) -> Result<(), QueueError> {
        let Some(root) = &self.root else { return Ok(()) };
        let shelf = root.join(&path_of(digest).as_ref()[..2]);
        let synced = spawn_blocking(move || File::open(shelf)?.sync_all()).await;
        let synced = synced.map_err(io::Error::other).flatten();
        synced.map_err(|error| self.classify(QueueError::Storage(error.to_string())))
    }

    /// Whether a blob is stored.
    ///
    /// # Errors
    /// When the storage fails.
    pub async fn has(&self, digest: Digest) -> Result<bool, QueueError> {
        Ok(self.meta(digest).await?.is_some())
    }

    /// The metadata of a blob; `None` if it does not exist.
    async fn meta(&self, digest: Digest) -> Result<Option<ObjectMeta>, QueueError> {
        match self.store.head(&path_of(digest)).await {
            Ok(meta) => Ok(Some(meta)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failure(&error)),
        }
    }

    /// All bytes of a blob.
    ///
    /// # Errors
    /// When the blob does not exist or is damaged, or the storage fails.
    pub async fn get(&self, digest: Digest) -> Result<Bytes, QueueError> {
        let mut reads = if self.is_shared() { READS } else { 1 };
        loop {
            reads -= 1;
            let found = match self.store.get(&path_of(digest)).await {
                Ok(found) => match found.bytes().await {
                    // Another node may have replaced the blob.
                    Err(_) if reads > 0 => continue,
                    found => found,
                },
                Err(object_store::Error::NotFound { .. }) if reads > 0 => {
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
                Err(error) => Err(error),
            };
            let bytes = found.map_err(|error| self.failure(&error))?;
            return verified::whole(digest, bytes).await;
        }
    }

    /// A part of a blob.
    ///
    /// # Errors
    /// When the blob does not exist or is damaged, or the storage fails.
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

    /// A part of a blob as a stream of chunks. A damaged chunk after the first one is an error in
    /// the stream.
    ///
    /// # Errors
    /// When the blob does not exist or its first chunk is damaged, or the storage fails.
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
        let path = path_of(blob.digest);
        let pieces = verified::part(&*self.store, &path, blob, range).await;
        let pieces = pieces.map_err(|error| self.classify(error))?;
        let blobs = self.clone();
        Ok(pieces.map(move |piece| piece.map_err(|error| blobs.classify(error))).boxed())
    }

    /// Waits until there are no pins. `None` while another process makes a backup of the folder.
    pub async fn collector(&self) -> Option<Collector<'_>> {
        let _no_pins = self.pins.write().await;
        // Without such a file, as on a full disk, there is no backup.
        let _no_backup = self.lock_file().ok().flatten();
        let lock = _no_backup.as_ref().map(File::try_lock_shared);
        let is_backup = matches!(lock, Some(Err(TryLockError::WouldBlock)));
        (!is_backup).then_some(Collector { blobs: self, _no_pins, _no_backup })
    }

    /// Waits until no process deletes blobs of the folder; none does while the file is open.
    pub(crate) fn hold(&self) -> io::Result<Option<File>> {
        let file = self.lock_file()?;
        file.as_ref().map_or(Ok(()), File::lock)?;
        Ok(file)
    }

    /// The file that is locked by deletions, shared, and by a backup.
    fn lock_file(&self) -> io::Result<Option<File>> {
        let path = self.folder.as_ref().map(|folder| folder.with_extension("lock"));
        path.map(|path| OpenOptions::new().create(true).truncate(false).write(true).open(path))
            .transpose()
    }

    /// All blobs in the folder of one process. Deletes the temporary files of interrupted writes:
    /// the caller must have a [`Collector`], so that no blob is being stored.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn all(&self) -> io::Result<Vec<Digest>> {
        let mut found = Vec::new();
        let Some(folder) = &self.folder else { return Ok(found) };
        for prefix in fs::read_dir(folder)? {
            let prefix = prefix?.path();
            if !prefix.is_dir() {
                continue;
            }
            for file in fs::read_dir(prefix)? {
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
    /// Whether the last write succeeded.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        self.health.failed_bytes() == 0
    }

    /// After a failed write, tries to write a test blob of the same length. A node that is not
    /// ready gets no requests, and could not become ready again without this.
    pub async fn probe(&self) {
        let length = self.health.failed_bytes();
        if length == 0 {
            return;
        }
        let path = BlobPath::from(PROBE);
        let is_stored = self.store.put(&path, vec![0; length].into()).await.is_ok();
        let _ = self.store.delete(&path).await;
        self.health.note(length, is_stored);
    }
}

impl Collector<'_> {
    /// Moves a blob of the folder of one process to another folder of the same file system.
    ///
    /// # Errors
    /// When the file cannot be moved.
    pub fn set_aside(&self, digest: Digest, aside: &Path) -> io::Result<()> {
        let Some(folder) = &self.blobs.folder else { return Ok(()) };
        fs::create_dir_all(aside)?;
        fs::rename(folder.join(path_of(digest).as_ref()), aside.join(digest.to_string()))
    }

    /// Deletes a blob if it exists.
    ///
    /// # Errors
    /// When the storage fails.
    pub async fn delete(&self, digest: Digest) -> Result<(), QueueError> {
        match self.blobs.store.delete(&path_of(digest)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.blobs.failure(&error)),
        }
    }
}

/// A bucket of a store on the network, with the credentials, region and endpoint in the environment
/// variables of its provider, as `object_store` reads them.
fn bucket(address: &str) -> object_store::Result<Arc<dyn ObjectStore>> {
    // Fails if a provider is installed already, which is the same one.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let endpoints = ["AWS_ENDPOINT_URL", "GOOGLE_BASE_URL", "AZURE_STORAGE_ENDPOINT"];
    let is_plain = |name| std::env::var(name).is_ok_and(|url| url.starts_with("http://"));
    let client = ClientOptions::new()
        .with_timeout(REQUEST_TIME)
        .with_connect_timeout(CONNECT_TIME)
        .with_allow_http(endpoints.into_iter().any(is_plain));
    let retry = RetryConfig {
        backoff: BackoffConfig::default(),
        max_retries: 3,
        retry_timeout: RETRY_TIME,
    };
    macro_rules! store {
        ($builder:ident) => {{
            let builder = $builder::from_env().with_url(address);
            Arc::new(builder.with_client_options(client).with_retry(retry).build()?)
        }};
    }
    let (scheme, path) = address.split_once("://").unwrap_or_default();
    let store: Arc<dyn ObjectStore> = match scheme {
        "gs" => store!(GoogleCloudStorageBuilder),
        "az" => store!(MicrosoftAzureBuilder),
        _ => store!(AmazonS3Builder),
    };
    let prefix = path.split_once('/').map_or("", |(_, path)| path.trim_matches('/'));
    Ok(match prefix {
        "" => store,
        prefix => Arc::new(PrefixStore::new(store, prefix)),
    })
}

/// Tests the bucket, the credentials, and the rights to write, read and delete.
async fn try_out(store: &dyn ObjectStore) -> Result<(), String> {
    // Nodes that start at the same time would delete an object that they share.
    let path = BlobPath::from(format!("{PROBE}-{}", Uuid::now_v7()));
    let cannot = |what| move |error| format!("an object cannot be {what}: {error}");
    store.put(&path, Bytes::from_static(b"probe").into()).await.map_err(cannot("written"))?;
    let read = async { store.get(&path).await?.bytes().await }.await;
    store.delete(&path).await.map_err(cannot("deleted"))?;
    read.map(|_| ()).map_err(cannot("read"))
}

/// The path of a blob, in one of 256 folders.
fn path_of(digest: Digest) -> BlobPath {
    let name = digest.to_string();
    BlobPath::from_iter([&name[..2], &name[..]])
}

impl Blobs {
    /// The error of the queue for an error of the store.
    fn failure(&self, error: &object_store::Error) -> QueueError {
        let is_there = self.folder.as_ref().is_some_and(|folder| folder.exists());
        match error {
            object_store::Error::NotFound { path, .. } if is_there => {
                QueueError::Damaged(format!("the blob {path} is missing"))
            }
            _ => self.classify(failure(error)),
        }
    }

    /// A failing shared store has an error of its own.
    fn classify(&self, error: QueueError) -> QueueError {
        match error {
            QueueError::Storage(text) if self.is_shared() => QueueError::Blobs(text),
            error => error,
        }
    }
}

#[cfg(test)]
impl Blobs {
    /// The same folder as a shared store.
    pub(crate) fn as_if_shared(&self) -> Self {
        Self { folder: None, ..self.clone() }
    }

    /// The folder of the blobs.
    pub(crate) fn folder_for_test(&self) -> &Path {
        self.folder.as_deref().unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::blobs;
    use std::io::ErrorKind;

    #[tokio::test(flavor = "multi_thread", worker_threads = 4)]
    async fn nodes_that_start_together_use_one_store() {
        let folder = tempfile::TempDir::new().unwrap();
        let engine = BlobEngine::Folder(folder.path().to_owned());
        let starts = (0..64).map(|_| {
            let engine = engine.clone();
            tokio::spawn(async move { Blobs::shared(&engine).await.map(|_| ()) })
        });
        let started = futures_util::future::join_all(starts.collect::<Vec<_>>()).await;
        for start in started {
            start.unwrap().unwrap();
        }
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "every probe is deleted");
    }

    #[tokio::test]
    async fn stored_blob_is_read_until_deleted() {
        let (blobs, _folder) = blobs();
        let bytes = Bytes::from_static(b"ten bytes!");
        let digest = Digest::of(&bytes);
        let pin = blobs.pin().await;
        for _ in 0..2 {
            blobs.put(&pin, digest, bytes.clone()).await.unwrap();
        }
        drop(pin);
        assert_eq!(blobs.get(digest).await.unwrap(), bytes);
        let blob = ChunkedBlob { digest, bytes: 10, chunks: Vec::new() };
        let part: Vec<_> = blobs.read(blob, 4..9).await.unwrap().collect().await;
        assert_eq!(part.into_iter().collect::<io::Result<Vec<_>>>().unwrap().concat(), b"bytes");
        assert_eq!(blobs.all().unwrap(), [digest]);
        let collector = blobs.collector().await.unwrap();
        collector.delete(digest).await.unwrap();
        collector.delete(digest).await.unwrap();
        assert!(blobs.get(digest).await.is_err() && blobs.all().unwrap().is_empty());
    }

    #[tokio::test(start_paused = true)]
    async fn late_blob_of_another_node_is_read() {
        let (blobs, _folder) = blobs();
        let bytes = Bytes::from_static(b"late");
        let (digest, shared) = (Digest::of(&bytes), blobs.as_if_shared());
        let getting = tokio::spawn(async move { shared.get(digest).await });
        tokio::time::sleep(PAUSE / 2).await;
        assert!(!getting.is_finished(), "it reads again");
        blobs.put(&blobs.pin().await, digest, bytes.clone()).await.unwrap();
        assert_eq!(getting.await.unwrap().unwrap(), bytes);
    }

    #[tokio::test(start_paused = true)]
    async fn missing_blob_of_one_process_fails_at_once() {
        let ((blobs, _folder), digest) = (blobs(), Digest::of(b"nowhere"));
        let began = tokio::time::Instant::now();
        assert!(blobs.get(digest).await.is_err());
        assert_eq!(began.elapsed(), Duration::ZERO, "without a pause");
    }

    #[tokio::test]
    async fn errors_are_classified_by_cause_and_store() {
        let (blobs, _folder) = blobs();
        let error = |blobs: &Blobs, kind: ErrorKind| {
            let source = Box::new(io::Error::from(kind));
            blobs.failure(&object_store::Error::Generic { store: "test", source })
        };
        for kind in [ErrorKind::StorageFull, ErrorKind::QuotaExceeded, ErrorKind::FileTooLarge] {
            assert!(matches!(error(&blobs, kind), QueueError::StorageFull(_)), "{kind}");
            assert!(
                matches!(error(&blobs.as_if_shared(), kind), QueueError::StorageFull(_)),
                "{kind}"
            );
        }
        let kind = ErrorKind::PermissionDenied;
        assert!(matches!(error(&blobs, kind), QueueError::Storage(_)));
        assert!(matches!(error(&blobs.as_if_shared(), kind), QueueError::Blobs(_)));
    }

    #[tokio::test]
    async fn collector_waits_for_pins() {
        let (blobs, _folder) = blobs();
        let pin = blobs.pin().await;
        let soon = Duration::from_millis(20);
        assert!(tokio::time::timeout(soon, blobs.collector()).await.is_err());
        drop(pin);
        assert!(tokio::time::timeout(Duration::from_secs(60), blobs.collector()).await.is_ok());
    }

    #[test]
    fn temporary_files_are_deleted() {
        let (blobs, _folder) = blobs();
        let prefix = blobs.folder.clone().unwrap().join("ab");
        fs::create_dir_all(&prefix).unwrap();
        fs::write(prefix.join("abcd#1"), b"half").unwrap();
        assert!(blobs.all().unwrap().is_empty());
        assert!(!prefix.join("abcd#1").exists());
    }
}
