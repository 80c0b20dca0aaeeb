//! Whose jobs there are: one consumer of the stream of work for each owner.
//!
//! The server gives each message to one worker, and again to another when it is neither taken away
//! nor kept alive for as long as a lease. A consumer for each owner lets owners take turns, however
//! many jobs each of them has. A node learns of owners from what it submits, from other nodes' calls
//! to work, and from the server every few seconds.

use super::broker::failure;
use super::streams::{owner_of_word, owner_word};
use super::table::Table;
use crate::fairness::{Caps, OwnerLoad, next_owner};
use crate::queue::QueueError;
use async_nats::jetstream::Message;
use async_nats::jetstream::consumer::pull::Config;
use async_nats::jetstream::consumer::{AckPolicy, Consumer, Info};
use futures_util::{StreamExt, TryStreamExt};
use pixmesh_engine::Owner;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::time::timeout;

/// What the names of consumers begin with.
const CONSUMER: &str = "worker-";
/// How long a consumer may take to say that it has nothing.
const ANSWER_TIME: Duration = Duration::from_secs(5);

/// The owners that are known of.
#[derive(Debug)]
pub(super) struct Owners {
    work: Table,
    lease: Duration,
    known: Mutex<HashMap<Owner, Known>>,
}

/// An owner, as far as this node knows.
#[derive(Clone, Debug, Default)]
struct Known {
    consumer: Option<Consumer<Config>>,
    /// When there was last nothing to do.
    found_empty: Option<Instant>,
    last_turn: u64,
}

impl Owners {
    pub(super) fn new(work: Table, lease: Duration) -> Self {
        Self { work, lease, known: Mutex::default() }
    }

    /// There may be something to do for an owner.
    pub(super) fn expect_work(&self, owner: &Owner) {
        self.known().entry(owner.clone()).or_default().found_empty = None;
    }

    /// Learns of owners from the server.
    pub(super) async fn refresh(&self) -> Result<(), QueueError> {
        let names: Result<Vec<String>, _> = self.work.stream().consumer_names().try_collect().await;
        let names = names.map_err(|error| failure("owners cannot be read", &error))?;
        let words = names.iter().filter_map(|name| name.strip_prefix(CONSUMER));
        let mut known = self.known();
        for owner in words.filter_map(owner_of_word) {
            known.entry(owner).or_default();
        }
        Ok(())
    }

    /// The next message of the owner whose turn it is; owners with nothing to do are asked again
    /// after a while.
    pub(super) async fn fetch(
        &self,
        caps: &Caps,
        running: impl Fn(&Owner) -> usize,
        again: Duration,
    ) -> Result<Option<(Owner, Message)>, QueueError> {
        let mut loads = self.loads(running, again);
        while let Some(owner) = next_owner(&loads, caps).map(|load| load.owner.clone()) {
            if let Some(message) = self.fetch_of(&owner).await? {
                return Ok(Some((owner, message)));
            }
            self.known().entry(owner.clone()).or_default().found_empty = Some(Instant::now());
            loads.retain(|load| load.owner != owner);
        }
        Ok(None)
    }

    /// The owner had a turn.
    pub(super) fn take_turn(&self, owner: &Owner) {
        let mut known = self.known();
        let last = known.values().map(|known| known.last_turn).max().unwrap_or(0);
        known.entry(owner.clone()).or_default().last_turn = last + 1;
    }

    fn loads(&self, running: impl Fn(&Owner) -> usize, again: Duration) -> Vec<OwnerLoad> {
        let known = self.known();
        let may_have = known
            .iter()
            .filter(|(_, known)| known.found_empty.is_none_or(|found| found.elapsed() >= again));
        may_have
            .map(|(owner, known)| OwnerLoad {
                owner: owner.clone(),
                queued: 1,
                running: running(owner),
                last_turn: known.last_turn,
            })
            .collect()
    }

    async fn fetch_of(&self, owner: &Owner) -> Result<Option<Message>, QueueError> {
        let consumer = self.consumer(owner).await?;
        let fetched = async {
            let mut batch = consumer.fetch().max_messages(1).messages().await?;
            batch.next().await.transpose()
        };
        let error = match timeout(ANSWER_TIME, fetched).await {
            Ok(Ok(message)) => return Ok(message),
            Ok(Err(error)) => failure("no work can be fetched", error.as_ref()),
            Err(_) => QueueError::Unreachable("no work can be fetched: no answer".into()),
        };
        // It may have been deleted, and is made again the next time.
        self.known().entry(owner.clone()).or_default().consumer = None;
        Err(error)
    }

    /// The consumer of an owner's work, which is made where there is none.
    pub(super) async fn consumer(&self, owner: &Owner) -> Result<Consumer<Config>, QueueError> {
        if let Some(consumer) = self.known().get(owner).and_then(|known| known.consumer.clone()) {
            return Ok(consumer);
        }
        let word = owner_word(owner);
        let config = Config {
            durable_name: Some(format!("{CONSUMER}{word}")),
            filter_subject: self.work.subject(&format!("work.{word}.*")),
            ack_policy: AckPolicy::Explicit,
            ack_wait: self.lease,
            // Attempts are counted in the record: one that was handed back does not count.
            max_deliver: -1,
            max_ack_pending: -1,
            ..Config::default()
        };
        let consumer = self.work.stream().create_consumer(config).await;
        let consumer = consumer.map_err(|error| failure("a consumer cannot be made", &error))?;
        self.known().entry(owner.clone()).or_default().consumer = Some(consumer.clone());
        Ok(consumer)
    }

    /// How an owner's consumer stands.
    pub(super) async fn info(&self, owner: &Owner) -> Result<Info, QueueError> {
        let consumer = self.consumer(owner).await?;
        match consumer.get_info().await {
            Ok(info) => Ok(info),
            Err(error) => {
                self.known().entry(owner.clone()).or_default().consumer = None;
                Err(failure("a consumer cannot be asked", &error))
            }
        }
    }

    /// Everybody known of.
    pub(super) fn all(&self) -> Vec<Owner> {
        self.known().keys().cloned().collect()
    }

    fn known(&self) -> MutexGuard<'_, HashMap<Owner, Known>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
