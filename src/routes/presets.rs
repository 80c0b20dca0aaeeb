//! `GET /v1/presets`: every preset, from the parser's own table.

use super::openapi::answers::ProblemsOf;
use axum::Json;
use pixmesh_engine::Format;
use pixmesh_engine::params::{PRESETS, Preset};
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

/// Every preset.
#[derive(Serialize, ToSchema)]
pub(super) struct Presets {
    presets: Vec<PresetRow>,
}

/// Parameters for a purpose.
#[derive(Serialize, ToSchema)]
pub(super) struct PresetRow {
    name: &'static str,
    /// Its name for people.
    title: &'static str,
    /// What it is for.
    about: &'static str,
    /// What it is not for, with the preset that is.
    not_for: &'static str,
    /// The format of the answer, where neither `format` nor Accept says one; null for the default.
    format: Option<&'static str>,
    /// What it sets parameters to.
    #[schema(value_type = Object)]
    parameters: Map<String, Value>,
}

/// Answers with every preset.
#[utoipa::path(
    get, path = "/v1/presets", operation_id = "presets",
    summary = "Parameters for a purpose",
    description = "Sets of parameters that `preset=` names. A parameter given beside a preset wins, \
                   and another method takes its own parameters.",
    responses(
        (status = 200, description = "Every preset", body = Presets),
        ProblemsOf::<401>, ProblemsOf::<429>,
    ),
    security((), ("key" = [])),
)]
pub(super) async fn list() -> Json<Presets> {
    Json(Presets { presets: PRESETS.iter().map(PresetRow::from).collect() })
}

impl From<&Preset> for PresetRow {
    fn from(preset: &Preset) -> Self {
        let &Preset { name, title, about, not_for, format, .. } = preset;
        Self {
            name,
            title,
            about,
            not_for,
            format: format.map(Format::name),
            parameters: preset.object(),
        }
    }
}
