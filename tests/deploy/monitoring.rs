//! The dashboard and the alerts use metrics that exist, and Prometheus accepts them.

use crate::pictures::disc;
use crate::read;
use crate::server::Server;
use crate::tools::{checkout, require, run, text};
use pixmesh::telemetry::names::all;
use pixmesh_engine::telemetry::Kind;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

const ALERTS: &str = "deploy/monitoring/alerts.yaml";

#[test]
fn operator_resource_has_the_alerts_of_the_rules_file() {
    let resource = read("deploy/monitoring/prometheus-rule.yaml");
    let indented = |line: &str| if line.is_empty() { String::new() } else { format!("  {line}") };
    let rules = read(ALERTS);
    let groups = rules.lines().skip_while(|line| !line.starts_with("groups:")).map(indented);
    let groups = groups.collect::<Vec<_>>().join("\n");
    assert!(resource.contains(&groups), "copy the groups of {ALERTS} into prometheus-rule.yaml");
}

#[test]
fn a_running_service_has_the_metrics_that_are_declared_and_no_others() {
    let server = Server::start(&[]);
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
    server.mesh("density=0", &[], &disc(30, 30, 1));
    let job = server.job("", &disc(30, 30, 1));
    server.wait_for(&job, "completed");
    // How long jobs take is known with the next look at the queue.
    server.wait_until("the work that waits is told", || {
        server.operate("/metrics").text().contains("\npixmesh_jobs_queued_work_seconds ")
    });
    let metrics = server.operate("/metrics").text();
    let mut seen = BTreeSet::new();
    for line in metrics.lines().filter_map(|line| line.strip_prefix("# TYPE ")) {
        let (name, kind) = line.split_once(' ').unwrap();
        let declared = all().find(|metric| metric.name == name);
        let declared = declared.unwrap_or_else(|| panic!("{name} is not declared"));
        let expected = match declared.kind {
            Kind::Counter => "counter",
            Kind::Gauge => "gauge",
            Kind::Histogram => "histogram",
        };
        assert_eq!(kind, expected, "{name}");
        seen.insert(name.to_owned());
    }
    for metric in all() {
        // Nothing was turned away, and there is no shared database.
        let is_absent = metric.name == "pixmesh_requests_shed_total"
            || metric.name.starts_with("pixmesh_database_");
        assert_eq!(seen.contains(metric.name), !is_absent, "{}", metric.name);
    }
    for line in metrics.lines().filter(|line| !line.starts_with('#')) {
        for label in labels(line) {
            let metric = all().find(|metric| line.starts_with(metric.name)).unwrap();
            let is_declared = metric.labels.contains(&label) || label == "le";
            assert!(is_declared, "the label {label} of {} is not declared", metric.name);
        }
    }
}

/// The names of the labels of a line of metrics; no value has a quote or an equals sign in it.
fn labels(line: &str) -> Vec<&str> {
    let Some((_, labels)) = line.split_once('{') else { return Vec::new() };
    let names = labels.split("=\"").map(|part| part.rsplit(['{', ',']).next().unwrap());
    let count = labels.matches("=\"").count();
    names.take(count).collect()
}

#[test]
fn every_metric_is_on_the_dashboard_and_every_expression_is_of_metrics_that_there_are() {
    let dashboard = dashboard_expressions().concat();
    for metric in all() {
        assert!(dashboard.contains(metric.name), "{} is not on the dashboard", metric.name);
    }
    let known = |word: &str| {
        let parts = ["_bucket", "_sum", "_count"].map(|suffix| word.strip_suffix(suffix));
        let name = parts.into_iter().flatten().next().unwrap_or(word);
        all().any(|metric| metric.name == name || metric.name == word)
    };
    for word in (dashboard + &read(ALERTS)).split(|c: char| !c.is_alphanumeric() && c != '_') {
        let is_metric = word.starts_with("pixmesh_") || word.starts_with("process_");
        assert!(!is_metric || known(word), "there is no metric {word}");
    }
}

fn dashboard_expressions() -> Vec<String> {
    let dashboard: Value = serde_json::from_str(&read("deploy/monitoring/dashboard.json")).unwrap();
    let panels = dashboard["panels"].as_array().unwrap().iter();
    let targets = panels.flat_map(|panel| panel["targets"].as_array().unwrap());
    targets.map(|target| target["expr"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn every_alert_has_its_section_in_the_runbook_and_every_section_its_alert() {
    let (alerts, runbook) = (read(ALERTS), read("deploy/runbook.md"));
    let named: BTreeSet<_> =
        alerts.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    let sections: BTreeSet<_> =
        runbook.lines().filter_map(|line| line.strip_prefix("## ")).collect();
    assert!(named.len() > 10);
    assert_eq!(named, sections);
    for section in runbook.split("\n## ").skip(1) {
        for part in ["**Means**", "**Look at**", "**Do**"] {
            assert!(section.contains(part), "{part} is missing: {section}");
        }
    }
}

#[test]
fn the_alerts_fire_when_they_should() {
    require("promtool");
    run(Command::new("promtool").args(["check", "rules"]).arg(checkout(ALERTS)));
    let tests = checkout("deploy/monitoring/alerts.test.yaml");
    run(Command::new("promtool").args(["test", "rules"]).arg(tests));
}

#[test]
fn prometheus_can_read_the_metrics_and_the_dashboard_s_expressions() {
    require("promtool");
    let server = Server::start(&[]);
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
    let mut check = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    check.stdin.take().unwrap().write_all(&server.operate("/metrics").body).unwrap();
    let output = check.wait_with_output().unwrap();
    // It also says what names it would choose; unreadable metrics are an error.
    assert!(!text(&output).contains("error while linting"), "{}", text(&output));
    let rules: Vec<Value> = dashboard_expressions()
        .iter()
        .enumerate()
        .map(|(number, expression)| {
            let expression = expression.replace("$__rate_interval", "5m");
            json!({ "record": format!("panel:{number}"), "expr": expression })
        })
        .collect();
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("dashboard-rules.json");
    let file = json!({ "groups": [{ "name": "dashboard", "rules": rules }] });
    std::fs::write(&path, file.to_string()).unwrap();
    run(Command::new("promtool").args(["check", "rules"]).arg(path));
}
