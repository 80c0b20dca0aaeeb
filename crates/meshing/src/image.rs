//! Planar integer images: the input of every method and the output of rasterisation.
//!
//! The coordinate convention of the crate: `x` grows to the right from 0 to `width - 1`, `y` grows
//! **upwards** from 0 to `height - 1`, so row 0 is the bottom row of the picture. Decoders yield
//! rows from the top; [`Image::from_top_down`] reverses them, and nothing else in this crate does.

use crate::alpha::{has_alpha, premultiply};
use std::fmt;
use thiserror::Error;

/// The most columns or rows an image may have, so that `2 * area` of any triangle and every product
/// of two coordinates fit into 64 bits.
pub const MAX_SIDE: usize = 1 << 20;

/// The most lattice points an image may have: a mesh of all of them has fewer than six times as
/// many half-edges, and these are numbered in 32 bits.
pub const MAX_POINTS: usize = u32::MAX as usize / 6;

/// A point of the image's lattice; `y` grows upwards.
///
/// ```
/// use pixmesh_meshing::Point;
/// let [first, second, third] = [(0, 3), (7, 3), (0, 4)].map(|(x, y)| Point::new(x, y));
/// assert!(first < second && second < third); // by row, then column
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Point {
    /// Row, `0..height`, 0 at the bottom. The first field, so points compare by row, then column.
    pub y: i32,
    /// Column, `0..width`.
    pub x: i32,
}

impl Point {
    /// The point in column `x` of row `y`.
    #[must_use]
    pub const fn new(x: i32, y: i32) -> Self {
        Self { y, x }
    }
}

/// Width, height, components and precision of the image that a mesh models.
///
/// ```
/// use pixmesh_meshing::{Image, Shape};
/// let image = Image::from_top_down(3, 2, 8, vec![vec![0; 6]])?;
/// assert_eq!(image.shape(), Shape { width: 3, height: 2, component_count: 1, precision: 8 });
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Shape {
    /// Columns, at least 2.
    pub width: usize,
    /// Rows, at least 2.
    pub height: usize,
    /// Components, at least 1.
    pub component_count: usize,
    /// Bits per sample, 1 to 16.
    pub precision: u8,
}

impl fmt::Display for Shape {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, component_count, precision } = self;
        write!(formatter, "{width}x{height} with {component_count} components of {precision} bits")
    }
}

/// Two images, or an image and a mesh, that cannot be compared.
///
/// ```
/// use pixmesh_meshing::{Fidelity, Image, MeshingError};
/// let image = |width| Image::from_top_down(width, 2, 8, vec![vec![0; 2 * width]]);
/// let refused = Fidelity::between(&image(2)?, &image(3)?, &());
/// assert!(matches!(refused, Err(MeshingError::Shape(_))));
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("images of different shape cannot be compared: {first} and {second}")]
pub struct ShapeMismatch {
    first: Shape,
    second: Shape,
}

impl ShapeMismatch {
    pub(crate) fn check(first: Shape, second: Shape) -> Result<(), Self> {
        if first == second { Ok(()) } else { Err(Self { first, second }) }
    }
}

/// An image of any number of components, each sample an integer of 1 to 16 bits.
///
/// Components are stored one after the other, each row by row from the bottom.
///
/// ```
/// use pixmesh_meshing::Image;
/// let image = Image::from_top_down(2, 2, 8, vec![vec![10, 20, 30, 40]])?;
/// assert_eq!(image.row(0, 0), [30, 40]); // row 0 is the bottom row
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    shape: Shape,
    components: Vec<Vec<u16>>,
}

/// Why samples do not make an image.
///
/// ```
/// use pixmesh_meshing::{Image, ImageError};
/// let short = Image::from_top_down(3, 2, 8, vec![vec![0; 5]]);
/// assert_eq!(short, Err(ImageError::SampleCount { component: 0, actual: 5, expected: 6 }));
/// ```
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each variant and its message explain the fields")]
pub enum ImageError {
    /// One row or one column cannot be triangulated.
    #[error(
        "an image of {width}x{height} cannot be meshed: two columns and two rows are the least"
    )]
    TooSmall { width: usize, height: usize },
    /// A side is longer than [`MAX_SIDE`], or there are more than [`MAX_POINTS`] lattice points.
    #[error(
        "an image of {width}x{height} is too large: {MAX_SIDE} columns and rows and {MAX_POINTS} \
         points are the most"
    )]
    TooLarge { width: usize, height: usize },
    /// The precision lies outside 1..=16.
    #[error("a precision of {0} bits is not supported: 1 to 16 are")]
    Precision(u8),
    /// There is no component.
    #[error("an image needs at least one component")]
    NoComponents,
    /// A component, counted from 0, does not hold `width * height` samples.
    #[error("component {component} holds {actual} samples where {expected} are needed")]
    SampleCount { component: usize, actual: usize, expected: usize },
    /// There is not one weight for each lattice point.
    #[error("{actual} weights where {expected} are needed")]
    WeightCount { actual: usize, expected: usize },
    /// A sample does not fit the precision.
    #[error(
        "component {component} holds the sample {sample}, more than the {maximum} that \
         {precision} bits allow"
    )]
    SampleRange { component: usize, sample: u16, maximum: u16, precision: u8 },
}

