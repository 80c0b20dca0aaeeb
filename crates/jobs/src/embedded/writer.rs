//! The one thread that writes: many commands, one commit.
//!
//! A sync takes a few milliseconds, however much it syncs. Commands that arrive within
//! [`BATCH_TIME`] therefore share a transaction. Each has a savepoint of its own, and all are
//! acknowledged after the commit.

use super::rows::first;
use crate::queue::{QueueError, Terms};
use crate::record::JobId;
use crate::row::Row as _;
use crate::watchers::{Changes, Watchers};
use pixmesh_engine::digest::Digest;
use rusqlite::{Connection, ErrorCode, Params, params};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// The most commands of one commit.
const MAX_COMMANDS: usize = 64;
/// How long a commit waits for more commands.
const BATCH_TIME: Duration = Duration::from_millis(2);

/// Executes a command in a transaction, or gets the error with which it did not begin; returns the
/// acknowledgement.
type Command = Box<dyn FnOnce(Result<&mut Write<'_>, QueueError>) -> Acknowledge + Send>;
/// Called with the result of the commit.
type Acknowledge = Box<dyn FnOnce(Result<(), QueueError>)>;

/// A transaction and its changes.
pub(super) struct Write<'a> {
    pub(super) connection: &'a Connection,
    pub(super) changes: Changes,
}

/// Sends commands to the thread.
#[derive(Debug)]
pub(super) struct Writer {
    commands: Sender<Command>,
    is_healthy: Arc<AtomicBool>,
}

impl Writer {
    /// Starts the thread.
    pub(super) fn start(connection: Connection, watchers: Arc<Watchers>) -> io::Result<Self> {
        let (commands, received) = channel();
        let is_healthy = Arc::new(AtomicBool::new(true));
        let health = Arc::clone(&is_healthy);
        thread::Builder::new().name("jobs".into()).spawn(move || {
            while let Some(commands) = batch(&received) {
                let committed = execute(&connection, commands, &watchers);
                if let Err(error) = &committed {
                    tracing::error!(%error, "job transaction failed");
                }
                health.store(committed.is_ok(), Ordering::Release);
            }
        })?;
        Ok(Self { commands, is_healthy })
    }

    /// Writes in a transaction, and returns when the commit is on stable storage.
    pub(super) async fn write<T: Send + 'static>(
        &self,
        write: impl FnOnce(&mut Write<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, QueueError> {
        let (reply, result) = oneshot::channel();
        let command: Command = Box::new(move |transaction| {
            let written = transaction.and_then(|transaction| transaction.command(write));
            Box::new(move |committed| {
                let _ = reply.send(committed.and(written));
            })
        });
        self.commands.send(command).map_err(|_| stopped())?;
        result.await.map_err(|_| stopped())?
    }

    /// Whether the last commit succeeded.
    pub(super) fn is_healthy(&self) -> bool {
        self.is_healthy.load(Ordering::Acquire)
    }
}

impl Write<'_> {
    /// Executes a command in a savepoint, which is rolled back if the command fails.
    fn command<T>(
        &mut self,
        write: impl FnOnce(&mut Self) -> rusqlite::Result<T>,
    ) -> Result<T, QueueError> {
        let batch = |sql| self.connection.execute_batch(sql).map_err(|error| failure(&error));
        batch("SAVEPOINT command")?;
        let written = write(self).map_err(|error| failure(&error));
        let batch = |sql| self.connection.execute_batch(sql).map_err(|error| failure(&error));
        match &written {
            Ok(_) => batch("RELEASE command")?,
            Err(error) => {
                tracing::warn!(%error, "job change rolled back");
                batch("ROLLBACK TO command; RELEASE command")?;
            }
        }
        written
    }

    pub(super) fn execute(&self, sql: &str, parameters: impl Params) -> rusqlite::Result<usize> {
        self.connection.prepare_cached(sql)?.execute(parameters)
    }

