//! Blobs in the bucket of a real server.

#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the cluster share is not used here")]

use super::*;
use crate::nats::settings::BrokerSettings;
use clap::Parser;
use nats_server::NatsServer;
use object_store::{GetRange, ObjectStoreExt};

#[allow(clippy::duplicate_mod, reason = "the tests of the queue in a broker have it too")]
#[path = "../../../../../tests/cluster/nats_server.rs"]
mod nats_server;

async fn broker_of(server: &NatsServer) -> Broker {
    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        broker: BrokerSettings,
    }
    let flags = Flags::try_parse_from(["pixmesh", "--queue", &server.address()]).unwrap();
    Broker::connect(&flags.broker).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn blobs_are_kept_whole_read_in_parts_and_deleted_once() {
    let Some(program) = nats_server::program() else { return };
    let server = NatsServer::start(&program);
    let broker = broker_of(&server).await;
    let bucket = BrokerBucket::open(&broker).await.unwrap();
    let name = broker.stream_name("blobs-store");
    let stream = broker.context.get_stream(format!("OBJ_{name}")).await.unwrap();
    let config = &stream.cached_info().config;
    assert_eq!((config.storage, config.num_replicas), (StorageType::File, broker.replicas));
    assert!(config.description.is_some());

    let place = Path::from("blob");
    let bytes: Vec<u8> = (0..300_000_u32).map(|i| (i % 251) as u8).collect();
    let before = SystemTime::now();
    bucket.put(&place, bytes.clone().into()).await.unwrap();
    // Another node opens the same one.
    let other = BrokerBucket::open(&broker_of(&server).await).await.unwrap();
    for range in [0..300_000, 0..1, 1000..1001, 299_990..300_000, 130_000..270_000] {
        let part = other.get_range(&place, range.clone()).await.unwrap();
        assert_eq!(part, bytes[range.start as usize..range.end as usize]);
    }
    let get = |range| GetOptions { range: Some(range), ..GetOptions::default() };
    let last = other.get_opts(&place, get(GetRange::Suffix(7))).await.unwrap();
    assert_eq!(last.range, 299_993..300_000);
    let meta = other.head(&place).await.unwrap();
    assert_eq!((meta.size, meta.location), (300_000, place.clone()));
    let written = SystemTime::from(meta.last_modified);
    let second = Duration::from_secs(1);
    assert!(written >= before - second && written <= SystemTime::now() + second);

    bucket.delete(&place).await.unwrap();
    for missing in [
        other.delete(&Path::from("blob/never")).await.unwrap_err(),
        other.head(&place).await.unwrap_err(),
        other.get(&place).await.unwrap_err(),
        other.read("blob".into(), 0..1).await.map(|_| ()).unwrap_err(),
    ] {
        assert!(
            matches!(&missing, Error::NotFound { path, .. } if path.starts_with("blob")),
            "{missing}"
        );
    }
    assert!(bucket.copy(&place, &Path::from("other")).await.is_err());
    assert_eq!(format!("{bucket} {bucket:?}"), "JetStream JetStream");
}

/// A bucket, and a server that ends with it.
async fn bucket_of_a_server() -> Option<(NatsServer, Broker, BrokerBucket)> {
    let server = NatsServer::start(&nats_server::program()?);
    let broker = broker_of(&server).await;
    let bucket = BrokerBucket::open(&broker).await.unwrap();
    Some((server, broker, bucket))
}

/// Deletes the pieces of all blobs, as those of a copy are that is replaced while it is read.
async fn lose_pieces(broker: &Broker) {
    let name = broker.stream_name("blobs-store");
    let stream = broker.context.get_stream(format!("OBJ_{name}")).await.unwrap();
    stream.purge().filter(format!("$O.{name}.C.>")).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn whoever_reads_a_copy_that_is_replaced_or_deleted_waits_no_more_for_its_pieces() {
    let Some((_server, broker, bucket)) = bucket_of_a_server().await else { return };
    let place = Path::from("blob");
    for (is_replaced, begin) in [(true, 0), (true, 7), (false, 0), (false, 7)] {
        bucket.put(&place, vec![1; 1000].into()).await.unwrap();
        lose_pieces(&broker).await;
        let reading = tokio::spawn({
            let (bucket, place) = (bucket.clone(), place.clone());
            async move { bucket.get_range(&place, begin..1000).await }
        });
        tokio::time::sleep(3 * LOOK_AGAIN).await;
        assert!(!reading.is_finished(), "its pieces may still come");
        match is_replaced {
            true => drop(bucket.put(&place, vec![2; 1000].into()).await.unwrap()),
            false => bucket.delete(&place).await.unwrap(),
        }
        let read = timeout(Duration::from_secs(60), reading).await.expect("none will come");
        let error = read.unwrap().unwrap_err().to_string();
        assert!(error.contains("replaced"), "{error}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn whoever_wants_a_blob_reads_the_copy_that_replaces_the_one_begun() {
    let Some((_server, broker, bucket)) = bucket_of_a_server().await else { return };
    let bytes = Bytes::from_static(b"what was stored");
    let digest = pixmesh_engine::digest::Digest::of(&bytes);
    let place = crate::blobs::place(digest);
    bucket.put(&place, bytes.clone().into()).await.unwrap();
    let blobs = crate::blobs::Blobs::shared(&crate::blobs::BlobEngine::Broker, Some(&broker));
    let blobs = blobs.await.unwrap();
    lose_pieces(&broker).await;
    let reading = tokio::spawn(async move { blobs.get(digest).await });
    tokio::time::sleep(3 * LOOK_AGAIN).await;
    assert!(!reading.is_finished(), "its pieces may still come");
    bucket.put(&place, bytes.clone().into()).await.unwrap();
    let read = timeout(Duration::from_secs(60), reading).await.expect("it is there");
    assert_eq!(read.unwrap().unwrap(), bytes);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pieces_that_are_lost_are_not_waited_for_without_end() {
    let Some((_server, broker, bucket)) = bucket_of_a_server().await else { return };
    let bucket = BrokerBucket { most_looks: 3, ..bucket };
    let place = Path::from("blob");
    bucket.put(&place, vec![1; 1000].into()).await.unwrap();
    lose_pieces(&broker).await;
    for begin in [0, 7] {
        let begun = std::time::Instant::now();
        let read = timeout(Duration::from_secs(60), bucket.get_range(&place, begin..1000)).await;
        let error = read.expect("it is given up").unwrap_err().to_string();
        assert!(error.contains("lost"), "{error}");
        assert!(begun.elapsed() >= 3 * LOOK_AGAIN);
    }
}