impl Image {
    /// Width, height, number of components and precision.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Makes an image of components with rows from the top to the bottom, as decoders give them.
    ///
    /// Each component has `width * height` samples in `0..=2^precision - 1`. The last of two or of
    /// four components is alpha, and the others are [premultiplied](crate::alpha).
    ///
    /// # Errors
    /// When a side is under 2 or over [`MAX_SIDE`], there are more than [`MAX_POINTS`] points or no
    /// component, the precision is not 1..=16, or a component has a wrong length or sample.
    pub fn from_top_down(
        width: usize,
        height: usize,
        precision: u8,
        mut components: Vec<Vec<u16>>,
    ) -> Result<Self, ImageError> {
        check_shape(width, height, precision)?;
        for samples in &mut components {
            flip_rows(samples, width);
        }
        Self::from_bottom_up(width, height, precision, components)
    }

    /// Makes an image of components whose rows run from the bottom to the top.
    ///
    /// `components[c][y * width + x]`, in `0..=2^precision - 1`, is a sample of component `c`.
    ///
    /// # Errors
    /// As [`from_top_down`](Self::from_top_down).
    pub fn from_bottom_up(
        width: usize,
        height: usize,
        precision: u8,
        components: Vec<Vec<u16>>,
    ) -> Result<Self, ImageError> {
        check_shape(width, height, precision)?;
        if components.is_empty() {
            return Err(ImageError::NoComponents);
        }
        let maximum = largest_sample(precision);
        for (component, samples) in components.iter().enumerate() {
            let (expected, actual) = (width * height, samples.len());
            if actual != expected {
                return Err(ImageError::SampleCount { component, actual, expected });
            }
            // The largest is found four times as fast as the first that is too large.
            let largest = samples.iter().fold(0, |largest, &sample| sample.max(largest));
            if largest > maximum
                && let Some(&sample) = samples.iter().find(|&&sample| sample > maximum)
            {
                return Err(ImageError::SampleRange { component, sample, maximum, precision });
            }
        }
        Ok(Self::from_kernel(width, height, precision, components))
    }

    /// The same image with its colours, which are straight, [premultiplied](crate::alpha) by its
    /// alpha, where it has one.
    ///
    /// ```
    /// use pixmesh_meshing::Image;
    /// let gray_alpha = vec![vec![200, 200, 200, 200], vec![0, 51, 51, 255]];
    /// let image = Image::from_top_down(2, 2, 8, gray_alpha)?.premultiplied();
    /// assert_eq!(image.components()[0], [40, 200, 0, 40]);
    /// # Ok::<(), pixmesh_meshing::ImageError>(())
    /// ```
    #[must_use]
    pub fn premultiplied(mut self) -> Self {
        let largest = self.max_sample();
        if has_alpha(self.component_count())
            && let Some((alphas, colors)) = self.components.split_last_mut()
        {
            colors.iter_mut().for_each(|color| premultiply(color, alphas, largest));
        }
        self
    }

    /// An image of parts that are valid by construction.
    pub(crate) fn from_kernel(
        width: usize,
        height: usize,
        precision: u8,
        components: Vec<Vec<u16>>,
    ) -> Self {
        let component_count = components.len();
        Self { shape: Shape { width, height, component_count, precision }, components }
    }

    /// An image of the same size and precision with other components, valid by construction.
    pub(crate) fn with_components(&self, components: Vec<Vec<u16>>) -> Self {
        Self::from_kernel(self.width(), self.height(), self.precision(), components)
    }

    /// Number of columns, at least 2.
    #[must_use]
    pub fn width(&self) -> usize {
        self.shape.width
    }

    /// Number of rows, at least 2.
    #[must_use]
    pub fn height(&self) -> usize {
        self.shape.height
    }

    pub(crate) fn sides(&self) -> (usize, usize) {
        (self.shape.width, self.shape.height)
    }

