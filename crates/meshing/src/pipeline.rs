//! From an image to its mesh: the stages of every method, in order.

use crate::control::{Cancelled, Control, Stage};
use crate::density::luma::luma;
use crate::dynamic_mesh::MeasuredMesh;
use crate::face_error::metrics::mean_error;
use crate::face_error::{FaceErrors, Measure};
use crate::image::{Image, Point};
use crate::model::flat_color::{FlatColors, FlatFaces, RowSums};
use crate::model::mesh::Mesh;
use crate::model::rasterize::rasterize;
use crate::parallel::in_parallel;
use crate::parameters::choices::{Connectivity, ErrorMetric, Guide, Parallel, Values};
use crate::parameters::{ErrorBound, ParameterError, Parameters, Plan, Target};
use crate::points::sample_points;
use crate::quality::fidelity::Fidelity;
use crate::quality::ssim_weights::ruling_image;
use crate::refinement::batch_removal::remove_in_batches;
use crate::refinement::refine;
use crate::refinement::unconstrained::liberate;
use crate::refinement::unconstrained::moves::Freedom;
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use crate::removal::max_error::removals_within;
use crate::removal::{Removal, Simplified, StopRule, simplify, simplify_by};
use crate::search::{SearchProgress, bisect_size};
use crate::triangulation::{Face, Triangulation};
use std::cell::LazyCell;
use std::collections::HashSet;
use thiserror::Error;

/// A refined mesh of a wanted quality is searched until the sizes differ by less than this part:
/// more meshes cost more than they gain.
const REFINED_SEARCH_PRECISION: usize = 200;

/// Faces measured between two polls of the control.
const FACES_PER_POLL: usize = 8192;

/// A mesh made of an image, with what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Approximation {
    /// The mesh.
    pub mesh: Mesh,
    /// How close the picture rebuilt from the mesh is to the image.
    pub fidelity: Fidelity,
    /// The numbers that the parameters meant for this image.
    pub plan: Plan,
    /// The vertices that greedy removal took out, in order.
    pub removals: Vec<Removal>,
    /// In what the mesh goes beyond the model of the thesis, for whoever reads it.
    pub remarks: Vec<&'static str>,
    /// The best colours of the faces, where these have one each: then the fidelity is theirs.
    pub flat: Option<FlatColors>,
}

/// Why no mesh was made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshingError {
    /// A parameter is out of its bounds or not defined for such an image.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The control cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Makes a mesh of an image: chooses the initial points, triangulates them, removes the least
