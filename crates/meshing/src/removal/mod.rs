//! Greedy point removal: the vertex whose removal raises the error least goes first.
//!
//! Laurent Demaret and Armin Iske, "Advances in digital image compression by adaptive thinning",
//! 2004, remove from a Delaunay triangulation of an image's points, again and again, the least
//! significant one. The change of the error is taken over the faces that change, with rounded
//! interpolants, in whole numbers; of equal changes the one of the first vertex by row, then column
//! counts as the least. A removal changes the keys of the vertex's neighbours alone, about six.
//! Vertices in areas of one color leave before all others (see `featureless`).

pub(crate) mod candidate;
pub(crate) mod featureless;
mod fill_cache;
mod group;
pub(crate) mod max_error;
mod partition;
mod progress;
pub(crate) mod queue;
mod star;
mod start;
pub(crate) mod vertex_order;
mod vertices;

pub use progress::Removal;
pub(crate) use progress::StopRule;

use crate::control::{Cancelled, Control};
use crate::face_error::ErrorEvaluator;
use crate::image::{Image, Point};
use crate::parameters::choices::Parallel;
use crate::removal::group::{Group, Selection};
use crate::removal::partition::tile_digits;
use crate::removal::progress::Progress;
use crate::removal::queue::Entry;
use crate::removal::start::{ONE_TILE, Start, prepare};
use crate::removal::vertices::Vertices;
use crate::triangulation::{Face, Triangulation};

/// What greedy removal leaves.
pub(crate) struct Simplified {
    /// The vertices left, by row, then column.
    pub(crate) points: Vec<Point>,
    /// The faces, counter-clockwise, each beginning with its smallest vertex, in ascending order.
    pub(crate) faces: Vec<Face>,
    /// The removals, in order.
    pub(crate) removals: Vec<Removal>,
    /// The sum of errors over the image, in the metric's whole numbers.
    pub(crate) error: u64,
}

/// Removes vertices of a triangulation of `image`, whose points are given by row, then column,
/// until the rule says stop.
#[cfg(test)]
pub(crate) fn simplify(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    parallel: Parallel,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let measure = ErrorEvaluator::new(image, rule.metric, None);
    simplify_by(image, &measure, triangulation, rule, parallel, control)
}

/// The same by a measure of the rule's metric that exists already.
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
        partition::remove_in_rounds(&mut start, measure, control)?;
        start.merge_tiles();
    }
    remove_in_order(start, measure, control)
}

/// Removes vertices in the exact order.
fn remove_in_order(
    start: Start,
    measure: &ErrorEvaluator<'_>,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let Start { vertices, mut stars, mut queues, mut progress } = start;
    let mut order = ExactOrder { vertices: &vertices, progress: &mut progress, control };
    Group::new(&vertices, measure, 0, &mut stars, &mut queues).remove_from(0, &mut order)?;
    let (points, faces) = vertices.mesh(&stars, || progress.poll(control))?;
    Ok(Simplified { points, faces, removals: progress.removals, error: progress.error })
}

/// Accepts removals until the rule says stop.
struct ExactOrder<'p> {
    vertices: &'p Vertices,
    progress: &'p mut Progress,
    control: &'p dyn Control,
}

impl Selection for ExactOrder<'_> {
    #[inline]
    fn accepts(&mut self, first: Entry) -> Result<bool, Cancelled> {
        self.progress.poll(self.control)?;
        Ok(!self.progress.must_stop(first.change))
    }

    #[inline]
    fn record(&mut self, removed: Entry) {
        self.progress.record(self.vertices.points[removed.vertex as usize], removed);
    }
}

#[cfg(test)]
mod tests;
