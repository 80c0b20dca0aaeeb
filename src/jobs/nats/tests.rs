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
        queue.sweep().await.unwrap();
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
