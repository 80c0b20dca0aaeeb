//! Blobs in the bucket of a real server.

#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the cluster share is not used here")]

use super::*;
use crate::config::BrokerSettings;
use clap::Parser;
use nats_server::NatsServer;
use object_store::{GetRange, ObjectStoreExt};

#[allow(clippy::duplicate_mod, reason = "the tests of the queue in a broker have it too")]
#[path = "../../../../tests/cluster/nats_server.rs"]
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
