//! The stores of pictures and meshes that many nodes share.

use crate::cluster::Cluster;
use crate::emulator::{Protocol, StoreEmulator};
use crate::ledger::Ledger;
use crate::node::{Node, program};
use crate::pictures::disc;
use crate::proxy::Proxy;
use std::thread;
use std::time::Duration;

#[test]
fn a_shared_folder_stores_blobs() {
    let cluster = Cluster::start();
    let (node, _worker) = (cluster.serve(&[]), cluster.work(&[]));
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
    assert_eq!(node.get(&format!("{job}/mesh")).status, 200);
    assert!(cluster.blobs.path().read_dir().unwrap().count() > 0);
}

#[test]
fn s3_stores_blobs_and_its_failure_is_503() {
    a_bucket_stores_blobs_and_its_failure_is_503(Protocol::S3);
}

#[test]
fn google_cloud_storage_stores_blobs_and_its_failure_is_503() {
    a_bucket_stores_blobs_and_its_failure_is_503(Protocol::Google);
}

#[test]
fn azure_stores_blobs_and_its_failure_is_503() {
    a_bucket_stores_blobs_and_its_failure_is_503(Protocol::Azure);
}

fn a_bucket_stores_blobs_and_its_failure_is_503(protocol: Protocol) {
    let (cluster, mut store) = (Cluster::start(), StoreEmulator::start(protocol));
    let command = || store.at_port(program(), store.port);
    let (bucket, queue) = (format!("{}/jobs", store.bucket()), cluster.server.url());
    let flags = ["--blobs", &bucket];
    let doctor = |bucket: &str| {
        let mut command = command();
        command.args(["doctor", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
        let output = command.args(["--queue", &queue, "--blobs", bucket]).output().unwrap();
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let found = doctor(&bucket);
    assert!(found.contains("ok    queue") && found.contains("ok    blobs"), "{found}");
    let other = bucket.replace("pixmesh", "missing");
    let found = doctor(&other);
    assert!(found.contains(&format!("BAD   blobs: --blobs {other}: an object cannot be written")));
    let node = Node::serve(command(), &queue, &flags);
    let _worker = Node::work(command(), &queue, &flags);
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
    let mesh = node.get(&format!("{job}/mesh"));
    assert_eq!(mesh.status, 200, "{}", mesh.text());
    let ranged = crate::client::send(
        node.public,
        "GET",
        &format!("{job}/mesh"),
        &[("Range", "bytes=2-9")],
        b"",
    );
    assert_eq!((ranged.status, ranged.body.as_slice()), (206, &mesh.body[2..10]));
    store.kill();
    let refused = node.submit("size=52", &[], &disc(52, 50, 1));
    let problem = refused.problem(503, "storage-unavailable");
    assert_eq!(problem["setting"], "--blobs", "{problem}");
    assert!(!refused.header("retry-after").is_empty());
}

/// The store is away while jobs are queued and running, for longer than a lease.
#[test]
fn a_store_that_is_slow_and_then_down_costs_no_job_and_no_attempt() {
    const LEASE: [&str; 4] = ["--blobs", "s3://pixmesh", "--job-lease", "5s"];
    let (cluster, store) = (Cluster::start(), StoreEmulator::start(Protocol::S3));
    let proxy = Proxy::to(store.port);
    let command = || store.at_port(program(), proxy.port);
    let node = Node::serve(command(), &cluster.server.url(), &LEASE);
    let workers = [(); 2].map(|()| Node::work(command(), &cluster.server.url(), &LEASE));
    let mut ledger = Ledger::default();
    proxy.delay(Duration::from_millis(200));
    ledger.submit(&[&node], 0..4);
    node.wait_until("one is done", || ledger.ended(&node) > 0);
    proxy.delay(Duration::ZERO);
    ledger.submit(&[&node], 4..10);
    proxy.refuse();
    let refused = node.submit("size=52", &[], &disc(52, 50, 1));
    assert_eq!(refused.problem(503, "storage-unavailable")["setting"], "--blobs");
    thread::sleep(Duration::from_secs(10));
    proxy.pass();
    ledger.submit(&[&node], 10..12);
    ledger.check(&node);
    assert_eq!(ledger.attempts(&node), ledger.len());
    drop(workers);
}
