//! Greedy point removal: again and again, the vertex whose removal raises the error least.
//!
//! Laurent Demaret and Armin Iske, "Advances in digital image compression by adaptive thinning",
//! 2004, remove from a Delaunay triangulation of an image's points, again and again, the least
//! significant one. The significance of a vertex is the change of the error over the faces that its
//! removal replaces, in whole numbers. A removal changes the keys of its neighbours, some six.
//!
//! `greedy` is the loop and what one removal changes, `queue` the order, `star` the mesh. These
//! three, `hole` and `predicates` of `triangulation`, and `mod` and `scan_conversion` of
//! `face_error` are what runs for one removal by the squared error.
//!
//! `start` evaluates all vertices for the first time; `partition` lets threads remove from tiles.
//! Vertices in areas of one color leave before all others (see `featureless`).

pub(crate) mod conversion;
pub(crate) mod featureless;
mod greedy;
mod partition;
pub(crate) mod queue;
mod star;
mod start;
pub(crate) mod tile_order;

pub use greedy::Removal;
pub(crate) use greedy::StopRule;

use crate::control::{Cancelled, Control, free};
use crate::face_error::ErrorEvaluator;
use crate::image::{Image, Point};
use crate::parameters::choices::Parallel;
use crate::removal::conversion::mesh_of;
use crate::removal::greedy::remove_in_order;
use crate::removal::partition::{remove_in_rounds, tile_digits};
use crate::removal::star::ONE_TILE;
use crate::removal::start::{Start, prepare};
use crate::triangulation::{Face, Triangulation};

pub(crate) struct Simplified {
    /// The vertices left, by row, then column.
    pub(crate) points: Vec<Point>,
    /// The faces, counter-clockwise, each beginning with its smallest vertex, in ascending order.
    pub(crate) faces: Vec<Face>,
    pub(crate) removals: Vec<Removal>,
    pub(crate) error: u64,
}

/// Removes vertices of a triangulation of `image`, whose points are given by row, then column,
/// until the rule says stop. `measure` evaluates the rule's metric.
pub(crate) fn simplify_by(
    image: &Image,
    measure: &ErrorEvaluator<'_>,
    triangulation: Triangulation,
    rule: StopRule,
    parallel: Parallel,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let digits = match parallel {
        Parallel::Exact => ONE_TILE,
        Parallel::Tiles => tile_digits(triangulation.points.len(), rule).unwrap_or(ONE_TILE),
    };
    let mut start = prepare(image, triangulation, rule, measure, digits, control)?;
    if digits != ONE_TILE {
        remove_in_rounds(&mut start, measure, control)?;
        start.merge_tiles(control)?;
    }
    finish(start, measure, control)
}

fn finish(
    start: Start,
    measure: &ErrorEvaluator<'_>,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let Start { mut stars, mut queues, mut progress } = start;
    remove_in_order(stars.whole(), &mut queues, measure, &mut progress, control)?;
    let poller = &mut progress.poller(control);
    let (points, faces) = mesh_of(&stars.whole(), poller)?;
    queues.into_iter().try_for_each(|queue| free(queue.siblings, poller))?;
    free(stars.vertices.points, poller)?;
    free(stars.records, poller)?;
    Ok(Simplified { points, faces, removals: progress.removals, error: progress.error })
}

#[cfg(test)]
mod tests;
