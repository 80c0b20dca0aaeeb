//! Why bytes are no pmesh.

use crate::error::DecodeError;
use pixmesh_meshing::{Cancelled, MeshError, ProgressionError};
use thiserror::Error;

/// Why bytes are no pmesh.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PmeshError {
    /// The header does not begin as one does, or ends early.
    #[error("this is no pmesh: the header is wrong")]
    Header,
    /// A later version of the format.
    #[error("pmesh version {0} is not supported: 1 to 4 are")]
    Version(u8),
    /// What the file says of an elevation model is damaged.
    #[error("{0}")]
    Terrain(String),
    /// The image is larger than the limits allow.
    #[error(transparent)]
    Size(#[from] DecodeError),
    /// The number of vertices cannot be.
    #[error("{count} vertices are announced, but 4 to {most} are possible")]
    VertexCount {
        /// Vertices announced.
        count: usize,
        /// Lattice points of the image.
        most: usize,
    },
    /// The stream ends early, goes on too long, or is no deflate stream.
    #[error("the stream of the pmesh is damaged")]
    Stream,
    /// The file does not hold the order of importance.
    #[error(
        "this file holds one mesh and keeps no order of its vertices, which smaller meshes and the \
         format progression need: make it with the format progression"
    )]
    NoOrder,
    /// The points and samples make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The points make no progression.
    #[error(transparent)]
    Progression(#[from] ProgressionError),
    /// The result is no longer wanted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
