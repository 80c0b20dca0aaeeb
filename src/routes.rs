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

use crate::extract::auth::authenticate;
use crate::extract::request_id::identify;
use crate::problem::{self, Kind, Problem};
use crate::service::{Operations, Service};
use axum::Router;
use axum::extract::{Request, State};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use std::any::Any;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;

/// The public routes.
pub fn public(service: Arc<Service>) -> Router {
    let authenticate = from_fn_with_state(service.keys.clone(), authenticate);
    let stop = from_fn_with_state(service.cut.clone(), stop);
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
            .layer(authenticate)
            .layer(stop),
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

/// The layer that drops requests that a stopping service can wait for no longer.
async fn stop(State(cut): State<CancellationToken>, request: Request, next: Next) -> Response {
    tokio::select! {
        response = next.run(request) => response,
        () = cut.cancelled() => {
            Problem::new(Kind::ShuttingDown, "the service is stopping").into_response()
        }
    }
}

async fn not_found() -> Problem {
    Problem::new(Kind::NotFound, "there is nothing at this path; / lists what there is")
}

/// The panic itself is in the log already, by the hook.
#[allow(clippy::needless_pass_by_value, reason = "the layer hands over the payload")]
fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::new(Kind::Internal, "the log has the reason under this request's id").into_response()
}
