//! What the broker's answers mean, and its silence.

use super::*;
use crate::nats::answers::server_code;
use async_nats::jetstream::consumer::pull::Config as ConsumerConfig;
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::Config;
use async_nats::jetstream::{ErrorCode, object_store};
use futures_util::FutureExt;
use futures_util::future::join_all;
use std::error::Error;
use std::time::Instant;
use table::Expected;

#[test]
fn the_causes_of_an_error_are_each_said_once() {
    #[derive(Debug)]
    struct Caused(&'static str, Option<Box<Caused>>);
    impl std::fmt::Display for Caused {
        fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            formatter.write_str(self.0)
        }
    }
    impl Error for Caused {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
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

/// What a server without a stream, without a consumer, or with others answers, as its client has it.
async fn refusals(broker: &Broker) -> Vec<(&'static str, Box<dyn Error>, ErrorCode)> {
    let context = &broker.context;
    let config =
        |name: &str| Config { name: name.into(), subjects: vec!["a".into()], ..Config::default() };
    let stream = context.create_stream(config("there")).await.unwrap();
    let consumer = |name: &str| ConsumerConfig {
        durable_name: Some(name.into()),
        ..ConsumerConfig::default()
    };
    let (deleted, orphan) = (
        stream.create_consumer(consumer("deleted")).await.unwrap(),
        stream.create_consumer(consumer("orphan")).await.unwrap(),
    );
    stream.delete_consumer("deleted").await.unwrap();
    let missing = context.get_stream_no_info("missing").await.unwrap();
    let bucket = object_store::Config {
        bucket: "bucket".into(),
        num_replicas: 3,
        ..object_store::Config::default()
    };
    let unexpected = PublishMessage::build().expected_last_sequence(7).outbound_message("a");
    let unexpected = context.publish_with_headers("a", unexpected.headers.unwrap(), Bytes::new());
    let no_stream = ErrorCode::STREAM_NOT_FOUND;
    macro_rules! refused {
        ($($what:literal, $asked:expr, $code:expr;)+) => {
            vec![$(($what, Box::new($asked.err().unwrap()) as Box<dyn Error>, $code)),+]
        };
    }
    let mut refused = refused! {
        "get", context.get_stream("missing").await, no_stream;
        "change", context.update_stream(config("missing")).await, no_stream;
        "make", context.create_stream(config("other")).await, ErrorCode::STREAM_SUBJECT_OVERLAP;
        "bucket", context.create_object_store(bucket).await, ErrorCode::STREAM_REPLICAS_NOT_SUPPORTED;
        "ask", missing.get_info().await, no_stream;
        "names", missing.info_with_subjects("a").await, no_stream;
        "read", missing.get_last_raw_message_by_subject("a").await, no_stream;
        "nothing", stream.get_last_raw_message_by_subject("a").await, ErrorCode::NO_MESSAGE_FOUND;
        "delete", missing.delete_message(1).await, no_stream;
        "remove", missing.purge().await, no_stream;
        "consumer", missing.create_consumer(consumer("new")).await, no_stream;
        "deleted", deleted.get_info().await, ErrorCode::CONSUMER_NOT_FOUND;
        "publish", unexpected.await.unwrap().await, ErrorCode::STREAM_WRONG_LAST_SEQUENCE;
    };
    context.delete_stream("there").await.unwrap();
    refused.extend(refused! { "orphan", orphan.get_info().await, no_stream; });
    refused
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_broker_that_refuses_is_not_one_that_does_not_answer() {
    let Some(engine) = engine("refusals") else { return };
    for (what, error, code) in refusals(&engine.broker().await).await {
        assert_eq!(server_code(&*error), Some(code), "{what}: {error:?}");
        let failure = failure(what, &*error);
        assert!(matches!(failure, QueueError::Broker(_)), "{what}: {failure}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_that_is_gone_already_is_deleted() {
    let Some(engine) = engine("gone") else { return };
    let queue = opened(&engine).await;
    let (jobs, name) = (&queue.streams.jobs, "job.o.a");
    let put = jobs.put(name, &(), Expected::Nothing).await.unwrap();
    let table::Put::Stored(version) = put else { panic!("{put:?}") };
    for _ in 0..2 {
        jobs.delete(name, version).await.unwrap();
        assert!(!jobs.has(name).await.unwrap());
    }
    // One that is there since is another.
    jobs.put(name, &(), Expected::Nothing).await.unwrap();
    jobs.delete(name, version).await.unwrap();
    assert!(jobs.has(name).await.unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_that_may_not_be_deleted_is_an_error() {
    let Some(engine) = engine("sealed") else { return };
    let queue = opened(&engine).await;
    let (jobs, name) = (&queue.streams.jobs, "job.o.a");
    jobs.put(name, &(), Expected::Nothing).await.unwrap();
    let mut config = jobs.stream().get_info().await.unwrap().config;
    config.sealed = true;
    queue.broker.context.update_stream(config).await.unwrap();
    let error = jobs.take_away(name).await.unwrap_err();
    assert!(matches!(error, QueueError::Broker(_)), "{error}");
    assert!(jobs.has(name).await.unwrap());
}

/// That nothing is heard is neither that there is nothing, nor that somebody else was quicker.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_broker_that_is_gone_does_not_answer_is_an_error() {
    let Some(program) = nats_server::program() else { return };
    let mut server = NatsServer::start(&program);
    let broker = Broker::connect(&settings(&server.address(), &[])).await.unwrap();
    let queue = Nats::open(broker, terms()).await.unwrap();
    let job = job("image", None);
    let id = job.id;
    queue.submit(job).await.unwrap();
    assert!(queue.is_healthy());
    server.kill();
    let began = Instant::now();
    while queue.is_healthy() {
        assert!(began.elapsed() < Duration::from_secs(60), "nobody notices");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let (owner, table) = (Owner::Anonymous, &queue.streams.jobs);
    let asked = [
        queue.get(&owner, id).map(|found| found.map(drop)).boxed(),
        queue.claim().map(|claim| claim.map(drop)).boxed(),
        queue.stats().map(|stats| stats.map(drop)).boxed(),
        table.next("job.*.*", 1).map(|next| next.map(drop)).boxed(),
        table.names("job.*.*").map(|names| names.map(drop)).boxed(),
        table.put("job.o.a", &(), Expected::Nothing).map(|put| put.map(drop)).boxed(),
        table.remove("job.o.a").boxed(),
        table.delete("job.o.a", 1).boxed(),
    ];
    for (n, answer) in join_all(asked).await.into_iter().enumerate() {
        assert!(matches!(answer, Err(QueueError::Unreachable(_))), "{n}: {answer:?}");
    }
}
