//! What fails, and what becomes of the jobs that were accepted: a ledger that the client keeps tells.

use crate::client::try_send;
use crate::ledger::{Ledger, SECOND, Work};
use crate::nats_server::{NatsServer, program};
use crate::node::{self, Node};
use crate::pictures::{disc, noise};
use crate::proxy::{Cut, Proxy};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// A lease in tests: short, and longer than a busy machine keeps a worker from renewing it.
const LEASE: Duration = Duration::from_secs(5);
const SHORT_LEASE: [&str; 2] = ["--job-lease", "5s"];
/// The lease where none is set: servers elect a leader within seconds, whatever the lease.
const DEFAULT_LEASE: Duration = Duration::from_secs(30);
/// How much longer than a lease a job may wait for another worker.
const RECOVERY: Duration = Duration::from_secs(5);

#[test]
fn a_killed_workers_job_is_another_workers_within_the_lease_and_five_seconds() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let queue = broker.address();
    let node = Node::serve(&queue, &SHORT_LEASE);
    let mut worker = Node::work(&queue, &SHORT_LEASE);
    let job = node.job("method=mgpr&density=1", &noise(500));
    node.wait_for(&job, "running");
    // It must not be done before there is another to take it.
    worker.pause();
    let silent = Instant::now();
    let _other = Node::work(&queue, &SHORT_LEASE);
    worker.kill();
    node.wait_until("another has it", || node.get(&job).json()["attempt"] == 2);
    assert!(silent.elapsed() < LEASE + RECOVERY, "{:?}", silent.elapsed());
}

#[test]
fn nothing_is_lost_or_doubled_when_workers_and_the_broker_are_killed() {
    let Some(program) = program() else { return };
    let mut broker = NatsServer::start(&program);
    let queue = broker.address();
    let nodes = [Node::serve(&queue, &SHORT_LEASE), Node::serve(&queue, &SHORT_LEASE)];
    let nodes_ref = [&nodes[0], &nodes[1]];
    let mut workers = [Node::work(&queue, &SHORT_LEASE), Node::work(&queue, &SHORT_LEASE)];
    let mut ledger = Ledger::default();
    ledger.submit(&nodes_ref, 0..10);
    workers[0].kill();
    workers[0] = Node::work(&queue, &SHORT_LEASE);
    ledger.submit(&nodes_ref, 10..20);
    for worker in &mut workers {
        worker.kill();
    }
    broker.kill();
    nodes[0].wait_until("it says so", || nodes[0].log().contains("to the broker is lost"));
    let refused = nodes[0].submit("size=40", &[], &disc(40, 40, 1));
    refused.problem(503, "storage-unavailable");
    assert_eq!(nodes[0].operate("/readyz").status, 503);
    assert_eq!(nodes[0].operate("/livez").status, 200);
    broker.restart();
    ledger.submit(&nodes_ref, 20..30);
    let workers = [Node::work(&queue, &SHORT_LEASE), Node::work(&queue, &SHORT_LEASE)];
    ledger.check(&nodes[1]);
    assert_eq!(ledger.len(), 30);
    drop(workers);
}

#[test]
fn a_worker_that_was_cut_off_longer_than_its_lease_changes_nothing_when_it_is_back() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let (queue, wire) = (broker.address(), Proxy::to(broker.port));
    let node = Node::serve(&queue, &SHORT_LEASE);
    let cut_off = Node::work(&wire.address(), &SHORT_LEASE);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..6);
    node.wait_until("it has begun", || ledger.ended(&node) > 0);
    wire.cut();
    let other = Node::work(&queue, &SHORT_LEASE);
    other.wait_until("the other has done all", || ledger.ended(&node) == ledger.len());
    wire.mend();
    thread::sleep(Duration::from_secs(2));
    ledger.check(&node);
    let done = cut_off.completions() + other.completions();
    assert_eq!(done, ledger.len(), "each once\n{}\n{}", cut_off.log(), other.log());
}

