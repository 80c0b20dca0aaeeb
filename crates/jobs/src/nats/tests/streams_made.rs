//! The streams and consumers that are made, and what is found in their place.

use super::*;

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
    let caps = |queued| crate::fairness::Caps { queued, ..terms().caps };
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
    use async_nats::jetstream::stream::{Config, RetentionPolicy};
    // Another retention, other subjects, and both.
    for (prefix, retention, subject) in [
        ("a", RetentionPolicy::Limits, "a.work.*.*"),
        ("b", RetentionPolicy::WorkQueue, "b.other"),
        ("c", RetentionPolicy::Limits, "c.other"),
    ] {
        let broker = engine.broker_under(prefix).await;
        let name = broker.stream_name("work");
        let subjects = vec![subject.into()];
        let foreign = Config { name: name.clone(), subjects, retention, ..Config::default() };
        broker.context.create_stream(foreign).await.unwrap();
        let error = Nats::open(broker, terms()).await.unwrap_err().to_string();
        assert!(error.contains(&name) && error.contains("--queue-prefix"), "{error}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_consumer_gives_out_any_number_of_messages_as_often_as_it_takes() {
    let Some(engine) = engine("consumers") else { return };
    let queue = opened(&engine).await;
    let owner = Owner::named("somebody");
    let config = queue.owners.info(&owner).await.unwrap().config;
    assert_eq!(config.ack_policy, async_nats::jetstream::consumer::AckPolicy::Explicit);
    assert_eq!(config.ack_wait, terms().lease);
    assert_eq!((config.max_deliver, config.max_ack_pending), (-1, -1));
}
