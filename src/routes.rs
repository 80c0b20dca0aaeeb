//! The route table, and the order of the layers around it.

pub mod comparisons;
pub mod conversions;
pub mod docs;
pub mod health;
pub mod index;
pub mod jobs;
pub mod log_level;
pub mod meshes;
pub mod methods;
pub mod metrics;
pub mod openapi;
pub mod operating;
pub mod presets;
pub mod problems;
pub mod studio;

mod answer;
mod compress;
mod cors;
mod guard;
mod observe;
mod origin;

use crate::extract::auth::authenticate;
use crate::extract::request_id::identify;
use crate::problem::{self, Kind, Problem};
use crate::service::{Operations, Service};
use axum::extract::{Request, State};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use axum::{Extension, Router};
use jobs::document::JobEvent;
use openapi::DocumentText;
use operating::Operators;
use std::any::Any;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// The public routes.
pub fn public(service: Arc<Service>) -> Router {
    let authenticate = from_fn_with_state(service.keys.clone(), authenticate);
    let stop = from_fn_with_state(service.shutdown.cut.clone(), stop);
    let cors = cors::layer(&service.visitors.origins);
    let observe = from_fn_with_state(Arc::clone(&service.trusted_proxies), observe::observe);
    let admit = from_fn_with_state(Arc::clone(&service.visitors), origin::admit);
    let (documented, document) = documented().split_for_parts();
    let routes = documented
        .route("/studio/{asset}", get(studio::asset).layer(compress::of_assets()))
        .route("/docs/", get(docs::show))
        .route("/docs/{asset}", get(docs::asset))
        .layer(Extension(DocumentText::of(&document)))
        .fallback(not_found)
        .with_state(service);
    rendered(
        routes.layer(
            ServiceBuilder::new()
                .layer(observe)
                .layer(from_fn(guard::guard))
                .layer(admit)
                .option_layer(cors)
                .layer(CatchPanicLayer::custom(panicked))
                .layer(authenticate)
                .layer(stop)
                .layer(from_fn(compress::finish))
                .layer(compress::layer())
                .layer(from_fn(compress::mark)),
        ),
    )
}

/// Routes whose requests have ids and whose refusals have documents. Both layers are around the
/// router itself, because it adds `Allow` to a refusal outside of its own layers.
fn rendered(routes: Router) -> Router {
    let layers = ServiceBuilder::new().layer(from_fn(identify)).layer(from_fn(problem::render));
    Router::new().fallback_service(layers.service(routes))
}

/// The public routes that the OpenAPI document describes.
fn documented() -> OpenApiRouter<Arc<Service>> {
    OpenApiRouter::with_openapi(openapi::base::<JobEvent>())
        .routes(routes!(studio::show))
        .routes(routes!(meshes::create))
        .routes(routes!(jobs::list::list, jobs::submit::create))
        .routes(routes!(jobs::show, jobs::cancel))
        .routes(routes!(jobs::events::follow))
        .routes(routes!(jobs::mesh::show))
        .routes(routes!(jobs::source::show))
        .routes(routes!(conversions::create))
        .routes(routes!(conversions::rebuild))
        .routes(routes!(comparisons::create))
        .routes(routes!(methods::list))
        .routes(routes!(presets::list))
        .routes(routes!(problems::show))
        .routes(routes!(openapi::show))
        .routes(routes!(docs::show))
}

/// The OpenAPI document as indented JSON.
#[must_use]
pub fn openapi_document() -> String {
    DocumentText::of(&documented().into_openapi()).into_string()
}

/// The routes for operations, on a listener of their own.
pub fn operations(operations: Operations, operators: Operators) -> Router {
    let jobs = operations.jobs.clone();
    let routes = Router::new()
        .route("/livez", get(health::live))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(metrics::show))
        .route("/log-level/{level}", put(log_level::change))
        .with_state(operations)
        .merge(operating::routes(jobs, operators))
        .fallback(not_found);
    rendered(routes.layer(
        ServiceBuilder::new().layer(from_fn(guard::guard)).layer(CatchPanicLayer::custom(panicked)),
    ))
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