    /// Number of lattice points, `width * height`.
    #[must_use]
    pub fn pixel_count(&self) -> usize {
        self.shape.width * self.shape.height
    }

    /// Bits per sample, 1 to 16.
    #[must_use]
    pub fn precision(&self) -> u8 {
        self.shape.precision
    }

    /// The largest sample the precision allows, `2^precision - 1`.
    #[must_use]
    pub fn max_sample(&self) -> u16 {
        largest_sample(self.shape.precision)
    }

    /// Number of components, at least 1.
    #[must_use]
    pub fn component_count(&self) -> usize {
        self.components.len()
    }

    /// The components in order, each `width * height` samples, row 0 at the bottom.
    #[must_use]
    pub fn components(&self) -> &[Vec<u16>] {
        &self.components
    }

    /// The samples of component `c` in row `y`, from left to right.
    ///
    /// # Panics
    /// When `c` or `y` is out of range.
    #[must_use]
    pub fn row(&self, c: usize, y: usize) -> &[u16] {
        &self.components[c][y * self.shape.width..][..self.shape.width]
    }

    /// The sample of component `c` at `(x, y)`.
    ///
    /// # Panics
    /// When `c` or the position is out of range.
    #[must_use]
    pub fn sample(&self, c: usize, x: usize, y: usize) -> u16 {
        self.row(c, y)[x]
    }
}

pub(crate) fn largest_sample(precision: u8) -> u16 {
    u16::MAX >> (16 - precision)
}

pub(crate) fn check_shape(width: usize, height: usize, precision: u8) -> Result<(), ImageError> {
    if width < 2 || height < 2 {
        return Err(ImageError::TooSmall { width, height });
    }
    if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_POINTS {
        return Err(ImageError::TooLarge { width, height });
    }
    if !(1..=16).contains(&precision) {
        return Err(ImageError::Precision(precision));
    }
    Ok(())
}

pub(crate) fn flip_rows<T>(samples: &mut [T], width: usize) {
    let mut rows = samples.chunks_exact_mut(width);
    while let (Some(first), Some(last)) = (rows.next(), rows.next_back()) {
        first.swap_with_slice(last);
    }
}

/// The four corners of an image's lattice, by row, then column.
pub(crate) fn corner_points(width: usize, height: usize) -> [Point; 4] {
    let (right, top) = (width as i32 - 1, height as i32 - 1);
    [Point::new(0, 0), Point::new(right, 0), Point::new(0, top), Point::new(right, top)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn from_top_down_puts_the_bottom_row_first() {
        let image = Image::from_top_down(2, 3, 8, vec![vec![1, 2, 3, 4, 5, 6]]).unwrap();
        assert_eq!(image.row(0, 0), [5, 6]);
        assert_eq!(image.row(0, 2), [1, 2]);
        assert_eq!(image.sample(0, 1, 1), 4);
    }

    #[test]
    fn largest_shapes_are_valid() {
        assert_eq!(check_shape(MAX_SIDE, 2, 16), Ok(()));
        assert_eq!(check_shape(2, MAX_SIDE, 1), Ok(()));
        assert!(check_shape(2, MAX_SIDE + 1, 1).is_err());
        assert_eq!(check_shape(MAX_SIDE, MAX_POINTS / MAX_SIDE, 8), Ok(()));
        assert!(check_shape(MAX_SIDE, MAX_POINTS / MAX_SIDE + 1, 8).is_err());
    }

    #[test]
    fn errors_name_the_numbers() {
        let message = |result: Result<Image, ImageError>| result.unwrap_err().to_string();
        assert!(message(Image::from_bottom_up(1, 5, 8, vec![vec![0; 5]])).contains("1x5"));
        assert!(message(Image::from_bottom_up(5, 1, 8, vec![vec![0; 5]])).contains("5x1"));
        assert!(message(Image::from_bottom_up(2, 2, 0, vec![vec![0; 4]])).contains("0 bits"));
        assert!(message(Image::from_bottom_up(2, 2, 17, vec![vec![0; 4]])).contains("17 bits"));
        assert!(message(Image::from_bottom_up(2, 2, 8, vec![])).contains("component"));
        assert!(message(Image::from_bottom_up(2, 2, 8, vec![vec![0; 3]])).contains("3 samples"));
        assert!(
            message(Image::from_bottom_up(2, 2, 1, vec![vec![0, 1, 2, 0]])).contains("sample 2")
        );
        assert!(message(Image::from_bottom_up(MAX_SIDE + 1, 2, 1, vec![])).contains("1048577x2"));
    }
}
