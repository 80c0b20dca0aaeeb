//! `GET /v1/methods`: every method, policy, parameter and format, from the parser's own table.

use crate::extract::accept::offered;
use axum::Json;
use pixmesh_engine::params::{
    DEFAULT_DENSITY, DEFAULT_METHOD, MeshOptions, Output, Parameter, TABLE, Takes,
};
use pixmesh_meshing::parameters::Policy;
use pixmesh_meshing::{Method, Target};
use serde_json::{Map, Value, json};

/// Answers with everything that can be asked for.
pub async fn list() -> Json<Value> {
    Json(json!({
        "default": DEFAULT_METHOD.name(),
        "methods": Method::ALL.iter().map(|&method| of_method(method)).collect::<Vec<_>>(),
        "policies": Policy::ALL.iter().map(|&policy| of_policy(policy)).collect::<Vec<_>>(),
        "parameters": TABLE.iter().map(of_parameter).collect::<Vec<_>>(),
        "formats": offered().map(|offer| json!({
            "format": offer.format.name(),
            "media_type": offer.media_type,
        })).collect::<Vec<_>>(),
    }))
}

/// A method: the components it is for (null for any), and what it sets each parameter to.
fn of_method(method: Method) -> Value {
    let parameters = method.parameters(Target::Percent(DEFAULT_DENSITY));
    let order = MeshOptions { method, parameters, output: Output::default(), format: None };
    let defaults: Map<String, Value> = TABLE
        .iter()
        .filter(|row| row.name != "method")
        .filter_map(|row| Some((row.name.to_owned(), row.value(&order)?)))
        .collect();
    json!({ "name": method.name(), "components": method.component_count(), "defaults": defaults })
}

fn of_policy(policy: Policy) -> Value {
    json!({ "name": policy.name(), "components": policy.component_count() })
}

fn of_parameter(parameter: &Parameter) -> Value {
    let Parameter { name, about, .. } = parameter;
    match parameter.takes {
        Takes::Decimal { least, most } => {
            json!({ "name": name, "about": about, "type": "number", "minimum": least, "maximum": most })
        }
        Takes::Whole { least, most } => {
            json!({ "name": name, "about": about, "type": "integer", "minimum": least, "maximum": most })
        }
        Takes::Flag => json!({ "name": name, "about": about, "type": "boolean" }),
        Takes::Word(allowed) => {
            json!({ "name": name, "about": about, "type": "string", "allowed": allowed })
        }
        Takes::Pattern(pattern) => {
            json!({ "name": name, "about": about, "type": "string", "pattern": pattern })
        }
    }
}
