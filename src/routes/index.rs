//! `GET /` for programs, which ask for JSON: what there is.

use axum::Json;
use serde_json::{Value, json};

/// Answers with links to the resources.
pub async fn show() -> Json<Value> {
    Json(json!({
        "service": "pixmesh",
        "version": env!("CARGO_PKG_VERSION"),
        "links": {
            "meshes": "/v1/meshes",
            "jobs": "/v1/jobs",
            "reconstructions": "/v1/reconstructions",
            "comparisons": "/v1/comparisons",
            "methods": "/v1/methods",
            "openapi": "/openapi.json",
            "docs": "/docs",
        },
    }))
}