/// The end that the first of them writes is held up on its way until the second has written another.
#[test]
fn two_workers_that_end_one_job_have_one_effect() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let (queue, wire) = (broker.address(), Proxy::to(broker.port));
    let node = Node::serve(&queue, &SHORT_LEASE);
    let first = Node::work(&wire.address(), &SHORT_LEASE);
    wire.cut_at("\"state\":\"completed\"", Cut::Before);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..1);
    first.wait_until("it has ended the job", || wire.was_cut());
    let cut = Instant::now();
    let second = Node::work(&queue, &SHORT_LEASE);
    node.wait_until("the second has it", || ledger.attempts(&node) == 2);
    assert!(cut.elapsed() < LEASE + RECOVERY, "{:?}", cut.elapsed());
    node.wait_until("the second has ended it", || ledger.ended(&node) == 1);
    wire.mend();
    first.wait_until("the first has heard", || first.log().contains("lease lost"));
    ledger.check(&node);
    assert_eq!((first.completions(), second.completions()), (0, 1));
    assert_eq!(ledger.attempts(&node), 2);
}

#[test]
fn a_broker_that_is_full_is_said_to_be_and_keeps_what_it_accepted() {
    const NOISES: Work = Work { query: "size=40", picture: |n| noise(300 + n) };
    let room = |megabytes: usize| {
        format!(
            "jetstream {{ sync_interval: always, store_dir: \"STORE\", \
             max_file_store: {megabytes}MB }}"
        )
    };
    let Some(program) = program() else { return };
    let mut broker = NatsServer::start_with(&program, &room(2));
    let node = Node::serve(&broker.address(), &SHORT_LEASE);
    let mut ledger = Ledger::of(NOISES);
    let refused = (0..64).find_map(|n| {
        let answer = ledger.submit_once(&node, n).unwrap();
        (answer.status != 202).then_some((n, answer))
    });
    let (number, answer) = refused.expect("2 MB hold 64 pictures of 90 kB");
    assert!(matches!(answer.status, 503 | 507), "{}", answer.text());
    assert!(answer.text().contains("storage"), "{}", answer.text());
    assert_eq!(node.operate("/livez").status, 200);
    // With more room everything that was accepted is done, and what was refused is taken.
    broker.restart_with(&room(64));
    let _worker = Node::work(&broker.address(), &SHORT_LEASE);
    ledger.submit(&[&node], number..number + 1);
    ledger.check(&node);
    assert_eq!(ledger.len(), number + 1);
}

/// Where a node is killed that takes a job in: by what it is about to send to the broker, or has
/// sent to it.
const PLACES: [(&str, Cut); 5] = [
    ("PUB pixmesh.free.", Cut::Before),
    ("PUB pixmesh.word.", Cut::Before),
    ("PUB pixmesh.job.", Cut::Before),
    ("PUB pixmesh.work.", Cut::Before),
    ("PUB pixmesh.work.", Cut::After),
];

/// With a word, whatever the node had come to: before the picture, between picture, word, record and
/// message, and before the answer.
#[test]
fn a_submission_whose_node_is_killed_anywhere_is_one_job_when_it_is_sent_again() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let queue = broker.address();
    let other = Node::serve(&queue, &SHORT_LEASE);
    let mut ledger = Ledger::default();
    for (n, (message, side)) in PLACES.into_iter().enumerate() {
        let wire = Proxy::to(broker.port);
        let mut node = Node::serve(&wire.address(), &SHORT_LEASE);
        ledger.submit(&[&node], 2 * n..2 * n + 1);
        wire.cut_at(message, side);
        let address = node.public;
        let submission = thread::spawn(move || Ledger::attempt(SECOND, address, 2 * n + 1));
        node.wait_until(&format!("{side:?} {message}"), || wire.was_cut());
        node.kill();
        assert!(submission.join().unwrap().is_none(), "{side:?} {message}");
        ledger.submit(&[&other], 2 * n + 1..2 * n + 2);
    }
    let _worker = Node::work(&queue, &SHORT_LEASE);
    ledger.check(&other);
    assert_eq!(ledger.len(), 2 * PLACES.len());
}

