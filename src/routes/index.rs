//! `GET /` for programs, which ask for JSON: what there is.

use axum::Json;
use serde::Serialize;
use utoipa::ToSchema;

/// The service, and links to its resources.
#[derive(Serialize, ToSchema)]
pub(super) struct Index {
    service: &'static str,
    version: &'static str,
    links: IndexLinks,
}

/// The paths of the resources.
#[derive(Serialize, ToSchema)]
pub(super) struct IndexLinks {
    meshes: &'static str,
    jobs: &'static str,
    conversions: &'static str,
    reconstructions: &'static str,
    comparisons: &'static str,
    methods: &'static str,
    presets: &'static str,
    openapi: &'static str,
    docs: &'static str,
}

/// Answers with links to the resources.
pub(super) async fn show() -> Json<Index> {
    Json(Index {
        service: "pixmesh",
        version: env!("CARGO_PKG_VERSION"),
        links: IndexLinks {
            meshes: "/v1/meshes",
            jobs: "/v1/jobs",
            conversions: "/v1/conversions",
            reconstructions: "/v1/reconstructions",
            comparisons: "/v1/comparisons",
            methods: "/v1/methods",
            presets: "/v1/presets",
            openapi: "/openapi.json",
            docs: "/docs",
        },
    })
}
