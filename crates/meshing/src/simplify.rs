//! Greedy point removal: the vertex whose removal raises the error least goes first.
//!
//! Laurent Demaret and Armin Iske, "Advances in digital image compression by adaptive thinning",
//! 2004, remove from a Delaunay triangulation of an image's points, again and again, the least
//! significant one. The change of the error is taken over the faces that change, with rounded
//! interpolants, in whole numbers; equal changes go by row, then column. Removing one vertex
//! changes the keys of its neighbours alone, about six.

use crate::choices::ErrorMetric;
use crate::control::{Cancelled, Control, Stage};
use crate::face_error::FaceErrors;
use crate::hole::{Base, HoleFiller};
use crate::hole_memory::HoleMemory;
use crate::image::Image;
use crate::mesh::Point;
use crate::metrics::Fidelity;
use crate::parameters::ErrorBound;
use crate::removal_queue::RemovalQueue;
use crate::triangulation::{NONE, Triangulation, next, previous, smallest_first};

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
    /// The triangulation of the vertices left, by row, then column.
    pub(crate) triangulation: Triangulation,
    /// The removals, in order.
    pub(crate) removals: Vec<Removal>,
    /// The sum of errors over the image, in the metric's whole numbers.
    pub(crate) error: u64,
}

/// Removes vertices of a triangulation of `image` until the rule says stop.
pub(crate) fn simplify(
    image: &Image,
    triangulation: Triangulation,
    rule: StopRule,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let mut simplification = Simplification::new(image, triangulation, rule.metric);
    let surplus = simplification.remaining.saturating_sub(rule.size);
    let mut queue = simplification.evaluate_all(surplus, control)?;
    let mut removals = Vec::with_capacity(surplus);
    while let Some((change, vertex)) = queue.first() {
        control.poll(Stage::Simplify, removals.len().min(surplus), surplus)?;
        if simplification.must_stop(change, rule) {
            break;
        }
        queue.remove_first();
        simplification.remove(vertex);
        simplification.update_neighbours(&mut queue);
        let point = simplification.triangulation.points[vertex as usize];
        removals.push(Removal { point, change });
    }
    let error = simplification.total_error;
    Ok(Simplified { triangulation: simplification.finish(), removals, error })
}

/// A triangulation that loses vertices, and what is known of its faces.
struct Simplification<'a> {
    image: &'a Image,
    /// Slots of triangles that are gone have [`NONE`] as origins.
    triangulation: Triangulation,
    /// A half-edge that begins at each vertex; on the border the one with no twin.
    outgoing: Vec<u32>,
    errors: FaceErrors<'a>,
    /// Error of each triangle.
    face_errors: Vec<u64>,
    /// Sum of the above.
    total_error: u64,
    /// Vertices not removed.
    remaining: usize,
    star: Star,
    /// Vertices around the last hole.
    neighbours: Vec<u32>,
    filler: HoleFiller,
    memory: HoleMemory,
    /// Error of each triangle of the last fill.
    fill_errors: Vec<u64>,
}

/// The triangles around a vertex, counter-clockwise; keeps its memory from one to the next.
#[derive(Default)]
struct Star {
    /// Their indices.
    triangles: Vec<u32>,
    /// The vertices of the boundary, from that of the first triangle on.
    vertices: Vec<u32>,
    /// Their places.
    boundary: Vec<Point>,
    /// The half-edge beyond the boundary's edge from each vertex to the next.
    beyond: Vec<u32>,
}

impl<'a> Simplification<'a> {
    fn new(image: &'a Image, triangulation: Triangulation, metric: ErrorMetric) -> Self {
        let mut simplification = Self {
            image,
            outgoing: outgoing_half_edges(&triangulation),
            errors: FaceErrors::new(image, metric),
            face_errors: Vec::with_capacity(triangulation.origins.len() / 3),
            total_error: 0,
            remaining: triangulation.points.len(),
            star: Star::default(),
            neighbours: Vec::new(),
            filler: HoleFiller::default(),
            memory: HoleMemory::new(triangulation.points.len()),
            fill_errors: Vec::new(),
            triangulation,
        };
        for corners in simplification.triangulation.origins.chunks_exact(3) {
            let points =
                [0, 1, 2].map(|i| simplification.triangulation.points[corners[i] as usize]);
            let error = simplification.errors.error(points);
            simplification.face_errors.push(error);
            simplification.total_error += error;
        }
        simplification
    }

    /// The queue of all vertices but the corners of the image.
    fn evaluate_all(
        &mut self,
        surplus: usize,
        control: &dyn Control,
    ) -> Result<RemovalQueue, Cancelled> {
        let count = self.triangulation.points.len();
        let mut entries = Vec::with_capacity(count);
        for vertex in 0..count as u32 {
            if !self.is_corner(vertex) {
                control.poll(Stage::Simplify, 0, surplus)?;
                entries.push((self.evaluate(vertex), vertex));
            }
        }
        Ok(RemovalQueue::new(entries, count))
    }