    /// Marks a blob that a job does not use any more. Other jobs may use it.
    pub(super) fn mark_orphan_candidate(&self, blob: Digest) -> rusqlite::Result<()> {
        let sql = "INSERT OR IGNORE INTO orphan_candidates VALUES (?1)";
        self.execute(sql, [blob.to_string()]).map(|_| ())
    }

    /// Deletes a job, marks its blob as an orphan candidate, and keeps its idempotency key.
    pub(super) fn delete(&mut self, id: JobId, terms: &Terms) -> rusqlite::Result<()> {
        let sql = "INSERT OR REPLACE INTO kept_keys SELECT owner, idempotency_key, created_at + ?2
                   FROM jobs WHERE id = ?1 AND idempotency_key IS NOT NULL";
        self.execute(sql, params![id.as_bytes(), terms.idempotency_ttl.as_millis() as i64])?;
        // A failed job has its picture, a completed one its mesh.
        let sql = "DELETE FROM jobs WHERE id = ?1
                   RETURNING CASE state WHEN 3 THEN image_digest ELSE mesh_digest END AS blob";
        let blob = first(self.connection, sql, [id.as_bytes()], |row| Ok(row.digest("blob")))?;
        if let Some(Ok(Some(blob))) = blob {
            self.mark_orphan_candidate(blob)?;
        }
        self.changes.jobs.push(id);
        Ok(())
    }
}

/// The commands of the next commit; `None` when no more can come.
fn batch(received: &Receiver<Command>) -> Option<Vec<Command>> {
    let mut commands = vec![received.recv().ok()?];
    let end = Instant::now() + BATCH_TIME;
    while commands.len() < MAX_COMMANDS {
        match received.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(command) => commands.push(command),
            Err(_) => break,
        }
    }
    Some(commands)
}

/// Executes commands, commits, and acknowledges them.
fn execute(
    connection: &Connection,
    commands: Vec<Command>,
    watchers: &Watchers,
) -> Result<(), QueueError> {
    let begun = connection.execute_batch("BEGIN IMMEDIATE").map_err(|error| failure(&error));
    let mut write = Write { connection, changes: Changes::default() };
    let acknowledgements: Vec<Acknowledge> =
        commands.into_iter().map(|command| command(begun.clone().map(|()| &mut write))).collect();
    let commit = || connection.execute_batch("COMMIT").map_err(|error| failure(&error));
    let committed = begun.and_then(|()| commit());
    if committed.is_err() && !connection.is_autocommit() {
        let _ = connection.execute_batch("ROLLBACK");
    }
    for acknowledge in acknowledgements {
        acknowledge(committed.clone());
    }
    if committed.is_ok() {
        watchers.notify(&write.changes);
    }
    committed
}

/// The error of the queue for an error of the database.
pub(super) fn failure(error: &rusqlite::Error) -> QueueError {
    use rusqlite::Error as E;
    match (error.sqlite_error_code(), error) {
        (Some(ErrorCode::DiskFull), _) => QueueError::StorageFull(error.to_string()),
        (Some(ErrorCode::DatabaseCorrupt), _)
        | (
            _,
            E::InvalidColumnType(..)
            | E::IntegralValueOutOfRange(..)
            | E::FromSqlConversionFailure(..)
            | E::Utf8Error(..),
        ) => QueueError::Damaged(error.to_string()),
        _ => QueueError::Storage(error.to_string()),
    }
}

