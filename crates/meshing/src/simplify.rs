//! Greedy point removal: the vertex whose removal raises the error least goes first.
//!
//! Laurent Demaret and Armin Iske, "Advances in digital image compression by adaptive thinning",
//! 2004, remove from a Delaunay triangulation of an image's points, again and again, the least
//! significant one. The change of the error is taken over the faces that change, with rounded
//! interpolants, in whole numbers; equal changes go by row, then column. Removing one vertex
//! changes the keys of its neighbours alone, about six.

use crate::choices::ErrorMetric;
use crate::control::{Cancelled, Control, Stage};
use crate::face_error::{FaceErrors, Measure};
use crate::foresight::Foresight;
use crate::hole_memory::HoleMemory;
use crate::image::Image;
use crate::mesh::{Face, Point};
use crate::metrics::Fidelity;
use crate::parallel::in_parallel;
use crate::parameters::ErrorBound;
use crate::removal::{Neighbour, Net, Remover};
use crate::removal_queue::{Entry, RemovalQueue};
use crate::star::{ROOM, Stars};
use crate::tile_order::tile_order;
use crate::triangulation::Triangulation;

/// Faces measured, and vertices evaluated for the first time, between two polls of the control.
const VERTICES_PER_ROUND: usize = 8192;

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
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let measure = Measure::new(image, rule.metric);
    let surplus = triangulation.points.len().saturating_sub(rule.size);
    let mut simplification =
        Simplification::new(image, &triangulation, &measure, surplus, control)?;
    drop(triangulation);
    let mut queue = simplification.evaluate_all(&measure, surplus, control)?;
    let mut foresight =
        Foresight::new(&measure, simplification.net.points.len(), control.threads());
    let mut removals = Vec::with_capacity(surplus);
    while let Some(Entry { change, vertex, .. }) = queue.first() {
        control.poll(Stage::Simplify, removals.len().min(surplus), surplus)?;
        if simplification.must_stop(change, rule) {
            break;
        }
        if let Some(foresight) = &mut foresight {
            foresight.look_ahead(&simplification.net, &queue, simplification.remaining);
        }
        queue.remove_first();
        simplification.touch_next(&queue);
        simplification.remove(vertex, foresight.as_mut(), &mut queue);
        removals.push(Removal { point: simplification.net.points[vertex as usize], change });
    }
    let (points, faces) = simplification.mesh();
    Ok(Simplified { points, faces, removals, error: simplification.total_error })
}

/// A triangulation that loses vertices.
struct Simplification<'a> {
    image: &'a Image,
    net: Net,
    /// The places of the vertices by row, then column.
    ranks: Vec<u32>,
    remover: Remover<'a>,
    /// The neighbours of the last vertex that went.
    neighbours: Vec<Neighbour>,
    /// Sum of the errors of all faces.
    total_error: u64,
    /// Vertices not removed.
    remaining: usize,
}

impl<'a> Simplification<'a> {
    fn new(
        image: &'a Image,
        triangulation: &Triangulation,
        measure: &'a Measure<'a>,
        surplus: usize,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let errors = errors_of(triangulation, measure, surplus, control)?;
        let ranks = tile_order(&triangulation.points, image.width(), image.height());
        let mut numbers = vec![0; ranks.len()];
        for (number, &rank) in (0..).zip(&ranks) {
            numbers[rank as usize] = number;
        }
        let net = Net {
            stars: Stars::new(triangulation, &numbers, &errors),
            points: ranks.iter().map(|&rank| triangulation.points[rank as usize]).collect(),
            right: image.width() as i32 - 1,
            top: image.height() as i32 - 1,
        };
        Ok(Self {
            image,
            remaining: net.points.len(),
            net,
            ranks,
            remover: Remover::new(measure),
            neighbours: Vec::new(),
            total_error: errors.iter().sum(),
        })
    }

    /// The queue of all vertices but the corners of the image.
    fn evaluate_all(
        &mut self,
        measure: &Measure<'_>,
        surplus: usize,
        control: &dyn Control,
    ) -> Result<RemovalQueue, Cancelled> {
        let count = self.net.points.len();
        let mut entries = Vec::with_capacity(count);
        let mut evaluated = Vec::new();
        for first in (0..count).step_by(VERTICES_PER_ROUND) {
            control.poll(Stage::Simplify, 0, surplus)?;
            let vertices: Vec<u32> =
                (first as u32..count.min(first + VERTICES_PER_ROUND) as u32).collect();
            evaluated.clear();
            evaluated.resize(vertices.len(), (0, HoleMemory::NOTHING));
            let net = &self.net;
            in_parallel(&vertices, &mut evaluated, control.threads(), |vertices, evaluated| {
                let mut remover = Remover::new(measure);
                for (&vertex, evaluated) in vertices.iter().zip(evaluated) {
                    if !net.is_corner(vertex) {
                        *evaluated = remover.evaluate(vertex, net);
                    }
                }
            });
            for (vertex, &(change, memory)) in vertices.into_iter().zip(&evaluated) {
                if !self.net.is_corner(vertex) {
                    self.net.stars.remember(vertex, memory);
                    entries.push(Entry { change, rank: self.ranks[vertex as usize], vertex });
                }
            }
        }
        Ok(RemovalQueue::new(entries, count))
    }

