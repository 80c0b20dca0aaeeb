//! The connections to the database, and transactions on them.
//!
//! Every transaction can be repeated: after a conflict with another one, or when the connection is
//! lost, it is retried until the time limit of a request. A transaction that is dropped before its
//! commit closes its connection, so that nobody waits for a connection that hangs.

use super::settings::PostgresSettings;
use crate::queue::QueueError;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgArguments, PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgRow};
use sqlx::query::{Query, QueryAs};
use sqlx::{AssertSqlSafe, Connection, FromRow, Postgres};
use std::io;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout_at};

/// How long a request may take, retries included.
const REQUEST_TIME: Duration = Duration::from_secs(5);
/// How long an attempt waits for a free or new connection. Shorter than a request, because a retry
/// finds a database that has restarted sooner than a long wait.
const CONNECT_TIME: Duration = Duration::from_secs(2);
/// The pause before a retry.
const PAUSE: Duration = Duration::from_millis(25);
/// How often a transaction is tried that conflicts with others.
const MAX_CONFLICTS: u32 = 8;
/// A connection that was idle for longer is tested before it is used.
const IDLE_TIME: Duration = Duration::from_secs(1);

/// The connections of a node.
#[derive(Debug)]
pub(super) struct Database {
    pool: PgPool,
    /// The statements that begin a transaction.
    begin: String,
    /// Whether a pooler in transaction mode is between this node and the database.
    is_pooled: bool,
    is_healthy: AtomicBool,
}

/// A transaction, or a connection for a single statement.
pub(super) struct Transaction {
    connection: PoolConnection<Postgres>,
    /// Whether the connection keeps prepared statements.
    is_persistent: bool,
    is_begun: bool,
    is_over: bool,
}

impl Database {
    /// A pool that connects when a connection is first needed.
    pub(super) fn new(
        mut options: PgConnectOptions,
        settings: &PostgresSettings,
        is_pooled: bool,
    ) -> Self {
        let session = session(&settings.queue_schema, is_pooled);
        let mut pool = PgPoolOptions::new()
            .max_connections(settings.queue_connections.get())
            .acquire_timeout(CONNECT_TIME)
            .test_before_acquire(false)
            .before_acquire(|connection, known| {
                Box::pin(async move {
                    if known.idle_for > IDLE_TIME {
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
        let mut transaction = self.connection(true).await?;
        let begin = AssertSqlSafe(self.begin.as_str());
        sqlx::raw_sql(begin).execute(&mut *transaction).await?;
        Ok(transaction)
    }

    async fn connection(&self, is_begun: bool) -> sqlx::Result<Transaction> {
        let connection = self.pool.acquire().await?;
        Ok(Transaction { connection, is_persistent: !self.is_pooled, is_begun, is_over: false })
    }

    /// Begins a transaction of sqlx's own type, which the migrations need. They prepare statements,
    /// which the caller must discard before and after on a connection of a pooler.
    pub(super) async fn begin_migration(
        &self,
    ) -> sqlx::Result<sqlx::Transaction<'static, Postgres>> {
        self.pool.begin_with(AssertSqlSafe(self.begin.clone())).await
    }

    /// A connection for reading. It needs a transaction only behind a pooler, for its settings.
    pub(super) async fn reading(&self) -> sqlx::Result<Transaction> {
        if self.is_pooled { self.begin().await } else { self.connection(false).await }
    }

    /// Executes a single statement, with retries, and returns its rows.
    pub(super) async fn execute<'q>(
        &self,
        statement: impl Fn() -> Query<'q, Postgres, PgArguments>,
    ) -> Result<Vec<PgRow>, QueueError> {
        let attempt = || async {
            let mut connection = self.reading().await?;
            let statement = statement().persistent(connection.is_persistent);
            let rows = statement.fetch_all(&mut *connection).await?;
            connection.commit().await?;
            Ok(rows)
        };
        self.retry(attempt).await
    }

    /// Makes attempts until one succeeds, fails for good or the time of a request is over.
    pub(super) async fn retry<T, F>(&self, attempt: impl Fn() -> F) -> Result<T, QueueError>
    where
        F: Future<Output = sqlx::Result<T>>,
    {
        self.attempts(attempt).await.map_err(|error| failure(&error))
    }

    /// Like [`Self::retry`], with the error of the last attempt.
    pub(super) async fn attempts<T, F>(&self, attempt: impl Fn() -> F) -> sqlx::Result<T>
    where
        F: Future<Output = sqlx::Result<T>>,
    {
        let (until, mut conflicts) = (Instant::now() + REQUEST_TIME, 0);
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
            let may_succeed = is_lost(&error) || is_conflict(&error) && conflicts < MAX_CONFLICTS;
            if !may_succeed || Instant::now() + PAUSE >= until {
                self.is_healthy.store(false, Ordering::Release);
                return Err(error);
            }
            sleep(PAUSE).await;
        }
    }

    /// The statement that discards the prepared statements of a pooler's connection.
    pub(super) fn discard_statements(&self) -> &'static str {
        if self.is_pooled { "DEALLOCATE ALL" } else { "SELECT 1" }
    }

    /// The number of connections in use, and their limit.
    pub(super) fn connections(&self) -> (usize, u32) {
        let open = self.pool.size() as usize;
        (open.saturating_sub(self.pool.num_idle()), self.pool.options().get_max_connections())
    }

    /// Whether the last request succeeded.
    pub(super) fn is_healthy(&self) -> bool {
        self.is_healthy.load(Ordering::Acquire)
    }
}

impl Transaction {
    pub(super) fn query<'q>(&self, sql: &'static str) -> Query<'q, Postgres, PgArguments> {
        sqlx::query(sql).persistent(self.is_persistent)
    }

    /// A query whose rows are tuples.
    pub(super) fn query_as<'q, O>(&self, sql: &'static str) -> QueryAs<'q, Postgres, O, PgArguments>
    where
        O: for<'r> FromRow<'r, PgRow>,
    {
        sqlx::query_as(sql).persistent(self.is_persistent)
    }

    /// Commits. What was written is on stable storage afterwards.
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