fn stopped() -> QueueError {
    QueueError::Storage("the thread that writes has stopped".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rusqlite::{Error, ffi};
    use tempfile::TempDir;

    /// A writer of a database with parents and children, another connection to it, and its folder.
    fn writer() -> (Writer, Connection, TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("database");
        let open = || {
            let connection = Connection::open(&path).unwrap();
            connection.busy_timeout(Duration::ZERO).unwrap();
            connection.pragma_update(None, "foreign_keys", true).unwrap();
            connection
        };
        let connection = open();
        let tables = "CREATE TABLE parents (id INTEGER PRIMARY KEY);
             CREATE TABLE children (
                 parent INTEGER REFERENCES parents (id) DEFERRABLE INITIALLY DEFERRED
             )";
        connection.execute_batch(tables).unwrap();
        (Writer::start(connection, Arc::default()).unwrap(), open(), folder)
    }

    async fn execute(writer: &Writer, sql: &'static str) -> Result<(), QueueError> {
        writer.write(move |write| write.connection.execute_batch(sql)).await
    }

    /// The thread stores its health after the acknowledgement.
    async fn is_soon_healthy(writer: &Writer, expected: bool) -> bool {
        for _ in 0..30_000 {
            if writer.is_healthy() == expected {
                return true;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        false
    }

    fn parents(connection: &Connection) -> u32 {
        connection.query_row("SELECT COUNT(*) FROM parents", [], |row| row.get(0)).unwrap()
    }

    #[test]
    fn concurrent_commands_share_a_commit() {
        let (commands, received) = channel();
        for _ in 0..10 * MAX_COMMANDS + 1 {
            let command: Command = Box::new(|_| Box::new(|_| ()));
            commands.send(command).unwrap();
        }
        let sizes: Vec<usize> = (0..11).map(|_| batch(&received).unwrap().len()).collect();
        assert_eq!(sizes, [&[MAX_COMMANDS; 10][..], &[1]].concat());
        drop(commands);
        assert!(batch(&received).is_none());
    }

    #[tokio::test]
    async fn failed_commit_is_unhealthy_until_the_next_one() {
        let (writer, other, _folder) = writer();
        let insert = "INSERT INTO parents DEFAULT VALUES";
        assert!(writer.is_healthy());
        other.execute_batch("BEGIN IMMEDIATE").unwrap();
        assert!(matches!(execute(&writer, insert).await, Err(QueueError::Storage(_))));
        assert!(is_soon_healthy(&writer, false).await);
        other.execute_batch("COMMIT").unwrap();
        execute(&writer, insert).await.unwrap();
        assert!(is_soon_healthy(&writer, true).await);
        assert_eq!(parents(&other), 1);
    }

    #[tokio::test]
    async fn failed_command_is_rolled_back_alone() {
        let (writer, other, _folder) = writer();
        let failing = execute(&writer, "INSERT INTO parents DEFAULT VALUES; INSERT INTO nowhere");
        let whole = execute(&writer, "INSERT INTO parents DEFAULT VALUES");
        let (failed, done) = tokio::join!(failing, whole);
        assert!(failed.is_err());
        done.unwrap();
        assert_eq!(parents(&other), 1);
        assert!(is_soon_healthy(&writer, true).await);
    }

    #[tokio::test]
    async fn failed_commit_is_reported_and_rolled_back() {
        let (writer, other, _folder) = writer();
        let orphan = "INSERT INTO parents DEFAULT VALUES; INSERT INTO children VALUES (77)";
        assert!(execute(&writer, orphan).await.is_err());
        assert!(is_soon_healthy(&writer, false).await);
        assert_eq!(parents(&other), 0);
        execute(&writer, "INSERT INTO parents DEFAULT VALUES").await.unwrap();
        assert_eq!(parents(&other), 1);
    }

    #[test]
    fn errors_are_classified_by_code() {
        let of_code = |code| failure(&Error::SqliteFailure(ffi::Error::new(code), None));
        assert!(matches!(of_code(ffi::SQLITE_FULL), QueueError::StorageFull(_)));
        assert!(matches!(of_code(ffi::SQLITE_CORRUPT), QueueError::Damaged(_)));
        assert!(matches!(of_code(ffi::SQLITE_IOERR), QueueError::Storage(_)));
        assert!(matches!(failure(&Error::IntegralValueOutOfRange(0, -1)), QueueError::Damaged(_)));
        assert!(matches!(failure(&Error::QueryReturnedNoRows), QueueError::Storage(_)));
    }
}
