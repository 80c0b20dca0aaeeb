//! What the queue in a broker promises like all engines, and some promises of its own. Each test has
//! a real server of its own.

#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the cluster share is not used here")]

use super::*;
use crate::config::BrokerSettings;
use crate::jobs::conformance::{Engine, conforms};
use clap::Parser;
use nats_server::NatsServer;
use std::time::Duration;

#[path = "../../../tests/cluster/nats_server.rs"]
mod nats_server;

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
        for table in [&queue.streams.work, &queue.streams.jobs, &queue.streams.blobs] {
            let info = table.stream().get_info().await.unwrap();
            assert_eq!(info.config.num_replicas, 3);
            assert_eq!(info.cluster.unwrap().replicas.len(), 2);
        }
    }
}

fn terms() -> Terms {
    let caps =
        crate::jobs::fairness::Caps { queued: 100, queued_per_owner: 100, running_per_owner: 100 };
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
    let other = Nats::open(engine.broker_under("other").await, one.terms).await.unwrap();
    assert_eq!(other.claim().await.unwrap(), None);
    assert_eq!(other.stats().await.unwrap(), Stats::default());
}

/// Puts what nothing can read in the place of a value.
async fn damage(table: &table::Table, name: &str) {
    let nonsense = async_nats::jetstream::message::PublishMessage::build().payload("{".into());
    let put = table.publish(name, nonsense).await.unwrap();
    assert!(matches!(put, table::Put::Stored(_)), "{put:?}");
}