/// useful ones and refines what is left.
///
/// The same image and parameters give the same mesh, vertices by row, then column, faces in
/// ascending order, on every machine.
///
/// # Errors
/// When a parameter is out of its bounds or not defined for such an image, or the control cancels.
pub fn mesh_image(
    image: &Image,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Approximation, MeshingError> {
    let plan = parameters.plan(image.shape())?;
    if let Some(bound) = plan.bound
        && (parameters.searches() || image.weights().is_some())
    {
        return smallest_within(image, parameters, bound, control);
    }
    let ruling = ruling_image(image, parameters, control)?;
    let ruling = ruling.as_ref().unwrap_or(image);
    let Made { points, faces, removals, squared_error } = match parameters.guide {
        Guide::Components => triangulate_image(ruling, parameters, plan, control)?,
        Guide::Luma => {
            let made = triangulate_image(&luma(ruling), &on_luma(parameters), plan, control)?;
            Made { squared_error: None, ..made }
        }
    };
    let mut model = if parameters.connectivity == Connectivity::Free
        || parameters.values == Values::Fitted
    {
        let (mesh, squared_error) = liberate_mesh(image, points, &faces, parameters, control)?;
        let fidelity = Fidelity::of_sum(squared_error, image);
        Approximation { mesh, fidelity, plan, removals, remarks: remarks(parameters), flat: None }
    } else {
        let squared_error = match squared_error {
            Some(known) if ruling.weights().is_none() => known,
            _ => measure(image, &points, &faces, control)?,
        };
        let fidelity = Fidelity::of_sum(squared_error, image);
        let mesh = Mesh::of_samples(image, points, faces);
        Approximation { mesh, fidelity, plan, removals, remarks: remarks(parameters), flat: None }
    };
    if parameters.is_flat() {
        let flat = FlatColors::new(image, &model.mesh, control)?;
        model.fidelity = flat.fidelity;
        model.flat = Some(flat);
    }
    Ok(model)
}

/// The smallest mesh found that keeps the bound; that of all lattice points always does.
fn smallest_within(
    image: &Image,
    parameters: &Parameters,
    bound: ErrorBound,
    control: &dyn Control,
) -> Result<Approximation, MeshingError> {
    let (mut meshes, mut best) = (0, None::<Approximation>);
    let mut mesh_of = |size: usize| {
        let parameters = Parameters { target: Target::Size(size), ..parameters.clone() };
        let progress = SearchProgress { control, meshes };
        progress.poll(Stage::Search, 0, 1)?;
        meshes += 1;
        mesh_image(image, &parameters, &progress).map(|model| (model, meshes))
    };
    let all = image.pixel_count();
    let precision = if parameters.refines() { REFINED_SEARCH_PRECISION } else { usize::MAX };
    bisect_size(all, precision, |size| {
        let (model, meshes) = mesh_of(size)?;
        let progress = SearchProgress { control, meshes };
        let keeps = is_within(image, &model, parameters, bound, &progress)?;
        let is_smaller =
            |best: &Approximation| model.mesh.points().len() < best.mesh.points().len();
        if keeps && best.as_ref().is_none_or(is_smaller) {
            best = Some(model);
        }
        Ok::<_, MeshingError>(keeps)
    })?;
    match best {
        Some(model) => Ok(model),
        None => mesh_of(all).map(|(model, _)| model),
    }
}

/// Tells whether a mesh keeps a bound.
pub(crate) fn is_within(
    image: &Image,
    model: &Approximation,
    parameters: &Parameters,
    bound: ErrorBound,
    control: &dyn Control,
) -> Result<bool, Cancelled> {
    Ok(match bound {
        ErrorBound::PsnrDb(least) => model.fidelity.psnr_db() >= least,
        ErrorBound::MeanError(most) => {
            let metric = match parameters.guide {
                Guide::Components => parameters.error_metric,
                Guide::Luma => parameters.error_metric.of_one_component(),
            };
            mean_error(image, &rasterize(&model.mesh, control)?, metric) <= most
        }
        ErrorBound::MaxError(most) => largest_difference(image, &model.mesh, control)? <= most,
    })
}

/// The largest difference of any sample between an image and the picture that a mesh models.
fn largest_difference(image: &Image, mesh: &Mesh, control: &dyn Control) -> Result<u16, Cancelled> {
    let rebuilt = rasterize(mesh, control)?;
    let pairs = image.components().iter().zip(rebuilt.components());
    let differences = pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)));
    Ok(differences.max().unwrap_or(0))
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

/// Chooses, triangulates, simplifies and refines.
fn triangulate_image(
    image: &Image,
    parameters: &Parameters,
    plan: Plan,
    control: &dyn Control,
) -> Result<Made, Cancelled> {
    if parameters.is_flat() {
        return triangulate_for_flat(image, parameters, plan, control);
    }
    let (metric, size) = (parameters.error_metric, (image.width(), image.height()));
    if parameters.effort == 0 {
        let measure = LazyCell::new(|| Measure::new(image, metric));
        return simplify_image(image, &measure, parameters, plan, control);
    }
    let measure = LazyCell::new(|| Measure::with_model(image, metric));
    let made = simplify_image(image, &measure, parameters, plan, control)?;
    let Made { points, faces, removals, .. } = made;
    let errors = FaceErrors::new(&measure);
    let mesh = MeasuredMesh::new_on_all_threads(points, &faces, size, errors, control)?;
    let refined = refine(mesh, parameters.effort, control)?;
    let squared_error = metric.is_squared_difference().then_some(refined.total_error());
    let (points, faces, _) = refined.triangulation.mesh();
    Ok(Made { points, faces, removals, squared_error })
}

/// Chooses and triangulates, then simplifies and refines by the errors of flat faces.
fn triangulate_for_flat(
    image: &Image,
    parameters: &Parameters,
    plan: Plan,
    control: &dyn Control,
) -> Result<Made, Cancelled> {
    let points = sample_points(image, parameters, plan.initial_size, control)?;
    let triangulation = Triangulation::new(points, control)?;
    let (faces, size) = (triangulation.faces(), (image.width(), image.height()));
    let sums = RowSums::new(image);
    let mut mesh = MeasuredMesh::new(triangulation.points, &faces, size, FlatFaces::new(&sums));
    let surplus = mesh.vertex_count().saturating_sub(plan.size);
    let removals = if plan.initial_size == plan.size { 0 } else { surplus };
    let removals = remove_in_batches(&mut mesh, removals, |_| {}, control)?;
    let refined = refine(mesh, parameters.effort, control)?;
    let (points, faces, _) = refined.triangulation.mesh();
    Ok(Made { points, faces, removals, squared_error: None })
}

