//! The queue in a PostgreSQL database, shared by any number of nodes.
//!
//! | module | what |
//! |---|---|
//! | [`settings`] | how the database is reached |
//! | [`database`] | connections, and transactions that are tried again |
//! | [`schema`] | the tables and their versions |
//! | [`batches`] | many requests in one transaction |
//! | [`notifications`] | notifications between nodes by `LISTEN` and `NOTIFY` |
//! | [`submit`], [`claim`], [`renew`], [`finish`], [`sweep`], [`read`] | what is done with jobs |
//!
//! A node keeps nothing that another could not do without: it may end at any moment. All times are
//! those of the database's clock. What is acknowledged is committed, with the guarantees that the
//! database gives to its commits: `synchronous_commit` is on where it was off.
//!
//! No advisory locks are taken, and no locks of tables; sessions keep no state where connections are
//! lent for a transaction each.

mod batches;
mod claim;
mod database;
mod finish;
mod leases;
mod notifications;
mod read;
mod renew;
mod row;
mod schema;
mod settings;
mod submit;
mod sweep;

pub use settings::PostgresSettings;

use crate::embedded::watchers::Watchers;
use crate::queue::{
    Cancellation, Claim, Finish, Lease, Lookup, Outcome, Page, PageRequest, Queue, QueueError,
    Renewal, Stats, Submitted, Swept, Terms,
};
use crate::record::{Event, JobId, NewJob, Progress};
use async_trait::async_trait;
use batches::Batcher;
use database::Database;
use leases::HeldLeases;
use notifications::{Listening, Notifications};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use std::collections::HashSet;
use std::error::Error;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout};

/// How long the database may take to be there when a node starts.
const START: Duration = Duration::from_secs(15);
/// The pause before it is asked again.
const PAUSE: Duration = Duration::from_millis(500);
/// How often a node looks for changes that does not hear calls.
const UNHEARD: Duration = Duration::from_secs(1);

/// The queue, as one node has it.
#[derive(Debug)]
pub struct Postgres {
    node: Arc<Node>,
    submissions: Batcher<NewJob, Submitted>,
    claims: Batcher<(), Option<Claim>>,
    renewals: Batcher<(Lease, Option<Progress>), Renewal>,
    ends: Batcher<(Lease, Outcome), Finish>,
    expected: Batcher<Digest, ()>,
}

/// What all that a node does shares.
#[derive(Debug)]
struct Node {
    terms: Terms,
    database: Arc<Database>,
    watchers: Arc<Watchers>,
    notifications: Notifications,
    leases: HeldLeases,
    /// The owner with whom the next round of turns begins.
    turn: Mutex<String>,
    /// How long jobs take here, as other nodes were told.
    sent_mean_s: Mutex<Option<f64>>,
}

impl Postgres {
    /// Opens the queue, and makes its tables where there are none.
    ///
    /// # Errors
    /// When the database cannot be reached, refuses what is asked of it, or has the tables of a later
    /// version.
    pub async fn open(
        settings: &PostgresSettings,
        terms: Terms,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let direct_url = settings.direct_url.as_deref().unwrap_or(&settings.url);
        let listening = listening(settings, direct_url).await?;
        let is_pooled = settings.direct_url.is_some() || listening.is_none();
        let options = settings.options(&settings.url)?;
        let database = Arc::new(Database::new(options, settings, is_pooled));
        schema::migrate(&database, settings).await?;
        let watchers = Arc::new(Watchers::default());
        let notifications = Notifications::start(&database, &watchers, &settings.schema, listening);
        let (leases, turn, sent_mean_s) =
            (HeldLeases::default(), Mutex::default(), Mutex::default());
        let node = Node { terms, database, watchers, notifications, leases, turn, sent_mean_s };
        Ok(Self::of(&Arc::new(node)))
    }

    fn of(node: &Arc<Node>) -> Self {
        let ([one, two, three, four, five], node) = ([(); 5].map(|()| Arc::clone(node)), node);
        Self {
            node: Arc::clone(node),
            submissions: Batcher::start(move |jobs: Arc<[NewJob]>| {
                let node = Arc::clone(&one);
                async move { node.submit(&jobs).await }
            }),
            claims: Batcher::start(move |asked: Arc<[()]>| {
                let node = Arc::clone(&two);
                async move { node.claim(asked.len()).await }
            }),
            renewals: Batcher::start(move |asked: Arc<[(Lease, Option<Progress>)]>| {
                let node = Arc::clone(&three);
                async move { node.renew(&asked).await }
            }),
            ends: Batcher::start(move |ends: Arc<[(Lease, Outcome)]>| {
                let node = Arc::clone(&four);
                async move { node.finish(&ends).await }
            }),
            expected: Batcher::start(move |blobs: Arc<[Digest]>| {
                let node = Arc::clone(&five);
                async move { submit::expect(&node, &blobs).await }
            }),
        }
    }
}

/// Connects for notifications, and waits for a database that is starting; `None` if the address is that
/// of a pooler in transaction mode.
async fn listening(
    settings: &PostgresSettings,
    url: &str,
) -> Result<Option<Listening>, Box<dyn Error + Send + Sync>> {
    let (until, options) = (Instant::now() + START, settings.options(url)?);
    loop {
        match Listening::open(&options, &settings.schema).await {
            Ok(None) => {
                tracing::warn!(
                    "no notifications through this pooler: nodes poll every second; name the \
                     database itself with --queue-direct"
                );
                return Ok(None);
            }
            Ok(listening) => return Ok(listening),
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

impl Node {
    /// How long whoever waits does so before looking again.
    fn look_again(&self) -> Duration {
        let most = if self.notifications.are_received() { Duration::MAX } else { UNHEARD };
        self.terms.look_again.min(most)
    }
}

#[async_trait]
impl Queue for Postgres {
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError> {
        self.submissions.ask(job).await
    }

    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        self.node.get(owner, id).await
    }

    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError> {
        self.node.list(owner, request).await
    }

    async fn work(&self) {
        let _ = timeout(self.node.look_again(), self.node.watchers.work()).await;
    }

    async fn claim(&self) -> Result<Option<Claim>, QueueError> {
        self.claims.ask(()).await
    }

    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError> {
        self.renewals.ask((lease, progress)).await
    }

    async fn interruption(&self, lease: Lease) -> Renewal {
        let mut changes = self.node.watchers.subscribe(lease.job);
        loop {
            match self.node.standing(lease).await {
                Ok(Renewal::Ok) => {}
                Ok(interruption) => return interruption,
                Err(error) => tracing::warn!(%error, "whether a job goes on cannot be read"),
            }
            let _ = timeout(self.node.look_again(), changes.changed()).await;
        }
    }

    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError> {
        self.ends.ask((lease, outcome)).await
    }

    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError> {
        self.node.cancel(owner, id).await
    }

    async fn events(&self, owner: &Owner, id: JobId, after: u64) -> Result<Vec<Event>, QueueError> {
        let mut changes = self.node.watchers.subscribe(id);
        loop {
            let (events, more_may_come) = self.node.events(owner, id, after).await?;
            if !events.is_empty() || !more_may_come {
                return Ok(events);
            }
            let _ = timeout(self.node.look_again(), changes.changed()).await;
        }
    }

    async fn stats(&self) -> Result<Stats, QueueError> {
        self.node.stats().await
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
        self.expected.ask(blob).await
    }

    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError> {
        self.node.forget(&blobs).await
    }

    fn is_healthy(&self) -> bool {
        self.node.database.is_healthy()
    }
}

#[cfg(test)]
mod tests;
