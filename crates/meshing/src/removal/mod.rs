//! Greedy point removal: the vertex whose removal raises the error least goes first.
//!
//! Laurent Demaret and Armin Iske, "Advances in digital image compression by adaptive thinning",
//! 2004, remove from a Delaunay triangulation of an image's points, again and again, the least
//! significant one. The change of the error is taken over the faces that change, with rounded
//! interpolants, in whole numbers; equal changes go by row, then column. Removing one vertex
//! changes the keys of its neighbours alone, about six.

pub(crate) mod candidate;
pub(crate) mod fill_cache;
pub(crate) mod max_error;
pub(crate) mod partition;
pub(crate) mod queue;
pub(crate) mod small_candidate;
pub(crate) mod star;
pub(crate) mod vertex_order;

use crate::control::{Cancelled, Control, Stage};
use crate::face_error::{FaceErrors, Measure};
use crate::image::{Image, Point};
use crate::parallel::in_parallel;
use crate::parameters::ErrorBound;
use crate::parameters::choices::{ErrorMetric, Parallel};
use crate::quality::fidelity::Fidelity;
use crate::removal::candidate::{Neighbour, Net, Remover};
use crate::removal::fill_cache::HoleMemory;
use crate::removal::partition::remove_by_tiles;
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{ROOM, StarParts, StarSource, Stars};
use crate::removal::vertex_order::tile_order;
use crate::triangulation::{Face, Triangulation};

/// Faces measured, and vertices evaluated for the first time, between two polls of the control.
const VERTICES_PER_ROUND: usize = 8192;

/// The binary digits of a vertex's number, where all vertices are one part.
const ALL_DIGITS: u32 = u32::BITS;

/// Stands for a vertex that is gone.
const GONE: u32 = u32::MAX;

/// When removal ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StopRule {
    /// Vertices to keep.
    pub(crate) size: usize,
    /// A quality that no removal may take from the mesh.
    pub(crate) bound: Option<ErrorBound>,
    /// The error that counts.
    pub(crate) metric: ErrorMetric,
    /// Whether to go on below `size` while a removal lowers the error.
    pub(crate) bad_point_removal: bool,
}

/// A vertex that greedy removal took out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Removal {
    /// Its place.
    pub point: Point,
    /// By how much the sum of errors changed, in the metric's whole numbers.
    pub change: i64,
}

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
pub(crate) fn simplify(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    parallel: Parallel,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let measure = Measure::new(image, rule.metric);
    simplify_by(image, &measure, triangulation, rule, parallel, control)
}

/// The same by a measure of the rule's metric that is there already.
pub(crate) fn simplify_by(
    image: &Image,
    measure: &Measure<'_>,
    triangulation: Triangulation,
    rule: StopRule,
    parallel: Parallel,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let count = triangulation.points.len();
    if parallel == Parallel::Tiles
        && let Some(digits) = partition::tile_digits(count, rule)
    {
        let prepared = prepare(image, triangulation, rule, measure, digits, control)?;
        return remove_by_tiles(prepared, measure, digits, control);
    }
    let prepared = prepare(image, triangulation, rule, measure, ALL_DIGITS, control)?;
    remove_in_order(prepared, measure, control)
}

/// What removal begins with.
pub(crate) struct Prepared<'a> {
    pub(crate) vertices: Vertices,
    pub(crate) stars: StarParts,
    /// An entry for each vertex that may leave, by number.
    pub(crate) entries: Vec<Entry>,
    pub(crate) tally: Tally<'a>,
}

/// Evaluates the vertices of a triangulation, in parts of `1 << digits`.
pub(crate) fn prepare<'a>(
    image: &'a Image,
    triangulation: Triangulation,
    rule: StopRule,
    measure: &Measure<'_>,
    digits: u32,
    control: &dyn Control,
) -> Result<Prepared<'a>, Cancelled> {
    let count = triangulation.points.len();
    let surplus = count.saturating_sub(rule.size);
    let errors = errors_of(&triangulation, measure, surplus, control)?;
    let tally = Tally::new(image, rule, count, errors.iter().sum());
    let (vertices, mut stars) = Vertices::new(image, &triangulation, &errors, digits);
    drop((triangulation, errors));
    let entries = vertices.evaluate_all(&mut stars, measure, &tally, control)?;
    Ok(Prepared { vertices, stars, entries, tally })
}

