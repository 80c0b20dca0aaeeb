//! From the order of vertices that a job keeps to the mesh of any size, in any format.

use super::convert::rebuilt_by;
use super::encode::encode;
use crate::context::Context;
use crate::error::EngineError;
use crate::params::Output;
use pixmesh_codec::{Encodable, Format, Limits, read_progression_while};
use pixmesh_meshing::Fidelity;

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
/// When the format cannot hold the result, or the context stops the work.
pub fn resize(
    pmesh: impl AsRef<[u8]>,
    size: usize,
    format: Format,
    output: &Output,
    limits: &Limits,
    context: &Context,
) -> Result<Resized, EngineError> {
    context.check()?;
    context.begin("decode");
    let progression = read_progression_while(pmesh.as_ref(), limits, &|| context.check())?;
    drop(pmesh);
    let progression = progression.shortened(size)?;
    context.check()?;
    context.begin("triangulate");
    let mesh = progression.mesh(size, context)?;
    let mesh = rebuilt_by(mesh, output.reconstruction, context)?;
    let fidelity = progression.fidelity(size)?;
    let source = Encodable {
        fidelity: mesh.face_samples().is_none().then_some(&fidelity),
        progression: Some(&progression),
        ..Encodable::new(&mesh)
    };
    let bytes = encode(&source, format, &output.writing(None), context)?;
    Ok(Resized { bytes, faces: mesh.faces().len(), fidelity })
}