    /// By how much the error changes when the vertex goes; leaves the star and the fill of
    /// its hole in place.
    fn evaluate(&mut self, vertex: u32) -> i64 {
        self.star.gather(vertex, &self.triangulation, &self.outgoing);
        let before: u64 = self.star.triangles.iter().map(|&t| self.face_errors[t as usize]).sum();
        self.fill_errors.clear();
        let (star, errors) = (&self.star, &mut self.errors);
        for triangle in self.filler.fill(&star.boundary) {
            let face = smallest_first(triangle.corners.map(|place| star.vertices[place as usize]));
            let error = self.memory.error(vertex, face, || {
                errors.error(triangle.corners.map(|place| star.boundary[place as usize]))
            });
            self.fill_errors.push(error);
        }
        self.memory.keep(vertex);
        self.fill_errors.iter().sum::<u64>() as i64 - before as i64
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
            Some(ErrorBound::MeanError(most)) => rule.metric.mean(error, self.image) > most,
        }
    }

    /// Takes a vertex out of the mesh and fills its hole.
    fn remove(&mut self, vertex: u32) {
        let change = self.evaluate(vertex);
        self.total_error = self.total_error.wrapping_add_signed(change);
        let fill = std::mem::take(&mut self.filler);
        for (i, triangle) in fill.triangles().iter().enumerate() {
            let slot = self.star.triangles[i];
            self.face_errors[slot as usize] = self.fill_errors[i];
            self.place(slot, triangle.corners);
            let opposite = match triangle.base {
                Base::Boundary => self.star.beyond_last(),
                Base::FirstSide(t) => 3 * self.star.triangles[t as usize],
                Base::SecondSide(t) => 3 * self.star.triangles[t as usize] + 1,
            };
            self.connect(3 * slot + 2, opposite);
        }
        for &slot in &self.star.triangles[fill.triangles().len()..] {
            self.face_errors[slot as usize] = 0;
            self.triangulation.origins[3 * slot as usize..][..3].fill(NONE);
        }
        self.filler = fill;
        self.outgoing[vertex as usize] = NONE;
        self.remaining -= 1;
    }

    /// Writes a triangle of the fill to a slot, and connects its sides that lie on the boundary;
    /// the third side is left to its caller.
    fn place(&mut self, slot: u32, corners: [u32; 3]) {
        let [first, second, third] = corners;
        for (h, place) in (3 * slot..).zip(corners) {
            self.triangulation.origins[h as usize] = self.star.vertices[place as usize];
        }
        for (h, from, to) in [(3 * slot, first, second), (3 * slot + 1, second, third)] {
            if to == from + 1 {
                self.connect(h, self.star.beyond[from as usize]);
            }
        }
    }

    /// Makes two half-edges opposite, and the first of them the way out of its vertex, unless that
    /// vertex lies on the border and the half-edge does not.
    fn connect(&mut self, h: u32, opposite: u32) {
        self.triangulation.link(h, opposite);
        let origin = self.triangulation.origins[h as usize] as usize;
        if opposite == NONE || !self.is_on_border(self.triangulation.points[origin]) {
            self.outgoing[origin] = h;
        }
    }

    /// Gives the vertices around the last hole their new keys.
    fn update_neighbours(&mut self, queue: &mut RemovalQueue) {
        // Evaluating gathers another star.
        std::mem::swap(&mut self.neighbours, &mut self.star.vertices);
        for i in 0..self.neighbours.len() {
            let vertex = self.neighbours[i];
            if !self.is_corner(vertex) {
                let change = self.evaluate(vertex);
                queue.change(vertex, change);
            }
        }
    }

    /// Tells whether a point lies on the border of the image.
    fn is_on_border(&self, Point { x, y }: Point) -> bool {
        let (right, top) = (self.image.width() as i32 - 1, self.image.height() as i32 - 1);
        x == 0 || y == 0 || x == right || y == top
    }

    /// Tells whether a vertex is a corner of the image.
    fn is_corner(&self, vertex: u32) -> bool {
        let Point { x, y } = self.triangulation.points[vertex as usize];
        let (right, top) = (self.image.width() as i32 - 1, self.image.height() as i32 - 1);
        (x == 0 || x == right) && (y == 0 || y == top)
    }

    /// The triangulation without the slots and vertices that are gone.
    fn finish(self) -> Triangulation {
        let Triangulation { points, origins, twins } = self.triangulation;
        let mut kept = 0..;
        let vertex_numbers: Vec<u32> = self
            .outgoing
            .iter()
            .map(|&h| if h == NONE { NONE } else { kept.next().unwrap_or(NONE) })
            .collect();
        let mut kept = 0..;
        let slot_numbers: Vec<u32> = origins
            .chunks_exact(3)
            .map(|slot| if slot[0] == NONE { NONE } else { kept.next().unwrap_or(NONE) })
            .collect();
        let renumber =
            |h: u32| if h == NONE { NONE } else { 3 * slot_numbers[h as usize / 3] + h % 3 };
        let alive = |h: &usize| origins[*h] != NONE;
        let vertices = points.iter().zip(&vertex_numbers);
        Triangulation {
            points: vertices
                .filter(|(_, number)| **number != NONE)
                .map(|(&point, _)| point)
                .collect(),
            origins: origins
                .iter()
                .filter(|&&v| v != NONE)
                .map(|&v| vertex_numbers[v as usize])
                .collect(),
            twins: (0..origins.len()).filter(alive).map(|h| renumber(twins[h])).collect(),
        }
    }
}

