//! Where many nodes keep pictures and meshes.

use crate::emulator::{S3Emulator, with_store_at};
use crate::ledger::Ledger;
use crate::nats_server::{NatsServer, program};
use crate::node::{self, Node};
use crate::pictures::disc;
use crate::proxy::Proxy;
use std::thread;
use std::time::Duration;

#[test]
fn a_folder_that_all_nodes_have_keeps_blobs() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let folder = std::env::temp_dir().join(format!("pixmesh-shared-{}", std::process::id()));
    let blobs = format!("file://{}", folder.display());
    let flags = ["--blobs", blobs.as_str()];
    let node = Node::serve(&broker.address(), &flags);
    let _worker = Node::work(&broker.address(), &flags);
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
    assert_eq!(node.get(&format!("{job}/mesh")).status, 200);
    assert!(folder.read_dir().unwrap().count() > 0);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Against an emulator of the S3 protocol, in whole and in part.
#[test]
fn an_s3_bucket_keeps_blobs_and_its_failures_are_said_so() {
    let (Some(program), Some(mut store)) = (program(), S3Emulator::start()) else { return };
    let broker = NatsServer::start(&program);
    let wire = Proxy::to(store.port);
    let command = || with_store_at(node::program(), wire.port);
    let flags = ["--blobs", "s3://pixmesh/jobs"];
    let node = Node::serve_with(command(), &broker.address(), &flags);
    let _worker = Node::work_with(command(), &broker.address(), &flags);
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

/// The store's wire breaks while jobs wait and run, for longer than a lease: no attempt is lost to it.
#[test]
fn a_store_that_is_slow_and_then_down_loses_no_job_and_no_attempt() {
    const LEASE: [&str; 4] = ["--blobs", "s3://pixmesh", "--job-lease", "5s"];
    let (Some(program), Some(store)) = (program(), S3Emulator::start()) else { return };
    let broker = NatsServer::start(&program);
    let wire = Proxy::to(store.port);
    let command = || with_store_at(node::program(), wire.port);
    let node = Node::serve_with(command(), &broker.address(), &LEASE);
    let workers = [(); 2].map(|()| Node::work_with(command(), &broker.address(), &LEASE));
    let mut ledger = Ledger::default();
    wire.delay(Duration::from_millis(200));
    ledger.submit(&[&node], 0..4);
    node.wait_until("one is done", || ledger.ended(&node) > 0);
    wire.delay(Duration::ZERO);
    ledger.submit(&[&node], 4..10);
    wire.break_off();
    let refused = node.submit("size=52", &[], &disc(52, 50, 1));
    assert_eq!(refused.problem(503, "storage-unavailable")["setting"], "--blobs");
    thread::sleep(Duration::from_secs(10));
    wire.mend();
    ledger.submit(&[&node], 10..12);
    ledger.check(&node);
    assert_eq!(ledger.attempts(&node), ledger.len());
    drop(workers);
}
