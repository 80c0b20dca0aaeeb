//! The queue in a PostgreSQL database that nodes share.
//!
//! | module | what |
//! |---|---|
//! | [`settings`] | the connection to the database |
//! | [`database`] | connections, transactions and retries |
//! | [`schema`] | the tables and their versions |
//! | [`rows`] | columns as values |
//! | [`batches`] | many requests in one transaction |
//! | [`notifications`] | notifications between nodes by `LISTEN` and `NOTIFY` |
//! | [`leases`] | the leases of this node |
//! | [`node`] | what the operations share |
//! | [`submit`], [`claim`], [`renew`], [`finish`], [`sweep`], [`read`] | the operations on jobs |
//!
//! Nodes keep no state that other nodes need: a node may crash at any moment. All times are those
//! of the database's clock. An operation is acknowledged after its commit, with the guarantees that
//! the database gives to commits; `synchronous_commit` is switched on where it is off.
//!
//! The queue takes no advisory locks and no table locks, and keeps no state in sessions behind a
//! pooler in transaction mode.

mod batches;
mod claim;
mod database;
mod finish;
mod leases;
mod node;
mod notifications;
mod read;
mod renew;
mod rows;
mod schema;
mod settings;
mod submit;
mod sweep;

pub use settings::PostgresSettings;

use crate::queue::{
    Cancellation, Change, Claim, DELETION_TIME, Finish, Lease, Lookup, Outcome, Page, PageRequest,
    Paused, Queue, QueueError, Renewal, Search, Stats, Submitted, Swept, Terms,
};
use crate::record::{Event, JobId, NewJob, Progress, State};
use crate::secret::Secret;
use crate::watchers::Watchers;
use async_trait::async_trait;
use batches::Batcher;
use database::Database;
use leases::HeldLeases;
use node::Node;
use notifications::{ListenConnection, Listening, Notifications};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use std::collections::HashSet;
use std::error::Error;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// How long a starting node waits for a database that does not answer.
const START_TIME: Duration = Duration::from_secs(15);
/// The pause before it tries again.
const PAUSE: Duration = Duration::from_millis(500);
/// The longest polling period of a node that receives no notifications.
const POLL_PERIOD: Duration = Duration::from_secs(1);

/// The queue of one node.
#[derive(Debug)]
pub struct Postgres {
    node: Arc<Node>,
    submissions: Batcher<NewJob, Submitted>,
    claims: Batcher<(), Option<Claim>>,
    renewals: Batcher<(Lease, Option<Progress>), Renewal>,
    finishes: Batcher<(Lease, Outcome), Finish>,
    expected: Batcher<Digest, bool>,
}

impl Postgres {
    /// Opens the queue at an address, `postgres://NAME:PASSWORD@HOST:PORT/DATABASE`, and creates
    /// its tables if there are none.
    ///
    /// # Errors
    /// When the database cannot be reached or refuses a request, or its tables have a later
    /// version.
    pub async fn open(
        url: &Secret,
        settings: &PostgresSettings,
        terms: Terms,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let direct_url = settings.queue_direct.as_ref().unwrap_or(url);
        let listening = listen(settings, direct_url.reveal()).await;
        let listening = listening.map_err(|error| match settings.queue_direct {
            Some(_) => format!("--queue-direct: {error}").into(),
            None => error,
        })?;
        let is_pooled = settings.queue_direct.is_some() || matches!(listening, Listening::Pooled);
        let options = settings.options(url.reveal())?;
        let database = Arc::new(Database::new(options, settings, is_pooled));
        schema::migrate(&database, settings).await?;
        let watchers = Arc::new(Watchers::default());
        let notifications =
            Notifications::start(&database, &watchers, &settings.queue_schema, listening);
        let node = Arc::new(Node {
            terms,
            database,
            watchers,
            notifications,
            leases: HeldLeases::default(),
            next_owner: Mutex::default(),
            shared_mean_s: Mutex::default(),
        });
        Ok(Self {
            submissions: Batcher::start(
                &node,
                |node, jobs| async move { node.submit(&jobs).await },
            ),
            claims: Batcher::start(
                &node,
                |node, claims| async move { node.claim(claims.len()).await },
            ),
            renewals: Batcher::start(
                &node,
                |node, leases| async move { node.renew(&leases).await },
            ),
            finishes: Batcher::start(
                &node,
                |node, leases| async move { node.finish(&leases).await },
            ),
            expected: Batcher::start(&node, |node, blobs| async move { node.expect(&blobs).await }),
            node,
        })
    }
}

