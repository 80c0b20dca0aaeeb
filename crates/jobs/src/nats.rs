//! The queue in the streams of a NATS server or cluster with JetStream, shared by any number of
//! nodes.
//!
//! A job is a record, which is changed by compare-and-set alone, and for as long as it has not ended
//! a message in a stream of work. The server gives the message to one worker at a time; while the
//! worker is at it, it tells the server so, and when it falls silent for as long as a lease, the
//! server gives the message to another. Whoever takes the job so gets a new fence into the record,
//! and the one before can change it no more: two workers that finish one job have one effect.
//!
//! The order of writes is what survives a node that ends anywhere: blob, reference, record, message,
//! answer. A sweep completes or clears away what was cut off.
//!
//! Nothing is kept in the nodes. What a node is told of a job by others, it is told so that it looks;
//! should the call be lost, it looks a second later. No two machines' clocks are compared but for how
//! long results are kept.
//!
//! Power failure: an acknowledged write is on stable storage at once only where the server is set to
//! `sync_interval: always`; with three servers or more, a write is on a majority of them.

mod answers;
mod broker;
mod connection;
mod damaged;
mod holdings;
mod owners;
mod pace;
mod read;
mod records;
mod references;
pub mod settings;
mod silence;
mod start;
mod stored;
mod streams;
mod submit;
mod sweep;
mod table;
mod turn;
mod work;

pub use broker::Broker;
pub(super) use broker::{failure, is_full};

use super::queue::{
    Cancellation, Claim, Finish, Lease, Lookup, Outcome, Page, PageRequest, Queue, QueueError,
    Renewal, Stats, Submitted, Swept, Terms,
};
use super::record::{Event, JobId, NewJob, Progress};
use async_nats::Subscriber;
use async_trait::async_trait;
use bytes::Bytes;
use futures_util::StreamExt;
use holdings::Holdings;
use owners::Owners;
use pace::Pace;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use silence::Silence;
use std::collections::HashSet;
use std::sync::Arc;
use streams::{Streams, owner_of_word, owner_word};
use sweep::Places;
use tokio::sync::{Mutex, Notify};
use tokio::task::JoinHandle;
use tokio::time::timeout;
use turn::Turn;

/// The queue, as one node has it.
#[derive(Debug)]
pub struct Nats {
    broker: Broker,
    terms: Terms,
    streams: Streams,
    owners: Arc<Owners>,
    holdings: Holdings,
    silence: Silence,
    turn: Turn,
    pace: Pace,
    /// Where the next sweep goes on.
    places: Mutex<Places>,
    /// One claim at a time, so that the last attempt of a job is made alone.
    claiming: Mutex<()>,
    /// Somebody called to work.
    calls: Arc<Notify>,
    listening: JoinHandle<()>,
}

impl Nats {
    /// Opens the queue, and makes its streams where there are none.
    ///
    /// # Errors
    /// When the broker does not take what is asked of it.
    pub async fn open(broker: Broker, terms: Terms) -> Result<Self, QueueError> {
        let streams = Streams::open(&broker, &terms).await?;
        let owners = Arc::new(Owners::new(streams.work.clone(), terms.lease));
        owners.refresh().await?;
        let calls = Arc::new(Notify::new());
        let heard = broker.subscribe("call.*").await?;
        let listening = tokio::spawn(listen(heard, Arc::clone(&owners), Arc::clone(&calls)));
        Ok(Self {
            broker,
            terms,
            streams,
            owners,
            holdings: Holdings::default(),
            silence: Silence::default(),
            turn: Turn::default(),
            pace: Pace::default(),
            places: Mutex::default(),
            claiming: Mutex::default(),
            calls,
            listening,
        })
    }

    /// Calls the workers of all nodes: an owner has something to do.
    async fn call_to_work(&self, owner: &Owner) {
        self.owners.expect_work(owner);
        self.broker.call(&format!("call.{}", owner_word(owner))).await;
    }

    /// Tells those who follow a job that it has changed.
    async fn announce(&self, id: JobId) {
        self.broker.call(&format!("changed.{id}")).await;
    }

