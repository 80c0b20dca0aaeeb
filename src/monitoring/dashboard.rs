//! The dashboard: what comes in, what becomes of it, what it costs, in rows from left to right.

use crate::telemetry::names::*;
use serde_json::{Value, json};

/// Panels beside each other, and the size of each: Grafana's grid has 24 columns.
const ACROSS: usize = 3;
const WIDTH: usize = 24 / ACROSS;
const HEIGHT: usize = 8;

/// One panel: curves over time.
struct Panel {
    title: &'static str,
    unit: &'static str,
    /// An expression, and the label of its curves.
    curves: Vec<(String, &'static str)>,
}

impl Panel {
    fn new(title: &'static str, unit: &'static str, curves: Vec<(String, &'static str)>) -> Self {
        Self { title, unit, curves }
    }
}

/// A counter of the chosen processes, per second, summed by a label.
fn rate(metric: &str, by: &str) -> String {
    format!("sum by ({by}) (rate({metric}{{instance=~\"$instance\"}}[$__rate_interval]))")
}

/// A gauge of the chosen processes.
fn gauge(metric: &str) -> String {
    format!("{metric}{{instance=~\"$instance\"}}")
}

/// A quantile of a histogram, by a label when one is named.
fn quantile(share: f64, histogram: &str, by: &str) -> String {
    let labels = if by.is_empty() { "le".to_owned() } else { format!("le, {by}") };
    let buckets = rate(&format!("{histogram}_bucket"), &labels);
    format!("histogram_quantile({share}, {buckets})")
}

/// The median and the 99th percentile of a histogram.
fn median_and_p99(histogram: &str) -> Vec<(String, &'static str)> {
    vec![(quantile(0.5, histogram, ""), "median"), (quantile(0.99, histogram, ""), "p99")]
}

/// A metric of the process, of those processes that are this service.
fn of_process(metric: &str) -> String {
    let service = format!("max by (job, instance) ({})", gauge(BUILD_INFO));
    format!("{metric} * on (job, instance) group_left () {service}")
}

fn panels() -> Vec<Panel> {
    vec![
        Panel::new("Requests", "reqps", vec![(rate(HTTP_REQUESTS, "code"), "{{code}}")]),
        Panel::new(
            "Routes",
            "reqps",
            vec![(rate(HTTP_REQUESTS, "route, method"), "{{method}} {{route}}")],
        ),
        Panel::new("Turned away", "reqps", vec![(rate(REQUESTS_SHED, "reason"), "{{reason}}")]),
        Panel::new(
            "Time to the answer, p99",
            "s",
            vec![(quantile(0.99, HTTP_DURATION, "route"), "{{route}}")],
        ),
        Panel::new(
            "Time of each stage, p99",
            "s",
            vec![(quantile(0.99, STAGE_DURATION, "stage"), "{{stage}}")],
        ),
        Panel::new("Time waited", "s", median_and_p99(QUEUE_WAIT)),
        Panel::new(
            "Work",
            "short",
            vec![
                (gauge(REQUESTS_IN_PROGRESS), "requests in progress, {{instance}}"),
                (gauge(QUEUE_DEPTH), "waiting, {{instance}}"),
                (gauge(JOBS_IN_PROGRESS), "meshes being made, {{instance}}"),
                (gauge(WORKERS), "workers, {{instance}}"),
            ],
        ),
        Panel::new("Pixels of a picture", "short", median_and_p99(INPUT_PIXELS)),
        Panel::new("Vertices of a mesh", "short", median_and_p99(MESH_VERTICES)),
        Panel::new("Durable jobs", "ops", vec![(rate(JOBS, "state"), "{{state}}")]),
        Panel::new(
            "Durable jobs that wait, and attempts",
            "short",
            vec![
                (format!("max({})", gauge(JOBS_WAITING)), "waiting"),
                (format!("max({})", gauge(JOBS_RUNNING)), "running"),
                (
                    format!("sum(rate({}[$__rate_interval]))", gauge(JOB_ATTEMPTS)),
                    "attempts per second",
                ),
            ],
        ),
        Panel::new(
            "Wait of the oldest durable job",
            "s",
            vec![(format!("max({})", gauge(JOBS_OLDEST)), "oldest")],
        ),
        Panel::new(
            "Work of the durable jobs that wait",
            "s",
            vec![(format!("max({})", gauge(JOBS_WORK)), "of one worker's time")],
        ),
        Panel::new("Time of a durable job", "s", median_and_p99(JOB_DURATION)),
        Panel::new(
            "Memory for work",
            "mbytes",
            vec![(gauge(MEMORY_PERMITS), "{{state}}, {{instance}}")],
        ),
        Panel::new(
            "Memory of the process",
            "bytes",
            vec![(of_process(PROCESS_RESIDENT), "{{instance}}")],
        ),
        Panel::new(
            "Processors used",
            "short",
            vec![(of_process(&format!("rate({PROCESS_CPU}[$__rate_interval])")), "{{instance}}")],
        ),
        Panel::new(
            "Files and connections",
            "short",
            vec![(of_process(PROCESS_FDS), "{{instance}}")],
        ),
        Panel::new(
            "Panics",
            "short",
            vec![(format!("increase({}[$__rate_interval])", gauge(PANICS)), "{{instance}}")],
        ),
        Panel::new(
            "Versions",
            "short",
            vec![(
                format!("count by (version, commit) ({})", gauge(BUILD_INFO)),
                "{{version}} {{commit}}",
            )],
        ),
    ]
}

/// A panel as Grafana reads it.
fn rendered(number: usize, panel: &Panel) -> Value {
    let source = json!({ "type": "prometheus", "uid": "${datasource}" });
    let target = |(index, (expression, label)): (usize, &(String, &str))| {
        let id = char::from(b'A' + u8::try_from(index).unwrap_or_default());
        json!({
            "refId": id.to_string(), "datasource": source, "expr": expression, "legendFormat": label,
        })
    };
    json!({
        "id": number + 1,
        "type": "timeseries",
        "title": panel.title,
        "datasource": source,
        "gridPos": {
            "x": number % ACROSS * WIDTH, "y": number / ACROSS * HEIGHT, "w": WIDTH, "h": HEIGHT,
        },
        "fieldConfig": { "defaults": { "unit": panel.unit, "min": 0 }, "overrides": [] },
        "options": { "legend": { "displayMode": "list", "placement": "bottom" } },
        "targets": panel.curves.iter().enumerate().map(target).collect::<Vec<_>>(),
    })
}

/// The choices above the panels: the source of the data, and the processes.
fn choices() -> Value {
    json!({ "list": [
        { "name": "datasource", "type": "datasource", "query": "prometheus", "label": "Source" },
        {
            "name": "instance", "type": "query", "label": "Process",
            "datasource": { "type": "prometheus", "uid": "${datasource}" },
            "query": format!("label_values({BUILD_INFO}, instance)"),
            "refresh": 2, "multi": true, "includeAll": true, "allValue": ".*",
            "current": { "text": "All", "value": "$__all" },
        },
    ] })
}

/// The dashboard.
pub(super) fn document() -> String {
    let panels: Vec<Value> =
        panels().iter().enumerate().map(|(number, panel)| rendered(number, panel)).collect();
    let dashboard = json!({
        "uid": "pixmesh",
        "title": "pixmesh",
        "tags": ["pixmesh"],
        "schemaVersion": 39,
        "version": 1,
        "editable": true,
        "graphTooltip": 1,
        "time": { "from": "now-1h", "to": "now" },
        "refresh": "30s",
        "templating": choices(),
        "panels": panels,
    });
    format!("{dashboard:#}\n")
}