/// Removes vertices one by one, always the one whose removal raises the error least.
fn remove_in_order(
    prepared: Prepared<'_>,
    measure: &Measure<'_>,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let Prepared { vertices, stars, entries, mut tally } = prepared;
    let mut simplification = Simplification::new(&vertices, stars.into_one(), entries, measure);
    while let Some(first) = simplification.queue.first() {
        tally.poll(control)?;
        if tally.must_stop(first.change) {
            break;
        }
        simplification.remove_first();
        tally.note(&vertices, first);
    }
    Ok(tally.finish(&vertices, &simplification.stars))
}

/// How far removal has come, and when it ends.
pub(crate) struct Tally<'a> {
    image: &'a Image,
    pub(crate) rule: StopRule,
    /// Vertices that must go at least, if nothing else ends removal.
    surplus: usize,
    /// Vertices not removed.
    pub(crate) remaining: usize,
    /// Sum of the errors of all faces.
    error: u64,
    removals: Vec<Removal>,
}

impl<'a> Tally<'a> {
    fn new(image: &'a Image, rule: StopRule, count: usize, error: u64) -> Self {
        let surplus = count.saturating_sub(rule.size);
        let removals = Vec::with_capacity(surplus);
        Self { image, rule, surplus, remaining: count, error, removals }
    }

    /// Vertices that must still go.
    pub(crate) fn surplus_left(&self) -> usize {
        self.surplus.saturating_sub(self.removals.len())
    }

    /// Tells the control how far removal has come.
    pub(crate) fn poll(&self, control: &dyn Control) -> Result<(), Cancelled> {
        control.poll(Stage::Simplify, self.removals.len().min(self.surplus), self.surplus)
    }

    /// Tells whether a removal with this change must not be made.
    pub(crate) fn must_stop(&self, change: i64) -> bool {
        let rule = self.rule;
        if self.remaining <= rule.size {
            return !(rule.bad_point_removal && change < 0);
        }
        let error = self.error.wrapping_add_signed(change);
        match rule.bound {
            None => false,
            Some(ErrorBound::PsnrDb(least)) => {
                Fidelity::of_sum(error, self.image).psnr_db() < least
            }
            // Looked after by whoever follows the removals.
            Some(ErrorBound::MaxError(_)) => false,
            Some(ErrorBound::MeanError(most)) => rule.metric.mean(error, self.image) > most,
        }
    }

    /// Counts a vertex that has gone.
    pub(crate) fn note(&mut self, vertices: &Vertices, gone: Entry) {
        let point = vertices.points[gone.vertex as usize];
        self.removals.push(Removal { point, change: gone.change });
        self.error = self.error.wrapping_add_signed(gone.change);
        self.remaining -= 1;
    }

    /// What is left.
    pub(crate) fn finish(self, vertices: &Vertices, stars: &impl StarSource) -> Simplified {
        let (points, faces) = vertices.mesh(stars);
        Simplified { points, faces, removals: self.removals, error: self.error }
    }
}

/// The places of the vertices of a triangulation, numbered tile by tile.
pub(crate) struct Vertices {
    pub(crate) points: Vec<Point>,
    /// Their places by row, then column.
    ranks: Vec<u32>,
    /// The last column and row of the image.
    right: i32,
    top: i32,
}

impl Vertices {
    /// The vertices and their stars, in parts of `1 << digits`, with the errors of all triangles.
    fn new(
        image: &Image,
        triangulation: &Triangulation,
        errors: &[u64],
        digits: u32,
    ) -> (Self, StarParts) {
        let ranks = tile_order(&triangulation.points, image.width(), image.height());
        let mut numbers = vec![0; ranks.len()];
        for (number, &rank) in (0..).zip(&ranks) {
            numbers[rank as usize] = number;
        }
        let stars = StarParts::new(triangulation, &numbers, errors, digits);
        let points = ranks.iter().map(|&rank| triangulation.points[rank as usize]).collect();
        let (right, top) = (image.width() as i32 - 1, image.height() as i32 - 1);
        (Self { points, ranks, right, top }, stars)
    }

