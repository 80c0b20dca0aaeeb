//! `GET /v1/methods`: every method, policy, parameter and format, from the parser's own table.

use super::openapi::answers::ProblemsOf;
use crate::extract::accept::offered;
use axum::Json;
use pixmesh_engine::params::{
    DEFAULT_DENSITY, DEFAULT_METHOD, MeshOptions, Output, Parameter, TABLE, Takes,
};
use pixmesh_meshing::parameters::Policy;
use pixmesh_meshing::{Method, Target};
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

/// Everything that can be asked for.
#[derive(Serialize, ToSchema)]
pub(super) struct Methods {
    /// The method where none is given.
    default: &'static str,
    methods: Vec<MethodRow>,
    policies: Vec<PolicyRow>,
    parameters: Vec<ParameterRow>,
    formats: Vec<FormatRow>,
}

/// A method.
#[derive(Serialize, ToSchema)]
pub(super) struct MethodRow {
    name: &'static str,
    /// The components that an image must have; null for any.
    components: Option<usize>,
    /// What it sets each parameter to.
    #[schema(value_type = Object)]
    defaults: Map<String, Value>,
}

/// A sampling policy.
#[derive(Serialize, ToSchema)]
pub(super) struct PolicyRow {
    name: &'static str,
    /// The components that an image must have; null for any.
    components: Option<usize>,
}

/// A parameter.
#[derive(Default, Serialize, ToSchema)]
pub(super) struct ParameterRow {
    name: &'static str,
    about: &'static str,
    /// The JSON type of its values: number, integer, boolean or string.
    r#type: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = f64, required = false)]
    minimum: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = f64, required = false)]
    maximum: Option<Value>,
    /// Every text that it takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    allowed: Option<&'static [&'static str]>,
    /// The regular expression of the texts that it takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pattern: Option<&'static str>,
}

/// A format, and a media type that it is sent as.
#[derive(Serialize, ToSchema)]
pub(super) struct FormatRow {
    format: &'static str,
    media_type: &'static str,
}

/// Answers with everything that can be asked for.
#[utoipa::path(
    get, path = "/v1/methods", operation_id = "methods",
    summary = "Every method, policy, parameter and format",
    description = "The table by which the service reads parameters.",
    responses(
        (status = 200, description = "Every method, policy, parameter and format", body = Methods),
        ProblemsOf::<401>, ProblemsOf::<429>,
    ),
    security((), ("key" = [])),
)]
pub(super) async fn list() -> Json<Methods> {
    Json(Methods {
        default: DEFAULT_METHOD.name(),
        methods: Method::ALL.iter().map(|&method| MethodRow::from(method)).collect(),
        policies: Policy::ALL.iter().map(|&policy| PolicyRow::from(policy)).collect(),
        parameters: TABLE.iter().map(ParameterRow::from).collect(),
        formats: offered()
            .map(|offer| FormatRow { format: offer.format.name(), media_type: offer.media_type })
            .collect(),
    })
}

impl From<Method> for MethodRow {
    fn from(method: Method) -> Self {
        let parameters = method.parameters(Target::Percent(DEFAULT_DENSITY));
        let output = Output::default();
        let options = MeshOptions { method, parameters, output, format: None, usual_format: None };
        let mut defaults = options.object();
        defaults.shift_remove("method");
        Self { name: method.name(), components: method.component_count(), defaults }
    }
}

impl From<Policy> for PolicyRow {
    fn from(policy: Policy) -> Self {
        Self { name: policy.name(), components: policy.component_count() }
    }
}

impl From<&Parameter> for ParameterRow {
    fn from(parameter: &Parameter) -> Self {
        let &Parameter { name, about, takes, .. } = parameter;
        let row = Self { name, about, ..Self::default() };
        let within = |r#type, least: Value, most: Value| Self {
            r#type,
            minimum: Some(least),
            maximum: Some(most),
            ..row
        };
        match takes {
            Takes::Decimal { least, most } => within("number", least.into(), most.into()),
            Takes::Whole { least, most } => within("integer", least.into(), most.into()),
            Takes::Flag => Self { r#type: "boolean", ..row },
            Takes::Word(allowed) => Self { r#type: "string", allowed: Some(allowed), ..row },
            Takes::Pattern(pattern) => Self { r#type: "string", pattern: Some(pattern), ..row },
        }
    }
}
