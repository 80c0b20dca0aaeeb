//! Reading a mesh from any format that keeps it exactly: MODEL, pmesh, and pmesh with the order of
//! the vertices.

use crate::limits::Limits;
use crate::mesh_header::MeshHeader;
use crate::model::{ModelError, probe_model, read_model_while};
use crate::pmesh::{PmeshError, is_pmesh, probe_pmesh, read_pmesh_while};
use crate::wanted::Wanted;
use pixmesh_meshing::Mesh;
use thiserror::Error;

/// Why bytes are no mesh that can be read.
#[derive(Debug, Error)]
pub enum MeshFileError {
    /// The bytes are read as MODEL, and are none.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The bytes begin as a pmesh, and are none.
    #[error(transparent)]
    Pmesh(#[from] PmeshError),
}

/// Reads the header of a mesh file, which is a pmesh if it begins so, and else MODEL.
///
/// # Errors
/// When the header is damaged, or announces a mesh beyond the limits.
pub fn probe_mesh(bytes: &[u8], limits: &Limits) -> Result<MeshHeader, MeshFileError> {
    if is_pmesh(bytes) { Ok(probe_pmesh(bytes, limits)?) } else { Ok(probe_model(bytes, limits)?) }
}

/// Reads the mesh of a file as [`probe_mesh`] recognises it, for as long as it is wanted.
///
/// # Errors
/// When the bytes are no mesh, or one beyond the limits, or it is no longer wanted.
pub fn read_mesh_while(
    bytes: &[u8],
    limits: &Limits,
    wanted: &Wanted<'_>,
) -> Result<Mesh, MeshFileError> {
    if is_pmesh(bytes) {
        return Ok(read_pmesh_while(bytes, limits, wanted)?);
    }
    Ok(read_model_while(bytes, limits, wanted)?)
}