    /// The vertices with their stars.
    #[inline]
    pub(crate) fn net<'a, S: StarSource>(&'a self, stars: &'a S) -> Net<'a, S> {
        Net { points: &self.points, stars, right: self.right, top: self.top }
    }

    /// The entries of all vertices but the corners of the image, by number, and what is remembered
    /// of their holes.
    fn evaluate_all(
        &self,
        stars: &mut StarParts,
        measure: &Measure<'_>,
        tally: &Tally<'_>,
        control: &dyn Control,
    ) -> Result<Vec<Entry>, Cancelled> {
        let count = self.points.len();
        let mut entries = Vec::with_capacity(count);
        let mut evaluated = Vec::new();
        for first in (0..count).step_by(VERTICES_PER_ROUND) {
            tally.poll(control)?;
            let vertices: Vec<u32> =
                (first as u32..count.min(first + VERTICES_PER_ROUND) as u32).collect();
            evaluated.clear();
            evaluated.resize(vertices.len(), (0, HoleMemory::NOTHING));
            let net = self.net(stars);
            in_parallel(&vertices, &mut evaluated, control.threads(), |vertices, evaluated| {
                let mut remover = Remover::new(measure);
                for (&vertex, evaluated) in vertices.iter().zip(evaluated) {
                    if !net.is_corner(vertex) {
                        *evaluated = remover.evaluate(vertex, &net);
                    }
                }
            });
            for (vertex, &(change, memory)) in vertices.into_iter().zip(&evaluated) {
                if !self.net(stars).is_corner(vertex) {
                    stars.part_of(vertex).remember(vertex, memory);
                    entries.push(Entry { change, rank: self.ranks[vertex as usize], vertex });
                }
            }
        }
        Ok(entries)
    }

    /// The points and faces of the vertices that are left.
    fn mesh(&self, stars: &impl StarSource) -> (Vec<Point>, Vec<Face>) {
        let (net, ranks) = (self.net(stars), &self.ranks);
        let mut by_rank = vec![GONE; ranks.len()];
        let is_gone = |vertex| stars.stars_of(vertex).is_gone(vertex);
        for (vertex, &rank) in (0..).zip(ranks).filter(|&(v, _)| !is_gone(v)) {
            by_rank[rank as usize] = vertex;
        }
        by_rank.retain(|&vertex| vertex != GONE);
        let mut numbers = vec![GONE; ranks.len()];
        for (number, &vertex) in (0..).zip(&by_rank) {
            numbers[vertex as usize] = number;
        }
        let points = by_rank.iter().map(|&vertex| self.points[vertex as usize]).collect();
        let mut faces = Vec::with_capacity(2 * by_rank.len());
        for &vertex in &by_rank {
            faces_at(vertex, &net, &numbers, &mut faces);
        }
        (points, faces)
    }
}

/// Vertices that leave, with what removal keeps of them.
struct Simplification<'a> {
    vertices: &'a Vertices,
    stars: Stars,
    queue: RemovalQueue,
    remover: Remover<'a>,
    /// The neighbours of the last vertex that went.
    neighbours: Vec<Neighbour>,
}

impl<'a> Simplification<'a> {
    /// Vertices, with an entry for each that may leave.
    fn new(
        vertices: &'a Vertices,
        stars: Stars,
        entries: Vec<Entry>,
        measure: &'a Measure<'a>,
    ) -> Self {
        let queue = RemovalQueue::new(entries, vertices.points.len());
        let remover = Remover::new(measure);
        Self { vertices, stars, queue, remover, neighbours: Vec::new() }
    }

    /// Takes the first vertex of the queue out of the mesh, fills its hole and gives its neighbours
    /// their new keys.
    fn remove_first(&mut self) {
        let Some(Entry { vertex, .. }) = self.queue.first() else { return };
        self.queue.remove_first();
        touch_next(&self.stars, &self.queue);
        let net = self.vertices.net(&self.stars);
        self.remover.prepare(vertex, &net, &mut self.neighbours);
        for Neighbour { vertex, star, change } in self.neighbours.drain(..) {
            self.stars.write(vertex, star);
            if let Some(change) = change {
                self.queue.change(vertex, change);
            }
        }
        self.stars.remove(vertex);
    }
}

