//! The alerts: each says that people or their work suffer, or soon will, and the runbook has a section
//! of its name.

use crate::telemetry::names::*;
use std::fmt::Write;

/// Who must know how soon.
#[derive(Clone, Copy)]
enum Severity {
    /// At once: work is refused or lost.
    Critical,
    /// In working hours.
    Warning,
}

/// One alert.
struct Alert {
    name: &'static str,
    severity: Severity,
    /// What holds for how long.
    holds: String,
    minutes: u32,
    summary: &'static str,
}

impl Severity {
    fn name(self) -> &'static str {
        match self {
            Self::Critical => "critical",
            Self::Warning => "warning",
        }
    }
}

/// The processes of this service among those that export such a metric.
fn of_service(metric: &str) -> String {
    format!("{metric} * on (job, instance) group_left () max by (job, instance) ({BUILD_INFO})")
}

/// Those that fire when the service cannot be used.
fn availability() -> Vec<Alert> {
    vec![
        Alert {
            name: "PixmeshDown",
            severity: Severity::Critical,
            holds: format!("absent({BUILD_INFO}) or up{{job=~\".*pixmesh.*\"}} == 0"),
            minutes: 2,
            summary: "no process of the service answers",
        },
        Alert {
            name: "PixmeshPanicked",
            severity: Severity::Critical,
            holds: format!("increase({PANICS}[10m]) > 0"),
            minutes: 0,
            summary: "a defect made a piece of work end",
        },
        Alert {
            name: "PixmeshRestarts",
            severity: Severity::Critical,
            holds: format!("{} > 2", of_service(&format!("resets({PROCESS_CPU}[30m])"))),
            minutes: 0,
            summary: "the process ends again and again",
        },
        Alert {
            name: "PixmeshFails",
            severity: Severity::Critical,
            holds: format!(
                "sum(rate({HTTP_REQUESTS}{{code=~\"5..\", code!=\"503\"}}[5m])) \
                 / sum(rate({HTTP_REQUESTS}[5m])) > 0.01"
            ),
            minutes: 5,
            summary: "more than 1 % of the requests fail by the service's own fault",
        },
    ]
}

/// Those that fire when more is asked for than can be done.
fn load() -> Vec<Alert> {
    vec![
        Alert {
            name: "PixmeshOverloaded",
            severity: Severity::Warning,
            holds: format!(
                "sum(rate({REQUESTS_SHED}{{reason=~\"queue_full|memory\"}}[5m])) \
                 / sum(rate({HTTP_REQUESTS}[5m])) > 0.05"
            ),
            minutes: 10,
            summary: "more than 5 % of the requests are turned away",
        },
        Alert {
            name: "PixmeshMissesDeadlines",
            severity: Severity::Warning,
            holds: format!("sum(rate({REQUESTS_SHED}{{reason=\"deadline\"}}[10m])) > 0.01"),
            minutes: 10,
            summary: "work is given up because it takes longer than the deadline",
        },
        Alert {
            name: "PixmeshSlow",
            severity: Severity::Warning,
            holds: format!(
                "histogram_quantile(0.99, sum by (le) \
                 (rate({HTTP_DURATION}_bucket{{route=\"/v1/meshes\"}}[10m]))) > 20"
            ),
            minutes: 10,
            summary: "one mesh in a hundred takes more than 20 seconds",
        },
        Alert {
            name: "PixmeshMemoryBudgetUsedUp",
            severity: Severity::Warning,
            holds: format!(
                "{MEMORY_PERMITS}{{state=\"used\"}} \
                 / on (job, instance) {MEMORY_PERMITS}{{state=\"total\"}} > 0.95"
            ),
            minutes: 15,
            summary: "work waits for memory rather than for workers",
        },
        Alert {
            name: "PixmeshMemoryBeyondBudget",
            severity: Severity::Critical,
            // Work has three quarters of the budget; the process takes 80 MiB besides.
            holds: format!(
                "{} > on (job, instance) {MEMORY_PERMITS}{{state=\"total\"}} * 1048576 * 4 / 3 + 83886080",
                of_service(PROCESS_RESIDENT)
            ),
            minutes: 5,
            summary: "the process takes more memory than its budget and what it needs besides",
        },
        Alert {
            name: "PixmeshManyFilesOpen",
            severity: Severity::Warning,
            holds: format!("{} > 1000", of_service(PROCESS_FDS)),
            minutes: 10,
            summary: "connections pile up",
        },
    ]
}

/// Those that fire when durable jobs are not done.
fn jobs() -> Vec<Alert> {
    vec![
        Alert {
            name: "PixmeshJobsStuck",
            severity: Severity::Critical,
            holds: format!(
                "max({JOBS_WAITING}) > 0 and sum(rate({JOB_ATTEMPTS}[10m])) == 0 \
                 and sum({JOBS_IN_PROGRESS}) == 0"
            ),
            minutes: 10,
            summary: "jobs wait and nobody takes them",
        },
        Alert {
            name: "PixmeshJobsWaitLong",
            severity: Severity::Warning,
            holds: format!("max({JOBS_OLDEST}) > 900"),
            minutes: 5,
            summary: "a job has waited for more than 15 minutes",
        },
        Alert {
            name: "PixmeshJobsFillQueue",
            severity: Severity::Warning,
            holds: format!("max({JOBS_WAITING}) > 8000"),
            minutes: 5,
            summary: "four fifths of the places for jobs are taken",
        },
        Alert {
            name: "PixmeshJobsFail",
            severity: Severity::Warning,
            holds: format!(
                "sum(rate({JOBS}{{state=\"failed\"}}[15m])) \
                 / sum(rate({JOBS}{{state=~\"completed|failed\"}}[15m])) > 0.05"
            ),
            minutes: 15,
            summary: "more than 5 % of the jobs fail",
        },
    ]
}

/// All alerts as groups of rules, in YAML.
fn groups() -> String {
    let mut text = String::from("groups:\n");
    for (name, alerts) in [("availability", availability()), ("load", load()), ("jobs", jobs())] {
        let _ = writeln!(text, "  - name: pixmesh-{name}\n    rules:");
        for alert in alerts {
            let _ = write!(text, "{alert}");
        }
    }
    text
}

impl std::fmt::Display for Alert {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, severity, holds, minutes, summary } = self;
        writeln!(formatter, "      - alert: {name}")?;
        writeln!(formatter, "        expr: >-\n          {holds}")?;
        if *minutes > 0 {
            writeln!(formatter, "        for: {minutes}m")?;
        }
        writeln!(formatter, "        labels:\n          severity: {}", severity.name())?;
        writeln!(formatter, "        annotations:\n          summary: \"{summary}\"")?;
        let section = name.to_lowercase();
        writeln!(formatter, "          runbook: \"deploy/runbook.md#{section}\"")
    }
}

/// A file of rules for Prometheus.
pub(super) fn rules() -> String {
    format!("# Printed by `pixmesh monitoring alerts`.\n{}", groups())
}

/// A resource of the Prometheus operator.
pub(super) fn resource() -> String {
    let head = "# Printed by `pixmesh monitoring prometheus-rule`.\n\
                apiVersion: monitoring.coreos.com/v1\nkind: PrometheusRule\n\
                metadata:\n  name: pixmesh\nspec:\n";
    let spec: Vec<String> = groups().lines().map(|line| format!("  {line}\n")).collect();
    format!("{head}{}", spec.concat())
}
