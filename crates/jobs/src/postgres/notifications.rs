//! Notifications between nodes by `LISTEN` and `NOTIFY`: there may be a job to claim, or jobs have
//! changed.
//!
//! A node sends a notification after its commit, in a transaction of its own, because the database
//! serializes the commits of transactions that notify. Notifications that arise meanwhile are sent
//! together. A notification that is lost with its node is made good by polling.

use super::batches::Batcher;
use super::database::Database;
use crate::record::JobId;
use crate::watchers::{Changes, Watchers};
use sqlx::postgres::{PgConnectOptions, PgListener, PgPoolOptions};
use sqlx::{ConnectOptions, Connection, Row};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::sleep;
use uuid::Uuid;

/// The most jobs of one notification, whose payload must be shorter than 8,000 bytes.
const MAX_JOBS: usize = 200;
/// How long connecting may take.
const CONNECT_TIME: Duration = Duration::from_secs(5);
/// The pause before a connection is retried.
const PAUSE: Duration = Duration::from_millis(500);
/// The word of a payload for a job to claim.
const WORK: &str = "work";

/// Sends notifications to other nodes, and receives theirs.
#[derive(Debug)]
pub(super) struct Notifications {
    sender: Batcher<Arc<Changes>, ()>,
    watchers: Arc<Watchers>,
    are_supported: bool,
    are_received: Arc<AtomicBool>,
    receiver: JoinHandle<()>,
}

/// How a node learns of the changes of other nodes.
pub(super) enum Listening {
    /// By notifications.
    Connection(Box<ListenConnection>),
    /// By polling: the address is that of a pooler in transaction mode, which does not pass
    /// notifications on.
    Pooled,
    /// By polling: the database has no notifications.
    Unsupported,
}

/// A connection that listens for notifications.
pub(super) struct ListenConnection {
    options: PgConnectOptions,
    channel: String,
    listener: PgListener,
}

impl ListenConnection {
    /// Connects, and listens where that is possible. A pooler in transaction mode is recognized
    /// because it does not pass on the parameters of connections.
    pub(super) async fn open(options: &PgConnectOptions, schema: &str) -> sqlx::Result<Listening> {
        let (mark, channel) = ("pixmesh.direct", schema.to_owned());
        let mut connection = match options.clone().options([(mark, "on")]).connect().await {
            Err(error) if is_refused_as(&error, &["08P01"]) => return Ok(Listening::Pooled),
            connected => connected?,
        };
        let query = sqlx::raw_sql("SELECT current_setting('pixmesh.direct', true)");
        let value: Option<String> = query.fetch_one(&mut connection).await?.try_get(0)?;
        connection.close().await?;
        if value.as_deref() != Some("on") {
            return Ok(Listening::Pooled);
        }
        match listen(options, &channel).await {
            Ok(listener) => {
                let connection = Self { options: options.clone(), channel, listener };
                Ok(Listening::Connection(Box::new(connection)))
            }
            // The feature is not supported, or unknown.
            Err(error) if is_refused_as(&error, &["0A000", "42601"]) => Ok(Listening::Unsupported),
            Err(error) => Err(error),
        }
    }

    /// Passes the notifications of other nodes on to the watchers. When some may have been lost,
    /// every watcher reads again.
    async fn receive(
        mut self,
        node: String,
        watchers: Arc<Watchers>,
        are_received: Arc<AtomicBool>,
    ) {
        loop {
            match self.listener.try_recv().await {
                Ok(Some(received)) => watchers.notify(&parse(received.payload(), &node)),
                Ok(None) => watchers.notify_all(),
                Err(error) => {
                    are_received.store(false, Ordering::Release);
                    tracing::warn!(%error, "listen connection lost");
                    self.listener = loop {
                        sleep(PAUSE).await;
                        match listen(&self.options, &self.channel).await {
                            Ok(listener) => break listener,
                            Err(error) => tracing::debug!(%error, "listen connection refused"),
                        }
                    };
                    are_received.store(true, Ordering::Release);
                    watchers.notify_all();
                }
            }
        }
    }
}

