//! What the queue in a broker promises like all engines, and some promises of its own. Each test has
//! a real server of its own.

#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the cluster share is not used here")]

use super::*;
use crate::conformance::{Engine, conforms};
use crate::nats::settings::BrokerSettings;
use clap::Parser;
use nats_server::NatsServer;
use std::time::Duration;

mod answers;
mod cut_off;
mod damaged;
#[path = "../../../../tests/cluster/nats_server.rs"]
mod nats_server;
mod room;
mod starts;
mod streams_made;
mod turns;

/// A queue in one server or more, under a prefix.
struct InServers {
    servers: Arc<Vec<NatsServer>>,
    prefix: String,
}

#[async_trait]
impl Engine for InServers {
    /// The server is asked over a connection, and other tests use the same processor.
    const SHORT: Duration = Duration::from_millis(500);
    /// Longer than a busy machine holds anything up.
    const LEASE: Duration = Duration::from_secs(3);

    async fn open(&self, terms: Terms) -> Arc<dyn Queue> {
        Arc::new(Nats::open(self.broker().await, terms).await.unwrap())
    }

    /// That a process has ended shows when its leases end.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue> {
        let queue = self.open(terms).await;
        // The first only sees that another has swept; the second takes over and looks around.
        for _ in 0..2 {
            queue.sweep().await.unwrap();
        }
        tokio::time::sleep(terms.lease + Self::SHORT).await;
        queue.sweep().await.unwrap();
        queue
    }
}

impl InServers {
    async fn broker(&self) -> Broker {
        self.broker_under(&self.prefix).await
    }

    async fn broker_under(&self, prefix: &str) -> Broker {
        let addresses: Vec<String> = self.servers.iter().map(NatsServer::address).collect();
        let settings = settings(&addresses.join(","), &["--queue-prefix", prefix]);
        Broker::connect(&settings).await.unwrap()
    }
}

fn settings(addresses: &str, flags: &[&str]) -> BrokerSettings {
    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        broker: BrokerSettings,
    }
    let flags = ["pixmesh", "--queue", addresses].into_iter().chain(flags.iter().copied());
    Flags::try_parse_from(flags).unwrap().broker
}

/// One with a server of its own; `None` where there is no server to be had.
fn engine(_name: &str) -> Option<InServers> {
    let servers = vec![NatsServer::start(&nats_server::program()?)];
    Some(InServers { servers: Arc::new(servers), prefix: "pixmesh".into() })
}

mod one_server {
    use super::*;
    conforms! { engine, InServers }
}

/// Three servers that all these tests share while there are any: each has a prefix of its own.
mod three_servers {
    use super::*;
    use crate::blobs::BlobEngine;
    use crate::blobs::Blobs;
    use std::sync::{Mutex as Lock, Weak};

    static SERVERS: Lock<Weak<Vec<NatsServer>>> = Lock::new(Weak::new());

    fn engine(promise: &str) -> Option<InServers> {
        let program = nats_server::program()?;
        let mut shared = SERVERS.lock().unwrap();
        let servers = shared.upgrade().unwrap_or_else(|| {
            let started = Arc::new(NatsServer::start_cluster(&program));
            *shared = Arc::downgrade(&started);
            started
        });
        // A prefix has 32 letters at the most, and these are no two promises' beginning.
        let prefix = promise.chars().take(32).collect();
        Some(InServers { servers, prefix })
    }

    conforms! { engine, InServers }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn what_is_kept_is_on_three_servers() {
        let Some(engine) = engine("three") else { return };
        let queue = opened(&engine).await;
        Blobs::shared(&BlobEngine::Broker, Some(&queue.broker)).await.unwrap();
        let bucket = format!("OBJ_{}", queue.broker.stream_name("blobs-store"));
        let bucket = queue.broker.context.get_stream_no_info(bucket).await.unwrap();
        let tables = [&queue.streams.work, &queue.streams.jobs, &queue.streams.blobs];
        for stream in tables.map(table::Table::stream).into_iter().chain([&bucket]) {
            let info = stream.get_info().await.unwrap();
            assert_eq!(info.config.num_replicas, 3);
            assert_eq!(info.cluster.unwrap().replicas.len(), 2);
        }
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn as_many_copies_are_kept_as_are_asked_for_of_late() {
        let Some(engine) = engine("copies") else { return };
        for copies in [1, 3] {
            let broker = Broker { replicas: copies, ..engine.broker().await };
            let queue = Nats::open(broker, terms()).await.unwrap();
            let info = queue.streams.jobs.stream().get_info().await.unwrap();
            assert_eq!(info.config.num_replicas, copies);
        }
    }
}

fn terms() -> Terms {
    let caps = crate::fairness::Caps { queued: 100, queued_per_owner: 100, running_per_owner: 100 };
    let hour = Duration::from_secs(3600);
    Terms {
        caps,
        lease: hour,
        result_ttl: hour,
        idempotency_ttl: hour,
        gone_ttl: hour,
        look_again: Duration::from_secs(1),
    }
}

async fn opened(engine: &InServers) -> Nats {
    Nats::open(engine.broker().await, terms()).await.unwrap()
}

/// What a worker gets; a consumer hears of a message a moment after whoever published it.
async fn claimed(queue: &Nats) -> Claim {
    let looking = async {
        loop {
            match queue.claim().await.unwrap() {
                Some(claim) => return claim,
                None => queue.work().await,
            }
        }
    };
    timeout(Duration::from_secs(60), looking).await.expect("a job waits")
}

fn job(image: &str, word: Option<&str>) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: Owner::Anonymous,
        order: "density=2".into(),
        picture: crate::record::Picture::of_bytes(image.as_bytes()),
        idempotency_key: word.map(str::to_owned),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_under_other_prefixes_know_nothing_of_each_other() {
    let Some(engine) = engine("prefixes") else { return };
    let one = opened(&engine).await;
    one.submit(job("image", None)).await.unwrap();
    let other = Nats::open(engine.broker_under("other").await, one.terms).await.unwrap();
    assert_eq!(other.claim().await.unwrap(), None);
    assert_eq!(other.stats().await.unwrap(), Stats::default());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_node_knows_how_long_jobs_take_on_the_one_that_worked_last() {
    let Some(engine) = engine("pace") else { return };
    let (one, other) = (opened(&engine).await, opened(&engine).await);
    assert_eq!(other.mean_duration_s(None).await.unwrap(), None);
    assert_eq!(one.mean_duration_s(Some(2.5)).await.unwrap(), Some(2.5));
    assert_eq!(other.mean_duration_s(None).await.unwrap(), Some(2.5));
    assert_eq!(other.mean_duration_s(Some(4.0)).await.unwrap(), Some(4.0));
    // The first has done nothing since: what it knows is old.
    assert_eq!(one.mean_duration_s(Some(2.5)).await.unwrap(), Some(4.0));
    drop((one, other));
    assert_eq!(opened(&engine).await.mean_duration_s(None).await.unwrap(), Some(4.0));
    let queue = opened(&engine).await;
    damaged::damage(&queue.streams.blobs, "turn.pace").await;
    assert_eq!(queue.mean_duration_s(None).await.unwrap(), None);
}
