//! Why there is no mesh of an image.

use crate::control::Cancelled;
use crate::image::ShapeMismatch;
use crate::parameters::ParameterError;
use thiserror::Error;

/// Why an image was not meshed, or an image and a mesh were not compared.
///
/// ```
/// use pixmesh_meshing::{Image, MeshingError, Method, Target, mesh_image};
/// let four_points = Image::from_top_down(2, 2, 8, vec![vec![0; 4]])?;
/// let refused = mesh_image(&four_points, &Method::Med.parameters(Target::Size(9)), &());
/// assert!(matches!(refused, Err(MeshingError::Parameter(_))));
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshingError {
    /// A parameter is out of its bounds or not defined for such an image.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The mesh of all initial points is not as good as the target asks for.
    #[error(
        "{parameter} asks for more than a mesh of {points} initial points has: give more of them, \
        or leave their number out"
    )]
    TargetMissed {
        /// Name of the target.
        parameter: &'static str,
        /// Initial points.
        points: usize,
    },
    /// Two images, or an image and a mesh, are of different shapes.
    #[error(transparent)]
    Shape(#[from] ShapeMismatch),
    /// The control cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