impl Notifications {
    /// Starts to send, and to receive if there is a connection for it.
    pub(super) fn start(
        database: &Arc<Database>,
        watchers: &Arc<Watchers>,
        channel: &str,
        listening: Listening,
    ) -> Self {
        let node = Uuid::now_v7().simple().to_string();
        let are_supported = !matches!(listening, Listening::Unsupported);
        let connection = match listening {
            Listening::Connection(connection) => Some(connection),
            Listening::Pooled | Listening::Unsupported => None,
        };
        let are_received = Arc::new(AtomicBool::new(connection.is_some()));
        let (receiving, flag) = (Arc::clone(watchers), Arc::clone(&are_received));
        let receiver = tokio::spawn({
            let node = node.clone();
            async move {
                if let Some(connection) = connection {
                    connection.receive(node, receiving, flag).await;
                }
            }
        });
        let channel = channel.to_owned();
        let sender = Batcher::start(database, move |database, changes: Arc<[Arc<Changes>]>| {
            let (payloads, channel) = (payloads(&node, &changes), channel.clone());
            async move {
                let statement = || {
                    sqlx::query(
                        "SELECT pg_notify($1, payload) FROM unnest($2::text[]) AS new (payload)",
                    )
                    .bind(&channel)
                    .bind(&payloads)
                };
                database.execute(statement).await?;
                Ok(vec![(); changes.len()])
            }
        });
        Self { sender, watchers: Arc::clone(watchers), are_supported, are_received, receiver }
    }

    /// Notifies this node and all others of changes that are committed.
    pub(super) fn send(&self, changes: Changes) {
        if changes.work || !changes.jobs.is_empty() {
            self.watchers.notify(&changes);
            if self.are_supported {
                self.sender.send(Arc::new(changes));
            }
        }
    }

    /// Wakes the workers of this node.
    pub(super) fn wake_workers(&self) {
        self.watchers.notify(&Changes { jobs: Vec::new(), work: true });
    }

    /// Whether this node receives the notifications of other nodes now.
    pub(super) fn are_received(&self) -> bool {
        self.are_received.load(Ordering::Acquire)
    }
}

impl Drop for Notifications {
    fn drop(&mut self) {
        self.receiver.abort();
    }
}

/// Whether the database refuses a request with one of these codes.
fn is_refused_as(error: &sqlx::Error, codes: &[&str]) -> bool {
    let code = error.as_database_error().and_then(|error| error.code());
    code.is_some_and(|code| codes.contains(&&*code))
}

/// Payloads are words: the id of the sending node, and then `work` or ids of jobs.
fn payloads(node: &str, changes: &[Arc<Changes>]) -> Vec<String> {
    let jobs: BTreeSet<JobId> = changes.iter().flat_map(|changes| &changes.jobs).copied().collect();
    let jobs: Vec<String> = jobs.iter().map(ToString::to_string).collect();
    let mut payloads: Vec<String> =
        jobs.chunks(MAX_JOBS).map(|jobs| format!("{node} {}", jobs.join(" "))).collect();
    if changes.iter().any(|changes| changes.work) {
        payloads.push(format!("{node} {WORK}"));
    }
    payloads
}

/// The changes of a payload; none if this node sent it.
fn parse(payload: &str, node: &str) -> Changes {
    let mut changes = Changes::default();
    let mut words = payload.split(' ');
    if words.next() == Some(node) {
        return changes;
    }
    for word in words {
        changes.work |= word == WORK;
        changes.jobs.extend(JobId::parse(word));
    }
    changes
}

async fn listen(options: &PgConnectOptions, channel: &str) -> sqlx::Result<PgListener> {
    let pool = PgPoolOptions::new()
        .max_connections(1)
        .acquire_timeout(CONNECT_TIME)
        .max_lifetime(None)
        .idle_timeout(None)
        .connect_with(options.clone())
        .await?;
    let mut listener = PgListener::connect_with(&pool).await?;
    listener.listen(channel).await?;
    Ok(listener)
}
