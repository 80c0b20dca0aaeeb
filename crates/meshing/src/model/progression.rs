//! Meshes of every size from one run: the vertices of a mesh by importance.
//!
//! Greedy removal takes one vertex after the other out. In the reverse order each prefix of four
//! points or more is the mesh that removal passed through at that size, because the points alone
//! determine the preferred-directions Delaunay triangulation. So one order holds the meshes of all
//! sizes, each costs one triangulation, and their squared errors are known.

use crate::control::{Cancelled, Control, Poller, Stage, Translated, collect};
use crate::dynamic_mesh::MeasuredMesh;
use crate::error::MeshingError;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::guide::Guided;
use crate::image::{Image, Point, Shape, ShapeMismatch, corner_points};
use crate::model::mesh::{Mesh, MeshError, check_vertices, sorted_points};
use crate::parameters::choices::{ErrorMetric, Parallel};
use crate::parameters::{MIN_SIZE, Parameters};
use crate::progress::Run;
use crate::quality::fidelity::Fidelity;
use crate::removal::featureless::remove_featureless;
use crate::removal::{Removal, Simplified, StopRule, simplify_by};
use crate::triangulation::Triangulation;
use thiserror::Error;

/// The vertices of a mesh, the most important first: the corners by row, then column, then the
/// others in the reverse order of their greedy removal.
///
/// ```
/// use pixmesh_meshing::{Image, Method, Progression, Target, mesh_image};
/// let image = Image::from_top_down(16, 16, 8, vec![(0..=255).collect()])?;
/// let parameters = Method::Mgprfs.parameters(Target::Size(40));
/// let mesh = mesh_image(&image, &parameters, &())?.mesh;
/// let progression = Progression::new(&image, &mesh, &parameters, &())?;
/// for size in [4, 10, 40] {
///     assert_eq!(progression.mesh(size, &())?.points().len(), size);
/// }
/// assert!(progression.fidelity(10)?.mse() >= progression.fidelity(40)?.mse());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progression {
    shape: Shape,
    points: Vec<Point>,
    samples: Vec<u16>,
    squared_errors: Vec<u64>,
}

