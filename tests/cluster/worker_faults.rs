//! Workers and nodes that fail. A ledger of the client's says what must become of each accepted job.

use crate::client::try_send;
use crate::cluster::Cluster;
use crate::ledger::{Ledger, SECOND};
use crate::pictures::{disc, noise};
use crate::proxy::{Hold, Proxy};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// Shorter than the default, and longer than a busy machine delays a renewal.
const LEASE: Duration = Duration::from_secs(5);
const SHORT_LEASE: [&str; 2] = ["--job-lease", "5s"];
/// How much longer than a lease a job may wait for another worker.
const RECOVERY: Duration = Duration::from_secs(5);

#[test]
fn another_worker_takes_the_job_of_a_killed_one_in_time() {
    let cluster = Cluster::start();
    let node = cluster.serve(&SHORT_LEASE);
    let mut worker = cluster.work(&SHORT_LEASE);
    let job = node.job("method=mgpr&density=1", &noise(500));
    node.wait_for(&job, "running");
    // The paused worker cannot complete the job before there is another.
    worker.pause();
    let paused = Instant::now();
    let _other = cluster.work(&SHORT_LEASE);
    worker.kill();
    node.wait_until("another worker has it", || node.get(&job).json()["attempt"] == 2);
    assert!(paused.elapsed() < LEASE + RECOVERY, "{:?}", paused.elapsed());
}

#[test]
fn a_worker_that_resumes_after_its_lease_changes_nothing() {
    let cluster = Cluster::start();
    let node = cluster.serve(&SHORT_LEASE);
    let paused = cluster.work(&SHORT_LEASE);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..6);
    node.wait_until("one job is done", || ledger.ended(&node) > 0);
    paused.pause();
    let other = cluster.work(&SHORT_LEASE);
    other.wait_until("the other has done all", || ledger.ended(&node) == ledger.len());
    paused.resume();
    thread::sleep(Duration::from_secs(2));
    ledger.check(&node);
    let done = paused.completions() + other.completions();
    assert_eq!(done, ledger.len(), "each once\n{}\n{}", paused.log(), other.log());
}

#[test]
fn a_worker_without_network_for_longer_than_its_lease_changes_nothing() {
    let cluster = Cluster::start();
    let proxy = Proxy::to(cluster.server.port);
    let node = cluster.serve(&SHORT_LEASE);
    let cut_off = cluster.work_at(proxy.port, &SHORT_LEASE);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..6);
    node.wait_until("one job is done", || ledger.ended(&node) > 0);
    proxy.hold();
    let other = cluster.work(&SHORT_LEASE);
    other.wait_until("the other has done all", || ledger.ended(&node) == ledger.len());
    proxy.pass();
    thread::sleep(Duration::from_secs(2));
    ledger.check(&node);
    let done = cut_off.completions() + other.completions();
    assert_eq!(done, ledger.len(), "each once\n{}\n{}", cut_off.log(), other.log());
}

/// The proxy holds the completion by the first worker until the second has completed the job.
#[test]
fn of_two_workers_that_complete_one_job_the_fence_accepts_one() {
    let cluster = Cluster::start();
    let proxy = Proxy::to(cluster.server.port);
    let node = cluster.serve(&SHORT_LEASE);
    let first = cluster.work_at(proxy.port, &SHORT_LEASE);
    proxy.hold_at(&["SET state = new.state"], Hold::Request);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..1);
    first.wait_until("the first sends its completion", || proxy.is_triggered());
    let held = Instant::now();
    let second = cluster.work(&SHORT_LEASE);
    node.wait_until("the second has it", || ledger.attempts(&node) == 2);
    assert!(held.elapsed() < LEASE + RECOVERY, "{:?}", held.elapsed());
    node.wait_until("the second has completed it", || ledger.ended(&node) == 1);
    proxy.pass();
    first.wait_until("the first knows", || first.log().contains("lease lost"));
    ledger.check(&node);
    assert_eq!((first.completions(), second.completions()), (0, 1));
    assert_eq!(ledger.attempts(&node), 2);
}

