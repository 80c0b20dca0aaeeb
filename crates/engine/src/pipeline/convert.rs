//! From MODEL to any other format: of a job's mesh, or of one that a client sends.

use super::encode::encode;
use crate::context::Context;
use crate::error::EngineError;
use crate::params::Output;
use pixmesh_codec::{Encodable, Format, Limits, read_model_while};
use pixmesh_meshing::parameters::Reconstruction;
use pixmesh_meshing::{Fidelity, Mesh, rasterize};

/// Reads a MODEL, and writes the mesh, or the picture rebuilt from it, in a format. JSON states the
/// fidelity where it is known.
///
/// # Errors
/// When the bytes are no MODEL, the format cannot hold the result, or the context stops the work.
pub fn convert(
    model: impl AsRef<[u8]>,
    fidelity: Option<Fidelity>,
    format: Format,
    output: &Output,
    limits: &Limits,
    context: &Context,
) -> Result<Vec<u8>, EngineError> {
    context.check()?;
    context.begin("decode");
    let mesh = read_model_while(model.as_ref(), limits, &|| context.check())?;
    drop(model);
    context.check()?;
    let mesh = rebuilt_by(mesh, output.reconstruction, context)?;
    let source = Encodable { fidelity: fidelity.as_ref(), ..Encodable::new(&mesh) };
    encode(&source, format, &output.writing(None), context)
}

/// The mesh whose picture is rebuilt in a way: linearly without colours of its faces; flat with the
/// best colour of each face for the picture that the mesh has.
pub(super) fn rebuilt_by(
    mesh: Mesh,
    reconstruction: Option<Reconstruction>,
    context: &Context,
) -> Result<Mesh, EngineError> {
    match reconstruction {
        Some(Reconstruction::Linear) => Ok(mesh.without_face_samples()),
        Some(Reconstruction::Flat) if mesh.face_samples().is_none() => {
            let picture = rasterize(&mesh, context)?;
            Ok(mesh.with_flat_colors(&picture, context)?.0)
        }
        _ => Ok(mesh),
    }
}
