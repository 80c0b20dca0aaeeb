//! Error weights of the lattice points of an image.

use crate::image::{ImageError, check_shape, flip_rows};
use std::fmt;
use std::sync::Arc;

/// Factors of the squared error of each lattice point, 0 to 255, for insertion, removal, refinement
/// and fitted values. Fidelity ignores weights.
///
/// Clones share their values.
///
/// ```
/// use pixmesh_meshing::{Method, Target, parameters::Weights};
///
/// let upper_row = Weights::from_top_down(2, 2, vec![255, 255, 0, 0])?;
/// assert_eq!(upper_row.values(), [0, 0, 255, 255]);
/// let parameters = Method::Mgprfs.parameters(Target::Size(4)).weights(Some(upper_row));
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
#[derive(Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Weights {
    width: usize,
    height: usize,
    values: Arc<Vec<u8>>,
}

impl Weights {
    /// Makes weights of rows that run from the top to the bottom.
    ///
    /// # Errors
    /// When no image has such a size, or there is not one weight for each lattice point.
    pub fn from_top_down(
        width: usize,
        height: usize,
        mut values: Vec<u8>,
    ) -> Result<Self, ImageError> {
        check_shape(width, height, u8::BITS as u8)?;
        flip_rows(&mut values, width);
        Self::from_bottom_up(width, height, values)
    }

    /// Makes weights of rows that run from the bottom to the top, as those of an image do.
    ///
    /// # Errors
    /// As [`from_top_down`](Self::from_top_down).
    pub fn from_bottom_up(
        width: usize,
        height: usize,
        values: Vec<u8>,
    ) -> Result<Self, ImageError> {
        check_shape(width, height, u8::BITS as u8)?;
        let (actual, expected) = (values.len(), width * height);
        if actual != expected {
            return Err(ImageError::WeightCount { actual, expected });
        }
        Ok(Self::from_kernel(width, height, values))
    }

    /// Weights that are known to be one for each lattice point of an image of an allowed size.
    pub(crate) fn from_kernel(width: usize, height: usize, values: Vec<u8>) -> Self {
        Self { width, height, values: Arc::new(values) }
    }

    /// Columns and rows of the image that the weights are for.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The weights: `values()[y * width + x]` is that of the point `(x, y)`, row 0 at the bottom.
    #[must_use]
    pub fn values(&self) -> &[u8] {
        &self.values
    }
}

impl fmt::Debug for Weights {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_tuple("Weights").field(&self.size()).finish_non_exhaustive()
    }
}
