//! Openings: places in the worst faces where one more vertex would lower the error most.

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::probe::{Probe, Surface, find_all};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::image::Point;
use std::collections::BinaryHeap;

/// Barycentric weights, in eighths, of places in a face: its middle, places nearer to each vertex,
/// and near the middle of each edge.
const PLACES: [[i32; 3]; 7] =
    [[3, 3, 2], [4, 2, 2], [2, 4, 2], [2, 2, 4], [4, 4, 0], [0, 4, 4], [4, 0, 4]];

/// A place in a face where a vertex would lower the error. Compares by how much, then by place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Opening {
    /// By how much the error falls.
    pub(crate) gain: i64,
    pub(crate) place: Point,
    /// A slot that holds it.
    pub(crate) slot: u32,
    /// How often the slot had been filled when this was found.
    version: u32,
}

/// The openings found, and which of them are still there.
pub(crate) struct Openings {
    /// The best first; some are out of date.
    heap: BinaryHeap<Opening>,
    /// How often each slot has been filled.
    versions: Vec<u32>,
}

impl Openings {
    /// Looks into `face_count` of the worst faces for openings worth more than `least`.
    pub(crate) fn find<M: FaceMeasure>(
        mesh: &MeasuredMesh<M>,
        face_count: usize,
        least: i64,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let versions = vec![0; mesh.triangulation.slot_count()];
        let (surface, new_probe) = (mesh.surface(), || mesh.another_probe());
        let find = |slot, probe: &mut _| look_into(surface, probe, slot, least);
        let found = find_all(&worst_faces(mesh, face_count), new_probe, find, control)?;
        Ok(Self { heap: found.into_iter().flatten().collect(), versions })
    }

    /// Takes the best opening that is still there.
    pub(crate) fn pop<M>(&mut self, mesh: &MeasuredMesh<M>) -> Option<Opening>
    where
        M: FaceMeasure,
    {
        loop {
            let opening = self.heap.pop()?;
            let is_current = self.versions[opening.slot as usize] == opening.version;
            if is_current && mesh.is_vacant(opening.place) {
                return Some(opening);
            }
        }
    }

    /// Forgets what was found in the faces that the mesh's last insertion replaced.
    pub(crate) fn forget_fan<M: FaceMeasure>(&mut self, mesh: &MeasuredMesh<M>) {
        self.versions.resize(mesh.triangulation.slot_count(), 0);
        for &slot in mesh.fan() {
            self.versions[slot as usize] += 1;
        }
    }

    /// Looks into the faces that the mesh's last insertion made, for openings worth more than
    /// `least`.
    pub(crate) fn look_into_fan<M: FaceMeasure>(&mut self, mesh: &mut MeasuredMesh<M>, least: i64) {
        for i in 0..mesh.fan().len() {
            let slot = mesh.fan()[i];
            let (surface, probe) = mesh.probed();
            let opening = look_into(surface, probe, slot, least);
            let version = self.versions[slot as usize];
            self.heap.extend(opening.map(|opening| Opening { version, ..opening }));
        }
    }
}

/// Looks into a face that has not been filled since for the best opening worth more than `least`.
fn look_into<M: FaceMeasure>(
    surface: Surface<'_>,
    probe: &mut Probe<M>,
    slot: u32,
    least: i64,
) -> Option<Opening> {
    let corners = surface.corners(slot);
    let (mut limit, mut best) = (-least.max(0), None);
    for &weights in &PLACES {
        let place = weighted_mean(corners, weights);
        if !surface.is_vacant(place) {
            continue;
        }
        if let Some(change) = surface.insertion_change(place, slot, limit, probe) {
            (limit, best) = (change, Some(place));
        }
    }
    best.map(|place| Opening { gain: -limit, place, slot, version: 0 })
}

/// Slots of the faces of largest error, in no order.
fn worst_faces<M: FaceMeasure>(mesh: &MeasuredMesh<M>, count: usize) -> Vec<u32> {
    let triangulation = &mesh.triangulation;
    let used = |slot: &u32| triangulation.is_used(*slot);
    let mut faces: Vec<u32> = (0..triangulation.slot_count() as u32).filter(used).collect();
    let place = |slot: u32| {
        let mut corners = triangulation.corners(slot);
        corners.sort_unstable();
        corners
    };
    if count < faces.len() {
        faces.select_nth_unstable_by(count, |&a, &b| {
            let by_error = mesh.face_error(b).cmp(&mesh.face_error(a));
            by_error.then_with(|| place(a).cmp(&place(b)))
        });
        faces.truncate(count);
    }
    faces
}

/// The lattice point nearest to a weighted mean of a face's vertices, weights in eighths.
fn weighted_mean(corners: [Point; 3], weights: [i32; 3]) -> Point {
    let mean = |of: fn(&Point) -> i32| {
        let sum: i32 = corners.iter().zip(weights).map(|(p, weight)| weight * of(p)).sum();
        (sum + 4) >> 3
    };
    Point::new(mean(|p| p.x), mean(|p| p.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn openings_gain_what_triangulating_afresh_gains_the_best_first(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mesh = measured(&measure, &image, points.clone());
            let mut openings = Openings::find(&mesh, usize::MAX, 0, &()).unwrap();
            let error = |points: &[Point]| sum_of_errors(&image, points, &triangulate(points));
            let before = error(&points);
            let gain = |place: Point| {
                let mut more = points.clone();
                more.insert(more.partition_point(|p| *p < place), place);
                before as i64 - error(&more) as i64
            };
            // The best place tried of every face, where it gains anything.
            let best = |corners: [Point; 3]| {
                let tried = PLACES.iter().map(|&weights| weighted_mean(corners, weights));
                let vacant = tried.filter(|place| !points.contains(place));
                vacant.map(gain).filter(|&gain| gain > 0).max()
            };
            let faces = (0..mesh.triangulation.slot_count() as u32)
                .map(|slot| mesh.triangulation.corners(slot));
            let mut expected: Vec<i64> = faces.filter_map(best).collect();
            expected.sort_unstable_by(|a, b| b.cmp(a));
            let mut found = Vec::new();
            while let Some(opening) = openings.pop(&mesh) {
                prop_assert_eq!(opening.gain, gain(opening.place));
                found.push(opening.gain);
            }
            prop_assert_eq!(&found, &expected);
            // Of these, only those that are worth more than something.
            let worth_more = |least: i64| {
                let mut openings = Openings::find(&mesh, usize::MAX, least, &()).unwrap();
                let gains = std::iter::from_fn(|| openings.pop(&mesh)).map(|opening| opening.gain);
                gains.collect::<Vec<i64>>()
            };
            for least in [-5, 1, 10, expected.first().copied().unwrap_or(0)] {
                let more: Vec<i64> = expected.iter().copied().filter(|&gain| gain > least).collect();
                prop_assert_eq!(worth_more(least), more);
            }
        }
    }
}