    /// Tells whether a removal with this change must not be made.
    fn must_stop(&self, change: i64, rule: StopRule) -> bool {
        if self.remaining <= rule.size {
            return !(rule.bad_point_removal && change < 0);
        }
        let error = self.total_error.wrapping_add_signed(change);
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

    /// Asks memory for what the removals after this one will probably need: for the next one the
    /// stars around it, for the one after that its own, which tells where those around it are.
    #[inline]
    fn touch_next(&self, queue: &RemovalQueue) {
        let stars = &self.net.stars;
        if let Some(next) = queue.first() {
            let around = stars.neighbours(next.vertex);
            stars.touch(&around[..around.len().min(ROOM)]);
        }
        if let Some(second) = queue.second() {
            stars.touch(&[second.vertex]);
        }
    }

    /// Takes a vertex out of the mesh, fills its hole and gives its neighbours their new keys.
    fn remove(
        &mut self,
        vertex: u32,
        mut foresight: Option<&mut Foresight<'_>>,
        queue: &mut RemovalQueue,
    ) {
        let foreseen = foresight.as_mut().and_then(|foresight| foresight.take(vertex, &self.net));
        let change = match foreseen {
            Some(prepared) => {
                std::mem::swap(&mut self.neighbours, &mut prepared.neighbours);
                prepared.change
            }
            None => self.remover.prepare(vertex, &self.net, &mut self.neighbours),
        };
        for Neighbour { vertex, star, change } in self.neighbours.drain(..) {
            self.net.stars.write(vertex, star);
            if let Some(foresight) = &mut foresight {
                foresight.note_change(vertex);
            }
            if let Some(change) = change {
                queue.change(vertex, change);
            }
        }
        self.net.stars.remove(vertex);
        self.total_error = self.total_error.wrapping_add_signed(change);
        self.remaining -= 1;
    }

    /// The points and faces of the vertices that are left.
    fn mesh(&self) -> (Vec<Point>, Vec<Face>) {
        let Self { net, ranks, .. } = self;
        let mut by_rank = vec![GONE; ranks.len()];
        for (vertex, &rank) in (0..).zip(ranks).filter(|&(v, _)| !net.stars.is_gone(v)) {
            by_rank[rank as usize] = vertex;
        }
        by_rank.retain(|&vertex| vertex != GONE);
        let mut numbers = vec![GONE; ranks.len()];
        for (number, &vertex) in (0..).zip(&by_rank) {
            numbers[vertex as usize] = number;
        }
        let points = by_rank.iter().map(|&vertex| net.points[vertex as usize]).collect();
        let mut faces = Vec::with_capacity(2 * by_rank.len());
        for &vertex in &by_rank {
            faces_at(vertex, net, &numbers, &mut faces);
        }
        (points, faces)
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
fn faces_at(vertex: u32, net: &Net, numbers: &[u32], faces: &mut Vec<Face>) {
    let neighbours = net.stars.neighbours(vertex);
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
    use crate::control::Unattended;
    use crate::star::Star;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// A picture of few gray levels, so that equal changes of error are common.
    fn picture(width: usize, height: usize, samples: &[u16]) -> Image {
        let plane = |c: usize| samples.iter().map(|s| (s >> c) % 8).take(width * height).collect();
        Image::new(width, height, 3, vec![plane(0), plane(3)]).unwrap()
    }

    fn all_points(width: usize, height: usize) -> Vec<Point> {
        (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y))).collect()
    }

    /// The errors kept for the faces are those computed afresh.
    fn assert_errors_are_current(simplification: &Simplification<'_>, measure: &Measure<'_>) {
        let mut errors = FaceErrors::new(measure);
        let Net { points, stars, .. } = &simplification.net;
        let (mut star, mut total) = (Star::default(), 0);
        for v in (0..points.len() as u32).filter(|&v| !stars.is_gone(v)) {
            stars.read(v, &mut star);
            let neighbours = &star.neighbours;
            for (i, &error) in star.errors.iter().enumerate() {
                let last = i + 1 == neighbours.len();
                let fresh = if last && simplification.net.is_on_border(v) {
                    0
                } else {
                    let next = neighbours[if last { 0 } else { i + 1 }];
                    errors.error([v, neighbours[i], next].map(|v| points[v as usize]))
                };
                assert_eq!(error, fresh);
                total += fresh;
            }
        }
        assert_eq!(3 * simplification.total_error, total);
    }

    /// The faces are those of the vertices that are left, triangulated afresh.
    fn assert_triangulated_afresh(simplification: &Simplification<'_>) {
        let (points, faces) = simplification.mesh();
        assert!(points.is_sorted());
        assert_eq!(faces, triangulate(&points));
    }

    /// The queue's keys are the changes computed afresh, with nothing remembered.
    fn assert_keys_are_current(simplification: &mut Simplification<'_>, queue: &mut RemovalQueue) {
        let mut entries = Vec::new();
        while let Some(entry) = queue.first() {
            let stars = &mut simplification.net.stars;
            let remembered = *stars.memory(entry.vertex);
            stars.remember(entry.vertex, HoleMemory::NOTHING);
            let (change, _) = simplification.remover.evaluate(entry.vertex, &simplification.net);
            simplification.net.stars.remember(entry.vertex, remembered);
            assert_eq!(change, entry.change);
            entries.push(entry);
            queue.remove_first();
        }
        *queue = RemovalQueue::new(entries, simplification.net.points.len());
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
            let triangulation = Triangulation::new(all_points(width, height), &Unattended).unwrap();
            let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
            let mut simplification =
                Simplification::new(&image, &triangulation, &measure, 1, &Unattended).unwrap();
            let mut queue = simplification.evaluate_all(&measure, 1, &Unattended).unwrap();
            while let Some(Entry { change, vertex, .. }) = queue.first() {
                let before = simplification.total_error;
                queue.remove_first();
                simplification.remove(vertex, None, &mut queue);
                prop_assert_eq!(simplification.total_error, before.wrapping_add_signed(change));
                assert_errors_are_current(&simplification, &measure);
                assert_triangulated_afresh(&simplification);
                assert_keys_are_current(&mut simplification, &mut queue);
            }
            prop_assert_eq!(simplification.remaining, 4);
        }
    }
}
