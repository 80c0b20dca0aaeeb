//! What fails, and what becomes of the jobs that were accepted: a ledger that the client keeps tells.

use crate::ledger::Ledger;
use crate::nats_server::{NatsServer, free_port, program};
use crate::node::Node;
use crate::pictures::{disc, noise};
use crate::proxy::Proxy;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// A lease in tests: short, and longer than a busy machine keeps a worker from renewing it.
const LEASE: Duration = Duration::from_secs(5);
const SHORT_LEASE: [&str; 2] = ["--job-lease", "5s"];
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
    let _other = Node::work(&queue, &SHORT_LEASE);
    worker.kill();
    let killed = Instant::now();
    node.wait_until("another has it", || node.get(&job).json()["attempt"] == 2);
    assert!(killed.elapsed() < LEASE + RECOVERY, "{:?}", killed.elapsed());
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
    let cut_off = Node::work(&format!("nats://127.0.0.1:{}", wire.port), &SHORT_LEASE);
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

#[test]
fn a_broker_that_is_full_is_said_to_be() {
    let Some(program) = program() else { return };
    let broker =
        NatsServer::start_with(&program, "jetstream { store_dir: \"STORE\", max_file_store: 2MB }");
    let node = Node::serve(&broker.address(), &[]);
    let mut status = 202;
    for n in 0..64 {
        let answer = node.submit("size=40", &[], &noise(300 + n));
        status = answer.status;
        if status != 202 {
            assert!(matches!(status, 503 | 507), "{}", answer.text());
            assert!(answer.text().contains("storage"), "{}", answer.text());
            break;
        }
    }
    assert_ne!(status, 202, "2 MB hold 64 pictures of 90 kB");
    assert_eq!(node.operate("/livez").status, 200);
}

/// A cluster of three: everything on a majority of them.
#[test]
fn nothing_is_lost_when_the_leader_of_the_stream_is_killed() {
    let Some(program) = program() else { return };
    let mut servers = cluster(&program);
    let queue: Vec<String> = servers.iter().map(NatsServer::address).collect();
    let queue = queue.join(",");
    let node = Node::serve(&queue, &SHORT_LEASE);
    let workers = [Node::work(&queue, &SHORT_LEASE), Node::work(&queue, &SHORT_LEASE)];
    let mut ledger = Ledger::default();
    ledger.submit(&[&node], 0..10);
    let leader = leader_of_work(&queue);
    servers[leader].kill();
    ledger.submit(&[&node], 10..20);
    ledger.check(&node);
    servers[leader].restart();
    ledger.submit(&[&node], 20..25);
    ledger.check(&node);
    drop(workers);
}

/// Three servers that know each other.
fn cluster(program: &Path) -> Vec<NatsServer> {
    let routes: [u16; 3] = std::array::from_fn(|_| free_port());
    let others = routes.map(|port| format!("nats://127.0.0.1:{port}")).join(", ");
    let start = |n: usize| {
        let configuration = format!(
            "server_name: n{n}\njetstream {{ sync_interval: always, store_dir: \"STORE\" }}\n\
             cluster {{ name: pixmesh, listen: \"127.0.0.1:{}\", routes: [{others}] }}",
            routes[n]
        );
        NatsServer::start_with(program, &configuration)
    };
    (0..3).map(start).collect()
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
