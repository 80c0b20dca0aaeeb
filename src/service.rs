//! What the handlers share.

use crate::access::{KeyRing, Shares};
use crate::config::{Settings, Visitors};
use crate::extract::upload::{BodyLimit, BodyMemory, Intake};
use crate::lifecycle::{Lifecycle, Shutdown};
use ipnet::IpNet;
use metrics_exporter_prometheus::PrometheusHandle;
use pixmesh_engine::{Owner, Scheduler, Workers};
use pixmesh_jobs::Jobs;
use std::sync::Arc;
use std::time::Duration;

/// What the public routes share.
#[derive(Debug)]
pub struct Service {
    /// How bodies are received.
    pub intake: Intake,
    /// What images may be like.
    pub pictures: pixmesh_codec::Limits,
    /// The keys that requests need one of, if they do.
    pub keys: Option<Arc<KeyRing>>,
    /// Which origins and host names are accepted.
    pub visitors: Arc<Visitors>,
    /// The proxies whose X-Forwarded-For is trusted.
    pub trusted_proxies: Arc<[IpNet]>,
    /// Admits every task.
    pub scheduler: Scheduler,
    /// The threads that tasks run on.
    pub workers: Workers,
    /// The longest time from the end of the upload to the answer.
    pub deadline: Duration,
    /// The jobs.
    pub jobs: Jobs,
    /// The streams of events that each owner has open.
    pub followers: Arc<Shares<Owner>>,
    /// The most of them.
    pub followers_of_each: usize,
    /// Stops the service.
    pub shutdown: Shutdown,
}

/// What the routes for operations share.
#[derive(Clone, Debug)]
pub struct Operations {
    /// Whether the service is starting, ready or stopping.
    pub lifecycle: Lifecycle,
    /// Whether jobs can be kept.
    pub jobs: Jobs,
    /// Writes the metrics out.
    pub metrics: PrometheusHandle,
}

impl Service {
    /// What the settings make of it, with the keys that requests need one of.
    #[must_use]
    pub fn new(
        settings: &Settings,
        jobs: Jobs,
        keys: Option<Arc<KeyRing>>,
        workers: Workers,
        shutdown: Shutdown,
    ) -> Self {
        Self {
            workers,
            keys,
            visitors: Arc::new(settings.visitors()),
            intake: Intake {
                max_body: BodyLimit {
                    bytes: settings.longest_body().0,
                    setting: settings.setting_of_longest_body(),
                },
                timeout: settings.limits.body_timeout.0,
                memory: BodyMemory::new(settings.body_budget().0),
            },
            pictures: settings.limits.of_pictures(),
            trusted_proxies: settings.limits.trusted_proxies.clone().into(),
            scheduler: Scheduler::new(&settings.of_scheduler()),
            deadline: settings.deadline(),
            jobs,
            followers: Arc::default(),
            followers_of_each: settings.event_streams(),
            shutdown,
        }
    }
}
