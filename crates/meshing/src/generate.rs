//! From an image to its mesh: the stages of every method, in order.

use crate::choices::{ErrorMetric, Meshed};
use crate::control::{Cancelled, Control, Stage};
use crate::face_error::{FaceErrors, Measure};
use crate::image::Image;
use crate::luma::luma;
use crate::mesh::{Face, Mesh, Point, Shape};
use crate::metrics::Fidelity;
use crate::parallel::in_parallel;
use crate::parameters::{ParameterError, Parameters, Plan};
use crate::sample_points::sample_points;
use crate::simplify::{Removal, Simplified, StopRule, simplify};
use crate::triangulation::Triangulation;
use thiserror::Error;

/// Faces measured between two polls of the control.
const FACES_PER_POLL: usize = 8192;

/// A mesh made of an image, with what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// The mesh.
    pub mesh: Mesh,
    /// How close the picture rebuilt from the mesh is to the image.
    pub fidelity: Fidelity,
    /// The numbers that the parameters meant for this image.
    pub plan: Plan,
    /// The vertices that greedy removal took out, in order.
    pub removals: Vec<Removal>,
}

/// Why no mesh was made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum GenerateError {
    /// A parameter is out of its bounds or not defined for such an image.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The control cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Makes a mesh of an image: chooses the initial points, triangulates them and removes the least
/// useful ones.
///
/// The same image and parameters give the same mesh, vertices by row, then column, faces in
/// ascending order, on every machine.
///
/// # Errors
/// When a parameter is out of its bounds or not defined for such an image, or the control cancels.
pub fn generate(
    image: &Image,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Model, GenerateError> {
    let plan = parameters.plan(image.shape())?;
    let Made { points, faces, removals, squared_error } = match parameters.meshed {
        Meshed::Components => triangulate_image(image, parameters, plan, control)?,
        Meshed::Luma => {
            let made = triangulate_image(&luma(image), &on_luma(parameters), plan, control)?;
            Made { squared_error: None, ..made }
        }
    };
    let squared_error = match squared_error {
        Some(known) => known,
        None => measure(image, &points, &faces, control)?,
    };
    let fidelity = Fidelity::of_sum(squared_error, image);
    let mesh = carry_samples(image, points, faces);
    Ok(Model { mesh, fidelity, plan, removals })
}

/// A triangulation made of an image.
struct Made {
    /// The vertices, by row, then column.
    points: Vec<Point>,
    /// The faces, each beginning with its smallest vertex, in ascending order.
    faces: Vec<Face>,
    removals: Vec<Removal>,
    /// The squared error of the image's approximation, where it is known already.
    squared_error: Option<u64>,
}

/// Chooses, triangulates and simplifies.
fn triangulate_image(
    image: &Image,
    parameters: &Parameters,
    plan: Plan,
    control: &dyn Control,
) -> Result<Made, Cancelled> {
    let points = sample_points(image, parameters, plan.initial_size, control)?;
    let triangulation = Triangulation::new(points, control)?;
    let Plan { size, initial_size, bound } = plan;
    let bad_point_removal = parameters.bad_point_removal;
    if initial_size == size && bound.is_none() && !bad_point_removal {
        // A one-shot mesh has the size that error diffusion gave it, a few points more or fewer.
        let faces = triangulation.faces();
        let points = triangulation.points;
        return Ok(Made { points, faces, removals: Vec::new(), squared_error: None });
    }
    let rule = StopRule { size, bound, metric: parameters.error_metric, bad_point_removal };
    let Simplified { points, faces, removals, error } =
        simplify(image, triangulation, rule, control)?;
    let squared_error = parameters.error_metric.is_squared_difference().then_some(error);
    Ok(Made { points, faces, removals, squared_error })
}

/// The parameters of a colour method for the luma, an image of one component.
fn on_luma(parameters: &Parameters) -> Parameters {
    let policy = parameters.policy.of_one_component();
    let error_metric = parameters.error_metric.of_one_component();
    Parameters { policy, error_metric, meshed: Meshed::Components, ..parameters.clone() }
}

/// The squared error of an image's approximation by a mesh.
fn measure(
    image: &Image,
    points: &[Point],
    faces: &[Face],
    control: &dyn Control,
) -> Result<u64, Cancelled> {
    let measure = Measure::for_few(image, ErrorMetric::MeanCompSe);
    let mut errors = vec![0; faces.len().min(FACES_PER_POLL)];
    let mut sum = 0;
    for (chunk, some) in faces.chunks(FACES_PER_POLL).enumerate() {
        control.poll(Stage::Measure, chunk * FACES_PER_POLL, faces.len())?;
        let errors = &mut errors[..some.len()];
        in_parallel(some, errors, control.threads(), |faces, errors| {
            let corners: Vec<[Point; 3]> =
                faces.iter().map(|face| face.map(|v| points[v as usize])).collect();
            let mut sums = Vec::with_capacity(faces.len());
            FaceErrors::new(&measure).errors(&corners, &mut sums);
            errors.copy_from_slice(&sums);
        });
        sum += errors.iter().sum::<u64>();
    }
    Ok(sum)
}

/// The mesh whose vertices carry the image's samples.
fn carry_samples(image: &Image, points: Vec<Point>, faces: Vec<Face>) -> Mesh {
    let samples = points
        .iter()
        .flat_map(|p| {
            let components = 0..image.component_count();
            components.map(|c| image.sample(c, p.x as usize, p.y as usize))
        })
        .collect();
    Mesh::from_kernel(image.shape(), points, samples, faces)
}

impl Image {
    /// Width, height, number of components and precision.
    #[must_use]
    pub fn shape(&self) -> Shape {
        Shape {
            width: self.width(),
            height: self.height(),
            component_count: self.component_count(),
            precision: self.precision(),
        }
    }
}
