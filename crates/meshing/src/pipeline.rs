//! From an image to its mesh: the stages of every method, in order.

use crate::alpha::has_alpha;
use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::half_edges::SortedMesh;
use crate::error::MeshingError;
use crate::face_error::bound::{Bound, Tolerance};
use crate::face_error::metrics::mean_error;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::guide::Guided;
use crate::image::{Image, Point};
use crate::model::flat_color::RowSums;
use crate::model::mesh::Mesh;
use crate::model::rasterize::rasterize;
use crate::parameters::{Connectivity, ErrorMetric, Parallel, Parameters, Plan, Target, Values};
use crate::points::bounded_insertion::points_within;
use crate::points::initial_points;
use crate::progress::Run;
use crate::quality::fidelity::{Fidelity, largest_squared_error};
use crate::refinement::batch_removal::remove_in_batches;
use crate::refinement::refine;
use crate::refinement::unconstrained::bounded::refine_within;
use crate::refinement::unconstrained::moves::Freedom;
use crate::refinement::unconstrained::refine_unconstrained;
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use crate::removal::featureless::remove_featureless;
use crate::removal::{Removal, Simplified, StopRule, simplify_by};
use crate::search::{bisect_size, count_meshes};
use crate::triangulation::{Face, Triangulation};
use std::borrow::Cow;

/// The search for a refined mesh of a quality ends when its two sizes differ by less than one part
/// in this many: a closer search costs more than it gains.
const REFINED_SEARCH_PRECISION: usize = 200;

/// A mesh that approximates an image, and how close it is.
///
/// ```
/// use pixmesh_meshing::{Approximation, Image, Method, Target, mesh_image};
/// let image = Image::from_top_down(16, 16, 8, vec![(0..=255).collect()])?;
/// let parameters = Method::Mgpr.parameters(Target::Size(40)).lists_removals(true);
/// let Approximation { mesh, plan, removals, .. } = mesh_image(&image, &parameters, &())?;
/// assert_eq!(mesh.points().len(), plan.initial_size - removals.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Approximation {
    /// The mesh.
    pub mesh: Mesh,
    /// How close the picture of the mesh, that of [`rasterize`](crate::rasterize), is to the image.
    pub fidelity: Fidelity,
    /// The numbers that the parameters mean for this image.
    pub plan: Plan,
    /// The vertices that greedy removal took out, in order, where the parameters want the list.
    pub removals: Vec<Removal>,
}

/// Makes a mesh of an image: chooses the initial points, triangulates them, removes the least
/// useful ones and refines the rest.
///
/// The same image and parameters give the same mesh, vertices by row, then column, faces in
/// ascending order, on every machine.
///
/// # Errors
/// When a parameter is out of its bounds or not defined for such an image, or the control cancels.
///
/// ```
/// use pixmesh_meshing::{Image, Method, Target, mesh_image};
/// let image = Image::from_top_down(16, 16, 8, vec![(0..=255).collect()])?;
/// let made = mesh_image(&image, &Method::Mgprfs.parameters(Target::Psnr(40.0)), &())?;
/// assert!(made.fidelity.psnr_db() >= 40.0 && made.mesh.points().len() < 256);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn mesh_image(
    image: &Image,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Approximation, MeshingError> {
    let plan = parameters.plan(image.shape())?;
    let is_bounded = parameters.target.is_quality();
    let is_weighted = parameters.weights.is_some() && !parameters.is_within();
    let by_search = is_bounded && (parameters.searches() || is_weighted);
    let made = if by_search {
        smallest_within(image, parameters, &Run::of(control, Stage::Search))?
    } else {
        let run = Run::of_mesh(control, image.shape(), parameters, &plan);
        mesh_by_plan(image, parameters, plan, &run)?
    };
    // All lattice points make a perfect mesh, some may not.
    if is_bounded
        && plan.initial_size < image.pixel_count()
        && !is_within(image, &made, parameters, control)?
    {
        let (parameter, points) = (parameters.target.parameter(), plan.initial_size);
        return Err(MeshingError::TargetMissed { parameter, points });
    }
    control.whole(1.0);
    Ok(made)
}

