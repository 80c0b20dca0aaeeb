//! A database that hangs, is slow, full, out of connections, restarted, or replaced by its standby.

use crate::client::send;
use crate::cluster::Cluster;
use crate::ledger::{Ledger, Work};
use crate::node::Node;
use crate::pictures::{disc, noise};
use crate::proxy::Proxy;
use pixmesh_test_support::postgres::PostgresServer;
use std::fs::File;
use std::io::Write;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How soon nodes accept jobs after the database is back.
const ACCEPTED_AGAIN: Duration = Duration::from_secs(2);
/// How long a request waits for a database that does not answer, and a reserve for a busy machine.
const REFUSED_WITHIN: Duration = Duration::from_secs(8);
const LEASE: [&str; 2] = ["--job-lease", "5s"];
/// Work that takes milliseconds.
const SMALL: Work = Work { query: "size=40", picture: |n| disc(40 + n % 8, 40, 1) };

/// Submits one job, and returns how long it took until it was accepted.
fn accepted(ledger: &mut Ledger, node: &Node, number: usize) -> Duration {
    let began = Instant::now();
    ledger.submit(&[node], number..number + 1);
    began.elapsed()
}

#[test]
fn a_database_that_hangs_for_30_s_loses_nothing() {
    let cluster = Cluster::start();
    let proxy = Proxy::to(cluster.server.port);
    let node = cluster.serve_at(proxy.port, &LEASE);
    let _worker = cluster.work_at(proxy.port, &LEASE);
    let mut ledger = Ledger::of(SMALL);
    ledger.submit(&[&node], 0..10);
    proxy.hold();
    let held = Instant::now();
    let refused = node.submit("size=41", &[("Idempotency-Key", "key-10")], &disc(42, 40, 1));
    assert_eq!(refused.problem(503, "storage-unavailable")["setting"], "--queue");
    assert!(refused.took < REFUSED_WITHIN, "{:?}", refused.took);
    assert_eq!(node.operate("/readyz").status, 503);
    thread::sleep(Duration::from_secs(30).saturating_sub(held.elapsed()));
    proxy.pass();
    let took = accepted(&mut ledger, &node, 11);
    assert!(took < ACCEPTED_AGAIN, "{took:?}");
    ledger.submit(&[&node], 12..20);
    ledger.check(&node);
}

#[test]
fn nodes_accept_jobs_within_2_s_of_a_restart() {
    let mut cluster = Cluster::start();
    let node = cluster.serve(&LEASE);
    let worker = cluster.work(&LEASE);
    let mut ledger = Ledger::of(SMALL);
    for round in 0..4 {
        ledger.submit(&[&node], 10 * round..10 * round + 9);
        cluster.server.restart();
        let took = accepted(&mut ledger, &node, 10 * round + 9);
        assert!(took < ACCEPTED_AGAIN, "{took:?}");
    }
    ledger.check(&node);
    drop(worker);
}

#[test]
fn a_promoted_synchronous_standby_has_every_accepted_job() {
    let mut cluster = Cluster::start();
    let mut standby = cluster.server.synchronous_standby();
    let proxy = Proxy::to(cluster.server.port);
    let nodes = [cluster.serve_at(proxy.port, &LEASE), cluster.serve_at(proxy.port, &LEASE)];
    let _worker = cluster.work_at(proxy.port, &LEASE);
    let mut ledger = Ledger::of(SMALL);
    ledger.submit(&[&nodes[0], &nodes[1]], 0..30);
    cluster.server.kill();
    standby.promote();
    proxy.switch_to(standby.port);
    std::mem::swap(&mut cluster.server, &mut standby);
    let took = accepted(&mut ledger, &nodes[0], 30);
    assert!(took < ACCEPTED_AGAIN, "{took:?}");
    ledger.submit(&[&nodes[0], &nodes[1]], 31..40);
    ledger.check(&nodes[1]);
}

#[test]
fn a_slow_database_delays_jobs_and_loses_none() {
    let cluster = Cluster::start();
    let proxy = Proxy::to(cluster.server.port);
    let node = cluster.serve_at(proxy.port, &LEASE);
    let _worker = cluster.work_at(proxy.port, &LEASE);
    let mut ledger = Ledger::of(SMALL);
    proxy.delay(Duration::from_millis(100));
    ledger.submit(&[&node], 0..5);
    node.wait_until("one job is done", || ledger.ended(&node) > 0);
    proxy.delay(Duration::ZERO);
    ledger.check(&node);
    assert_eq!(ledger.attempts(&node), ledger.len());
}