/// Why parts make no progression, or a progression has no mesh of a size.
///
/// ```
/// use pixmesh_meshing::{Point, Progression, ProgressionError, Shape};
/// let shape = Shape { width: 2, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Point::new(x, y)).to_vec();
/// let smallest = Progression::from_parts(shape, corners, vec![0; 4], vec![0], &())?;
/// assert_eq!(smallest.mesh(3, &()), Err(ProgressionError::Size { size: 3, most: 4 }));
/// # Ok::<(), ProgressionError>(())
/// ```
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each variant and its message explain the fields")]
pub enum ProgressionError {
    /// The shape is not allowed, or the points and samples are not the vertices of a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The first four points are not the corners by row, then column.
    #[error("the first four points are not the image's corners")]
    Corners,
    /// A size out of range; the number of points is `most`.
    #[error("size is {size}, but must lie in 4 to {most}")]
    Size { size: usize, most: usize },
    /// The squared errors are not one for each size.
    #[error("{actual} squared errors are given, but {expected} are needed")]
    ErrorCount { actual: usize, expected: usize },
    /// The control cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Progression {
    /// Orders the vertices of a mesh of an image by greedy removal down to the corners, by the
    /// errors and weights of the parameters. The mesh's faces play no part.
    ///
    /// The meshes of all sizes are those that removal with these parameters passes through, if the
    /// mesh is what it left; of a refined mesh, those that removal passes through from there on.
    /// But vertices inside of large areas of one color come last, in descending order by row, then
    /// column, where a mesh of a size between has such vertices evenly spread.
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
        let shape = mesh.shape();
        ShapeMismatch::check(image.shape(), shape)?;
        parameters.check_components(shape.component_count)?;
        parameters.check_weights((shape.width, shape.height))?;
        let run = Run::of(control, Stage::Order);
        let control = &report_as_ordering(&run);
        let vertices = sorted_points(mesh.points(), &|| control.poll(Stage::Order, 0, 1))?;
        let sorted: Vec<Point> = vertices.iter().map(|&(point, _)| point).collect();
        let (removals, squared_error) = remove_all(image, sorted.clone(), parameters, control)?;
        let rank_of = |point: Point| vertices.partition_point(|vertex| vertex.0 < point);
        let removed = removals.iter().map(|removal| rank_of(removal.point));
        let ranks = collect(removed, || control.poll(Stage::Measure, 0, 1))?;
        let squared_errors = match squared_error {
            Some(last) => squared_errors(last, removals.iter().map(|removal| removal.change)),
            None => measured_errors(image, sorted, &ranks, control)?,
        };
        let corners = corner_points(shape.width, shape.height).map(rank_of).into_iter();
        let order = corners.chain(ranks.into_iter().rev()).map(|rank| vertices[rank]);
        let order: Vec<(Point, usize)> = order.collect();
        let points = order.iter().map(|&(point, _)| point).collect();
        let samples = order.iter().flat_map(|&(_, v)| mesh.vertex_samples(v)).copied().collect();
        run.whole(1.0);
        Ok(Self { shape, points, samples, squared_errors })
    }

    /// A progression of its parts: points by importance, the corners first by row, then column;
    /// their samples, vertex by vertex; and the squared errors of the meshes of 4 points and more.
    ///
    /// # Errors
    /// When the shape, points or samples are not those of a mesh, the corners are not first, the
    /// errors are not one for each size, or the control cancels.
    pub fn from_parts(
        shape: Shape,
        points: Vec<Point>,
        samples: Vec<u16>,
        squared_errors: Vec<u64>,
        control: &dyn Control,
    ) -> Result<Self, ProgressionError> {
        check_vertices(shape, &points, &samples, control).map_err(|error| match error {
            MeshError::Cancelled(cancelled) => cancelled.into(),
            defect => ProgressionError::Mesh(defect),
        })?;
        if points[..MIN_SIZE] != corner_points(shape.width, shape.height) {
            return Err(ProgressionError::Corners);
        }
        let (actual, expected) = (squared_errors.len(), points.len() + 1 - MIN_SIZE);
        if actual != expected {
            return Err(ProgressionError::ErrorCount { actual, expected });
        }
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
        let is_in_range = (MIN_SIZE..=most).contains(&size);
        if is_in_range { Ok(()) } else { Err(ProgressionError::Size { size, most }) }
    }

    /// The mesh of the `size` most important vertices, by row, then column: the one that greedy
    /// removal passed through at that size. Costs one triangulation.
    ///
    /// # Errors
    /// When the size is under 4 or more than there are points, or the control cancels.
    pub fn mesh(&self, size: usize, control: &dyn Control) -> Result<Mesh, ProgressionError> {
        self.check_size(size)?;
        let poll = || control.poll(Stage::Triangulate, 0, size);
        let order = sorted_points(&self.points[..size], &poll)?;
        let count = self.shape.component_count;
        let samples = order.iter().flat_map(|&(_, v)| &self.samples[v * count..][..count]);
        let samples = samples.copied().collect();
        let points: Vec<Point> = order.into_iter().map(|(point, _)| point).collect();
        let faces = Triangulation::new(points.clone(), control)?.faces(control)?;
        Ok(Mesh::from_kernel(self.shape, points, samples, faces))
    }
}

