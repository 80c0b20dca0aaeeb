//! Greedy point removal by trying each point: the picture is triangulated afresh without it and
//! compared as a whole.

use super::interpolation::squared_error;
use super::triangulation::triangulate;
use pixmesh_meshing::{Image, Plan, Point};

/// Removes points, each time the one whose removal raises the squared error least, then by row
/// and column, as the plan and bad-point removal say.
pub(crate) fn simplify(
    image: &Image,
    mut points: Vec<Point>,
    plan: Plan,
    bad_point_removal: bool,
) -> Vec<Point> {
    let mut error = squared_error(image, &triangulate(&points));
    while let Some((after, p)) = least(image, &points) {
        let wanted = points.len() > plan.size
            && plan.minimum_psnr_db.is_none_or(|least| psnr_db(image, after) >= least);
        let improves = bad_point_removal && after < error;
        if !wanted && !improves {
            break;
        }
        points.retain(|&q| q != p);
        error = after;
    }
    points
}

/// The least squared error that removing one point leaves, and that point. As the error before is
/// the same for all, this is the least difference too; points compare by row, then column.
fn least(image: &Image, points: &[Point]) -> Option<(u64, Point)> {
    let removable = points.iter().filter(|p| !is_corner(image, **p));
    let without = |p: Point| {
        let rest: Vec<Point> = points.iter().copied().filter(|&q| q != p).collect();
        (squared_error(image, &triangulate(&rest)), p)
    };
    removable.map(|&p| without(p)).min()
}

fn is_corner(image: &Image, p: Point) -> bool {
    let at_end = |place: i32, side: usize| place == 0 || place == side as i32 - 1;
    at_end(p.x, image.width()) && at_end(p.y, image.height())
}

/// Peak signal-to-noise ratio of a squared error over all samples.
pub(crate) fn psnr_db(image: &Image, squared_error: u64) -> f64 {
    let count = image.component_count() * image.pixel_count();
    let mse = squared_error as f64 / count as f64;
    let largest = f64::from((1u32 << image.precision()) - 1);
    if squared_error == 0 { f64::INFINITY } else { 20.0 * (largest / mse.sqrt()).log10() }
}