/// Connects for notifications, and waits for a database that is starting.
async fn listen(
    settings: &PostgresSettings,
    url: &str,
) -> Result<Listening, Box<dyn Error + Send + Sync>> {
    let (until, options) = (Instant::now() + START_TIME, settings.options(url)?);
    loop {
        match ListenConnection::open(&options, &settings.queue_schema).await {
            Ok(listening) => {
                match listening {
                    Listening::Connection(_) => {}
                    Listening::Pooled => tracing::warn!(
                        "no notifications through this pooler: this node polls every second; name \
                         the database itself with --queue-direct"
                    ),
                    Listening::Unsupported => {
                        tracing::warn!("database without LISTEN and NOTIFY; polling every second");
                    }
                }
                return Ok(listening);
            }
            Err(error) => {
                if let Some(advice) = settings.explain(&error) {
                    return Err(advice.into());
                }
                if !database::is_lost(&error) || Instant::now() >= until {
                    return Err(format!("the database does not answer: {error}").into());
                }
            }
        }
        sleep(PAUSE).await;
    }
}

#[async_trait]
impl Queue for Postgres {
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError> {
        self.submissions.run(job).await
    }

    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        self.node.get(owner, id).await
    }

    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError> {
        self.node.list(owner, request).await
    }

    async fn claim(&self) -> Result<Option<Claim>, QueueError> {
        self.claims.run(()).await
    }

    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError> {
        self.renewals.run((lease, progress)).await
    }

    async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError> {
        self.node.standing(lease).await
    }

    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError> {
        self.finishes.run((lease, outcome)).await
    }

    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError> {
        self.node.cancel(owner, id).await
    }

    async fn search(&self, search: Search, limit: usize) -> Result<Page, QueueError> {
        self.node.search(&search, limit).await
    }

    async fn change(&self, jobs: Vec<JobId>, change: Change) -> Result<Vec<State>, QueueError> {
        self.node.change(jobs, change).await
    }

    async fn paused(&self) -> Result<Paused, QueueError> {
        self.node.paused().await
    }

    async fn pause(&self, paused: Paused) -> Result<(), QueueError> {
        self.node.pause(paused).await
    }

    async fn events_now(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<(Vec<Event>, bool), QueueError> {
        self.node.events(owner, id, after).await
    }

    async fn stats(&self) -> Result<Stats, QueueError> {
        self.node.stats().await
    }

    async fn stored_bytes(&self) -> Result<Vec<(Owner, u64)>, QueueError> {
        self.node.stored_bytes().await
    }

    async fn mean_duration_s(&self, own: Option<f64>) -> Result<Option<f64>, QueueError> {
        self.node.share_mean(own).await
    }

    async fn sweep(&self) -> Result<Swept, QueueError> {
        self.node.sweep().await
    }

    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError> {
        self.node.referenced(&blobs).await
    }

    async fn expect(&self, blob: Digest) -> Result<(), QueueError> {
        let until = Instant::now() + DELETION_TIME * 2;
        while !self.expected.run(blob).await? {
            if Instant::now() > until {
                return Err(QueueError::Database(format!("blob {blob} is being deleted")));
            }
            sleep(PAUSE).await;
        }
        Ok(())
    }

    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError> {
        self.node.forget(&blobs).await
    }

    fn is_healthy(&self) -> bool {
        self.node.database.is_healthy()
    }

    fn watchers(&self) -> &Arc<Watchers> {
        &self.node.watchers
    }

    fn poll_period(&self) -> Duration {
        let longest =
            if self.node.notifications.are_received() { Duration::MAX } else { POLL_PERIOD };
        self.node.terms.poll_period.min(longest)
    }
}

#[cfg(test)]
mod tests;
