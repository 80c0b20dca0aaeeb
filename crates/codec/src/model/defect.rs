//! Why bytes are no MODEL, and in which line.

use crate::error::DecodeError;
use pixmesh_meshing::{Cancelled, MeshError};
use thiserror::Error;

/// The first defect found in what should be a MODEL, and its line.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("line {line}: {defect}")]
pub struct ModelError {
    /// The line, counted from 1; the last one for what is missing at the end.
    pub line: usize,
    /// What is wrong there.
    pub defect: ModelDefect,
}

/// What is wrong in a MODEL.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModelDefect {
    /// The file ends too early.
    #[error("the file ends where {field} is expected")]
    Missing {
        /// What is expected.
        field: &'static str,
    },
    /// Something else stands where a number or word is expected.
    #[error("{field} is expected, not '{found}'")]
    Unexpected {
        /// What is expected.
        field: &'static str,
        /// What stands there, cut after a few characters.
        found: String,
    },
    /// A number is not finite.
    #[error("{field} must be a whole number, and '{found}' is not finite")]
    NotFinite {
        /// What the number means.
        field: &'static str,
        /// The number as it stands there.
        found: String,
    },
    /// A number has a fraction or an exponent.
    #[error("{field} must be a whole number, not '{found}'")]
    NotInteger {
        /// What the number means.
        field: &'static str,
        /// The number as it stands there.
        found: String,
    },
    /// A number lies outside its bounds.
    #[error("{field} is {found}, outside of {minimum} to {maximum}")]
    OutOfRange {
        /// What the number means.
        field: &'static str,
        /// The number as it stands there.
        found: String,
        /// The least that it may be.
        minimum: u64,
        /// The most that it may be.
        maximum: u64,
    },
    /// The image is larger or smaller than allowed.
    #[error(transparent)]
    Size(DecodeError),
    /// The image would have more samples than allowed.
    #[error("{component_count} components make {samples} samples, more than the limit of {limit}")]
    TooManySamples {
        /// Components claimed.
        component_count: u64,
        /// Columns times rows times components; `u64::MAX` when it is that or more.
        samples: u64,
        /// The most samples allowed: four for each pixel allowed.
        limit: u64,
    },
    /// The rest of the file cannot hold what is announced.
    #[error("{count} {what} are announced, but the rest of the file holds {maximum} at the most")]
    TooMany {
        /// Vertices or faces.
        what: &'static str,
        /// How many are announced.
        count: u64,
        /// How many of the least length would fit.
        maximum: u64,
    },
    /// The number of edges contradicts those of vertices and faces.
    #[error(
        "{edges} edges are announced, but {vertices} vertices and {faces} faces have {expected}"
    )]
    EdgeCount {
        /// Edges announced.
        edges: u64,
        /// Vertices announced.
        vertices: u64,
        /// Faces announced.
        faces: u64,
        /// Edges by Euler's formula.
        expected: u64,
    },
    /// A face has other than three corners.
    #[error("the face has {found} corners where only triangles are allowed")]
    NotTriangle {
        /// The number as it stands there.
        found: String,
    },
    /// A face names a vertex that does not exist.
    #[error("the face names vertex {found}, but the {count} vertices count from 0")]
    IndexOutOfRange {
        /// The number as it stands there.
        found: String,
        /// Number of vertices.
        count: usize,
    },
    /// Something follows the last face.
    #[error("'{found}' follows the last face")]
    Trailing {
        /// What stands there, cut after a few characters.
        found: String,
    },
    /// The parts make no mesh; vertices and faces count from 0.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Nobody wants the mesh any more.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