/// Without a word nobody comes again: what was acknowledged stays, and nothing else.
#[test]
fn a_picture_whose_node_was_killed_before_its_record_is_swept() {
    let (Some(program), Some(clocks)) = (program(), clock_library()) else { return };
    let broker = NatsServer::start(&program);
    let queue = broker.address();
    let folder = std::env::temp_dir().join(format!("pixmesh-orphans-{}", std::process::id()));
    let blobs = format!("file://{}", folder.display());
    let flags = ["--blobs", &blobs, "--job-lease", "5s"];
    let wire = Proxy::to(broker.port);
    let mut node = Node::serve(&wire.address(), &flags);
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..1);
    wire.cut_at("PUB pixmesh.job.", Cut::Before);
    let address = node.public;
    let submission =
        thread::spawn(move || try_send(address, "POST", "/v1/jobs?size=9", &[], &noise(99)));
    node.wait_until("the record is on its way", || wire.was_cut());
    assert_eq!(stored(&folder), 2, "both pictures are stored");
    node.kill();
    assert!(submission.join().unwrap().is_none());
    // A blob may be on its way to a job for an hour: that time is over by the clock of the next.
    let mut later = node::program();
    later.env("LD_PRELOAD", clocks).env("FAKETIME", "+2h").env("DONT_FAKE_MONOTONIC", "1");
    let later = Node::serve_with(later, &queue, &flags);
    later.wait_until("the picture of no job is gone", || stored(&folder) == 1);
    let _worker = Node::work(&queue, &flags);
    ledger.check(&later);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// How many blobs are in a folder.
fn stored(folder: &Path) -> usize {
    let shelves = folder.read_dir().unwrap().map(|shelf| shelf.unwrap().path());
    shelves.filter(|path| path.is_dir()).map(|shelf| shelf.read_dir().unwrap().count()).sum()
}

/// What lets a process have another time, where Debian's package `faketime` has it.
fn clock_library() -> Option<PathBuf> {
    let folders = ["/usr/lib/x86_64-linux-gnu/faketime", "/usr/lib/aarch64-linux-gnu/faketime"];
    let paths = folders.iter().map(|folder| Path::new(folder).join("libfaketime.so.1"));
    let found = paths.into_iter().find(|path| path.exists());
    if found.is_none() {
        assert!(std::env::var_os("PIXMESH_REQUIRE_TOOLS").is_none(), "libfaketime is missing");
        eprintln!("left out: there is no libfaketime; ./test installs it");
    }
    found
}

/// A cluster of three: everything on a majority of them.
#[test]
fn nothing_is_lost_when_the_leader_of_the_stream_is_killed() {
    let Some(program) = program() else { return };
    let mut servers = NatsServer::start_cluster(&program);
    let queue: Vec<String> = servers.iter().map(NatsServer::address).collect();
    let queue = queue.join(",");
    let node = Node::serve(&queue, &SHORT_LEASE);
    let workers = [Node::work(&queue, &SHORT_LEASE), Node::work(&queue, &SHORT_LEASE)];
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..10);
    let leader = leader_of_work(&queue);
    servers[leader].kill();
    let killed = Instant::now();
    ledger.submit(&[&node], 10..11);
    assert!(killed.elapsed() < DEFAULT_LEASE + RECOVERY, "{:?}", killed.elapsed());
    ledger.submit(&[&node], 11..20);
    ledger.check(&node);
    servers[leader].restart();
    ledger.submit(&[&node], 20..25);
    ledger.check(&node);
    drop(workers);
}

/// Which server leads the stream of work.
fn leader_of_work(queue: &str) -> usize {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let leader = runtime.block_on(async {
        let servers: Vec<async_nats::ServerAddr> =
            queue.split(',').map(|address| address.parse().unwrap()).collect();
        let client = async_nats::connect(servers).await.unwrap();
        let stream = async_nats::jetstream::new(client).get_stream("pixmesh-work").await.unwrap();
        let cluster = stream.cached_info().cluster.clone().unwrap();
        assert_eq!(cluster.replicas.len(), 2, "three copies");
        cluster.leader.unwrap()
    });
    leader.strip_prefix('n').unwrap().parse().unwrap()
}
