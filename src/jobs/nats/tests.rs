//! What the queue in a broker promises like all engines, and some promises of its own. Each test has
//! a real server of its own.

#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the cluster share is not used here")]

use super::*;
use crate::config::BrokerSettings;
use crate::jobs::conformance::{Engine, conforms};
use clap::Parser;
use nats_server::NatsServer;

#[path = "../../../tests/cluster/nats_server.rs"]
mod nats_server;

/// A queue in a server of its own; `None` where there is no server to be had.
struct InServer(NatsServer);

#[async_trait]
impl Engine for InServer {
    /// The server is asked over a connection, and other tests use the same processor.
    const SHORT: Duration = Duration::from_millis(500);
    const LEASE: Duration = Duration::from_secs(1);

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

impl InServer {
    async fn broker(&self) -> Broker {
        Broker::connect(&settings(&self.0.address(), &[])).await.unwrap()
    }
}

fn settings(address: &str, flags: &[&str]) -> BrokerSettings {
    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        broker: BrokerSettings,
    }
    let flags = ["pixmesh", "--queue", address].into_iter().chain(flags.iter().copied());
    Flags::try_parse_from(flags).unwrap().broker
}

fn engine(_name: &str) -> Option<InServer> {
    nats_server::program().map(|program| InServer(NatsServer::start(&program)))
}

conforms! { engine, InServer }

async fn opened(engine: &InServer) -> Nats {
    let caps =
        crate::jobs::fairness::Caps { queued: 100, queued_per_owner: 100, running_per_owner: 100 };
    let hour = Duration::from_secs(3600);
    let terms =
        Terms { caps, lease: hour, result_ttl: hour, idempotency_ttl: hour, gone_ttl: hour };
    Nats::open(engine.broker().await, terms).await.unwrap()
}

fn job(image: &str, word: Option<&str>) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: Owner::anonymous(),
        order: "density=2".into(),
        picture: crate::jobs::record::Picture::of_bytes(image.as_bytes()),
        idempotency_key: word.map(str::to_owned),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_blob_whose_submission_was_cut_off_is_given_up() {
    let Some(engine) = engine("cut-blob") else { return };
    let queue = opened(&engine).await;
    let blob = Digest::of(b"image");
    queue.expect(blob).await.unwrap();
    drop(queue);
    let other = opened(&engine).await;
    assert_eq!(other.sweep().await.unwrap().given_up, [blob]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_record_without_a_message_is_sent_to_work_by_a_sweep() {
    let Some(engine) = engine("cut-record") else { return };
    let (queue, job) = (opened(&engine).await, job("image", None));
    queue.refer(&job.picture.digest.to_string(), &job.owner, job.id).await.unwrap();
    let record = stored::StoredJob::new(&job, None);
    let name = streams::record_name(&job.owner, job.id);
    queue.streams.jobs.put(&name, &record, table::Expected::Nothing).await.unwrap();
    assert_eq!(queue.claim().await.unwrap(), None);
    tokio::time::sleep(Duration::from_secs(11)).await;
    queue.sweep().await.unwrap();
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, job.id);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_without_a_record_is_dropped() {
    let Some(engine) = engine("cut-message") else { return };
    let queue = opened(&engine).await;
    let whole = job("whole", None);
    queue.send_to_work(&Owner::anonymous(), JobId::new()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, whole.id);
    assert_eq!(queue.stats().await.unwrap().running, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_submission_with_a_word_that_was_cut_off_is_completed_by_the_next() {
    let Some(engine) = engine("cut-word") else { return };
    let queue = opened(&engine).await;
    let first = job("image", Some("word"));
    queue.leave_word(&first).await.unwrap();
    let again = queue.submit(job("image", Some("word"))).await.unwrap();
    let Submitted::Existing(record) = again else { panic!("{again:?}") };
    assert_eq!(record.id, first.id);
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, first.id);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_under_other_prefixes_know_nothing_of_each_other() {
    let Some(engine) = engine("prefixes") else { return };
    let one = opened(&engine).await;
    one.submit(job("image", None)).await.unwrap();
    let settings = settings(&engine.0.address(), &["--queue-prefix", "other"]);
    let broker = Broker::connect(&settings).await.unwrap();
    let other = Nats::open(broker, one.terms).await.unwrap();
    assert_eq!(other.claim().await.unwrap(), None);
    assert_eq!(other.stats().await.unwrap(), Stats::default());
}