fn mesh_by_plan(
    image: &Image,
    parameters: &Parameters,
    mut plan: Plan,
    control: &dyn Control,
) -> Result<Approximation, MeshingError> {
    let guided = Guided::new(image, parameters, control)?;
    let bound = bound_of(image, parameters).filter(|_| parameters.is_within());
    let points = match bound {
        Some(bound) if parameters.inserts_within() => points_within(bound, control)?,
        _ => initial_points(&guided.image, &guided.parameters, plan.initial_size, control)?,
    };
    if parameters.inserts_within() {
        plan.initial_size = points.len();
    }
    let triangulation = Triangulation::new(points, control)?;
    if let Some(bound) = bound
        && !is_kept(bound, &triangulation, control)?
    {
        let (parameter, points) = (parameters.target.parameter(), plan.initial_size);
        return Err(MeshingError::TargetMissed { parameter, points });
    }
    let reduced = if parameters.is_flat() {
        reduce_for_flat_faces(&guided, triangulation, plan, control)?
    } else {
        reduce(&guided, bound, triangulation, plan, control)?
    };
    let Reduced { points, faces, removals, squared_error } = reduced;
    let removals = if parameters.lists_removals { removals } else { Vec::new() };
    let is_refined_within = bound.is_some() && parameters.refines();
    let (mesh, squared_error) = if parameters.is_unconstrained() || is_refined_within {
        let (mesh, squared_error) = unconstrain(image, &guided, bound, points, control)?;
        (mesh, Some(squared_error))
    } else {
        (Mesh::of_samples(image, points, faces, control)?, squared_error)
    };
    let (mut mesh, mut fidelity) = measured(mesh, squared_error, image, &guided, control)?;
    if parameters.covers_alpha
        && let Some(covering) = mesh.covering(image, control)?
    {
        (mesh, fidelity) = measured(covering, None, image, &guided, control)?;
    }
    Ok(Approximation { mesh, fidelity, plan, removals })
}

/// The largest error that the target allows.
fn bound_of<'a>(image: &'a Image, parameters: &Parameters) -> Option<Bound<'a>> {
    let tolerance = match parameters.target {
        Target::MaxError(most) => Tolerance::of_rounded(most),
        Target::MaxDistance(most) => Tolerance::of_surface(most),
        _ => return None,
    };
    let has_holes = parameters.holes && has_alpha(image.component_count());
    Some(Bound { image, tolerance, has_holes })
}

