//! What watches the service: the dashboard and the alerts, made from the names of the metrics.
//!
//! `pixmesh monitoring` prints them, so that they suit the version that prints them; what is printed is
//! checked in below `deploy/monitoring`, with a runbook that says what to do.

mod alerts;
mod dashboard;

use clap::Subcommand;

/// What watches the service.
#[derive(Clone, Copy, Debug, Subcommand)]
pub enum Monitor {
    /// The dashboard, as Grafana reads it.
    Dashboard,
    /// The alerts, as a file of rules for Prometheus.
    Alerts,
    /// The alerts, as a resource of the Prometheus operator on Kubernetes.
    PrometheusRule,
}

impl Monitor {
    /// Its text.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::Dashboard => dashboard::document(),
            Self::Alerts => alerts::rules(),
            Self::PrometheusRule => alerts::resource(),
        }
    }
}