    /// Hears of a job's changes from now on.
    async fn follow(&self, id: JobId) -> Result<Subscriber, QueueError> {
        self.broker.subscribe(&format!("changed.{id}")).await
    }
}

impl Drop for Nats {
    fn drop(&mut self) {
        self.listening.abort();
    }
}

/// Hears the calls to work.
async fn listen(mut heard: Subscriber, owners: Arc<Owners>, calls: Arc<Notify>) {
    while let Some(call) = heard.next().await {
        let word = call.subject.rsplit('.').next().unwrap_or_default();
        if let Some(owner) = owner_of_word(word) {
            owners.expect_work(&owner);
        }
        calls.notify_one();
    }
}

impl Broker {
    /// Tells whoever listens; nobody need hear it.
    async fn call(&self, name: &str) {
        if let Err(error) =
            self.client.publish(format!("{}.{name}", self.prefix), Bytes::new()).await
        {
            tracing::debug!(%error, "nobody could be called");
        }
    }

    /// Hears what is said under a name from now on.
    async fn subscribe(&self, name: &str) -> Result<Subscriber, QueueError> {
        let subscribed = self.client.subscribe(format!("{}.{name}", self.prefix)).await;
        subscribed.map_err(|error| failure("nothing can be listened to", &error))
    }
}

#[async_trait]
impl Queue for Nats {
    async fn submit(&self, job: NewJob) -> Result<Submitted, QueueError> {
        self.submit_job(job).await
    }

    async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        self.look_up(owner, id).await
    }

    async fn list(&self, owner: &Owner, request: PageRequest) -> Result<Page, QueueError> {
        self.page(owner, request).await
    }

    async fn work(&self) {
        let called = async {
            tokio::select! {
                () = self.calls.notified() => {}
                () = self.holdings.fewer.notified() => {}
            }
        };
        let _ = timeout(self.terms.look_again, called).await;
    }

    async fn claim(&self) -> Result<Option<Claim>, QueueError> {
        self.next_claim().await
    }

    async fn renew(&self, lease: Lease, progress: Option<Progress>) -> Result<Renewal, QueueError> {
        self.renew_lease(lease, progress).await
    }

    async fn interruption(&self, lease: Lease) -> Renewal {
        let mut changes = self.follow(lease.job).await.ok();
        loop {
            match self.standing(lease).await {
                Ok(Renewal::Ok) => {}
                Ok(interruption) => return interruption,
                Err(error) => tracing::warn!(%error, "whether a job goes on cannot be read"),
            }
            let changed = async {
                match &mut changes {
                    Some(changes) => drop(changes.next().await),
                    None => std::future::pending().await,
                }
            };
            let _ = timeout(self.terms.look_again, changed).await;
        }
    }

    async fn finish(&self, lease: Lease, outcome: Outcome) -> Result<Finish, QueueError> {
        self.end_attempt(lease, &outcome).await
    }

    async fn cancel(&self, owner: &Owner, id: JobId) -> Result<Cancellation, QueueError> {
        self.cancel_job(owner, id).await
    }

    async fn events(&self, owner: &Owner, id: JobId, after: u64) -> Result<Vec<Event>, QueueError> {
        self.events_after(owner, id, after).await
    }

    async fn stats(&self) -> Result<Stats, QueueError> {
        self.count_all().await
    }

    async fn mean_duration_s(&self, own: Option<f64>) -> Result<Option<f64>, QueueError> {
        self.share_mean(own).await
    }

    async fn sweep(&self) -> Result<Swept, QueueError> {
        self.sweep_all().await
    }

    async fn referenced(&self, blobs: Vec<Digest>) -> Result<HashSet<Digest>, QueueError> {
        let mut found = HashSet::new();
        for blob in blobs {
            if self.is_referenced(blob).await? {
                found.insert(blob);
            }
        }
        Ok(found)
    }

    async fn expect(&self, blob: Digest) -> Result<(), QueueError> {
        self.give_up(&blob.to_string()).await
    }

    async fn forget(&self, blobs: Vec<Digest>) -> Result<(), QueueError> {
        self.forget_all(&blobs).await
    }

    fn is_healthy(&self) -> bool {
        self.broker.is_connected()
    }
}

#[cfg(test)]
mod tests;