/// Asks memory for what the removals after this one will probably need: for the next one the stars
/// around it, for the one after that its own, which tells where those around it are.
#[inline]
pub(crate) fn touch_next(stars: &Stars, queue: &RemovalQueue) {
    if let Some(next) = queue.first() {
        let around = stars.neighbours(next.vertex);
        stars.touch(&around[..around.len().min(ROOM)]);
    }
    if let Some(second) = queue.second() {
        stars.touch(&[second.vertex]);
    }
}

/// The errors of all triangles.
fn errors_of(
    triangulation: &Triangulation,
    measure: &Measure<'_>,
    surplus: usize,
    control: &dyn Control,
) -> Result<Vec<u64>, Cancelled> {
    let mut errors = vec![0; triangulation.origins.len() / 3];
    let origins = triangulation.origins.chunks(3 * VERTICES_PER_ROUND);
    for (origins, errors) in origins.zip(errors.chunks_mut(VERTICES_PER_ROUND)) {
        control.poll(Stage::Simplify, 0, surplus)?;
        let (faces, _) = origins.as_chunks::<3>();
        in_parallel(faces, errors, control.threads(), |faces, errors| {
            let place = |&v: &u32| triangulation.points[v as usize];
            let faces: Vec<[Point; 3]> =
                faces.iter().map(|[a, b, c]| [place(a), place(b), place(c)]).collect();
            let mut some = Vec::with_capacity(faces.len());
            FaceErrors::new(measure).errors(&faces, &mut some);
            errors.copy_from_slice(&some);
        });
    }
    Ok(errors)
}

