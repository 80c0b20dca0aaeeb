//! What is kept of a job, one piece a line: its order, its picture's shape, its mesh's figures, its
//! problem, its name, a digest.

use pixmesh::problem::Problem;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::params::ParameterSet;
use pixmesh_jobs::record::{JobId, MeshFigures, PictureShape};
use serde_json::Value;

/// Reads what a damaged disk may have made of a record.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let mut lines = text.lines();
    let mut next = || lines.next().unwrap_or_default();
    let _ = ParameterSet::of_query(Some(next())).and_then(|set| set.finish());
    if let Ok(shape) = serde_json::from_str::<PictureShape>(next()) {
        let written = serde_json::to_string(&shape).expect("numbers are JSON");
        assert_eq!(serde_json::from_str::<PictureShape>(&written).ok(), Some(shape));
    }
    if let Ok(figures) = serde_json::from_str::<MeshFigures>(next()) {
        let written = serde_json::to_string(&figures).expect("figures are JSON");
        let again: MeshFigures = serde_json::from_str(&written).expect("what was written");
        assert_eq!(again.digest, figures.digest);
    }
    if let Ok(value) = serde_json::from_str::<Value>(next())
        && let Some(problem) = Problem::of_value(&value)
    {
        assert!(Problem::of_value(&problem.value()).is_some());
    }
    let name = next();
    if let Some(id) = JobId::parse(name) {
        assert_eq!(id.to_string(), name);
    }
    let name = next();
    if let Ok(digest) = name.parse::<Digest>() {
        assert_eq!(digest.to_string(), name);
    }
}
