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

conforms! { engine, InServer;
    a_job_goes_from_queued_by_running_to_completed
    a_failed_job_keeps_its_problem
    what_was_acknowledged_is_there_after_a_kill
    a_job_whose_worker_falls_silent_is_given_to_another
    a_job_is_tried_three_times_and_then_failed_as_such
    the_last_attempt_is_made_alone
    an_attempt_that_was_handed_back_does_not_count
    what_may_succeed_another_time_is_tried_again
    a_waiting_job_is_cancelled_at_once_and_then_deleted
    the_worker_of_a_cancelled_job_is_told
    a_cancelled_job_stays_cancelled_when_its_worker_is_killed
    nobody_sees_or_cancels_the_jobs_of_others
    jobs_are_listed_newest_first_page_by_page
    the_same_word_with_the_same_content_is_the_same_job
    words_are_forgotten_in_time
    no_more_jobs_wait_than_may
    owners_take_turns_and_have_no_more_running_than_they_may
    every_change_can_be_followed_from_any_point
    work_is_heard_of_as_it_comes
    jobs_are_gone_after_their_time_and_then_unknown
    blobs_are_given_up_with_the_last_job_that_has_them
    a_blob_stored_for_nothing_is_given_up
    there_is_a_count_of_what_waits_and_runs
    many_at_once_are_each_done_once
}

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
