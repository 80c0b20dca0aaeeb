//! The data folder, which one process locks, and the free space of its file system.
//!
//! On a full disk even a deletion needs space, for the log of the database. So the folder holds a
//! file, the reserve, that is deleted when a write finds no space. Then there is room for what
//! makes room, and nothing new is accepted until the reserve is there again. Before that, jobs are
//! refused where less space is free than a setting asks for.

use crate::queue::QueueError;
use crate::telemetry;
use std::error::Error;
use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// The most bytes that are kept back.
const RESERVE_BYTES: u64 = 4 << 20;
/// The part of a small file system that is.
const RESERVE_PART: u64 = 16;
/// The largest part of a small file system that must stay free.
const LEAST_FREE_PART: u64 = 8;

/// A locked data folder. The system releases the lock when the process ends, however it ends.
#[derive(Debug)]
pub struct DataFolder {
    path: PathBuf,
    _lock: File,
    has_reserve: AtomicBool,
    least_free_bytes: u64,
    /// The files that must stay in their places, by their numbers in the file system.
    watched: OnceLock<Vec<(PathBuf, [u64; 2])>>,
    was_in_place: AtomicBool,
}

impl DataFolder {
    /// Locks a folder, and creates it, readable by its owner alone, if there is none. New jobs leave
    /// so many bytes free in its file system, but at most an eighth of it.
    ///
    /// # Errors
    /// When the folder cannot be created or written to, or another process has locked it.
    pub fn take(path: &Path, least_free_bytes: u64) -> Result<Self, Box<dyn Error>> {
        let named = |error: &dyn std::fmt::Display| {
            format!("--data-dir {}: the data folder cannot be used: {error}", path.display())
        };
        DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(|e| named(&e))?;
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(0o600)
            .open(path.join("lock"))
            .map_err(|error| named(&error))?;
        match lock.try_lock() {
            Ok(()) => {
                let has_reserve = AtomicBool::new(path.join(RESERVE).exists());
                let folder = Self {
                    path: path.to_owned(),
                    _lock: lock,
                    has_reserve,
                    least_free_bytes,
                    watched: OnceLock::new(),
                    was_in_place: AtomicBool::new(true),
                };
                folder.begin();
                Ok(folder)
            }
            Err(TryLockError::WouldBlock) => {
                Err(named(&"another process works in that folder").into())
            }
            Err(TryLockError::Error(error)) => Err(named(&error).into()),
        }
    }

    /// Keeps space back, or gives it up where the start itself would find none.
    fn begin(&self) {
        match Space::of(&self.path) {
            Ok(space) if self.has_reserve() && space.free < space.reserve() / 4 => {
                self.release_reserve();
            }
            _ => self.restore_reserve(),
        }
    }

    /// Whether space is kept back; if not, nothing new may be stored.
    #[must_use]
    pub fn has_reserve(&self) -> bool {
        self.has_reserve.load(Ordering::Acquire)
    }

    /// Notes the folder and these files of it, to notice when they are removed or replaced.
    pub(crate) fn watch(&self, names: &[&str]) {
        let paths = names.iter().map(|name| self.path.join(name)).chain([self.path.clone()]);
        let numbered = paths.filter_map(|path| Some((path.clone(), numbers_of(&path)?)));
        let _ = self.watched.set(numbered.collect());
    }

    /// Whether the watched files are where they were. What is written to removed ones is lost.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        let watched = self.watched.get().map(Vec::as_slice).unwrap_or_default();
        let is_in_place =
            watched.iter().all(|(path, numbers)| numbers_of(path).as_ref() == Some(numbers));
        if self.was_in_place.swap(is_in_place, Ordering::AcqRel) && !is_in_place {
            tracing::error!(
                folder = %self.path.display(),
                "the data folder or a file in it was removed or replaced: no jobs are accepted; stop \
                 the service, restore the folder, and start again"
            );
        }
        is_in_place
    }

    /// Fails where less space is free than must be, or the folder is not where it was.
    ///
    /// # Errors
    /// [`QueueError::Storage`], [`QueueError::StorageFull`] without a reserve, else [`QueueError::SpaceLow`].
    pub fn check_room(&self) -> Result<(), QueueError> {
        if !self.is_in_place() {
            return Err(QueueError::Storage("the data folder was removed or replaced".into()));
        }
        if !self.has_reserve() {
            return Err(QueueError::StorageFull("the space that is left is for deletions".into()));
        }
        let space =
            Space::of(&self.path).map_err(|error| QueueError::Storage(error.to_string()))?;
        let (free, least) = (space.free, space.least_free(self.least_free_bytes));
        if free < least { Err(QueueError::SpaceLow { free, least }) } else { Ok(()) }
    }

    /// Reports the free space of the file system.
    pub(crate) fn report(&self) {
        let _ = self.is_in_place();
        if let Ok(space) = Space::of(&self.path) {
            telemetry::disk(space.free, space.least_free(self.least_free_bytes));
        }
    }

    /// Gives up the space that is kept back, and says whether there was any.
    pub fn release_reserve(&self) -> bool {
        let had = self.has_reserve.swap(false, Ordering::AcqRel);
        if had {
            let removed = fs::remove_file(self.path.join(RESERVE));
            tracing::warn!(?removed, "disk of the data folder full; no new jobs accepted");
        }
        had
    }

    /// Keeps space back again, once as much again is free.
    pub fn restore_reserve(&self) {
        if self.has_reserve() {
            return;
        }
        match self.try_restore() {
            Ok(is_restored) => self.has_reserve.store(is_restored, Ordering::Release),
            Err(error) => {
                tracing::warn!(%error, "space for deletions not reserved");
                let _ = fs::remove_file(self.path.join(RESERVE));
                // Where no such file may be written, the service goes on without.
                let is_forbidden = error.kind() != ErrorKind::StorageFull;
                self.has_reserve.store(is_forbidden, Ordering::Release);
            }
        }
    }

    fn try_restore(&self) -> io::Result<bool> {
        let space = Space::of(&self.path)?;
        if space.free < 2 * space.reserve() {
            return Ok(false);
        }
        let mut file = File::create(self.path.join(RESERVE))?;
        // Zeros that are not written take no space.
        file.write_all(&vec![0; space.reserve() as usize])?;
        file.sync_all()?;
        Ok(true)
    }

    /// The path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The numbers of a file's file system and of the file in it; `None` where there is none.
fn numbers_of(path: &Path) -> Option<[u64; 2]> {
    fs::metadata(path).ok().map(|meta| [meta.dev(), meta.ino()])
}

/// The name of the reserve in the folder.
const RESERVE: &str = "reserve";

/// The bytes of a file system.
#[derive(Clone, Copy, Debug)]
pub struct Space {
    /// Those that are free.
    pub free: u64,
    /// All of them.
    pub total: u64,
}

impl Space {
    /// The bytes of the file system with this folder.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn of(path: &Path) -> io::Result<Self> {
        let system = rustix::fs::statvfs(path)?;
        let bytes = |blocks: u64| blocks.saturating_mul(system.f_frsize);
        Ok(Self { free: bytes(system.f_bavail), total: bytes(system.f_blocks) })
    }

    /// How much must stay free, at most an eighth.
    #[must_use]
    pub fn least_free(&self, bytes: u64) -> u64 {
        bytes.min(self.total / LEAST_FREE_PART)
    }

    /// How much of it is kept back.
    fn reserve(&self) -> u64 {
        RESERVE_BYTES.min(self.total / RESERVE_PART)
    }
}
