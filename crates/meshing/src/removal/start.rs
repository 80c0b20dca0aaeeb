//! What removal starts from: the stars of a triangulation, and the queue of each tile.

use crate::control::{Cancelled, Control, Stage, Translated, collect, free};
use crate::face_error::ErrorEvaluator;
use crate::image::Image;
use crate::parallel::in_parallel;
use crate::removal::conversion::stars_of;
use crate::removal::greedy::{Evaluator, Progress, StopRule};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{AllStars, FillCache, Stars, Vertices};
use crate::removal::tile_order::tile_order;
use crate::triangulation::Triangulation;

/// Vertices evaluated for the first time that threads share.
const VERTICES_PER_PART: usize = 8192;

/// How many steps of a [`Poller`](crate::control::Poller) such a vertex counts, beside its area.
const STEPS_PER_VERTEX: usize = 8;

pub(crate) struct Start {
    pub(crate) stars: AllStars,
    /// For each tile an entry for each vertex that may be removed.
    pub(crate) queues: Vec<RemovalQueue>,
    pub(crate) progress: Progress,
}

/// Evaluates the vertices of a triangulation, in tiles of `1 << digits` vertices.
pub(crate) fn prepare(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    measure: &ErrorEvaluator<'_>,
    digits: u32,
    control: &dyn Control,
) -> Result<Start, Cancelled> {
    let count = triangulation.points.len();
    let surplus = count.saturating_sub(rule.size);
    let (faces, _) = triangulation.origins.as_chunks::<3>();
    let corners = |face: usize| faces[face].map(|v| triangulation.points[v as usize]);
    let measuring = Translated { control, translate: |_, _, _| (Stage::Simplify, 0, surplus) };
    let mut errors = Vec::with_capacity(faces.len());
    let add = |part: &[u64]| errors.extend_from_slice(part);
    measure.for_each_part(faces.len(), corners, &measuring, add)?;
    let progress = Progress::new(rule, count, errors.iter().sum());
    let poller = &mut progress.poller(control);
    let ranks = tile_order(&triangulation.points, image.sides(), poller)?;
    let in_order = ranks.iter().map(|&rank| triangulation.points[rank as usize]);
    let points = collect(in_order, || progress.poller(control).poll())?;
    let (right, top) = (image.width() as i32 - 1, image.height() as i32 - 1);
    let vertices = Vertices { points, ranks, digits, right, top };
    let mut stars = stars_of(&triangulation, vertices, &errors, poller)?;
    free(errors, poller)?;
    triangulation.into_points(&measuring)?;
    let mut queues = Vec::with_capacity(stars.spilled.len());
    for tile in 0..stars.spilled.len() {
        queues.push(evaluate_tile(tile, &mut stars.whole(), measure, &progress, control)?);
    }
    Ok(Start { stars, queues, progress })
}

/// Evaluates the vertices of a tile but for the image's corners: their queue and fill caches.
fn evaluate_tile(
    tile: usize,
    stars: &mut Stars<'_>,
    measure: &ErrorEvaluator<'_>,
    progress: &Progress,
    control: &dyn Control,
) -> Result<RemovalQueue, Cancelled> {
    let numbers = stars.numbers(tile);
    let mut queue = RemovalQueue::with_capacity(numbers.clone());
    let mut evaluated = Vec::new();
    let steps = STEPS_PER_VERTEX + measure.pixel_count() / stars.vertices.points.len();
    for first in numbers.clone().step_by(VERTICES_PER_PART) {
        let chunk: Vec<u32> = (first..numbers.end.min(first + VERTICES_PER_PART as u32))
            .filter(|&vertex| !stars.is_corner(vertex))
            .collect();
        evaluated.clear();
        evaluated.resize(chunk.len(), (0, FillCache::EMPTY));
        let shared: &Stars<'_> = stars;
        in_parallel(&chunk, &mut evaluated, control, |vertices, evaluated, control| {
            let mut evaluator = Evaluator::new(measure, progress.poller(control));
            for (&vertex, evaluated) in vertices.iter().zip(evaluated) {
                evaluator.poller.step(steps)?;
                *evaluated = evaluator.evaluate(vertex, shared)?;
            }
            Ok(())
        })?;
        for (vertex, &(change, fill)) in chunk.into_iter().zip(&evaluated) {
            stars.set_fill(vertex, fill);
            queue.push(Entry { change, rank: stars.vertices.ranks[vertex as usize], vertex });
        }
    }
    queue.order(&mut progress.poller(control))?;
    Ok(queue)
}

impl Start {
    pub(crate) fn merge_tiles(&mut self, control: &dyn Control) -> Result<(), Cancelled> {
        let poller = &mut self.progress.poller(control);
        self.stars.merge_tiles();
        let mut all = RemovalQueue::with_capacity(0..self.stars.records.len() as u32);
        for queue in self.queues.drain(..) {
            poller.step(queue.len())?;
            queue.entries().for_each(|entry| all.push(entry));
        }
        all.order(poller)?;
        self.queues.push(all);
        Ok(())
    }
}
