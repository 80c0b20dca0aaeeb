//! Every size from one run: the vertices of a mesh in the order of their importance.
//!
//! Greedy removal takes one vertex after the other out; backwards that is an order in which each
//! prefix of four points or more is the mesh that removal passed through at that size, as the points alone say
//! what the preferred-directions Delaunay triangulation is. So one order holds every size, and a mesh
//! of it costs one triangulation. The squared errors of all sizes are known, too.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::error::MeshingError;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::guide::Guided;
use crate::image::{Image, ImageError, Point, Shape, ShapeMismatch, check_shape, corner_points};
use crate::model::mesh::{Mesh, MeshError, check_points, check_samples};
use crate::parameters::choices::{ErrorMetric, Parallel};
use crate::parameters::{MIN_SIZE, Parameters};
use crate::quality::fidelity::Fidelity;
use crate::removal::featureless::remove_featureless;
use crate::removal::{Removal, Simplified, StopRule, simplify_by};
use crate::triangulation::Triangulation;
use std::collections::HashMap;
use std::num::NonZeroUsize;
use thiserror::Error;

/// The vertices of a mesh, the most important first: the corners, then each before those that greedy
/// removal takes out before it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progression {
    shape: Shape,
    points: Vec<Point>,
    /// Vertex by vertex.
    samples: Vec<u16>,
    /// The squared errors of the meshes of 4 points, of 5, and so on to all.
    squared_errors: Vec<u64>,
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
    /// The squared errors are not one for each size.
    #[error("{actual} squared errors are given, but {expected} are needed")]
    ErrorCount {
        /// Squared errors given.
        actual: usize,
        /// One for each size.
        expected: usize,
    },
    /// The points and samples are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The control cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Progression {
    /// Orders the vertices of a mesh of an image by greedy removal down to the corners, by what the
    /// parameters say of errors, and the image's weights. The mesh's faces play no part.
    ///
    /// The meshes of all sizes are those that the simplification with these parameters passes
    /// through, where the mesh is what it left; of a refined mesh, those that it would pass through
    /// from there on.
    ///
    /// # Errors
    /// When the image has another shape than the mesh's, a parameter is not allowed for such an
    /// image, or the control cancels.
    pub fn new(
        image: &Image,
        mesh: &Mesh,
        parameters: &Parameters,
        control: &dyn Control,
    ) -> Result<Self, MeshingError> {
        ShapeMismatch::check(image.shape(), mesh.shape())?;
        parameters.check_components(image.component_count())?;
        parameters.check_weights((image.width(), image.height()))?;
        let (control, shape) = (&Ordering(control), mesh.shape());
        let mut sorted = mesh.points().to_vec();
        sorted.sort_unstable();
        let order = remove_all(image, sorted.clone(), parameters, control)?;
        let squared_errors = match order.squared_error {
            Some(last) => squared_errors(last, order.removals.iter().map(|removal| removal.change)),
            None => measured_errors(image, sorted, &order.removals, control)?,
        };
        let removed = order.removals.iter().rev().map(|removal| removal.point);
        let points: Vec<Point> =
            corner_points(shape.width, shape.height).into_iter().chain(removed).collect();
        let vertices: HashMap<Point, usize> =
            mesh.points().iter().enumerate().map(|(v, &point)| (point, v)).collect();
        let samples =
            points.iter().flat_map(|point| mesh.vertex_samples(vertices[point])).copied().collect();
        Ok(Self { shape, points, samples, squared_errors })
    }

    /// A progression of points in order, the corners first by row, then column, their samples,
    /// vertex by vertex, and the squared error of the mesh of each size from 4 up, as a file holds
    /// them.
    ///
    /// # Errors
    /// When the shape is not allowed, the corners are not first, the points or samples make no
    /// mesh, the errors are not one for each size, or the control cancels.
    pub fn from_parts(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        squared_errors: Vec<u64>,
        control: &dyn Control,
    ) -> Result<Self, ProgressionError> {
        check_shape(shape.width, shape.height, shape.precision)?;
        if points.get(..MIN_SIZE) != Some(&corner_points(shape.width, shape.height)[..]) {
            return Err(ProgressionError::Corners);
        }
        check_samples(shape, points.len(), &samples)?;
        let (actual, expected) = (squared_errors.len(), points.len() + 1 - MIN_SIZE);
        if actual != expected {
            return Err(ProgressionError::ErrorCount { actual, expected });
        }
        check_points(shape, &points, control).map_err(|error| match error {
            MeshError::Cancelled(cancelled) => cancelled.into(),
            defect => ProgressionError::Mesh(defect),
        })?;
        Ok(Self { shape, points, samples, squared_errors })
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

    /// The squared errors of the meshes of 4 points, of 5, and so on to all.
    #[must_use]
    pub fn squared_errors(&self) -> &[u64] {
        &self.squared_errors
    }

    /// How close the mesh of the `size` most important vertices is to the image.
    ///
    /// # Errors
    /// When the size is under 4 or more than there are points.
    pub fn fidelity(&self, size: usize) -> Result<Fidelity, ProgressionError> {
        self.check_size(size)?;
        Ok(Fidelity::new(self.squared_errors[size - MIN_SIZE], self.shape))
    }

    /// The progression of the `size` most important vertices.
    ///
    /// # Errors
    /// When the size is under 4 or more than there are points.
    pub fn shortened(mut self, size: usize) -> Result<Self, ProgressionError> {
        self.check_size(size)?;
        self.points.truncate(size);
        self.samples.truncate(size * self.shape.component_count);
        self.squared_errors.truncate(size + 1 - MIN_SIZE);
        Ok(self)
    }

    fn check_size(&self, size: usize) -> Result<(), ProgressionError> {
        let most = self.points.len();
        if !(MIN_SIZE..=most).contains(&size) {
            return Err(ProgressionError::Size { size, most });
        }
        Ok(())
    }

    /// The mesh of the `size` most important vertices, by row, then column: the one that greedy
    /// removal passed through at that size. Costs one triangulation.
    ///
    /// # Errors
    /// When the size is under 4 or more than there are points, or the control cancels.
    pub fn mesh(&self, size: usize, control: &dyn Control) -> Result<Mesh, ProgressionError> {
        self.check_size(size)?;
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_unstable_by_key(|&index| self.points[index]);
        let count = self.shape.component_count;
        let points: Vec<Point> = order.iter().map(|&index| self.points[index]).collect();
        let samples =
            order.iter().flat_map(|&index| &self.samples[index * count..][..count]).copied();
        let samples = samples.collect();
        let faces = Triangulation::new(points.clone(), control)?.faces(control)?;
        Ok(Mesh::from_kernel(self.shape, points, samples, faces))
    }
}