/// Whether every face of the triangulation keeps a bound; that of all points does.
fn is_kept(
    bound: Bound<'_>,
    triangulation: &Triangulation,
    control: &dyn Control,
) -> Result<bool, Cancelled> {
    if triangulation.points.len() == bound.image.pixel_count() {
        return Ok(true);
    }
    let (faces, _) = triangulation.origins.as_chunks::<3>();
    let poller = &mut Poller::new(control, Stage::Triangulate, faces.len(), faces.len());
    for face in faces {
        poller.poll()?;
        let corners = face.map(|v| triangulation.points[v as usize]);
        if !bound.is_kept_by_samples(corners, poller)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The mesh, with colours of its faces where these are flat, and how close it is to the image.
fn measured(
    mesh: Mesh,
    squared_error: Option<u64>,
    image: &Image,
    guided: &Guided<'_>,
    control: &dyn Control,
) -> Result<(Mesh, Fidelity), Cancelled> {
    if guided.parameters.is_flat() {
        return mesh.with_weighted_colors(image, guided.weights(), control);
    }
    let known = squared_error.map_or_else(|| squared_error_of(&mesh, image, control), Ok);
    Ok((mesh, Fidelity::new(known?, image.shape())))
}

struct Reduced {
    points: Vec<Point>,
    faces: Vec<Face>,
    removals: Vec<Removal>,
    /// The squared error of the image's approximation, where it is known already.
    squared_error: Option<u64>,
}

impl Reduced {
    fn of_triangulation(
        triangulation: Triangulation,
        removals: Vec<Removal>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let faces = triangulation.faces(control)?;
        let points = triangulation.into_points(control)?;
        Ok(Self { points, faces, removals, squared_error: None })
    }
}

/// Removes the least useful points, then moves and exchanges the others.
fn reduce(
    guided: &Guided<'_>,
    bound: Option<Bound<'_>>,
    triangulation: Triangulation,
    plan: Plan,
    control: &dyn Control,
) -> Result<Reduced, Cancelled> {
    let Parameters { error_metric, effort, .. } = guided.parameters;
    if !guided.parameters.simplifies(&plan) {
        return Reduced::of_triangulation(triangulation, Vec::new(), control);
    }
    let count = triangulation.points.len();
    let poller = &mut Poller::new(control, Stage::Triangulate, count, count);
    let evaluator = ErrorEvaluator::new(&guided.image, error_metric, guided.weights(), poller)?;
    let moves = effort > 0 && bound.is_none();
    let evaluator = if moves { evaluator.with_model(poller)? } else { evaluator.within(bound) };
    let reduced = remove(guided, &evaluator, triangulation, plan, control)?;
    if !moves {
        return Ok(reduced);
    }
    let (errors, sides) = (FaceErrors::new(&evaluator), guided.image.sides());
    let mut mesh = MeasuredMesh::new(reduced.points, sides, errors, Stage::Refine, control)?;
    let SortedMesh { points, faces, .. } = refine(&mut mesh, effort, control)?;
    let squared_error = guided.has_squared_errors().then_some(mesh.triangulation.total_error);
    Ok(Reduced { points, faces, removals: reduced.removals, squared_error })
}

/// Removes the points of featureless areas, then those whose removal raises the error least.
/// Without removal a mesh keeps the points of error diffusion, about as many as the plan's size.
fn remove(
    guided: &Guided<'_>,
    evaluator: &ErrorEvaluator<'_>,
    triangulation: Triangulation,
    plan: Plan,
    control: &dyn Control,
) -> Result<Reduced, Cancelled> {
    let Plan { size, initial_size } = plan;
    let Parameters { target, error_metric: metric, bad_point_removal, parallel, .. } =
        guided.parameters;
    if initial_size == size && !target.is_quality() && !bad_point_removal {
        return Reduced::of_triangulation(triangulation, Vec::new(), control);
    }
    let image = &guided.image;
    let surplus = triangulation.points.len().saturating_sub(size);
    let lists_removals = guided.parameters.lists_removals;
    let is_within = guided.parameters.is_within();
    // A gray picture has such areas where the picture itself has features, and so have holes.
    let (triangulation, featureless) = match guided.image {
        Cow::Owned(_) if is_within => (triangulation, Vec::new()),
        _ if guided.parameters.holes => (triangulation, Vec::new()),
        _ => remove_featureless(image, triangulation, surplus, lists_removals, control)?,
    };
    let bound = match target {
        Target::Psnr(least) => Some(largest_squared_error(least, image.shape())),
        Target::MeanError(most) => Some(metric.largest_sum(most, image)),
        _ => None,
    };
    let rule = StopRule { size, bound, bad_point_removal, lists_removals };
    let parallel = if is_within { Parallel::Exact } else { parallel };
    let Simplified { points, faces, mut removals, error } =
        simplify_by(image, evaluator, triangulation, rule, parallel, control)?;
    let squared_error = guided.has_squared_errors().then_some(error);
    removals.splice(0..0, featureless);
    Ok(Reduced { points, faces, removals, squared_error })
}

/// Removes and refines by the errors of faces of one colour each.
fn reduce_for_flat_faces(
    guided: &Guided<'_>,
    triangulation: Triangulation,
    plan: Plan,
    control: &dyn Control,
) -> Result<Reduced, Cancelled> {
    let (points, sides) = (triangulation.into_points(control)?, guided.image.sides());
    let sums = RowSums::new(&guided.image, guided.weights(), Stage::Refine, control)?;
    let mut mesh = MeasuredMesh::new(points, sides, &sums, Stage::Refine, control)?;
    let surplus = mesh.triangulation.vertex_count().saturating_sub(plan.size);
    let count = if plan.initial_size == plan.size { 0 } else { surplus };
    let removals = remove_in_batches(&mut mesh, count, |_| {}, control)?;
    let SortedMesh { points, faces, .. } = refine(&mut mesh, guided.parameters.effort, control)?;
    drop(mesh);
    sums.free(control)?;
    Ok(Reduced { points, faces, removals, squared_error: None })
}

fn unconstrain(
    image: &Image,
    guided: &Guided<'_>,
    bound: Option<Bound<'_>>,
    points: Vec<Point>,
    control: &dyn Control,
) -> Result<(Mesh, u64), Cancelled> {
    let parameters = &guided.parameters;
    let freedom = Freedom {
        connectivity: parameters.connectivity == Connectivity::Free,
        values: parameters.values == Values::Fitted,
    };
    let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
    let mut evaluator = |w| {
        let evaluator = ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, w, poller)?;
        Ok(evaluator.within(bound))
    };
    let (unweighted, weights) = (evaluator(None)?, guided.weights());
    let weighted = weights.map(|weights| evaluator(Some(weights))).transpose()?;
    let guide = weighted.as_ref().unwrap_or(&unweighted);
    let mut mesh = ValuedMesh::new(image, weights, guide, points, control)?;
    let refine = if bound.is_some() { refine_within } else { refine_unconstrained };
    let SortedMesh { points, faces, order } =
        refine(&mut mesh, freedom, parameters.effort, control)?;
    if weighted.is_some() {
        mesh.errors = FaceErrors::new(&unweighted);
        mesh.measure(Stage::Measure, control)?;
    }
    let squared_error = mesh.triangulation.total_error;
    let samples = order.iter().flat_map(|&v| mesh.values_of(v).iter().copied()).collect();
    Ok((Mesh::from_kernel(image.shape(), points, samples, faces), squared_error))
}

/// The smallest mesh found of the target's quality; that of all lattice points where none does.
fn smallest_within(
    image: &Image,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<Approximation, MeshingError> {
    let (mut meshes, mut best) = (0, None::<Approximation>);
    let mut mesh_of = |size: usize| {
        let parameters = parameters.clone().target(Target::Size(size));
        let progress = count_meshes(control, meshes);
        progress.poll(Stage::Search, 0, 1)?;
        meshes += 1;
        mesh_image(image, &parameters, &progress).map(|made| (made, meshes))
    };
    let all = image.pixel_count();
    let precision = if parameters.refines() { REFINED_SEARCH_PRECISION } else { usize::MAX };
    bisect_size(all, precision, |size| {
        let (made, meshes) = mesh_of(size)?;
        let progress = count_meshes(control, meshes);
        let keeps = is_within(image, &made, parameters, &progress)?;
        let is_smaller = |best: &Approximation| made.mesh.points().len() < best.mesh.points().len();
        if keeps && best.as_ref().is_none_or(is_smaller) {
            best = Some(made);
        }
        Ok::<_, MeshingError>(keeps)
    })?;
    match best {
        Some(best) => Ok(best),
        None => mesh_of(all).map(|(made, _)| made),
    }
}

pub(crate) fn is_within(
    image: &Image,
    made: &Approximation,
    parameters: &Parameters,
    control: &dyn Control,
) -> Result<bool, Cancelled> {
    Ok(match parameters.target {
        Target::Percent(_) | Target::Size(_) => true,
        Target::Psnr(least) => {
            made.fidelity.squared_error <= largest_squared_error(least, image.shape())
        }
        Target::MeanError(most) => {
            let rebuilt = rasterize(&made.mesh, control)?;
            mean_error(image, &rebuilt, parameters.metric_of_guide(), control)? <= most
        }
        Target::MaxDistance(_) if made.mesh.face_samples().is_none() => {
            let mesh = &made.mesh;
            let poller = &mut Poller::new(control, Stage::Measure, 0, mesh.faces().len());
            for &face in mesh.faces() {
                poller.poll()?;
                let values = |c| face.map(|v| mesh.vertex_samples(v as usize)[c]);
                if let Some(bound) = bound_of(image, parameters)
                    && !bound.is_kept(mesh.corners(face), values, poller)?
                {
                    return Ok(false);
                }
            }
            true
        }
        Target::MaxError(_) | Target::MaxDistance(_) => {
            let most = match parameters.target {
                Target::MaxError(most) => most,
                // Colours of faces are whole samples.
                Target::MaxDistance(most) => most.floor() as u16,
                _ => u16::MAX,
            };
            let rebuilt = rasterize(&made.mesh, control)?;
            for y in 0..image.height() {
                control.poll(Stage::Measure, y, image.height())?;
                let pairs = |c| image.row(c, y).iter().zip(rebuilt.row(c, y));
                let exceeds = |c| pairs(c).any(|(a, b)| a.abs_diff(*b) > most);
                if (0..image.component_count()).any(exceeds) {
                    return Ok(false);
                }
            }
            true
        }
    })
}

/// The squared error of an image's approximation by a mesh that carries its samples.
fn squared_error_of(mesh: &Mesh, image: &Image, control: &dyn Control) -> Result<u64, Cancelled> {
    let (faces, mut sum) = (mesh.faces(), 0);
    let poller = &mut Poller::new(control, Stage::Measure, 0, faces.len());
    let evaluator = ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, None, poller)?;
    let corners = |face: usize| mesh.corners(faces[face]);
    evaluator.for_each_part(faces.len(), corners, control, |errors| {
        sum += errors.iter().sum::<u64>();
    })?;
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::{Recorder, poller};
    use crate::face_error::FaceMeasure;
    use crate::face_error::tests::evaluator_of;
    use crate::parameters::{Method, Weights};
    use std::collections::HashSet;

    /// A square of slopes, 24 points a side.
    fn slopes() -> Image {
        let samples = (0..24 * 24).map(|i| (i * 37 % 101) as u16 + (i / 24) as u16).collect();
        Image::from_bottom_up(24, 24, 8, vec![samples]).unwrap()
    }

    #[test]
    fn target_quality_ignores_weights() {
        let image = slopes();
        let weights = (0..24 * 24).map(|i| (i % 24 * 10) as u8).collect();
        let weights = Weights::from_bottom_up(24, 24, weights).ok();
        let own = Method::Mgpr.parameters(Target::Psnr(35.0)).weights(weights);
        let of_size =
            |size| mesh_image(&image, &own.clone().target(Target::Size(size)), &()).unwrap();
        let found = mesh_image(&image, &own, &()).unwrap();
        assert!(found.fidelity.psnr_db() >= 35.0);
        let size = found.mesh.points().len();
        assert_eq!(of_size(size).fidelity, found.fidelity);
        assert!(size > 4 && of_size(size - 1).fidelity.psnr_db() < 35.0);
    }

    #[test]
    fn effort_lowers_the_error_at_the_same_size() {
        let image = slopes();
        let own = Method::Mgprfs.parameters(Target::Size(60)).lists_removals(true);
        let with = |effort| mesh_image(&image, &own.clone().effort(effort), &()).unwrap();
        let (simplified, refined) = (with(0), with(1));
        assert_eq!(refined.removals, simplified.removals);
        assert_eq!(refined.mesh.points().len(), simplified.mesh.points().len());
        assert!(refined.fidelity.squared_error < simplified.fidelity.squared_error);
        let measure = evaluator_of(&image);
        let removed: HashSet<Point> =
            simplified.removals.iter().map(|removal| removal.point).collect();
        assert!(simplified.mesh.points().iter().all(|point| !removed.contains(point)));
        let corners = simplified.mesh.faces().iter().map(|&face| simplified.mesh.corners(face));
        let mut errors = FaceErrors::new(&measure);
        let sum: u64 = corners.map(|corners| errors.error(corners, &mut poller()).unwrap()).sum();
        assert_eq!(simplified.fidelity.squared_error, sum);
    }

    #[test]
    fn lists_removals_on_request_only() {
        let own = Method::Mgpr.parameters(Target::Size(60));
        let made = mesh_image(&slopes(), &own, &()).unwrap();
        assert!(made.removals.is_empty());
        let listed = mesh_image(&slopes(), &own.lists_removals(true), &()).unwrap();
        assert_eq!(listed.removals.len(), 24 * 24 - 60);
        assert_eq!(listed.mesh, made.mesh);
    }

    #[test]
    fn polls_while_faces_are_measured() {
        let samples = (0..120 * 90).map(|i| (i * 37 % 101) as u16).collect();
        let image = Image::from_bottom_up(120, 90, 8, vec![samples]).unwrap();
        let mesh = mesh_image(&image, &Method::Mgpr.parameters(Target::Percent(100.0)), &());
        let (mesh, recorder) = (mesh.unwrap().mesh, Recorder::default());
        assert_eq!(squared_error_of(&mesh, &image, &recorder), Ok(0));
        assert_eq!(recorder.done(Stage::Measure, mesh.faces().len()), [0, 0, 8192, 16384]);
    }
}
