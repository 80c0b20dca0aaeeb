//! Examples in the document: real ones, from the same code that answers.

use crate::problem::Kind;
use pixmesh_codec::{Limits, decode, write_model};
use pixmesh_engine::params::{
    DEFAULT_DENSITY, DEFAULT_METHOD, MeshOptions, Parameter as Row, Takes,
};
use pixmesh_meshing::{Target, mesh_image};
use serde_json::{Value, json};

/// A picture that can be written in a document: a square on a ground, as plain graymap.
pub(in crate::routes) const PICTURE: &str = "P2\n6 5\n15\n0 0 0 0 0 0\n0 9 9 9 0 0\n0 9 9 9 0 0\n\
                                  0 9 9 9 0 0\n0 0 0 0 0 0\n";
/// Percent of its pixels.
const DENSITY: f64 = 40.0;

/// The mesh of the picture, as MODEL.
pub(super) fn model() -> String {
    let mut text = Vec::new();
    if let Ok(image) = decode(PICTURE.as_bytes(), &Limits::default())
        && let Ok(model) = mesh_image(&image, &order(DENSITY).parameters, &())
    {
        // Memory takes everything.
        let _ = write_model(&model.mesh, &mut text);
    }
    String::from_utf8(text).unwrap_or_default()
}

/// What a parameter is when it is not given; `None` for those that are nothing then, so that all
/// examples together are an order.
pub(super) fn value(row: &Row) -> Option<Value> {
    let shown = row.show(&order(DEFAULT_DENSITY))?;
    Some(match row.takes {
        Takes::Word(_) => shown.into(),
        _ => serde_json::from_str(&shown).unwrap_or(Value::String(shown)),
    })
}

fn order(density: f64) -> MeshOptions {
    let parameters = DEFAULT_METHOD.parameters(Target::Percent(density));
    MeshOptions {
        method: DEFAULT_METHOD,
        parameters,
        output: pixmesh_engine::params::Output::default(),
        format: None,
    }
}

/// A document of a kind of problem.
pub(in crate::routes) fn problem(kind: Kind) -> Value {
    let mut document = kind.document();
    document.insert("detail".into(), detail(kind).into());
    for (name, value) in members(kind) {
        document.insert(name.into(), value);
    }
    document.insert("request_id".into(), "01a1fdfd-8e1e-7599-b221-78796ef84ac3".into());
    Value::Object(document)
}

/// What is wrong, where more is said than the title.
fn detail(kind: Kind) -> &'static str {
    match kind {
        Kind::UnknownParameter => "there is no parameter 'desnity'",
        Kind::DuplicateParameter => "density is given more than once",
        Kind::ParameterMalformed => "density must be a decimal number such as 2 or 0.5",
        Kind::ParameterOutOfRange => "density is 101, but must lie in 0.000001 to 100",
        Kind::NotFinite => "density must be a finite number",
        Kind::ConflictingParameters => "density and size exclude each other: give one of them",
        Kind::BodyTooLarge => "the body is longer than the limit of 33554432 bytes",
        Kind::ImageTooLarge => {
            "an image of 10000x5000 has 50000000 pixels, more than the limit of 40000000: scale it \
             down first, or have the service started with a larger --max-pixels"
        }
        Kind::Overloaded => "10.250 s of work wait already, more than 10.000 s",
        Kind::QuotaExceeded => "the key's quota of 600 requests per minute is used up",
        Kind::Unauthorized => "a key is needed: send the header Authorization: Bearer KEY",
        _ => kind.title(),
    }
}

/// The members that programs can read.
fn members(kind: Kind) -> Vec<(&'static str, Value)> {
    let density = ("param", json!("density"));
    match kind {
        Kind::UnknownParameter => vec![("param", json!("desnity")), ("nearest", json!("density"))],
        Kind::DuplicateParameter | Kind::ParameterMalformed | Kind::NotFinite => vec![density],
        Kind::ConflictingParameters => vec![("param", json!("size"))],
        Kind::ParameterOutOfRange => vec![
            density,
            ("minimum", json!(0.000_001)),
            ("maximum", json!(100)),
            ("actual", json!("101")),
            ("nearest", json!(100)),
        ],
        Kind::BodyTooLarge => vec![
            ("setting", json!("--max-body")),
            ("limit", json!(33_554_432)),
            ("actual", json!(40_000_000)),
        ],
        Kind::ImageTooLarge => vec![
            ("limit", json!(40_000_000)),
            ("actual", json!(50_000_000)),
            ("setting", json!("--max-pixels")),
        ],
        Kind::Overloaded => vec![
            ("setting", json!("--queue-seconds")),
            ("limit", json!(10.0)),
            ("actual", json!(10.25)),
            ("retry_after_s", json!(12)),
        ],
        Kind::QuotaExceeded => vec![
            ("setting", json!("--key-requests-per-minute")),
            ("limit", json!(600)),
            ("retry_after_s", json!(1)),
        ],
        _ => Vec::new(),
    }
}