/// Adds the faces of which a vertex is the one of the smallest number, in ascending order.
fn faces_at(vertex: u32, net: &Net<'_, impl StarSource>, numbers: &[u32], faces: &mut Vec<Face>) {
    let neighbours = net.stars_of(vertex).neighbours(vertex);
    let number = numbers[vertex as usize];
    let begun = faces.len();
    for (i, &neighbour) in neighbours.iter().enumerate() {
        let is_last = i + 1 == neighbours.len();
        if is_last && net.is_on_border(vertex) {
            continue;
        }
        let next = neighbours[if is_last { 0 } else { i + 1 }];
        let (second, third) = (numbers[neighbour as usize], numbers[next as usize]);
        if number < second && number < third {
            faces.push([number, second, third]);
        }
    }
    faces[begun..].sort_unstable();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::removal::star::Star;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// A picture of few gray levels, so that equal changes of error are common.
    fn picture(width: usize, height: usize, samples: &[u16]) -> Image {
        let plane = |c: usize| samples.iter().map(|s| (s >> c) % 8).take(width * height).collect();
        Image::from_bottom_up(width, height, 3, vec![plane(0), plane(3)]).unwrap()
    }

    fn all_points(width: usize, height: usize) -> Vec<Point> {
        (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y))).collect()
    }

    /// The errors kept for the faces are those computed afresh.
    fn assert_errors_are_current(
        simplification: &Simplification<'_>,
        measure: &Measure<'_>,
        total_error: u64,
    ) {
        let mut errors = FaceErrors::new(measure);
        let Simplification { vertices, stars, .. } = simplification;
        let points = &vertices.points;
        let (mut star, mut total) = (Star::default(), 0);
        for v in (0..points.len() as u32).filter(|&v| !stars.is_gone(v)) {
            stars.read(v, &mut star);
            let neighbours = &star.neighbours;
            for (i, &error) in star.errors.iter().enumerate() {
                let last = i + 1 == neighbours.len();
                let fresh = if last && vertices.net(stars).is_on_border(v) {
                    0
                } else {
                    let next = neighbours[if last { 0 } else { i + 1 }];
                    errors.error([v, neighbours[i], next].map(|v| points[v as usize]))
                };
                assert_eq!(error, fresh);
                total += fresh;
            }
        }
        assert_eq!(3 * total_error, total);
    }

    /// The faces are those of the vertices that are left, triangulated afresh.
    fn assert_triangulated_afresh(simplification: &Simplification<'_>) {
        let (points, faces) = simplification.vertices.mesh(&simplification.stars);
        assert!(points.is_sorted());
        assert_eq!(faces, triangulate(&points));
    }

    /// The queue's keys are the changes computed afresh, with nothing remembered.
    fn assert_keys_are_current(simplification: &mut Simplification<'_>) {
        for entry in simplification.queue.entries() {
            let stars = &mut simplification.stars;
            let remembered = *stars.memory(entry.vertex);
            stars.remember(entry.vertex, HoleMemory::NOTHING);
            let net = simplification.vertices.net(stars);
            let (change, _) = simplification.remover.evaluate(entry.vertex, &net);
            stars.remember(entry.vertex, remembered);
            assert_eq!(change, entry.change);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn after_each_removal_everything_cached_is_what_is_computed_afresh(
            width in 2usize..8,
            height in 2usize..8,
            samples in prop::collection::vec(0u16..64, 64),
        ) {
            let image = picture(width, height, &samples);
            let triangulation = Triangulation::new(all_points(width, height), &()).unwrap();
            let metric = ErrorMetric::MeanCompSe;
            let measure = Measure::new(&image, metric);
            let rule = StopRule { size: 4, bound: None, metric, bad_point_removal: false };
            let Prepared { vertices, stars, entries, mut tally } =
                prepare(&image, triangulation, rule, &measure, ALL_DIGITS, &()).unwrap();
            let mut simplification =
                Simplification::new(&vertices, stars.into_one(), entries, &measure);
            while let Some(first) = simplification.queue.first() {
                simplification.remove_first();
                tally.note(&vertices, first);
                assert_errors_are_current(&simplification, &measure, tally.error);
                assert_triangulated_afresh(&simplification);
                assert_keys_are_current(&mut simplification);
            }
            prop_assert_eq!(tally.remaining, 4);
        }
    }

    /// A tally of a picture of 100 points whose error is 50, with 10 vertices of which 6 may stay.
    fn tally(image: &Image, bound: Option<ErrorBound>, bad_point_removal: bool) -> Tally<'_> {
        let metric = ErrorMetric::MeanCompSe;
        let rule = StopRule { size: 6, bound, metric, bad_point_removal };
        Tally::new(image, rule, 10, 50)
    }

    #[test]
    fn removal_ends_at_the_size_but_for_points_that_only_raise_the_error() {
        let image = picture(10, 10, &[7; 100]);
        for bad_point_removal in [false, true] {
            let above = tally(&image, None, bad_point_removal);
            assert!([-1, 0, 1, i64::MAX].iter().all(|&change| !above.must_stop(change)));
            let at_size = Tally { remaining: 6, ..above };
            assert!(at_size.must_stop(0) && at_size.must_stop(1));
            assert_eq!(at_size.must_stop(-1), !bad_point_removal);
        }
    }

    #[test]
    fn removal_ends_before_the_first_that_would_break_the_bound() {
        let image = picture(10, 10, &[7; 100]);
        let with = |bound| tally(&image, Some(bound), false);
        // Two components of 100 points: the mean error is a two-hundredth of the sum.
        let mean = with(ErrorBound::MeanError(0.25 + 0.05));
        assert!(!mean.must_stop(10) && mean.must_stop(11));
        let psnr_db = Fidelity::of_sum(60, &image).psnr_db();
        let psnr = with(ErrorBound::PsnrDb(psnr_db));
        assert!(!psnr.must_stop(10) && psnr.must_stop(11) && !psnr.must_stop(-50));
        let max = with(ErrorBound::MaxError(3));
        assert!(!max.must_stop(1000));
    }

    #[test]
    fn the_control_is_told_how_many_have_gone_and_ends_the_work() {
        struct Expected(usize);
        impl Control for Expected {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                assert_eq!((stage, done, total), (Stage::Simplify, self.0, 4));
                Err(Cancelled)
            }
        }
        let image = picture(10, 10, &[7; 100]);
        let mut tally = tally(&image, None, true);
        let removal = Removal { point: Point::new(1, 1), change: 0 };
        for gone in 0..6 {
            assert_eq!(tally.poll(&Expected(gone.min(4))), Err(Cancelled));
            assert_eq!(tally.surplus_left(), 4_usize.saturating_sub(gone));
            tally.removals.push(removal);
        }
    }
}
