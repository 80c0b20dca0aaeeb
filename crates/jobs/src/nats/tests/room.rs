//! What there is no room for.

use super::*;
use async_nats::jetstream::stream::Config;

/// A queue whose stream of work takes less than the terms ask for.
async fn cramped(engine: &InServers, cramp: impl FnOnce(&mut Config)) -> Nats {
    let queue = opened(engine).await;
    let mut config = queue.streams.work.stream().get_info().await.unwrap().config;
    cramp(&mut config);
    queue.broker.context.update_stream(config).await.unwrap();
    queue
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_of_work_that_takes_no_more_messages_is_a_full_queue() {
    let Some(engine) = engine("full-stream") else { return };
    let queue = cramped(&engine, |config| config.max_messages = 1).await;
    let (kept, refused) = (job("kept", None), job("refused", Some("word")));
    let created = queue.submit(kept.clone()).await.unwrap();
    assert!(matches!(created, Submitted::Created(_)), "{created:?}");
    let full = queue.submit(refused.clone()).await.unwrap();
    assert_eq!(full, Submitted::QueueFull { limit: terms().caps.queued });
    assert_eq!(queue.get(&refused.owner, refused.id).await.unwrap(), Lookup::Unknown);
    let blobs = vec![kept.picture.digest, refused.picture.digest];
    assert_eq!(queue.referenced(blobs).await.unwrap(), [kept.picture.digest].into());
    assert_eq!(queue.sweep().await.unwrap().given_up, [refused.picture.digest]);
    // Its word is free: it is as good as never submitted.
    assert_eq!(claimed(&queue).await.lease.job, kept.id);
    assert!(queue.streams.words.names("word.*").await.unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_of_work_that_takes_no_more_bytes_is_a_full_broker() {
    let Some(engine) = engine("full-bytes") else { return };
    let queue = cramped(&engine, |config| config.max_bytes = 1).await;
    let error = queue.submit(job("image", None)).await.unwrap_err();
    assert!(matches!(error, QueueError::BrokerFull(_)), "{error}");
}

/// A consumer hears of a job a moment after its submission; who submits on within it is counted all the
/// same.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_owner_is_quick_enough_to_have_one_more_waiting_than_may() {
    let Some(engine) = engine("quick") else { return };
    let caps = crate::fairness::Caps { queued_per_owner: 1, ..terms().caps };
    let queue = Nats::open(engine.broker().await, Terms { caps, ..terms() }).await.unwrap();
    for name in (0..50).map(|n| format!("owner {n}")) {
        let own = || NewJob { owner: Owner::named(&name), ..job(&name, None) };
        let first = queue.submit(own()).await.unwrap();
        assert!(matches!(first, Submitted::Created(_)), "{first:?}");
        assert_eq!(queue.submit(own()).await.unwrap(), Submitted::OwnerFull { limit: 1 }, "{name}");
    }
}
