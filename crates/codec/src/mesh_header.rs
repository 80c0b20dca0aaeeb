//! What is known of a mesh file before its vertices.

use crate::mesh_format::Format;
use crate::terrain::Terrain;
use pixmesh_meshing::Shape;

/// What a mesh file's header says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshHeader {
    /// [`Format::Model`], [`Format::Pmesh`], or [`Format::Progression`] for a pmesh that keeps the
    /// order of its vertices.
    pub format: Format,
    /// Of the image.
    pub shape: Shape,
    /// Vertices announced.
    pub vertices: usize,
    /// Whether the faces may have colours: always for MODEL, whose header does not say.
    pub is_flat: bool,
    /// What the samples mean, where the mesh is that of an elevation model.
    pub terrain: Option<Terrain>,
}
