//! promtool evaluates the documented and deployed scaling signals on the metrics of real nodes.

use crate::cluster::Cluster;
use crate::node::Node;
use crate::pictures::{disc, noise};
use crate::tools::{checkout, require, run};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

/// The files with the signals.
const FILES: [&str; 2] = ["docs/scaling.md", "deploy/kubernetes/overlays/cluster/autoscaling.yaml"];
/// All signals ask for enough slots to start queued jobs within this time, in seconds.
const WAIT_S: f64 = 30.0;

#[test]
fn scaling_signals_give_the_number_of_slots_needed() {
    require("promtool");
    let cluster = Cluster::start();
    let nodes = [cluster.serve(&[]), cluster.serve(&[])];
    for n in 0..3 {
        nodes[0].job(&format!("size={}", 40 + n), &disc(40, 40, 1));
    }
    // Before the first completed job each queued job counts as one second, so that a worker starts.
    wait_for_counts(&nodes, [3.0, 0.0]);
    assert_eq!(value(&nodes[0], "pixmesh_jobs_queued_work_seconds"), None);
    evaluate(&nodes, 3.0 / WAIT_S);
    let worker = cluster.work(&[]);
    wait_for_counts(&nodes, [0.0, 0.0]);
    evaluate(&nodes, 0.0);
    // Nodes share the mean duration of jobs every 3 s.
    thread::sleep(Duration::from_secs(6));
    let running = nodes[0].job("method=mgpr&density=1", &noise(900));
    nodes[0].wait_for(&running, "running");
    // Each node counts every 3 s; the job must not end before both have counted it.
    worker.pause();
    for n in 0..4 {
        nodes[1].job(&format!("size={}", 50 + n), &disc(40, 40, 1));
    }
    wait_for_counts(&nodes, [4.0, 1.0]);
    let work_s = value(&nodes[0], "pixmesh_jobs_queued_work_seconds").unwrap();
    assert!(work_s > 0.0);
    evaluate(&nodes, 1.0 + work_s / WAIT_S);
    drop(worker);
}

/// Waits until every node reports these numbers of queued and running jobs.
#[track_caller]
fn wait_for_counts(nodes: &[Node], expected: [f64; 2]) {
    for node in nodes {
        node.wait_until(&format!("{expected:?} wait and run"), || {
            ["pixmesh_jobs_queued", "pixmesh_jobs_running"].map(|name| value(node, name))
                == expected.map(Some)
        });
    }
}

/// A node's value of a metric without labels.
fn value(node: &Node, name: &str) -> Option<f64> {
    let metrics = node.operate("/metrics").text();
    let mut values = metrics.lines().filter_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    values.next().map(|value| value.parse().unwrap())
}

/// Checks the value of every signal in slots, and that the other signals evaluate.
#[track_caller]
fn evaluate(nodes: &[Node], slots: f64) {
    let series: Vec<Value> =
        nodes.iter().enumerate().flat_map(|(n, node)| series(n, node)).collect();
    let expressions: Vec<String> = FILES.iter().flat_map(|file| expressions(file)).collect();
    let (of_slots, others): (Vec<_>, Vec<_>) =
        expressions.into_iter().partition(|expression| expression.contains("pixmesh_jobs_running"));
    assert!(of_slots.len() >= 3 && others.len() == 1, "{of_slots:?} {others:?}");
    let slots = of_slots.iter().map(|expression| {
        let samples = json!([{ "labels": "{}", "value": slots }]);
        json!({ "expr": expression, "eval_time": "0s", "exp_samples": samples })
    });
    let ages = others.iter().map(|expression| {
        let samples = json!([{ "labels": "{}", "value": 1 }]);
        json!({ "expr": format!("({expression}) >= bool 0"), "eval_time": "0s", "exp_samples": samples })
    });
    let tests: Vec<Value> = slots.chain(ages).collect();
    let file = json!({
        "evaluation_interval": "1m",
        "tests": [{ "interval": "1m", "input_series": series, "promql_expr_test": tests }]
    });
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scaling-signals.json");
    std::fs::write(&path, file.to_string()).unwrap();
    run(Command::new("promtool").args(["test", "rules"]).arg(path));
}

/// A node's metrics of the queue, as Prometheus stores them.
fn series(number: usize, node: &Node) -> Vec<Value> {
    let metrics = node.operate("/metrics").text();
    let of_queue = metrics.lines().filter(|line| line.starts_with("pixmesh_jobs_"));
    let kept = of_queue.filter_map(|line| {
        let (name, value) = line.split_once(' ')?;
        let series = format!("{name}{{instance=\"{number}\", namespace=\"pixmesh\"}}");
        (!name.contains('{')).then(|| json!({ "series": series, "values": value }))
    });
    kept.collect()
}

/// The expressions in a file: what follows `query:` or `metricsQuery:`, in its line or below it.
fn expressions(file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(checkout(file)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let indentation = |line: &str| line.len() - line.trim_start().len();
    let found = lines.iter().enumerate().filter_map(|(n, line)| {
        let (_, value) = line.split_once("uery: ")?;
        if value != ">-" {
            return Some(value.to_owned());
        }
        let below =
            lines[n + 1..].iter().take_while(|below| indentation(below) > indentation(line));
        Some(below.map(|below| below.trim()).collect::<Vec<_>>().join(" "))
    });
    found.filter(|value| value.contains('(')).collect()
}
