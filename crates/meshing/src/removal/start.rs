//! What removal starts from: the stars and the queues of all vertices of a triangulation.

use crate::control::{Cancelled, Control, Stage};
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, Point};
use crate::parallel::in_parallel;
use crate::removal::candidate::Evaluator;
use crate::removal::fill_cache::FillCache;
use crate::removal::progress::{Progress, StopRule};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::StarBlock;
use crate::removal::vertices::{MeshView, Vertices};
use crate::triangulation::Triangulation;

/// The binary digits of a vertex's number in its tile where all vertices are one tile.
pub(crate) const ONE_TILE: u32 = u32::BITS - 1;

/// Faces measured, and vertices evaluated for the first time, between two polls of the control.
const STEPS_PER_POLL: usize = 8192;

/// A mesh before removal, in tiles of `1 << vertices.digits` vertices.
pub(crate) struct Start {
    pub(crate) vertices: Vertices,
    /// The stars of each tile.
    pub(crate) stars: Vec<StarBlock>,
    /// For each tile an entry for each vertex that may be removed.
    pub(crate) queues: Vec<RemovalQueue>,
    pub(crate) progress: Progress,
}

/// Evaluates the vertices of a triangulation.
pub(crate) fn prepare(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    measure: &ErrorEvaluator<'_>,
    digits: u32,
    control: &dyn Control,
) -> Result<Start, Cancelled> {
    let count = triangulation.points.len();
    let errors = face_errors(&triangulation, measure, count.saturating_sub(rule.size), control)?;
    let progress = Progress::new(rule, count, errors.iter().sum());
    let vertices = Vertices::new(image, &triangulation.points, digits);
    let mut stars = StarBlock::of_triangulation(&triangulation, &vertices.ranks, &errors, digits);
    drop((triangulation, errors));
    let mut queues = Vec::with_capacity(stars.len());
    for tile in 0..stars.len() {
        queues.push(evaluate_tile(tile, &mut stars, &vertices, measure, &progress, control)?);
    }
    Ok(Start { vertices, stars, queues, progress })
}

/// The errors of all triangles.
fn face_errors(
    triangulation: &Triangulation,
    measure: &ErrorEvaluator<'_>,
    surplus: usize,
    control: &dyn Control,
) -> Result<Vec<u64>, Cancelled> {
    let mut errors = vec![0; triangulation.origins.len() / 3];
    let origins = triangulation.origins.chunks(3 * STEPS_PER_POLL);
    for (origins, errors) in origins.zip(errors.chunks_mut(STEPS_PER_POLL)) {
        control.poll(Stage::Simplify, 0, surplus)?;
        let (faces, _) = origins.as_chunks::<3>();
        in_parallel(faces, errors, control.threads(), |faces, errors| {
            let point = |&v: &u32| triangulation.points[v as usize];
            let faces: Vec<[Point; 3]> =
                faces.iter().map(|[a, b, c]| [point(a), point(b), point(c)]).collect();
            let mut some = Vec::with_capacity(faces.len());
            FaceErrors::new(measure).errors(&faces, &mut some);
            errors.copy_from_slice(&some);
        });
    }
    Ok(errors)
}

/// Evaluates the vertices of a tile but for the corners of the image: their queue, and what is
/// cached of their holes.
fn evaluate_tile(
    tile: usize,
    stars: &mut [StarBlock],
    vertices: &Vertices,
    measure: &ErrorEvaluator<'_>,
    progress: &Progress,
    control: &dyn Control,
) -> Result<RemovalQueue, Cancelled> {
    let numbers = stars[tile].numbers();
    let mut entries = Vec::with_capacity(numbers.len());
    let mut evaluated = Vec::new();
    for first in numbers.clone().step_by(STEPS_PER_POLL) {
        progress.poll(control)?;
        let view = MeshView { vertices, blocks: stars, first_block: 0 };
        let chunk: Vec<u32> = (first..numbers.end.min(first + STEPS_PER_POLL as u32))
            .filter(|&vertex| !view.is_corner(vertex))
            .collect();
        evaluated.clear();
        evaluated.resize(chunk.len(), (0, FillCache::EMPTY));
        in_parallel(&chunk, &mut evaluated, control.threads(), |vertices, evaluated| {
            let mut evaluator = Evaluator::new(measure);
            for (&vertex, evaluated) in vertices.iter().zip(evaluated) {
                *evaluated = evaluator.evaluate(vertex, &view);
            }
        });
        for (vertex, &(change, fill)) in chunk.into_iter().zip(&evaluated) {
            stars[tile].set_fill(vertex, fill);
            entries.push(Entry { change, rank: vertices.ranks[vertex as usize], vertex });
        }
    }
    Ok(RemovalQueue::of_vertices_from(numbers.start, numbers.len(), entries))
}

impl Start {
    /// Makes one tile of all.
    pub(crate) fn merge_tiles(&mut self) {
        let count = self.vertices.points.len();
        let mut all = StarBlock::with_capacity(0, count);
        for block in self.stars.drain(..) {
            all.append(block);
        }
        let entries = self.queues.drain(..).flat_map(RemovalQueue::into_entries).collect();
        self.queues.push(RemovalQueue::new(entries, count));
        self.stars.push(all);
        self.vertices.digits = ONE_TILE;
    }
}
