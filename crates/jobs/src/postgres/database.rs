//! The connections to the database, and transactions on them.
//!
//! Everything is done in a transaction that can be made once more: when it meets another, or when
//! the connection is lost, it is tried again for as long as a caller waits. A transaction that has not
//! come to its end takes its connection with it, so that nobody waits for one that hangs.

use super::settings::PostgresSettings;
use crate::queue::QueueError;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgArguments, PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgRow};
use sqlx::query::{Query, QueryAs, QueryScalar};
use sqlx::{AssertSqlSafe, Connection, FromRow, Postgres};
use std::io;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout_at};

/// How long an answer may take before the database is said not to answer.
const ANSWER_TIME: Duration = Duration::from_secs(5);
/// How long a free connection, or a new one, is waited for at a time: a wait that is tried again finds
/// a database that has come back sooner than a longer one.
const CONNECT_TIME: Duration = Duration::from_secs(2);
/// The pause before a transaction is tried again.
const PAUSE: Duration = Duration::from_millis(25);
/// How often a transaction is tried that meets others.
const MOST_CONFLICTS: u32 = 8;
/// A connection that was idle for longer is tried before it is used.
const FRESH: Duration = Duration::from_secs(1);

/// The connections of a node.
#[derive(Debug)]
pub(super) struct Database {
    pool: PgPool,
    /// Begins a transaction.
    begin: String,
    /// Whether connections are lent by a pooler for a transaction each.
    is_pooled: bool,
    is_healthy: AtomicBool,
}

/// A transaction, or a connection for one statement.
pub(super) struct Transaction {
    connection: PoolConnection<Postgres>,
    /// Whether the connection may know statements that it was asked before.
    is_persistent: bool,
    is_begun: bool,
    is_over: bool,
}

impl Database {
    /// Connections as the settings say, made when they are first needed.
    pub(super) fn new(
        mut options: PgConnectOptions,
        settings: &PostgresSettings,
        is_pooled: bool,
    ) -> Self {
        let session = session(&settings.schema, is_pooled);
        let mut pool = PgPoolOptions::new()
            .max_connections(settings.max_connections.get())
            .acquire_timeout(CONNECT_TIME)
            .test_before_acquire(false)
            .before_acquire(|connection, known| {
                Box::pin(async move {
                    if known.idle_for > FRESH {
                        connection.ping().await?;
                    }
                    Ok(true)
                })
            });
        let mut begin = String::from("BEGIN");
        if is_pooled {
            begin = format!("BEGIN; {session}");
            options = options.statement_cache_capacity(0);
        } else {
            pool = pool.after_connect(move |connection, _| {
                let session = session.clone();
                Box::pin(async move {
                    sqlx::raw_sql(AssertSqlSafe(session)).execute(connection).await.map(|_| ())
                })
            });
        }
        let pool = pool.connect_lazy_with(options);
        Self { pool, begin, is_pooled, is_healthy: AtomicBool::new(true) }
    }

    /// Begins a transaction.
    pub(super) async fn begin(&self) -> sqlx::Result<Transaction> {
        let connection = self.pool.acquire().await?;
        let is_persistent = !self.is_pooled;
        let mut transaction =
            Transaction { connection, is_persistent, is_begun: true, is_over: false };
        let begin = AssertSqlSafe(self.begin.as_str());
        sqlx::raw_sql(begin).execute(&mut *transaction).await?;
        Ok(transaction)
    }

    /// Begins a transaction in which others may begin, for one who has a connection know statements:
    /// what a pooler lends knows none of before, and none afterwards once these are forgotten.
    pub(super) async fn begin_outer(&self) -> sqlx::Result<sqlx::Transaction<'static, Postgres>> {
        self.pool.begin_with(AssertSqlSafe(self.begin.clone())).await
    }

    /// A connection for one statement that reads, in a transaction only where it needs one.
    pub(super) async fn reading(&self) -> sqlx::Result<Transaction> {
        if self.is_pooled {
            return self.begin().await;
        }
        let connection = self.pool.acquire().await?;
        Ok(Transaction { connection, is_persistent: true, is_begun: false, is_over: false })
    }

    /// Makes attempts until one succeeds or fails for good, for as long as a caller waits.
    pub(super) async fn retry<T, F>(&self, attempt: impl Fn() -> F) -> Result<T, QueueError>
    where
        F: Future<Output = sqlx::Result<T>>,
    {
        self.attempts(attempt).await.map_err(|error| failure(&error))
    }

    /// The same with the error of the last attempt.
    pub(super) async fn attempts<T, F>(&self, attempt: impl Fn() -> F) -> sqlx::Result<T>
    where
        F: Future<Output = sqlx::Result<T>>,
    {
        let (until, mut conflicts) = (Instant::now() + ANSWER_TIME, 0);
        loop {
            let error = match timeout_at(until, attempt()).await {
                Ok(Ok(done)) => {
                    self.is_healthy.store(true, Ordering::Release);
                    return Ok(done);
                }
                Ok(Err(error)) => error,
                Err(_) => sqlx::Error::Io(io::ErrorKind::TimedOut.into()),
            };
            conflicts += u32::from(is_conflict(&error));
            let may_succeed = is_lost(&error) || is_conflict(&error) && conflicts < MOST_CONFLICTS;
            if !may_succeed || Instant::now() + PAUSE >= until {
                self.is_healthy.store(false, Ordering::Release);
                return Err(error);
            }
            sleep(PAUSE).await;
        }
    }

    /// Forgets the statements that a lent connection knows.
    pub(super) fn forget_statements(&self) -> &'static str {
        if self.is_pooled { "DEALLOCATE ALL" } else { "SELECT 1" }
    }

    /// Whether the last transaction came to its end.
    pub(super) fn is_healthy(&self) -> bool {
        self.is_healthy.load(Ordering::Acquire)
    }
}