/// Chooses, triangulates and simplifies; a mesh of one shot needs no measure.
fn simplify_image<'m>(
    image: &Image,
    measure: &LazyCell<Measure<'m>, impl FnOnce() -> Measure<'m>>,
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
    if let Some(ErrorBound::MaxError(most)) = bound {
        return simplify_within(image, triangulation, rule, most, control);
    }
    let Simplified { points, faces, removals, error } =
        simplify_by(image, measure, triangulation, rule, parameters.parallel, control)?;
    let squared_error = parameters.error_metric.is_squared_difference().then_some(error);
    Ok(Made { points, faces, removals, squared_error })
}

/// What a mesh of these parameters is that one of the thesis is not.
fn remarks(parameters: &Parameters) -> Vec<&'static str> {
    let free = "connectivity free: the faces need not be those of the Delaunay triangulation";
    let fitted = "values fitted: the values need not be the image's samples";
    let free = (parameters.connectivity == Connectivity::Free).then_some(free);
    let fitted = (parameters.values == Values::Fitted).then_some(fitted);
    let flat = "reconstruction flat: made for one colour in each face";
    let flat = parameters.is_flat().then_some(flat);
    free.into_iter().chain(fitted).chain(flat).collect()
}

/// Flips edges and fits values as the parameters say; tells the squared error too.
fn liberate_mesh(
    image: &Image,
    points: Vec<Point>,
    faces: &[Face],
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<(Mesh, u64), Cancelled> {
    let freedom = Freedom {
        connectivity: parameters.connectivity == Connectivity::Free,
        values: parameters.values == Values::Fitted,
    };
    let mut mesh = ValuedMesh::new(image, points, faces);
    liberate(&mut mesh, freedom, parameters.effort, control)?;
    let (points, faces, order) = mesh.triangulation.mesh();
    let samples = order.iter().flat_map(|&v| mesh.values_of(v).iter().copied()).collect();
    Ok((Mesh::from_kernel(image.shape(), points, samples, faces), mesh.total_error))
}

/// Simplifies as far as no sample's error goes beyond a bound.
fn simplify_within(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    most: u16,
    control: &dyn Control,
) -> Result<Made, Cancelled> {
    let (initial, faces) = (triangulation.points.clone(), triangulation.faces());
    let mut removals = simplify(image, triangulation, rule, Parallel::Exact, control)?.removals;
    let count = removals_within(image, initial.clone(), &faces, &removals, most, control)?;
    removals.truncate(count);
    let gone: HashSet<Point> = removals.iter().map(|removal| removal.point).collect();
    let kept = initial.into_iter().filter(|point| !gone.contains(point)).collect();
    let triangulation = Triangulation::new(kept, &())?;
    let faces = triangulation.faces();
    Ok(Made { points: triangulation.points, faces, removals, squared_error: None })
}

/// The parameters of a colour method for the luma, an image of one component.
fn on_luma(parameters: &Parameters) -> Parameters {
    let policy = parameters.policy.of_one_component();
    let error_metric = parameters.error_metric.of_one_component();
    Parameters { policy, error_metric, guide: Guide::Components, ..parameters.clone() }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::parameters::Target;
    use crate::parameters::choices::Policy;
    use crate::parameters::method::Method;

    #[test]
    fn a_quality_is_one_of_the_picture_however_much_its_points_matter() {
        let samples = (0..24 * 24).map(|i| (i * 37 % 101) as u16 + (i / 24) as u16).collect();
        let image = Image::from_bottom_up(24, 24, 8, vec![samples]).unwrap();
        let weights = (0..24 * 24).map(|i| (i % 24 * 10) as u8).collect();
        let weighted = image.with_weights(weights).unwrap();
        let own = Method::Mgpr.parameters(Target::Psnr(35.0));
        let of_size = |size| {
            let target = Target::Size(size);
            mesh_image(&weighted, &Parameters { target, ..own.clone() }, &()).unwrap()
        };
        let found = mesh_image(&weighted, &own, &()).unwrap();
        assert!(found.fidelity.psnr_db() >= 35.0);
        let size = found.mesh.points().len();
        assert_eq!(of_size(size).fidelity, found.fidelity);
        assert!(size > 4 && of_size(size - 1).fidelity.psnr_db() < 35.0);
    }

    #[test]
    fn effort_improves_what_removal_leaves_and_none_leaves_it_as_it_is() {
        let samples = (0..24 * 24).map(|i| (i * 37 % 101) as u16 + (i / 24) as u16).collect();
        let image = Image::from_bottom_up(24, 24, 8, vec![samples]).unwrap();
        let own = Method::Mgprfs.parameters(Target::Size(60));
        let with = |effort| mesh_image(&image, &Parameters { effort, ..own.clone() }, &()).unwrap();
        let (simplified, refined) = (with(0), with(1));
        assert_eq!(refined.removals, simplified.removals);
        assert_eq!(refined.mesh.points().len(), simplified.mesh.points().len());
        assert!(refined.fidelity.squared_error < simplified.fidelity.squared_error);
        let measure = Measure::for_few(&image, ErrorMetric::MeanCompSe);
        let gone: HashSet<Point> = simplified.removals.iter().map(|gone| gone.point).collect();
        assert!(simplified.mesh.points().iter().all(|point| !gone.contains(point)));
        let corners =
            simplified.mesh.faces().iter().map(|f| f.map(|v| simplified.mesh.points()[v as usize]));
        let mut errors = FaceErrors::new(&measure);
        let sum: u64 = corners.map(|corners| errors.error(corners)).sum();
        assert_eq!(simplified.fidelity.squared_error, sum);
    }

    #[test]
    fn the_control_is_told_of_every_8192_faces_that_are_measured() {
        let (width, height) = (120, 90);
        let samples = (0..width * height).map(|i| (i * 37 % 101) as u16).collect();
        let image = Image::from_bottom_up(width, height, 8, vec![samples]).unwrap();
        let lattice =
            (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y)));
        let triangulation = Triangulation::new(lattice.collect(), &()).unwrap();
        let (faces, recorder) = (triangulation.faces(), Recorder::default());
        assert_eq!(measure(&image, &triangulation.points, &faces, &recorder), Ok(0));
        assert_eq!(recorder.done(Stage::Measure, faces.len()), [0, 8192, 16384]);
    }

    #[test]
    fn each_liberty_taken_has_a_remark_of_its_own() {
        let plain = Method::Optimal.parameters(Target::Size(50));
        assert_eq!(remarks(&plain), [] as [&str; 0]);
        let free = Parameters { connectivity: Connectivity::Free, ..plain };
        let fitted = Parameters { values: Values::Fitted, ..plain };
        let flat = Method::Flat.parameters(Target::Size(50));
        for (parameters, word) in [(&free, "connectivity"), (&fitted, "values"), (&flat, "flat")] {
            let remarks = remarks(parameters);
            assert!(remarks.len() == 1 && remarks[0].contains(word), "{remarks:?}");
        }
        let both = Parameters { values: Values::Fitted, ..free };
        assert_eq!(remarks(&both).len(), 2);
    }

    #[test]
    fn the_luma_is_meshed_as_a_picture_of_one_component() {
        let own = Method::Cgpr.parameters(Target::Size(50));
        for (&policy, &error_metric) in Policy::ALL.iter().zip(ErrorMetric::ALL.iter().cycle()) {
            let luma = on_luma(&Parameters { policy, error_metric, ..own.clone() });
            assert_eq!(luma.guide, Guide::Components);
            assert!(luma.policy.component_count().is_none_or(|count| count == 1), "{policy}");
            assert!(luma.error_metric.component_count().is_none_or(|count| count == 1));
            assert_eq!((luma.target, luma.generator), (own.target, own.generator));
        }
    }

    #[test]
    fn weights_given_lower_those_of_what_is_seen_and_never_to_nothing() {
        let samples = (0..24 * 24).map(|i| (i * 37 % 101) as u16 + (i / 24) as u16).collect();
        let image = Image::from_bottom_up(24, 24, 8, vec![samples]).unwrap();
        let own = Method::Mgpr.parameters(Target::Size(50));
        let parameters = Parameters { error_metric: ErrorMetric::Ssim, ..own };
        let seen = |image: &Image| {
            let ruling = ruling_image(image, &parameters, &()).unwrap().unwrap();
            ruling.weights().unwrap().to_vec()
        };
        let alone = seen(&image);
        assert!(alone.iter().any(|&weight| weight > 1));
        for given in [0, 1, 128, 255] {
            let weighted = image.clone().with_weights(vec![given; 24 * 24]).unwrap();
            for (&with, &without) in seen(&weighted).iter().zip(&alone) {
                let expected = f64::from(without) * f64::from(given) / 255.0;
                assert_eq!(f64::from(with), expected.ceil(), "{without} and {given}");
            }
        }
    }
}
