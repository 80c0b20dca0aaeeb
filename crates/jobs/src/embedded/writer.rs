//! The one thread that writes: many commands, one commit.
//!
//! A sync takes a few milliseconds, whatever it syncs. So commands that arrive within [`GATHERING`]
//! are carried out one after another in one transaction, each in a savepoint of its own, and none
//! is acknowledged before all are on stable storage.

use super::watchers::{Changes, Watchers};
use crate::queue::QueueError;
use rusqlite::{Connection, ErrorCode};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// The most commands of one commit.
const MOST_COMMANDS: usize = 64;
/// How long commands are gathered for one commit.
const GATHERING: Duration = Duration::from_millis(2);

/// Carries a command out, or hears why not, and returns what acknowledges it after the commit.
type Command = Box<dyn FnOnce(Result<&mut Write<'_>, QueueError>) -> Acknowledge + Send>;
/// Hears how the commit went.
type Acknowledge = Box<dyn FnOnce(Result<(), QueueError>)>;

/// A transaction, and what it changes for those who wait.
pub(super) struct Write<'a> {
    pub(super) connection: &'a Connection,
    pub(super) changes: Changes,
}

/// The way to the thread.
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
            while let Some(commands) = gather(&received) {
                let committed = carry_out(&connection, commands, &watchers);
                if let Err(error) = &committed {
                    tracing::error!(%error, "jobs could not be written");
                }
                health.store(committed.is_ok(), Ordering::Release);
            }
        })?;
        Ok(Self { commands, is_healthy })
    }

    /// Writes in a transaction, and returns when it is on stable storage.
    pub(super) async fn write<T: Send + 'static>(
        &self,
        write: impl FnOnce(&mut Write<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, QueueError> {
        let (reply, result) = oneshot::channel();
        let command: Command = Box::new(move |transaction| {
            let written = transaction.and_then(|transaction| transaction.try_to(write));
            Box::new(move |committed| {
                let _ = reply.send(committed.and(written));
            })
        });
        self.commands.send(command).map_err(|_| gone())?;
        result.await.map_err(|_| gone())?
    }

    /// Whether the last commit succeeded.
    pub(super) fn is_healthy(&self) -> bool {
        self.is_healthy.load(Ordering::Acquire)
    }
}

impl Write<'_> {
    /// Carries out one command, or leaves nothing of it.
    fn try_to<T>(
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
                tracing::warn!(%error, "a change of jobs was taken back");
                batch("ROLLBACK TO command; RELEASE command")?;
            }
        }
        written
    }
}

/// The commands of the next commit; `None` when no more can come.
fn gather(received: &Receiver<Command>) -> Option<Vec<Command>> {
    let mut commands = vec![received.recv().ok()?];
    let end = Instant::now() + GATHERING;
    while commands.len() < MOST_COMMANDS {
        match received.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(command) => commands.push(command),
            Err(_) => break,
        }
    }
    Some(commands)
}

/// Carries commands out, commits, and acknowledges.
fn carry_out(
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
        watchers.tell(&write.changes);
    }
    committed
}

/// What a failure of the database means.
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

fn gone() -> QueueError {
    QueueError::Storage("the thread that writes has ended".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder_for_test;
    use rusqlite::{Error, ffi};

    /// A writer of a database with parents and children, and another connection to it.
    fn writer(name: &str) -> (Writer, Connection) {
        let path = folder_for_test(name).join("database");
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
        (Writer::start(connection, Arc::default()).unwrap(), open())
    }

    async fn execute(writer: &Writer, sql: &'static str) -> Result<(), QueueError> {
        writer.write(move |write| write.connection.execute_batch(sql)).await
    }

    /// Health is known when the next write has begun: the thread takes it down behind the
    /// acknowledgement.
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
    fn commands_at_once_share_their_sync() {
        let (commands, received) = channel();
        for _ in 0..10 * MOST_COMMANDS + 1 {
            let command: Command = Box::new(|_| Box::new(|_| ()));
            commands.send(command).unwrap();
        }
        let gathered: Vec<usize> = (0..11).map(|_| gather(&received).unwrap().len()).collect();
        assert_eq!(gathered, [&[MOST_COMMANDS; 10][..], &[1]].concat());
        drop(commands);
        assert!(gather(&received).is_none());
    }

    #[tokio::test]
    async fn a_storage_that_takes_no_writes_is_known_until_it_takes_one() {
        let (writer, other) = writer("locked");
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
    async fn a_command_that_fails_leaves_nothing_and_harms_no_other() {
        let (writer, other) = writer("commands");
        let failing = execute(&writer, "INSERT INTO parents DEFAULT VALUES; INSERT INTO nowhere");
        let whole = execute(&writer, "INSERT INTO parents DEFAULT VALUES");
        let (failed, done) = tokio::join!(failing, whole);
        assert!(failed.is_err());
        done.unwrap();
        assert_eq!(parents(&other), 1);
        assert!(is_soon_healthy(&writer, true).await);
    }

    #[tokio::test]
    async fn what_could_not_be_committed_is_told_and_does_not_stay_open() {
        let (writer, other) = writer("commits");
        let orphan = "INSERT INTO parents DEFAULT VALUES; INSERT INTO children VALUES (77)";
        assert!(execute(&writer, orphan).await.is_err());
        assert!(is_soon_healthy(&writer, false).await);
        assert_eq!(parents(&other), 0);
        execute(&writer, "INSERT INTO parents DEFAULT VALUES").await.unwrap();
        assert_eq!(parents(&other), 1);
    }

    #[test]
    fn failures_of_the_database_are_told_by_their_causes() {
        let of_code = |code| failure(&Error::SqliteFailure(ffi::Error::new(code), None));
        assert!(matches!(of_code(ffi::SQLITE_FULL), QueueError::StorageFull(_)));
        assert!(matches!(of_code(ffi::SQLITE_CORRUPT), QueueError::Damaged(_)));
        assert!(matches!(of_code(ffi::SQLITE_IOERR), QueueError::Storage(_)));
        assert!(matches!(failure(&Error::IntegralValueOutOfRange(0, -1)), QueueError::Damaged(_)));
        assert!(matches!(failure(&Error::QueryReturnedNoRows), QueueError::Storage(_)));
    }
}