impl Transaction {
    /// A statement.
    pub(super) fn query<'q>(&self, sql: &'static str) -> Query<'q, Postgres, PgArguments> {
        sqlx::query(sql).persistent(self.is_persistent)
    }

    /// A statement whose rows have a known form.
    pub(super) fn query_as<'q, O>(&self, sql: &'static str) -> QueryAs<'q, Postgres, O, PgArguments>
    where
        O: for<'r> FromRow<'r, PgRow>,
    {
        sqlx::query_as(sql).persistent(self.is_persistent)
    }

    /// A statement whose rows have one value.
    pub(super) fn query_scalar<'q, O>(
        &self,
        sql: &'static str,
    ) -> QueryScalar<'q, Postgres, O, PgArguments>
    where
        (O,): for<'r> FromRow<'r, PgRow>,
    {
        sqlx::query_scalar(sql).persistent(self.is_persistent)
    }

    /// Commits, and returns when what was written is on stable storage.
    pub(super) async fn commit(mut self) -> sqlx::Result<()> {
        if self.is_begun {
            sqlx::raw_sql("COMMIT").execute(&mut *self.connection).await?;
        }
        self.is_over = true;
        Ok(())
    }
}

impl Deref for Transaction {
    type Target = PgConnection;

    fn deref(&self) -> &PgConnection {
        &self.connection
    }
}

impl DerefMut for Transaction {
    fn deref_mut(&mut self) -> &mut PgConnection {
        &mut self.connection
    }
}

impl Drop for Transaction {
    fn drop(&mut self) {
        if !self.is_over {
            self.connection.close_on_drop();
        }
    }
}

/// What holds for a connection, or for one transaction on it. No transaction of a node that was stopped
/// keeps its locks, and no commit is acknowledged before it is on stable storage.
pub(super) fn session(schema: &str, is_for_transaction: bool) -> String {
    let set = if is_for_transaction { "SET LOCAL" } else { "SET" };
    format!(
        "{set} search_path TO \"{schema}\"; {set} lock_timeout = '3s'; \
         {set} statement_timeout = '10s'; {set} idle_in_transaction_session_timeout = '5s'; \
         SELECT set_config('synchronous_commit', 'on', {is_for_transaction}) \
         WHERE current_setting('synchronous_commit') = 'off'"
    )
}

/// Whether a transaction met another one.
fn is_conflict(error: &sqlx::Error) -> bool {
    // Serialization failure, deadlock, a lock that was waited for too long, and two that make the same.
    code(error).is_some_and(|code| ["40001", "40P01", "55P03", "23505"].contains(&code.as_str()))
}

/// Whether the connection was lost, or could not be had: the database may be there again in a moment.
pub(super) fn is_lost(error: &sqlx::Error) -> bool {
    match error {
        sqlx::Error::Io(_)
        | sqlx::Error::PoolTimedOut
        | sqlx::Error::Protocol(_)
        | sqlx::Error::WorkerCrashed => true,
        // Connection exceptions, no connection to be had, a server that stops or starts, and one that
        // takes no writes because another has been promoted.
        sqlx::Error::Database(_) => code(error).is_some_and(|code| {
            ["08", "53300", "57P", "25006"].iter().any(|begin| code.starts_with(begin))
        }),
        _ => false,
    }
}

fn code(error: &sqlx::Error) -> Option<String> {
    Some(error.as_database_error()?.code()?.into_owned())
}

/// The error of the queue for one of the database.
pub(super) fn failure(error: &sqlx::Error) -> QueueError {
    let text = error.to_string();
    match error {
        sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) => QueueError::Damaged(text),
        error if is_lost(error) => QueueError::Unreachable(text),
        error => match code(error).as_deref() {
            Some("53100" | "53200" | "54000") => QueueError::DatabaseFull(text),
            Some("XX001" | "XX002") => QueueError::Damaged(text),
            _ => QueueError::Database(text),
        },
    }
}