/// Points at which a node is killed during a submission: before the picture is stored, before the
/// job is inserted, before its commit, and after its commit.
const KILLED_AT: [(&[&str], Hold); 4] = [
    (&["unnest($1::bytea[])"], Hold::Request),
    (&["INSERT INTO jobs"], Hold::Request),
    (&["INSERT INTO jobs", "COMMIT"], Hold::Request),
    (&["INSERT INTO jobs", "COMMIT"], Hold::Answer),
];

#[test]
fn a_repeated_submission_to_another_node_is_one_job_wherever_the_first_node_was_killed() {
    let cluster = Cluster::start();
    let other = cluster.serve(&SHORT_LEASE);
    let mut ledger = Ledger::default();
    for (n, (texts, hold)) in KILLED_AT.into_iter().enumerate() {
        let proxy = Proxy::to(cluster.server.port);
        let mut node = cluster.serve_at(proxy.port, &SHORT_LEASE);
        proxy.hold_at(texts, hold);
        let address = node.public;
        let submission = thread::spawn(move || Ledger::attempt(SECOND, address, n));
        node.wait_until(&format!("{texts:?} {hold:?}"), || proxy.is_triggered());
        node.kill();
        assert!(submission.join().unwrap().is_none(), "{texts:?} {hold:?}");
        proxy.refuse();
        ledger.submit(&[&other], n..n + 1);
    }
    let _worker = cluster.work(&SHORT_LEASE);
    ledger.check(&other);
    assert_eq!(ledger.len(), KILLED_AT.len());
}

#[test]
fn a_picture_without_a_job_is_deleted_after_an_hour() {
    let cluster = Cluster::start();
    let other = cluster.serve(&[]);
    let mut ledger = Ledger::default();
    ledger.submit(&[&other], 0..1);
    let proxy = Proxy::to(cluster.server.port);
    let mut node = cluster.serve_at(proxy.port, &[]);
    proxy.hold_at(&["INSERT INTO jobs"], Hold::Request);
    let address = node.public;
    let submission =
        thread::spawn(move || try_send(address, "POST", "/v1/jobs?size=9", &[], &noise(99)));
    node.wait_until("the node inserts the job", || proxy.is_triggered());
    assert_eq!(blobs(cluster.blobs.path()).len(), 2, "both pictures are stored");
    node.kill();
    assert!(submission.join().unwrap().is_none());
    // The test dates back the marks instead of waiting for two hours.
    let earlier = "eligible_at = eligible_at - interval '2 hours'";
    cluster.server.run_sql(&format!("UPDATE pixmesh.orphan_candidates SET {earlier}"));
    other
        .wait_until("the picture without a job is gone", || blobs(cluster.blobs.path()).len() == 1);
    let _worker = cluster.work(&[]);
    ledger.check(&other);
}

/// The files of all blobs.
fn blobs(folder: &Path) -> Vec<PathBuf> {
    let folders = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
    let folders = folders.filter(|path| path.is_dir());
    folders.flat_map(|path| path.read_dir().unwrap().map(|file| file.unwrap().path())).collect()
}

#[test]
fn nothing_is_lost_when_nodes_workers_and_the_database_are_killed() {
    let mut cluster = Cluster::start();
    let nodes = [cluster.serve(&SHORT_LEASE), cluster.serve(&SHORT_LEASE)];
    let mut workers = [cluster.work(&SHORT_LEASE), cluster.work(&SHORT_LEASE)];
    let mut ledger = Ledger::default();
    ledger.submit(&[&nodes[0], &nodes[1]], 0..10);
    workers[0].kill();
    workers[0] = cluster.work(&SHORT_LEASE);
    ledger.submit(&[&nodes[0], &nodes[1]], 10..20);
    for worker in &mut workers {
        worker.kill();
    }
    cluster.server.kill();
    let refused = nodes[0].submit("size=40", &[], &disc(40, 40, 1));
    refused.problem(503, "storage-unavailable");
    assert_eq!(nodes[0].operate("/readyz").status, 503);
    assert_eq!(nodes[0].operate("/livez").status, 200);
    cluster.server.restart();
    let [mut killed, node] = nodes;
    killed.kill();
    let killed = cluster.serve(&SHORT_LEASE);
    ledger.submit(&[&node, &killed], 20..30);
    let workers = [cluster.work(&SHORT_LEASE), cluster.work(&SHORT_LEASE)];
    ledger.check(&node);
    assert_eq!(ledger.len(), 30);
    drop(workers);
}