/// Removes all points of an image but the corners. Returns the squared error at the end too, where
/// the removals' changes are those of the squared error.
fn remove_all(
    image: &Image,
    points: Vec<Point>,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<(Vec<Removal>, Option<u64>), Cancelled> {
    let guided = Guided::new(image, parameters, control)?;
    let (image, metric) = (&guided.image, guided.parameters.error_metric);
    let triangulation = Triangulation::new(points, control)?;
    let surplus = triangulation.points.len() - MIN_SIZE;
    let (triangulation, mut removals) =
        remove_featureless(image, triangulation, surplus, true, control)?;
    let (size, bad_point_removal) = (MIN_SIZE, false);
    let rule = StopRule { size, bound: None, bad_point_removal, lists_removals: true };
    let poller = &mut Poller::new(control, Stage::Simplify, 0, surplus);
    let measure = ErrorEvaluator::new(image, metric, guided.weights(), poller)?;
    let Simplified { removals: others, error, .. } =
        simplify_by(image, &measure, triangulation, rule, Parallel::Exact, control)?;
    removals.extend(others);
    Ok((removals, guided.has_squared_errors().then_some(error)))
}

/// The squared errors of all sizes from 4 up, by the one at the end of removal and its changes.
fn squared_errors(last: u64, changes: impl DoubleEndedIterator<Item = i64>) -> Vec<u64> {
    let before = |error: &mut u64, change: i64| {
        *error = error.wrapping_sub(change as u64);
        Some(*error)
    };
    std::iter::once(last).chain(changes.rev().scan(last, before)).collect()
}

/// The same, measured while the vertices of these ranks are removed again.
fn measured_errors(
    image: &Image,
    sorted: Vec<Point>,
    ranks: &[usize],
    control: &dyn Control,
) -> Result<Vec<u64>, Cancelled> {
    let poller = &mut Poller::new(control, Stage::Measure, 0, ranks.len());
    let measure = ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, None, poller)?;
    let (sides, errors) = (image.sides(), FaceErrors::new(&measure));
    let mut mesh = MeasuredMesh::new(sorted, sides, errors, Stage::Measure, control)?;
    let mut changes = Vec::with_capacity(ranks.len());
    for (done, &vertex) in ranks.iter().enumerate() {
        poller.done = done;
        poller.poll()?;
        changes.push(mesh.remove(vertex as u32, poller)?);
    }
    Ok(squared_errors(mesh.triangulation.total_error, changes.into_iter()))
}

