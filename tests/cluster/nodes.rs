//! Two nodes that take requests and two workers, as clients see them.

use crate::client::send;
use crate::cluster::Cluster;
use crate::node::Node;
use crate::pictures::{disc, noise};
use crate::proxy::Proxy;
use std::thread;
use std::time::Duration;

/// Parameters with which noise takes seconds.
const SLOW: &str = "method=mgpr&density=1";
/// Nodes count jobs and share their mean duration at this interval; the rest is a reserve.
const STATS_INTERVAL: Duration = Duration::from_secs(6);

#[test]
fn every_node_answers_for_every_job() {
    let cluster = Cluster::start();
    let (one, other) = (cluster.serve(&[]), cluster.serve(&[]));
    let workers = [cluster.work(&[]), cluster.work(&[])];
    let image = disc(64, 48, 3);
    let job = one.job("method=mgprfs&size=60", &image);
    other.wait_for(&job, "completed");
    let mesh = other.get(&format!("{job}/mesh"));
    let direct = send(one.public, "POST", "/v1/meshes?method=mgprfs&size=60", &[], &image);
    assert_eq!(mesh.body, direct.body);
    assert_eq!(one.get(&format!("{job}/mesh")).body, direct.body);
    assert_eq!(other.get("/v1/jobs").json()["jobs"][0]["id"], job.rsplit('/').next().unwrap());
    let events = other.stream(&format!("{job}/events"));
    for state in ["queued", "running", "completed"] {
        assert!(events.contains(&format!("\"state\":\"{state}\"")), "{events}");
    }
    let done: usize = workers.iter().map(Node::completions).sum();
    assert_eq!(done, 1);
}

#[test]
fn an_idempotency_key_holds_on_all_nodes() {
    let cluster = Cluster::start();
    let nodes = [cluster.serve(&[]), cluster.serve(&[])];
    let image = disc(40, 40, 1);
    let headers = [("Idempotency-Key", "key")];
    let answers: Vec<_> = thread::scope(|scope| {
        let submit = |n: usize| nodes[n % 2].submit("size=40", &headers, &image);
        let tries: Vec<_> = (0..8).map(|n| scope.spawn(move || submit(n))).collect();
        tries.into_iter().map(|attempt| attempt.join().unwrap()).collect()
    });
    for answer in &answers {
        assert_eq!(answer.status, 202, "{}", answer.text());
        assert_eq!(answer.header("location"), answers[0].header("location"));
    }
    nodes[1].submit("size=41", &headers, &image).problem(422, "idempotency-key-reused");
    assert_eq!(nodes[0].get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 1);
}

#[test]
fn progress_and_cancellation_cross_nodes() {
    let cluster = Cluster::start();
    let (one, other) = (cluster.serve(&[]), cluster.serve(&[]));
    let worker = cluster.work(&[]);
    let job = one.job(SLOW, &noise(700));
    other.wait_for(&job, "running");
    other.wait_until("the other node shows progress", || {
        other.get(&job).json()["progress"]["stage"].is_string()
    });
    let cancelled = send(other.public, "DELETE", &job, &[], &[]);
    assert_eq!(cancelled.status, 202, "{}", cancelled.text());
    one.wait_for(&job, "cancelled");
    one.wait_until("the worker is free", || {
        let metrics = worker.operate("/metrics").text();
        metrics.lines().any(|line| line == "pixmesh_jobs_in_progress 0")
    });
    assert_eq!(send(one.public, "DELETE", &job, &[], &[]).status, 204);
    assert_eq!(other.get(&job).status, 404);
}

/// The seconds of queued work that a node reports.
fn queued_work_s(node: &Node) -> Option<f64> {
    let metrics = node.operate("/metrics").text();
    let line = metrics.lines().find_map(|l| l.strip_prefix("pixmesh_jobs_queued_work_seconds "))?;
    Some(line.parse().unwrap())
}

#[test]
fn nodes_poll_a_database_without_notifications() {
    let cluster = Cluster::start();
    let proxy = Proxy::to(cluster.server.port);
    proxy.replace("LISTEN", "LISTEX");
    proxy.replace("pg_notify", "pg_nobody");
    let (one, other) = (cluster.serve_at(proxy.port, &[]), cluster.serve_at(proxy.port, &[]));
    let worker = cluster.work_at(proxy.port, &[]);
    for node in [&one, &other, &worker] {
        assert!(node.log().contains("without LISTEN and NOTIFY"), "{}", node.log());
    }
    let job = one.job(SLOW, &noise(700));
    other.wait_for(&job, "running");
    assert_eq!(send(other.public, "DELETE", &job, &[], &[]).status, 202);
    one.wait_for(&job, "cancelled");
    let job = one.job("size=50", &disc(50, 50, 1));
    other.wait_for(&job, "completed");
    for node in [&one, &other, &worker] {
        assert_eq!(node.operate("/readyz").status, 200, "{}", node.log());
    }
}

#[test]
fn all_nodes_count_queued_jobs_and_refuse_more_than_the_limit() {
    let cluster = Cluster::start();
    let flags = ["--max-queued-jobs", "5"];
    let nodes = [cluster.serve(&flags), cluster.serve(&flags)];
    for n in 0..5 {
        nodes[n % 2].job(&format!("size={}", 40 + n), &disc(40, 40, 1));
    }
    for node in &nodes {
        let refused = node.submit("size=90", &[], &disc(40, 40, 1));
        assert_eq!(refused.status, 503, "{}", refused.text());
        assert!(!refused.header("retry-after").is_empty());
        node.wait_until("the metrics are there", || {
            let metrics = node.operate("/metrics").text();
            let age = metrics
                .lines()
                .find_map(|line| line.strip_prefix("pixmesh_jobs_oldest_queued_age_seconds "));
            metrics.contains("\npixmesh_jobs_queued 5\n")
                && metrics.contains("\npixmesh_database_connections{state=\"limit\"} 8\n")
                && metrics.contains("\npixmesh_database_commit_seconds 0.")
                && metrics.contains("\npixmesh_database_replication_lag_seconds 0\n")
                && age.is_some_and(|age| age.parse::<f64>().unwrap() > 0.0)
        });
    }
    let worker = cluster.work(&[]);
    nodes[0].wait_until("all jobs are done", || worker.completions() == 5);
    for node in [&nodes[0], &nodes[1], &worker] {
        node.wait_until("no work is queued", || queued_work_s(node) == Some(0.0));
    }
    // Nodes that have done no jobs report queued work by the mean duration that the worker shares.
    worker.wait_until("the worker has measured five jobs", || {
        worker.operate("/metrics").text().contains("pixmesh_job_duration_seconds_count 5")
    });
    thread::sleep(STATS_INTERVAL);
    drop(worker);
    nodes[0].job("size=90", &disc(40, 40, 1));
    let new = cluster.serve(&[]);
    for node in [&nodes[0], &nodes[1], &new] {
        node.wait_until("the node reports the seconds of queued work", || {
            queued_work_s(node).is_some_and(|seconds| seconds > 0.0)
        });
    }
}