impl Star {
    /// Collects the triangles around a vertex.
    fn gather(&mut self, vertex: u32, triangulation: &Triangulation, outgoing: &[u32]) {
        self.triangles.clear();
        self.vertices.clear();
        self.boundary.clear();
        self.beyond.clear();
        let Triangulation { points, origins, twins } = triangulation;
        let first = outgoing[vertex as usize];
        let mut spoke = first;
        loop {
            let side = next(spoke);
            let neighbour = origins[side as usize];
            self.triangles.push(spoke / 3);
            self.vertices.push(neighbour);
            self.boundary.push(points[neighbour as usize]);
            self.beyond.push(twins[side as usize]);
            let incoming = previous(spoke);
            spoke = twins[incoming as usize];
            if spoke == first {
                return;
            }
            if spoke == NONE {
                // On the border the boundary ends at the vertex before, which no spoke begins at.
                let last = origins[incoming as usize];
                self.vertices.push(last);
                self.boundary.push(points[last as usize]);
                self.beyond.push(NONE);
                return;
            }
        }
    }

    /// The half-edge beyond the boundary's edge from its last vertex to its first.
    fn beyond_last(&self) -> u32 {
        self.beyond[self.vertices.len() - 1]
    }
}

/// A half-edge that begins at each vertex; on the border the one with no twin, from which turning
/// counter-clockwise meets every triangle.
fn outgoing_half_edges(triangulation: &Triangulation) -> Vec<u32> {
    let mut outgoing = vec![NONE; triangulation.points.len()];
    let half_edges = triangulation.origins.iter().zip(&triangulation.twins);
    for (h, (&origin, &twin)) in half_edges.enumerate() {
        let out = &mut outgoing[origin as usize];
        if *out == NONE || twin == NONE {
            *out = h as u32;
        }
    }
    outgoing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
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

    /// The errors cached for the faces are those computed afresh.
    fn assert_errors_are_cached(simplification: &Simplification<'_>) {
        let mut errors = FaceErrors::new(simplification.image, ErrorMetric::MeanCompSe);
        let Triangulation { points, origins, .. } = &simplification.triangulation;
        let mut total = 0;
        for (t, corners) in origins.chunks_exact(3).enumerate() {
            let fresh = if corners[0] == NONE {
                0
            } else {
                errors.error([0, 1, 2].map(|i| points[corners[i] as usize]))
            };
            assert_eq!(simplification.face_errors[t], fresh);
            total += fresh;
        }
        assert_eq!(simplification.total_error, total);
    }

    /// The faces are those of the vertices that are left, triangulated afresh.
    fn assert_triangulated_afresh(simplification: &Simplification<'_>) {
        let outgoing = &simplification.outgoing;
        let all = &simplification.triangulation.points;
        let kept: Vec<usize> = (0..all.len()).filter(|&v| outgoing[v] != NONE).collect();
        let points: Vec<Point> = kept.iter().map(|&v| all[v]).collect();
        let mut faces: Vec<_> = simplification
            .triangulation
            .origins
            .chunks_exact(3)
            .filter(|corners| corners[0] != NONE)
            .map(|corners| smallest_first([corners[0], corners[1], corners[2]]))
            .collect();
        faces.sort_unstable();
        let fresh = triangulate(&points);
        let fresh: Vec<_> =
            fresh.iter().map(|face| face.map(|v| kept[v as usize] as u32)).collect();
        assert_eq!(faces, fresh);
    }

    /// The queue's keys are the changes computed afresh.
    fn assert_keys_are_current(simplification: &mut Simplification<'_>, queue: &mut RemovalQueue) {
        let mut entries = Vec::new();
        while let Some((change, vertex)) = queue.first() {
            assert_eq!(simplification.evaluate(vertex), change);
            entries.push((change, vertex));
            queue.remove_first();
        }
        *queue = RemovalQueue::new(entries, simplification.triangulation.points.len());
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
            let mut simplification = Simplification::new(&image, triangulation, ErrorMetric::MeanCompSe);
            let mut queue = simplification.evaluate_all(1, &Unattended).unwrap();
            while let Some((change, vertex)) = queue.first() {
                let before = simplification.total_error;
                queue.remove_first();
                simplification.remove(vertex);
                prop_assert_eq!(simplification.total_error, before.wrapping_add_signed(change));
                simplification.update_neighbours(&mut queue);
                assert_errors_are_cached(&simplification);
                assert_triangulated_afresh(&simplification);
                assert_keys_are_current(&mut simplification, &mut queue);
            }
            prop_assert_eq!(simplification.remaining, 4);
        }
    }
}
