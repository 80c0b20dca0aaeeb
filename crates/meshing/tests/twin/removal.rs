//! Greedy point removal by trying each point: the picture is triangulated afresh without it and
//! compared as a whole.

use super::interpolation::{owner, total_error};
use super::metric;
use super::triangulation::{Triangle, triangulate};
use pixmesh_meshing::parameters::{ErrorMetric, Plan};
use pixmesh_meshing::{Image, Parameters, Point, Target};
use std::collections::HashSet;

/// Removes points in areas of one color, then each time the one whose removal raises the error
/// least, then by row and column, as the plan and the parameters say.
pub(crate) fn simplify(
    image: &Image,
    mut points: Vec<Point>,
    plan: Plan,
    parameters: &Parameters,
) -> Vec<Point> {
    let metric = parameters.error_metric;
    remove_featureless(image, &mut points, plan.size);
    let mut error = total_error(image, &triangulate(&points), metric);
    while let Some((after, p)) = least(image, &points, metric) {
        let good = match parameters.target {
            Target::Percent(_) | Target::Size(_) => true,
            Target::Psnr(least) => psnr_db(image, after) >= least,
            Target::MaxError(_) | Target::MaxDistance(_) => {
                unreachable!("tried with other targets only")
            }
            Target::MeanError(most) => metric::mean(metric, after, image) <= most,
        };
        let wanted = points.len() > plan.size && good;
        let improves = parameters.bad_point_removal && after < error;
        if !wanted && !improves {
            break;
        }
        points.retain(|&q| q != p);
        error = after;
    }
    points
}

/// Removes points that are at least six edges away from every face of several colors, until
/// `size` points are left. Those that stay are evenly spread along the rows: pictures are so small
/// that all points lie in one tile.
fn remove_featureless(image: &Image, points: &mut Vec<Point>, size: usize) {
    let triangles = triangulate(points);
    let mut near = corners_of_features(image, &triangles);
    for _ in 0..5 {
        let reached = triangles.iter().filter(|t| t.iter().any(|p| near.contains(p)));
        near = reached.flatten().copied().collect();
    }
    let is_featureless = |p: &Point| !near.contains(p) && !is_corner(image, *p);
    let featureless: Vec<Point> = points.iter().copied().filter(is_featureless).collect();
    let leaving = featureless.len().min(points.len().saturating_sub(size));
    let leaves = |i: usize| i * leaving / featureless.len() < (i + 1) * leaving / featureless.len();
    let left: Vec<usize> = (0..featureless.len()).filter(|&i| leaves(i)).collect();
    points.retain(|p| left.iter().all(|&i| featureless[i] != *p));
}

/// The corners of the faces whose corners and own points are of several colors.
fn corners_of_features(image: &Image, triangles: &[Triangle]) -> HashSet<Point> {
    let color = |p: Point| {
        let sample = |c| image.sample(c, p.x as usize, p.y as usize);
        (0..image.component_count()).map(sample).collect::<Vec<_>>()
    };
    let is_one_color = |t: &Triangle| t.iter().all(|&p| color(p) == color(t[0]));
    let mut features: HashSet<Point> =
        triangles.iter().filter(|t| !is_one_color(t)).flatten().copied().collect();
    for (y, x) in (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| (y, x))) {
        let p = Point::new(x as i32, y as i32);
        let triangle = triangles[owner(triangles, p)];
        if color(p) != color(triangle[0]) {
            features.extend(triangle);
        }
    }
    features
}

/// The least error that removing one point leaves, and that point. As the error before is
/// the same for all, this is the least difference too; points compare by row, then column.
fn least(image: &Image, points: &[Point], metric: ErrorMetric) -> Option<(u64, Point)> {
    let removable = points.iter().filter(|p| !is_corner(image, **p));
    let without = |p: Point| {
        let rest: Vec<Point> = points.iter().copied().filter(|&q| q != p).collect();
        (total_error(image, &triangulate(&rest), metric), p)
    };
    removable.map(|&p| without(p)).min()
}

fn is_corner(image: &Image, p: Point) -> bool {
    let at_end = |at: i32, side: usize| at == 0 || at == side as i32 - 1;
    at_end(p.x, image.width()) && at_end(p.y, image.height())
}

/// Peak signal-to-noise ratio of a squared error over all samples.
pub(crate) fn psnr_db(image: &Image, squared_error: u64) -> f64 {
    let count = image.component_count() * image.pixel_count();
    let mse = squared_error as f64 / count as f64;
    let largest = f64::from((1u32 << image.precision()) - 1);
    if squared_error == 0 { f64::INFINITY } else { 20.0 * (largest / mse.sqrt()).log10() }
}
