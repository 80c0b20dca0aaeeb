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
    /// The text does not follow the format's rules, or ends early.
    #[error("{0}")]
    Malformed(String),
    /// A number is not finite.
    #[error("{field} must be a whole number, and '{found}' is not finite")]
    NotFinite {
        /// What the number means.
        field: &'static str,
        /// The number as it stands there.
        found: String,
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
    /// A face names a vertex that does not exist.
    #[error("the face names vertex {found}, but the {count} vertices count from 0")]
    IndexOutOfRange {
        /// The number as it stands there.
        found: String,
        /// Number of vertices.
        count: usize,
    },
    /// The parts make no mesh; vertices and faces count from 0.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The mesh is no longer wanted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
