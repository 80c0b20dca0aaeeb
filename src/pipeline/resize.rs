//! From the order of vertices that a job keeps to the mesh of any size, in any format.

use super::encode::encode;
use crate::extract::params::Output;
use crate::pool::Watch;
use crate::problem::{Problem, internal};
use pixmesh_codec::{Encodable, Format, Limits, PmeshError, read_progression_while};
use pixmesh_meshing::{Fidelity, ProgressionError};

/// A mesh of another size as bytes, with what is known of it.
#[derive(Debug)]
pub struct Resized {
    /// The mesh in the format asked for.
    pub bytes: Vec<u8>,
    /// Faces of the mesh.
    pub faces: usize,
    /// How close it is to the image.
    pub fidelity: Fidelity,
}

/// Reads the order from its pmesh, and writes the mesh of its first `size` vertices in a format.
///
/// # Errors
/// When the format cannot hold the result, or the watch stops the work.
pub fn resize(
    pmesh: impl AsRef<[u8]>,
    size: usize,
    format: Format,
    output: &Output,
    limits: &Limits,
    watch: &Watch,
) -> Result<Resized, Problem> {
    let damaged = |error| match error {
        ProgressionError::Cancelled(cancelled) => cancelled.into(),
        error => internal("the order of a job's vertices is damaged", &error),
    };
    watch.check()?;
    watch.begin("decode");
    let progression = match read_progression_while(pmesh.as_ref(), limits, &|| watch.check()) {
        Err(PmeshError::Cancelled(cancelled)) => return Err(cancelled.into()),
        read => {
            read.map_err(|error| internal("the order of a job's vertices cannot be read", &error))?
        }
    };
    drop(pmesh);
    let progression = progression.shortened(size).map_err(damaged)?;
    watch.check()?;
    watch.begin("triangulate");
    let mesh = progression.mesh(size, watch).map_err(damaged)?;
    let fidelity = progression.fidelity(size).map_err(damaged)?;
    let source = Encodable {
        fidelity: Some(&fidelity),
        progression: Some(&progression),
        ..Encodable::new(&mesh)
    };
    let bytes = encode(&source, format, &output.writing(None), watch)?;
    Ok(Resized { bytes, faces: mesh.faces().len(), fidelity })
}
