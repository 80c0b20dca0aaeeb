//! What nodes tell each other at once: that there may be work, and which jobs have changed.
//!
//! A call follows the commit that it tells of, in a transaction of its own: the database lets those
//! that call commit one after another, and calls that come meanwhile are told together. One that is
//! lost with its node is made good by looking again.

use super::batches::Batcher;
use super::database::Database;
use crate::embedded::watchers::{Changes, Watchers};
use crate::record::JobId;
use sqlx::postgres::{PgConnectOptions, PgListener, PgPoolOptions};
use sqlx::{ConnectOptions, Connection, Row};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::sleep;
use uuid::Uuid;

/// The most jobs that one call names: a call has less than 8,000 bytes.
const MOST_JOBS: usize = 200;
/// How long a connection on which calls are heard may take.
const CONNECT_TIME: Duration = Duration::from_secs(5);
/// The pause before such a connection is asked for again.
const PAUSE: Duration = Duration::from_millis(500);
/// What a call begins with that says that there may be work.
const WORK: &str = "work";

/// Calls to other nodes.
#[derive(Debug)]
pub(super) struct Notifications {
    gathered: Batcher<Arc<Changes>, ()>,
    watchers: Arc<Watchers>,
    hears: Arc<AtomicBool>,
    listening: JoinHandle<()>,
}

/// A connection on which calls of other nodes are heard.
pub(super) struct Listening {
    options: PgConnectOptions,
    channel: String,
    listener: PgListener,
}

impl Listening {
    /// Opens one, unless the address is that of a pooler, which lends connections for a transaction
    /// each: it does not pass on with what parameters a connection is asked for.
    pub(super) async fn open(
        options: &PgConnectOptions,
        schema: &str,
    ) -> sqlx::Result<Option<Self>> {
        let (mark, channel) = ("pixmesh.direct", schema.to_owned());
        let mut connection = match options.clone().options([(mark, "on")]).connect().await {
            Err(sqlx::Error::Database(error)) if error.code().as_deref() == Some("08P01") => {
                return Ok(None);
            }
            connected => connected?,
        };
        let asked = sqlx::raw_sql("SELECT current_setting('pixmesh.direct', true)");
        let answer: Option<String> = asked.fetch_one(&mut connection).await?.try_get(0)?;
        connection.close().await?;
        if answer.as_deref() != Some("on") {
            return Ok(None);
        }
        let listener = listener(options, &channel).await?;
        Ok(Some(Self { options: options.clone(), channel, listener }))
    }
}

impl Notifications {
    /// Calls nodes, and hears of theirs where there is a line.
    pub(super) fn start(
        database: &Arc<Database>,
        watchers: &Arc<Watchers>,
        channel: &str,
        line: Option<Listening>,
    ) -> Self {
        let node = Uuid::now_v7().simple().to_string();
        let hears = Arc::new(AtomicBool::new(line.is_some()));
        let heard = (Arc::clone(watchers), Arc::clone(&hears));
        let listening = tokio::spawn(listen(line, node.clone(), heard.0, heard.1));
        let (database, channel) = (Arc::clone(database), channel.to_owned());
        let gathered = Batcher::start(move |changes: Arc<[Arc<Changes>]>| {
            let calls = calls(&node, &changes);
            let (database, channel) = (Arc::clone(&database), channel.clone());
            async move {
                let call = || async {
                    let mut transaction = database.begin().await?;
                    transaction
                        .query("SELECT pg_notify($1, call) FROM unnest($2::text[]) AS calls (call)")
                        .bind(&channel)
                        .bind(&calls)
                        .execute(&mut *transaction)
                        .await?;
                    transaction.commit().await
                };
                database.retry(call).await?;
                Ok(vec![(); changes.len()])
            }
        });
        Self { gathered, watchers: Arc::clone(watchers), hears, listening }
    }

    /// Tells this node and all others what was committed.
    pub(super) fn send(&self, changes: Changes) {
        if changes.work || !changes.jobs.is_empty() {
            self.watchers.tell(&changes);
            self.gathered.tell(Arc::new(changes));
        }
    }

    /// Calls the workers of this node alone.
    pub(super) fn wake_workers(&self) {
        self.watchers.tell(&Changes { jobs: Vec::new(), work: true });
    }

    /// Whether calls of other nodes are heard now.
    pub(super) fn are_received(&self) -> bool {
        self.hears.load(Ordering::Acquire)
    }
}

impl Drop for Notifications {
    fn drop(&mut self) {
        self.listening.abort();
    }
}

/// The texts of calls: who calls, and then whether there may be work, and names of jobs.
fn calls(node: &str, changes: &[Arc<Changes>]) -> Vec<String> {
    let work = changes.iter().any(|changes| changes.work);
    let jobs: BTreeSet<JobId> = changes.iter().flat_map(|changes| &changes.jobs).copied().collect();
    let jobs: Vec<String> = jobs.iter().map(ToString::to_string).collect();
    let mut calls: Vec<String> =
        jobs.chunks(MOST_JOBS).map(|jobs| format!("{node} {}", jobs.join(" "))).collect();
    if work {
        calls.push(format!("{node} {WORK}"));
    }
    calls
}

async fn listener(options: &PgConnectOptions, channel: &str) -> sqlx::Result<PgListener> {
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

/// Hears calls, and has everybody look who waits when some may have been lost.
async fn listen(
    line: Option<Listening>,
    node: String,
    watchers: Arc<Watchers>,
    hears: Arc<AtomicBool>,
) {
    let Some(mut line) = line else { return };
    loop {
        match line.listener.try_recv().await {
            Ok(Some(call)) => watchers.tell(&heard(call.payload(), &node)),
            Ok(None) => watchers.tell_all(),
            Err(error) => {
                hears.store(false, Ordering::Release);
                tracing::warn!(%error, "calls of other nodes are not heard");
                line.listener = loop {
                    sleep(PAUSE).await;
                    match listener(&line.options, &line.channel).await {
                        Ok(listener) => break listener,
                        Err(error) => tracing::debug!(%error, "no connection to hear calls on"),
                    }
                };
                hears.store(true, Ordering::Release);
                watchers.tell_all();
            }
        }
    }
}

/// What a call says; nothing, when it is this node's own.
fn heard(call: &str, node: &str) -> Changes {
    let mut words = call.split(' ');
    if words.next() == Some(node) {
        return Changes::default();
    }
    let mut changes = Changes::default();
    for word in words {
        changes.work |= word == WORK;
        changes.jobs.extend(JobId::parse(word));
    }
    changes
}