/// The settings of a connection, or of one transaction. Timeouts release the locks of a node that
/// was stopped, and commits are acknowledged when they are on stable storage.
pub(super) fn session(schema: &str, is_for_transaction: bool) -> String {
    let set = if is_for_transaction { "SET LOCAL" } else { "SET" };
    format!(
        "{set} search_path TO \"{schema}\"; {set} lock_timeout = '3s'; \
         {set} statement_timeout = '10s'; {set} idle_in_transaction_session_timeout = '5s'; \
         SELECT set_config('synchronous_commit', 'on', {is_for_transaction}) \
         WHERE current_setting('synchronous_commit') = 'off'"
    )
}

/// Whether the transaction conflicts with another one.
fn is_conflict(error: &sqlx::Error) -> bool {
    // Serialization failure, deadlock, lock timeout and unique violation.
    code(error).is_some_and(|code| ["40001", "40P01", "55P03", "23505"].contains(&code.as_str()))
}

/// Whether the connection was lost or could not be opened. The database may be back in a moment.
pub(super) fn is_lost(error: &sqlx::Error) -> bool {
    match error {
        sqlx::Error::Io(_)
        | sqlx::Error::PoolTimedOut
        | sqlx::Error::Protocol(_)
        | sqlx::Error::WorkerCrashed => true,
        // Connection exceptions, too many connections, a server that stops or starts, and one that
        // is read-only because another has been promoted.
        sqlx::Error::Database(_) => code(error).is_some_and(|code| {
            ["08", "53300", "57P", "25006"].iter().any(|begin| code.starts_with(begin))
        }),
        _ => false,
    }
}

fn code(error: &sqlx::Error) -> Option<String> {
    Some(error.as_database_error()?.code()?.into_owned())
}

/// The error of the queue for an error of the database.
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