#[test]
fn a_full_disk_of_the_database_refuses_jobs_until_there_is_room() {
    const MIB: u32 = 128;
    let server = PostgresServer::start_on_disk(MIB, &["max_wal_size=8MB", "min_wal_size=2MB"]);
    let mut cluster = Cluster { server, blobs: TempDir::new().unwrap() };
    let node = cluster.serve(&LEASE);
    let worker = cluster.work(&LEASE);
    let mut ledger = Ledger::of(SMALL);
    ledger.submit(&[&node], 0..5);
    let ballast = cluster.server.folder().join("ballast");
    let fill = |bytes: u64| File::create(&ballast).unwrap().write_all(&vec![1; bytes as usize]);
    // As much as there is room for.
    assert!(fill(u64::from(MIB) << 20).is_err());
    let mut number = 5;
    let refused = loop {
        let answer = ledger.submit_once(&node, number).unwrap();
        if answer.status != 202 {
            break answer;
        }
        number += 1;
        assert!(number < 5000, "the disk does not fill up");
    };
    match refused.status {
        507 => refused.problem(507, "storage-full"),
        _ => refused.problem(503, "storage-unavailable"),
    };
    assert!(!refused.header("retry-after").is_empty());
    let direct = send(node.public, "POST", "/v1/meshes?size=40", &[], &disc(40, 40, 1));
    assert_eq!(direct.status, 200, "requests without a job need no database");
    // Longer than a lease.
    thread::sleep(Duration::from_secs(8));
    std::fs::remove_file(&ballast).unwrap();
    // A server that cannot write its log ends.
    if !cluster.server.is_running() {
        cluster.server.restart();
    }
    ledger.submit(&[&node], number..number + 5);
    ledger.check(&node);
    drop(worker);
}

/// A dump that was made while jobs were waiting and running, and a copy of the blobs that was made
/// after it.
#[test]
fn a_restored_database_has_every_mesh_and_continues_every_job() {
    let cluster = Cluster::start();
    let node = cluster.serve(&LEASE);
    let worker = cluster.work(&LEASE);
    let small = disc(40, 40, 1);
    let done = node.job("size=40", &small);
    node.wait_for(&done, "completed");
    let mesh = node.get(&format!("{done}/mesh"));
    let running = node.job("method=mgpr&density=1", &noise(300));
    node.wait_for(&running, "running");
    worker.pause();
    let waiting = node.job("size=41", &small);
    let dump = cluster.server.dump();
    let blobs = TempDir::new().unwrap();
    let mut copy = Command::new("cp");
    copy.arg("-a").arg(cluster.blobs.path().join(".")).arg(blobs.path());
    assert!(copy.status().unwrap().success());
    drop((node, worker, cluster));
    let server = PostgresServer::start(&[]);
    server.restore(&dump);
    let cluster = Cluster { server, blobs };
    let node = cluster.serve(&LEASE);
    assert_eq!(node.get(&format!("{done}/mesh")).body, mesh.body);
    assert_eq!(node.get(&waiting).json()["state"], "queued");
    let _worker = cluster.work(&LEASE);
    node.wait_for(&waiting, "completed");
    assert_eq!(node.wait_for(&running, "completed")["attempt"], 2);
    assert_eq!(node.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 3);
}

#[test]
fn a_database_without_free_connections_serves_with_those_that_nodes_have() {
    let cluster = Cluster::start_with(&["max_connections=12"]);
    let node = cluster.serve(&LEASE);
    let _worker = cluster.work(&LEASE);
    let mut ledger = Ledger::of(SMALL);
    ledger.submit(&[&node], 0..1);
    // More sessions than there are connections; those that get none end.
    let mut others: Vec<_> = (0..12)
        .map(|_| cluster.server.psql("SELECT pg_sleep(600)").stderr(Stdio::null()).spawn().unwrap())
        .collect();
    thread::sleep(Duration::from_secs(1));
    assert!(others.iter_mut().any(|other| other.try_wait().unwrap().is_some()), "all connected");
    ledger.submit(&[&node], 1..20);
    for mut other in others {
        let _ = other.kill();
        let _ = other.wait();
    }
    ledger.check(&node);
}
