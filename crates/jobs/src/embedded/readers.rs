//! A few connections that only read.

use super::schema;
use super::writer::failure;
use crate::queue::QueueError;
use rusqlite::Connection;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;

/// How many connections read at the same time.
const CONNECTIONS: usize = 4;

/// Connections that are opened when they are first needed.
#[derive(Debug)]
pub(super) struct Readers {
    shared: Arc<Shared>,
    permits: Semaphore,
}

#[derive(Debug)]
struct Shared {
    path: PathBuf,
    idle: Mutex<Vec<Connection>>,
}

impl Readers {
    pub(super) fn new(path: PathBuf) -> Self {
        let shared = Arc::new(Shared { path, idle: Mutex::default() });
        Self { shared, permits: Semaphore::new(CONNECTIONS) }
    }

    /// Reads what was committed, on a blocking thread.
    pub(super) async fn read<T: Send + 'static>(
        &self,
        read: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, QueueError> {
        let _permit = self.permits.acquire().await.map_err(|error| stopped(&error))?;
        let shared = Arc::clone(&self.shared);
        let task = spawn_blocking(move || shared.read(read));
        task.await.map_err(|error| stopped(&error))?
    }
}

impl Shared {
    fn read<T>(
        &self,
        read: impl FnOnce(&Connection) -> rusqlite::Result<T>,
    ) -> Result<T, QueueError> {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let known = idle().pop();
        let connection = match known {
            Some(connection) => connection,
            None => schema::open_for_reading(&self.path).map_err(|error| failure(&error))?,
        };
        let found = read(&connection).map_err(|error| failure(&error));
        idle().push(connection);
        found
    }
}

fn stopped(error: &dyn std::error::Error) -> QueueError {
    QueueError::Storage(error.to_string())
}