/// The removals of all points but the corners.
struct Removed {
    removals: Vec<Removal>,
    /// The squared error at the end, where the removals' changes are those of the squared error.
    squared_error: Option<u64>,
}

/// Removes all points of an image but the corners.
fn remove_all(
    image: &Image,
    points: Vec<Point>,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Removed, Cancelled> {
    let guided = Guided::new(image, parameters, control)?;
    let (image, metric) = (&guided.image, guided.parameters.error_metric);
    let triangulation = Triangulation::new(points, control)?;
    let surplus = triangulation.points.len() - MIN_SIZE;
    let (triangulation, mut removals) =
        remove_featureless(image, triangulation, surplus, true, control)?;
    let (size, bad_point_removal, lists_removals) = (MIN_SIZE, false, true);
    let rule = StopRule { size, bound: None, metric, bad_point_removal, lists_removals };
    let measure = ErrorEvaluator::new(image, metric, guided.weights());
    let Simplified { removals: others, error, .. } =
        simplify_by(image, &measure, triangulation, rule, Parallel::Exact, control)?;
    removals.extend(others);
    Ok(Removed { removals, squared_error: guided.has_squared_errors().then_some(error) })
}

/// The squared errors of all sizes from 4 up, by the one at the end of removal and its changes.
fn squared_errors(last: u64, changes: impl DoubleEndedIterator<Item = i64>) -> Vec<u64> {
    let before = |error: &mut u64, change: i64| {
        *error = error.wrapping_sub(change as u64);
        Some(*error)
    };
    std::iter::once(last).chain(changes.rev().scan(last, before)).collect()
}

/// The same, measured while the removals are made again.
fn measured_errors(
    image: &Image,
    points: Vec<Point>,
    removals: &[Removal],
    control: &dyn Control,
) -> Result<Vec<u64>, Cancelled> {
    let measure = ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, None);
    let numbers: Vec<usize> =
        removals.iter().filter_map(|removal| points.binary_search(&removal.point).ok()).collect();
    let (sides, errors) = (image.sides(), FaceErrors::new(&measure));
    let mut mesh = MeasuredMesh::new(points, sides, errors, Stage::Measure, control)?;
    let mut changes = Vec::with_capacity(numbers.len());
    for (made, &vertex) in numbers.iter().enumerate() {
        control.poll(Stage::Measure, made, numbers.len())?;
        changes.push(mesh.remove(vertex as u32));
    }
    Ok(squared_errors(mesh.total_error(), changes.into_iter()))
}

