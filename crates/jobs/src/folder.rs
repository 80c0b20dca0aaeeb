//! The data folder, which one process locks.

use std::error::Error;
use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// A locked data folder. The system releases the lock when the process ends, however it ends.
#[derive(Debug)]
pub struct DataFolder {
    path: PathBuf,
    _lock: File,
}

impl DataFolder {
    /// Locks a folder, and creates it, readable by its owner alone, if there is none.
    ///
    /// # Errors
    /// When the folder cannot be created or written to, or another process has locked it.
    pub fn take(path: &Path) -> Result<Self, Box<dyn Error>> {
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
            Ok(()) => Ok(Self { path: path.to_owned(), _lock: lock }),
            Err(TryLockError::WouldBlock) => {
                Err(named(&"another process works in that folder").into())
            }
            Err(TryLockError::Error(error)) => Err(named(&error).into()),
        }
    }

    /// The path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}
