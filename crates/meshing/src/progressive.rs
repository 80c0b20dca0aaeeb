//! Every size from one run: the vertices of a mesh in the order of their importance.
//!
//! Greedy removal takes one vertex after the other out; backwards that is an order in which each
//! prefix of four points or more is the mesh that removal passed through at that size, as the points alone say
//! what the preferred-directions Delaunay triangulation is. So one order holds every size, and a mesh
//! of it costs one triangulation.

use crate::choices::ErrorMetric;
use crate::control::{Cancelled, Control};
use crate::image::{Image, ImageError, check_shape};
use crate::mesh::{Mesh, MeshError, Point, Shape, corner_points};
use crate::parameters::MIN_SIZE;
use crate::simplify::{StopRule, simplify};
use crate::triangulation::{Triangulation, triangulate};
use std::collections::{HashMap, HashSet};
use thiserror::Error;

/// The vertices of a mesh, the most important first: the corners, then each before those that greedy
/// removal takes out before it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progression {
    shape: Shape,
    points: Vec<Point>,
    /// Vertex by vertex.
    samples: Vec<u16>,
}

/// Why points make no progression, or a progression no mesh.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProgressionError {
    /// The image's shape is not allowed.
    #[error(transparent)]
    Shape(#[from] ImageError),
    /// The first four points are not the corners.
    #[error("the first four points are not the image's corners")]
    Corners,
    /// A size out of range.
    #[error("size is {size}, but must lie in 4 to {most}")]
    Size {
        /// The size asked for.
        size: usize,
        /// The largest there is.
        most: usize,
    },
    /// The points and samples are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl Progression {
    /// Orders the vertices of a mesh of an image by greedy removal down to the corners, by the
    /// image's weights and a metric. The mesh's faces play no part.
    ///
    /// # Errors
    /// When the control cancels.
    pub fn new(
        image: &Image,
        mesh: &Mesh,
        metric: ErrorMetric,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let shape = mesh.shape();
        let mut sorted = mesh.points().to_vec();
        sorted.sort_unstable();
        let triangulation = Triangulation::new(sorted, control)?;
        let rule = StopRule { size: MIN_SIZE, bound: None, metric, bad_point_removal: false };
        let removals = simplify(image, triangulation, rule, control)?.removals;
        let removed = removals.iter().rev().map(|removal| removal.point);
        let points: Vec<Point> =
            corner_points(shape.width, shape.height).into_iter().chain(removed).collect();
        let vertices: HashMap<Point, usize> =
            mesh.points().iter().enumerate().map(|(v, &point)| (point, v)).collect();
        let samples =
            points.iter().flat_map(|point| mesh.vertex_samples(vertices[point])).copied().collect();
        Ok(Self { shape, points, samples })
    }

    /// A progression of points in order, the corners first by row, then column, and their samples,
    /// vertex by vertex, as a file holds them.
    ///
    /// # Errors
    /// When the shape is not allowed, the corners are not first, or the points or samples make no
    /// mesh.
    pub fn from_parts(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
    ) -> Result<Self, ProgressionError> {
        let Shape { width, height, component_count, precision } = shape;
        check_shape(width, height, precision)?;
        if points.get(..MIN_SIZE) != Some(&corner_points(width, height)[..]) {
            return Err(ProgressionError::Corners);
        }
        let (actual, expected) = (samples.len(), points.len() * component_count);
        if actual != expected {
            return Err(MeshError::SampleCount { actual, expected }.into());
        }
        let mut places = HashSet::with_capacity(points.len());
        let inside = |p: &Point| {
            (0..width as i64).contains(&p.x.into()) && (0..height as i64).contains(&p.y.into())
        };
        for (vertex, &Point { x, y }) in points.iter().enumerate() {
            if !inside(&points[vertex]) {
                return Err(MeshError::PointOutside { vertex, x, y, width, height }.into());
            }
            if !places.insert(points[vertex]) {
                let first = points.iter().position(|p| *p == points[vertex]).unwrap_or(vertex);
                return Err(MeshError::PointRepeated { vertex, first, x, y }.into());
            }
        }
        let maximum = crate::image::largest_sample(precision);
        if let Some(i) = samples.iter().position(|&sample| sample > maximum) {
            let (vertex, sample) = (i / component_count, samples[i]);
            return Err(MeshError::SampleRange { vertex, sample, maximum }.into());
        }
        Ok(Self { shape, points, samples })
    }

    /// Shape of the image.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The points, the most important first.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Their samples, vertex by vertex.
    #[must_use]
    pub fn samples(&self) -> &[u16] {
        &self.samples
    }

    /// The mesh of the `size` most important vertices, by row, then column: the one that greedy
    /// removal passed through at that size. Costs one triangulation.
    ///
    /// # Errors
    /// When the size is under 4 or more than there are points.
    pub fn mesh(&self, size: usize) -> Result<Mesh, ProgressionError> {
        let most = self.points.len();
        if !(MIN_SIZE..=most).contains(&size) {
            return Err(ProgressionError::Size { size, most });
        }
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_unstable_by_key(|&place| self.points[place]);
        let count = self.shape.component_count;
        let points: Vec<Point> = order.iter().map(|&place| self.points[place]).collect();
        let samples =
            order.iter().flat_map(|&place| &self.samples[place * count..][..count]).copied();
        let (samples, faces) = (samples.collect(), triangulate(&points));
        Ok(Mesh::from_kernel(self.shape, points, samples, faces))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::generate::generate;
    use crate::method::Method;
    use crate::parameters::Target;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn each_prefix_is_the_mesh_that_simplification_passes_through(
            (width, height) in (3usize..12, 3usize..12),
            samples in prop::collection::vec(0u16..32, 144),
        ) {
            let image = Image::new(width, height, 8, vec![samples[..width * height].to_vec()]).unwrap();
            let of_size = |size| {
                let parameters = Method::Mgpr.parameters(Target::Size(size));
                generate(&image, &parameters, &Unattended).unwrap().mesh
            };
            let most = width * height * 2 / 3;
            let metric = ErrorMetric::MeanCompSe;
            let progression =
                Progression::new(&image, &of_size(most), metric, &Unattended).unwrap();
            for size in MIN_SIZE..=most {
                prop_assert_eq!(progression.mesh(size).unwrap(), of_size(size));
            }
            let Progression { shape, points, samples } = progression.clone();
            prop_assert_eq!(Progression::from_parts(shape, points, samples), Ok(progression));
        }
    }

    #[test]
    fn what_is_no_progression_is_refused() {
        let shape = Shape { width: 3, height: 3, component_count: 1, precision: 4 };
        let corners = corner_points(3, 3).to_vec();
        let of = |extra: &[Point], sample: u16| {
            let points = [&corners, extra].concat();
            let samples = vec![sample; points.len()];
            Progression::from_parts(shape, points, samples)
        };
        assert!(of(&[Point::new(1, 1)], 15).is_ok());
        for (refused, word) in [
            (of(&[Point::new(1, 1)], 16), "maximum 15"),
            (of(&[Point::new(3, 1)], 1), "outside"),
            (of(&[Point::new(1, -1)], 1), "outside"),
            (of(&[Point::new(2, 2)], 1), "repeats"),
            (Progression::from_parts(shape, corners[..3].to_vec(), vec![0; 3]), "corners"),
            (Progression::from_parts(shape, corners.clone(), vec![0; 3]), "3 samples"),
        ] {
            assert!(refused.unwrap_err().to_string().contains(word), "{word}");
        }
        let small = of(&[], 0).unwrap();
        let message = small.mesh(5).unwrap_err().to_string();
        assert_eq!(message, "size is 5, but must lie in 4 to 4");
    }
}
