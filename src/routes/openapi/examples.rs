//! Examples in the document: real ones, from the same code that answers.

use crate::access::Standing;
use crate::extract::auth::{KEY_NEEDED, exhausted};
use crate::extract::upload::BodyLimit;
use crate::problem::{Kind, Problem};
use pixmesh_codec::{DecodeError, Limits, decode, write_model};
use pixmesh_engine::EngineError;
use pixmesh_engine::params::{
    DEFAULT_DENSITY, DEFAULT_METHOD, MeshOptions, Parameter as Row, ParameterSet,
};
use pixmesh_meshing::{Target, mesh_image};
use serde_json::Value;

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
    row.value(&order(DEFAULT_DENSITY))
}

fn order(density: f64) -> MeshOptions {
    let parameters = DEFAULT_METHOD.parameters(Target::Percent(density));
    MeshOptions {
        method: DEFAULT_METHOD,
        parameters,
        output: pixmesh_engine::params::Output::default(),
        format: None,
        usual_format: None,
    }
}

/// A document of a kind of problem: one that the service makes, or one with the title as its detail.
pub(in crate::routes) fn problem(kind: Kind) -> Value {
    let problem = refusal(kind).unwrap_or_else(|| Problem::new(kind, kind.title()));
    let mut document = problem.value();
    document["request_id"] = "01a1fdfd-8e1e-7599-b221-78796ef84ac3".into();
    document
}

/// A refusal of this kind, where more is said than the title.
fn refusal(kind: Kind) -> Option<Problem> {
    Some(match kind {
        Kind::UnknownParameter => of_query("desnity=2")?,
        Kind::DuplicateParameter => of_query("density=2&density=3")?,
        Kind::ParameterMalformed => of_query("density=two")?,
        Kind::ParameterOutOfRange => of_query("density=101")?,
        Kind::NotFinite => of_query("density=NaN")?,
        Kind::ConflictingParameters => of_query("density=2&size=100")?,
        Kind::BodyTooLarge => {
            BodyLimit { bytes: 32 << 20, setting: "--max-body" }.check(40_000_000).err()?
        }
        Kind::ImageTooLarge => {
            let (width, height) = (10_000, 5_000);
            let pixels = width * height;
            DecodeError::TooManyPixels { width, height, pixels, limit: 40_000_000 }.into()
        }
        Kind::Overloaded => {
            EngineError::QueueFull { waiting_s: 10.25, limit_s: 10.0, retry_after_s: 12 }.into()
        }
        Kind::QuotaExceeded => exhausted(Standing { per_minute: 600, remaining: 0, reset_s: 1 }),
        Kind::Unauthorized => Problem::new(kind, KEY_NEEDED),
        _ => return None,
    })
}

/// What is wrong with a query.
fn of_query(query: &str) -> Option<Problem> {
    let options = ParameterSet::of_query(Some(query)).and_then(|set| set.finish());
    options.err().map(Problem::from)
}