/// A control that reports all work as the stage of ordering, of which removal takes most.
fn report_as_ordering(control: &dyn Control) -> impl Control {
    let translate = |stage, done, total| match stage {
        Stage::Simplify => (Stage::Order, done, total),
        Stage::Measure => (Stage::Order, total, total),
        _ => (Stage::Order, 0, total),
    };
    Translated { control, translate }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use crate::parameters::{InitialSize, Method, Target, Weights};
    use crate::pipeline::mesh_image;
    use proptest::prelude::*;
    use std::num::NonZeroUsize;

    /// An image of shapes and noise.
    fn picture(side: usize, component_count: usize) -> Image {
        let sample = |c: usize, i: usize| {
            let (x, y) = (i % side, i / side);
            let inside = (x / 9 + y / 7 + c).is_multiple_of(3);
            (if inside { 200 } else { 40 }) + ((i * 40_503 + c * 977) >> 5) as u16 % 19
        };
        let plane = |c| (0..side * side).map(|i| sample(c, i)).collect();
        Image::from_bottom_up(side, side, 8, (0..component_count).map(plane).collect()).unwrap()
    }

    /// Compares some sizes with the meshes that the same parameters make of that size.
    fn check(image: &Image, parameters: &Parameters, most: usize, sizes: &[usize]) {
        let of_size = |size| {
            let target = Target::Size(size);
            mesh_image(image, &Parameters { target, ..parameters.clone() }, &()).unwrap()
        };
        let mesh = of_size(most).mesh;
        let progression = Progression::new(image, &mesh, parameters, &()).unwrap();
        for &size in sizes {
            let made = of_size(size);
            assert_eq!(progression.mesh(size, &()).unwrap(), made.mesh, "{size}");
            assert_eq!(progression.fidelity(size), Ok(made.fidelity), "{size}");
        }
        let Progression { shape, points, samples, squared_errors } = progression.clone();
        let again = Progression::from_parts(shape, points, samples, squared_errors, &());
        assert_eq!(again.as_ref(), Ok(&progression));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn prefixes_are_the_meshes_of_their_sizes(
            (width, height) in (3usize..12, 3usize..12),
            samples in prop::collection::vec(0u16..32, 144),
        ) {
            let samples = samples[..width * height].to_vec();
            let image = Image::from_bottom_up(width, height, 8, vec![samples]).unwrap();
            let most = width * height * 2 / 3;
            let sizes: Vec<usize> = (MIN_SIZE..=most).collect();
            check(&image, &Method::Mgpr.parameters(Target::Size(most)), most, &sizes);
        }
    }

    #[test]
    fn follows_every_metric_weights_and_luma() {
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

    const SHAPE: Shape = Shape { width: 3, height: 4, component_count: 2, precision: 4 };

    /// Six points of [`SHAPE`], the corners first.
    fn six_points() -> Vec<Point> {
        [&corner_points(3, 4)[..], &[Point::new(1, 2), Point::new(1, 1)]].concat()
    }

    fn of(
        points: &[Point],
        samples: &[u16],
        errors: &[u64],
    ) -> Result<Progression, ProgressionError> {
        Progression::from_parts(SHAPE, points.to_vec(), samples.to_vec(), errors.to_vec(), &())
    }

    #[test]
    fn keeps_and_shortens_its_parts() {
        let (points, samples): (_, Vec<u16>) = (six_points(), (1..=12).collect());
        let progression = of(&points, &samples, &[7, 5, 3]).unwrap();
        assert_eq!((progression.shape(), progression.points()), (SHAPE, &points[..]));
        assert_eq!(
            (progression.samples(), progression.squared_errors()),
            (&samples[..], &[7, 5, 3][..])
        );
        let message = progression.mesh(7, &()).unwrap_err().to_string();
        assert_eq!(message, "size is 7, but must lie in 4 to 6");
        let short = progression.shortened(5).unwrap();
        assert_eq!(Ok(short), of(&points[..5], &samples[..10], &[7, 5]));
    }

    #[test]
    fn refuses_parts_of_no_progression() {
        let (points, samples, errors) = (six_points(), [0; 12], [0; 3]);
        let mut repeated = points.clone();
        repeated[5] = points[4];
        let defect = MeshError::PointRepeated { vertex: 5, first: 4, x: 1, y: 2 };
        assert_eq!(of(&repeated, &samples, &errors), Err(defect.into()));
        let mut large = samples;
        large[9] = 16;
        let defect = MeshError::SampleRange { vertex: 4, sample: 16, maximum: 15 };
        assert_eq!(of(&points, &large, &errors), Err(defect.into()));
        let defect = MeshError::CornerMissing { x: 2, y: 3 };
        assert_eq!(of(&points[..3], &samples[..6], &[]), Err(defect.into()));
        let mut swapped = points.clone();
        swapped.swap(3, 4);
        assert_eq!(of(&swapped, &samples, &errors), Err(ProgressionError::Corners));
        let refused = ProgressionError::ErrorCount { actual: 2, expected: 3 };
        assert_eq!(of(&points, &samples, &errors[1..]), Err(refused));
    }

    #[test]
    fn reports_all_work_as_ordering() {
        let control = OnThreads(Recorder::default(), NonZeroUsize::MAX);
        for (stage, done) in [(Stage::Triangulate, 2), (Stage::Simplify, 3), (Stage::Measure, 4)] {
            report_as_ordering(&control).poll(stage, done, 9).unwrap();
        }
        assert_eq!(report_as_ordering(&control).threads(), NonZeroUsize::MAX);
        assert_eq!(control.0.done(Stage::Order, 9), [0, 3, 9]);
    }
}
