//! The route table, and the order of the layers around it.

pub mod comparisons;
pub mod docs;
pub mod health;
pub mod index;
pub mod jobs;
pub mod meshes;
pub mod methods;
pub mod metrics;
pub mod openapi;
pub mod problems;
pub mod reconstructions;
pub mod studio;

mod answer;
mod cors;
mod guard;
mod observe;

use crate::access::KeyRing;
use crate::config::Settings;
use crate::extract::auth::authenticate;
use crate::extract::request_id::identify;
use crate::extract::upload::{BodyLimit, BodyMemory, Intake};
use crate::problem::{self, Kind, Problem};
use crate::server::Lifecycle;
use axum::Router;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use metrics_exporter_prometheus::PrometheusHandle;
use pixmesh_engine::Scheduler;
use pixmesh_engine::Workers;
use pixmesh_jobs::Jobs;
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;

/// What the public routes share.
#[derive(Debug)]
pub struct Service {
    /// How bodies are received.
    pub intake: Intake,
    /// What images may be like.
    pub pictures: pixmesh_codec::Limits,
    /// The keys that requests need one of, if they do.
    pub keys: Option<Arc<KeyRing>>,
    /// The origins whose pages may use the service.
    pub origins: Vec<String>,
    /// Admits every task.
    pub scheduler: Scheduler,
    /// The threads that tasks run on.
    pub workers: Workers,
    /// The longest time from the end of the upload to the answer.
    pub deadline: Duration,
    /// The jobs.
    pub jobs: Jobs,
    /// Raised when the service stops: who only waits shall come back later.
    pub stop: CancellationToken,
    /// Raised when a stopping service can wait no longer for its work.
    pub cut: CancellationToken,
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
    ) -> Self {
        Self {
            workers,
            keys,
            origins: settings.access.cors_origins.clone(),
            intake: Intake {
                max_body: BodyLimit {
                    bytes: settings.longest_body().0,
                    setting: settings.setting_of_longest_body(),
                },
                timeout: settings.limits.body_timeout.0,
                memory: BodyMemory::new(settings.body_budget().0),
            },
            pictures: settings.limits.of_pictures(),
            scheduler: Scheduler::new(&settings.of_scheduler()),
            deadline: settings.deadline(),
            jobs,
            stop: CancellationToken::new(),
            cut: CancellationToken::new(),
        }
    }
}

/// The public routes.
pub fn public(service: Arc<Service>) -> Router {
    let authenticate = from_fn_with_state(service.keys.clone(), authenticate);
    let cors = cors::layer(&service.origins);
    let routes = Router::new()
        .route("/", get(studio::show))
        .route("/studio/{asset}", get(studio::asset))
        .route("/v1/meshes", post(meshes::create))
        .route("/v1/jobs", get(jobs::list::list).post(jobs::create))
        .route("/v1/jobs/{id}", get(jobs::show).delete(jobs::cancel))
        .route("/v1/jobs/{id}/events", get(jobs::events::follow))
        .route("/v1/jobs/{id}/mesh", get(jobs::mesh::show))
        .route("/v1/reconstructions", post(reconstructions::create))
        .route("/v1/comparisons", post(comparisons::create))
        .route("/v1/methods", get(methods::list))
        .route("/problems/{slug}", get(problems::show))
        .route("/openapi.json", get(openapi::show))
        .route("/docs", get(docs::show))
        .route("/docs/", get(docs::show))
        .route("/docs/{asset}", get(docs::asset))
        .fallback(not_found)
        .with_state(service);
    routes.layer(
        ServiceBuilder::new()
            .layer(from_fn(identify))
            .layer(from_fn(observe::observe))
            .layer(from_fn(problem::render))
            .layer(from_fn(guard::guard))
            .option_layer(cors)
            .layer(CatchPanicLayer::custom(panicked))
            .layer(authenticate),
    )
}

/// The routes for operations, on a listener of their own.
pub fn operations(operations: Operations) -> Router {
    let routes = Router::new()
        .route("/livez", get(health::live))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(metrics::show))
        .fallback(not_found)
        .with_state(operations);
    routes.layer(
        ServiceBuilder::new()
            .layer(from_fn(identify))
            .layer(from_fn(problem::render))
            .layer(from_fn(guard::guard))
            .layer(CatchPanicLayer::custom(panicked)),
    )
}

async fn not_found() -> Problem {
    Problem::new(Kind::NotFound, "there is nothing at this path; / lists what there is")
}

/// The panic itself is in the log already, by the hook.
#[allow(clippy::needless_pass_by_value, reason = "the layer hands over the payload")]
fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::new(Kind::Internal, "the log has the reason under this request's id").into_response()
}