/// A control to which all work is the stage of ordering.
struct Ordering<'a>(&'a dyn Control);

impl Control for Ordering<'_> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        match stage {
            Stage::Simplify => self.0.poll(Stage::Order, done, total),
            // What comes before and after is short.
            Stage::Measure => self.0.poll(Stage::Order, total, total),
            _ => self.0.poll(Stage::Order, 0, total),
        }
    }

    fn threads(&self) -> NonZeroUsize {
        self.0.threads()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::method::Method;
    use crate::parameters::{InitialSize, Target, Weights};
    use crate::pipeline::mesh_image;
    use proptest::prelude::*;

    /// A picture of shapes and noise.
    fn picture(side: usize, component_count: usize) -> Image {
        let sample = |c: usize, i: usize| {
            let (x, y) = (i % side, i / side);
            let inside = (x / 9 + y / 7 + c).is_multiple_of(3);
            (if inside { 200 } else { 40 }) + ((i * 40_503 + c * 977) >> 5) as u16 % 19
        };
        let plane = |c| (0..side * side).map(|i| sample(c, i)).collect();
        Image::from_bottom_up(side, side, 8, (0..component_count).map(plane).collect()).unwrap()
    }

    /// Checks some sizes against the meshes that the same parameters make of that size.
    fn check(image: &Image, parameters: &Parameters, most: usize, sizes: &[usize]) {
        let of_size = |size| {
            let target = Target::Size(size);
            mesh_image(image, &Parameters { target, ..parameters.clone() }, &()).unwrap()
        };
        let mesh = of_size(most).mesh;
        let progression = Progression::new(image, &mesh, parameters, &()).unwrap();
        for &size in sizes {
            let model = of_size(size);
            assert_eq!(progression.mesh(size, &()).unwrap(), model.mesh, "{size}");
            assert_eq!(progression.fidelity(size), Ok(model.fidelity), "{size}");
        }
        let Progression { shape, points, samples, squared_errors } = progression.clone();
        let again = Progression::from_parts(shape, points, samples, squared_errors, &());
        assert_eq!(again.as_ref(), Ok(&progression));
        let short = progression.clone().shortened(MIN_SIZE).unwrap();
        assert_eq!(short.mesh(MIN_SIZE, &()), progression.mesh(MIN_SIZE, &()));
        assert_eq!(short.fidelity(MIN_SIZE), progression.fidelity(MIN_SIZE));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn each_prefix_is_the_mesh_that_simplification_passes_through(
            (width, height) in (3usize..12, 3usize..12),
            samples in prop::collection::vec(0u16..32, 144),
        ) {
            let image = Image::from_bottom_up(width, height, 8, vec![samples[..width * height].to_vec()]).unwrap();
            let most = width * height * 2 / 3;
            let sizes: Vec<usize> = (MIN_SIZE..=most).collect();
            check(&image, &Method::Mgpr.parameters(Target::Size(most)), most, &sizes);
        }
    }

    #[test]
    fn each_prefix_is_so_by_every_metric_with_weights_and_by_the_luma() {
        let image = picture(64, 3);
        let initial_size = InitialSize::Size(1600);
        let own = Parameters { initial_size, ..Method::Mgprfs.parameters(Target::Size(400)) };
        let sizes = [4, 5, 60, 399, 400];
        for &error_metric in ErrorMetric::ALL {
            check(&image, &Parameters { error_metric, ..own.clone() }, 400, &sizes);
        }
        let luma = Parameters { initial_size, ..Method::Cgprfsed.parameters(Target::Size(400)) };
        check(&image, &luma, 400, &sizes);
        let weights = (0..64 * 64).map(|i| (i % 64 * 4) as u8).collect();
        let weights = Weights::from_bottom_up(64, 64, weights).ok();
        check(&image, &own.weights(weights), 400, &sizes);
    }

    #[test]
    fn what_is_no_progression_is_refused() {
        let shape = Shape { width: 3, height: 3, component_count: 1, precision: 4 };
        let corners = corner_points(3, 3).to_vec();
        let of = |extra: &[Point], sample: u16| {
            let points = [&corners, extra].concat();
            let (samples, errors) = (vec![sample; points.len()], vec![0; points.len() - 3]);
            Progression::from_parts(shape, points, samples, errors, &())
        };
        assert!(of(&[Point::new(1, 1)], 15).is_ok());
        for (refused, word) in [
            (of(&[Point::new(1, 1)], 16), "maximum 15"),
            (of(&[Point::new(3, 1)], 1), "outside"),
            (of(&[Point::new(1, -1)], 1), "outside"),
            (of(&[Point::new(2, 2)], 1), "repeats"),
            (
                Progression::from_parts(shape, corners[..3].to_vec(), vec![0; 3], vec![], &()),
                "corners",
            ),
            (
                Progression::from_parts(shape, corners.clone(), vec![0; 3], vec![0], &()),
                "3 samples",
            ),
            (
                Progression::from_parts(shape, corners.clone(), vec![0; 4], vec![], &()),
                "0 squared errors",
            ),
        ] {
            assert!(refused.unwrap_err().to_string().contains(word), "{word}");
        }
        let small = of(&[], 0).unwrap();
        let message = small.mesh(5, &()).unwrap_err().to_string();
        assert_eq!(message, "size is 5, but must lie in 4 to 4");
    }

    #[test]
    fn the_parts_of_a_progression_are_handed_out_and_shortened() {
        let shape = Shape { width: 3, height: 4, component_count: 2, precision: 4 };
        let points = [&corner_points(3, 4)[..], &[Point::new(1, 2), Point::new(1, 1)]].concat();
        let samples: Vec<u16> = (1..=12).collect();
        let of = |points: &[Point], samples: &[u16], errors: &[u64]| {
            Progression::from_parts(shape, points.to_vec(), samples.to_vec(), errors.to_vec(), &())
        };
        let progression = of(&points, &samples, &[7, 5, 3]).unwrap();
        assert_eq!(progression.shape(), shape);
        assert_eq!(progression.points(), points);
        assert_eq!(progression.samples(), samples);
        assert_eq!(progression.squared_errors(), [7, 5, 3]);
        let short = progression.shortened(5).unwrap();
        assert_eq!(Ok(short), of(&points[..5], &samples[..10], &[7, 5]));
    }

    #[test]
    fn a_refusal_names_the_vertex() {
        let shape = Shape { width: 3, height: 4, component_count: 2, precision: 4 };
        let points = [&corner_points(3, 4)[..], &[Point::new(1, 2), Point::new(1, 1)]].concat();
        let of = |points: Vec<Point>, samples: Vec<u16>| {
            Progression::from_parts(shape, points, samples, vec![0; 3], &())
        };
        let mut repeated = points.clone();
        repeated[5] = points[4];
        let refused = MeshError::PointRepeated { vertex: 5, first: 4, x: 1, y: 2 };
        assert_eq!(of(repeated, vec![0; 12]), Err(refused.into()));
        let mut samples = vec![0; 12];
        samples[9] = 16;
        let refused = MeshError::SampleRange { vertex: 4, sample: 16, maximum: 15 };
        assert_eq!(of(points, samples), Err(refused.into()));
    }

    #[test]
    fn all_work_is_told_as_ordering() {
        struct Notes(std::sync::Mutex<Vec<(Stage, usize, usize)>>);
        impl Control for Notes {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                self.0.lock().unwrap().push((stage, done, total));
                Ok(())
            }
            fn threads(&self) -> NonZeroUsize {
                NonZeroUsize::new(5).unwrap()
            }
        }
        let notes = Notes(std::sync::Mutex::default());
        let ordering = Ordering(&notes);
        for (stage, done) in [(Stage::Triangulate, 2), (Stage::Simplify, 3), (Stage::Measure, 4)] {
            ordering.poll(stage, done, 9).unwrap();
        }
        assert_eq!(ordering.threads(), notes.threads());
        let told = notes.0.into_inner().unwrap();
        assert_eq!(told, [(Stage::Order, 0, 9), (Stage::Order, 3, 9), (Stage::Order, 9, 9)]);
    }
}