async fn damage_record(queue: &Nats, job: &NewJob) {
    damage(&queue.streams.jobs, &streams::record_name(&job.owner, job.id)).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_record_that_cannot_be_read_is_set_aside_and_the_others_go_on() {
    let Some(engine) = engine("damaged") else { return };
    let queue = opened(&engine).await;
    let (damaged, whole) = (job("damaged", None), job("whole", None));
    queue.submit(damaged.clone()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    damage_record(&queue, &damaged).await;
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, whole.id);
    assert_eq!(queue.claim().await.unwrap(), None);
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
    let stats = queue.stats().await.unwrap();
    assert_eq!((stats.queued, stats.running), (0, 1), "nobody is given it again");
    let found = queue.get(&damaged.owner, damaged.id).await;
    assert!(matches!(found, Err(QueueError::Damaged(_))), "{found:?}");
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&whole.owner, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole.id]);
    let image = damaged.picture.digest;
    assert!(queue.referenced(vec![image]).await.unwrap().contains(&image), "it may be mended");
    let deleted = queue.cancel(&damaged.owner, damaged.id).await.unwrap();
    assert_eq!(deleted, Cancellation::Deleted);
    assert_eq!(queue.get(&damaged.owner, damaged.id).await.unwrap(), Lookup::Unknown);
    assert_eq!(queue.sweep().await.unwrap().given_up, [image]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_whose_record_is_damaged_as_it_runs_is_lost_to_its_worker() {
    let Some(engine) = engine("damaged-running") else { return };
    let queue = opened(&engine).await;
    let (one, other) = (job("one", None), job("other", None));
    for job in [&one, &other] {
        queue.submit(job.clone()).await.unwrap();
        let lease = queue.claim().await.unwrap().unwrap().lease;
        damage_record(&queue, job).await;
        if job.id == one.id {
            assert_eq!(queue.renew(lease, None).await.unwrap(), Renewal::Lost);
            assert_eq!(queue.interruption(lease).await, Renewal::Lost);
        }
        let finish = queue.finish(lease, Outcome::Cancelled).await.unwrap();
        assert_eq!(finish, Finish::Fenced);
    }
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_record_that_cannot_be_read_is_gone_in_its_time() {
    let Some(engine) = engine("damaged-gone") else { return };
    let result_ttl = Duration::from_secs(4);
    let terms = Terms { result_ttl, ..terms() };
    let queue = Nats::open(engine.broker().await, terms).await.unwrap();
    let damaged = job("damaged", None);
    queue.submit(damaged.clone()).await.unwrap();
    damage_record(&queue, &damaged).await;
    assert_eq!(queue.sweep().await.unwrap().expired, 0);
    tokio::time::sleep(result_ttl + InServers::SHORT).await;
    let swept = queue.sweep().await.unwrap();
    assert_eq!((swept.expired, swept.given_up), (1, vec![damaged.picture.digest]));
    assert_eq!(queue.get(&damaged.owner, damaged.id).await.unwrap(), Lookup::Gone);
    assert_eq!(queue.claim().await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_word_a_mark_and_an_end_that_cannot_be_read_stop_nothing() {
    let Some(engine) = engine("damaged-others") else { return };
    let queue = opened(&engine).await;
    let first = job("image", Some("word"));
    queue.submit(first.clone()).await.unwrap();
    for (table, name) in [
        (&queue.streams.words, queue.streams.words.names("word.*").await.unwrap().remove(0)),
        (&queue.streams.blobs, "turn.sweep".into()),
        (&queue.streams.gone, streams::gone_name(&first.owner, first.id)),
    ] {
        damage(table, &name).await;
    }
    let again = queue.submit(job("image", Some("word"))).await.unwrap();
    assert!(matches!(again, Submitted::Created(_)), "{again:?}");
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
    queue.cancel(&first.owner, first.id).await.unwrap();
    queue.cancel(&first.owner, first.id).await.unwrap();
    assert_eq!(queue.get(&first.owner, first.id).await.unwrap(), Lookup::Gone);
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
    damage(&queue.streams.blobs, "turn.pace").await;
    assert_eq!(queue.mean_duration_s(None).await.unwrap(), None);
}

/// Whether a stream is one of newest values in a file, and what is kept of them.
async fn stream_of(table: &table::Table) -> async_nats::jetstream::stream::Config {
    let config = table.stream().get_info().await.unwrap().config;
    assert_eq!(config.storage, async_nats::jetstream::stream::StorageType::File);
    assert_eq!((config.max_messages_per_subject, config.num_replicas), (1, 1));
    assert!(config.description.as_ref().is_some_and(|text| !text.is_empty()), "{}", config.name);
    config
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn streams_are_made_as_the_terms_say_and_follow_other_terms() {
    use async_nats::jetstream::stream::{DiscardPolicy, RetentionPolicy};
    let Some(engine) = engine("streams") else { return };
    let second = Duration::from_secs(1);
    let caps = |queued| crate::jobs::fairness::Caps { queued, ..terms().caps };
    let one = Terms { idempotency_ttl: 60 * second, gone_ttl: 70 * second, ..terms() };
    let others = [
        one,
        Terms { caps: caps(50), ..one },
        Terms { idempotency_ttl: 30 * second, ..one },
        Terms { gone_ttl: 2 * second, ..one },
        Terms { idempotency_ttl: second / 10, gone_ttl: second / 10, ..one },
    ];
    for terms in others {
        let queue = Nats::open(engine.broker().await, terms).await.unwrap();
        let work = stream_of(&queue.streams.work).await;
        assert_eq!(work.retention, RetentionPolicy::WorkQueue);
        assert_eq!((work.discard, work.discard_new_per_subject), (DiscardPolicy::New, true));
        assert_eq!(work.max_messages as usize, terms.caps.queued + 1024);
        let words = stream_of(&queue.streams.words).await;
        assert_eq!(
            (words.max_age, words.duplicate_window),
            (terms.idempotency_ttl.max(second), second)
        );
        let gone = stream_of(&queue.streams.gone).await;
        assert_eq!((gone.max_age, gone.duplicate_window), (terms.gone_ttl.max(second), second));
        for table in [&queue.streams.jobs, &queue.streams.blobs] {
            let config = stream_of(table).await;
            assert_eq!(
                (config.max_age, config.retention),
                (Duration::ZERO, RetentionPolicy::Limits)
            );
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_of_somebody_else_is_left_alone_and_the_prefix_named() {
    let Some(engine) = engine("foreign") else { return };
    let broker = engine.broker().await;
    let name = broker.stream_name("work");
    let foreign = async_nats::jetstream::stream::Config {
        name: name.clone(),
        subjects: vec![format!("{}.other", broker.prefix)],
        ..Default::default()
    };
    broker.context.create_stream(foreign).await.unwrap();
    let error = Nats::open(broker, terms()).await.unwrap_err().to_string();
    assert!(error.contains(&name) && error.contains("--queue-prefix"), "{error}");
}

#[test]
fn the_causes_of_an_error_are_each_said_once() {
    #[derive(Debug)]
    struct Caused(&'static str, Option<Box<Caused>>);
    impl std::fmt::Display for Caused {
        fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            formatter.write_str(self.0)
        }
    }
    impl std::error::Error for Caused {
        fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
            self.1.as_deref().map(|cause| cause as _)
        }
    }
    let root = Caused("no room", None);
    let error =
        Caused("not kept: no room", Some(Box::new(Caused("no room", Some(Box::new(root))))));
    assert_eq!(broker::causes(&error), "not kept: no room");
    let error = Caused("not kept", Some(Box::new(Caused("no room", None))));
    assert_eq!(broker::causes(&error), "not kept: no room");
}
