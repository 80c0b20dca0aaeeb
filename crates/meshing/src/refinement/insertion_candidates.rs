//! Insertion candidates: positions where one more vertex would lower the error most.

use crate::control::{Cancelled, Control, Poller, Stage, select, sort};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::evaluator::Evaluator;
use crate::dynamic_mesh::half_edges::DynamicTriangulation;
use crate::face_error::FaceMeasure;
use crate::image::Point;
use std::cmp::Reverse;

/// Barycentric weights, in eighths, of the positions tried in a face: its middle, one near each
/// vertex, and the middle of each edge.
const WEIGHTS: [[i32; 3]; 7] =
    [[3, 3, 2], [4, 2, 2], [2, 4, 2], [2, 2, 4], [4, 4, 0], [0, 4, 4], [4, 0, 4]];

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Candidate {
    pub(crate) gain: i64,
    pub(crate) position: Point,
    pub(crate) slot: u32,
    corners: [Point; 3],
}

impl Candidate {
    pub(crate) fn insert<M: FaceMeasure>(
        &self,
        mesh: &mut MeasuredMesh<M>,
        poller: &mut Poller<'_>,
    ) -> Result<Option<u32>, Cancelled> {
        let is_current = mesh.triangulation.corners(self.slot) == self.corners;
        if is_current { mesh.add_vertex(self.position, self.slot, poller) } else { Ok(None) }
    }
}

/// The best candidate of each of the `face_count` faces of largest error that has one, in
/// descending order of their gains. Faces of equal error may add some to the count.
pub(crate) fn find_candidates<M: FaceMeasure>(
    mesh: &MeasuredMesh<M>,
    face_count: usize,
    control: &dyn Control,
) -> Result<Vec<Candidate>, Cancelled> {
    let faces = worst_faces(&mesh.triangulation, face_count, control)?;
    let found = mesh.evaluate_all(&faces, best_in_face, control)?;
    let mut candidates: Vec<Candidate> = found.into_iter().flatten().collect();
    sort(&mut candidates, &|| control.poll(Stage::Refine, 0, 1))?;
    candidates.reverse();
    Ok(candidates)
}

fn best_in_face<M: FaceMeasure>(
    evaluator: &mut Evaluator<M>,
    triangulation: &DynamicTriangulation,
    slot: u32,
    poller: &mut Poller<'_>,
) -> Result<Option<Candidate>, Cancelled> {
    let corners = triangulation.corners(slot);
    let (mut limit, mut best) = (0, None);
    for weights in WEIGHTS {
        let position = weighted_mean(corners, weights);
        let change = evaluator.insertion_change(triangulation, position, slot, limit, poller)?;
        if let Some(change) = change {
            (limit, best) = (change, Some(position));
        }
    }
    Ok(best.map(|position| Candidate { gain: -limit, position, slot, corners }))
}

/// Slots of the faces of largest error, not of faces without error.
fn worst_faces(
    triangulation: &DynamicTriangulation,
    count: usize,
    control: &dyn Control,
) -> Result<Vec<u32>, Cancelled> {
    let slots = 0..triangulation.slot_count() as u32;
    let error = |slot| (Reverse(triangulation.face_error(slot)), slot);
    let mut errors: Vec<(Reverse<u64>, u32)> = slots.clone().map(error).collect();
    let mut least = 1;
    if count < errors.len() {
        let poll = || control.poll(Stage::Refine, 0, 1);
        least = select(&mut errors, count, &poll)?.0.0.max(least);
    }
    Ok(slots.filter(|&slot| triangulation.face_error(slot) >= least).collect())
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
    use crate::control::tests::poller;
    use crate::face_error::tests::evaluator_of;
    use crate::refinement::tests::{measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn gains_are_those_of_fresh_triangulations(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
            face_count in 0usize..20,
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let evaluator = evaluator_of(&image);
            let mesh = measured(&evaluator, &image, points.clone());
            let error = |points: &[Point]| sum_of_errors(&image, points, &triangulate(points));
            let before = error(&points);
            let gain = |position: Point| {
                let mut more = points.clone();
                more.insert(more.partition_point(|p| *p < position), position);
                before as i64 - error(&more) as i64
            };
            // The best gain of every face that has one, faces of largest error first.
            let mut slots: Vec<u32> = (0..mesh.triangulation.slot_count() as u32).collect();
            slots.sort_by_key(|&slot| Reverse(mesh.triangulation.face_error(slot)));
            let best = |&slot: &u32| {
                let corners = mesh.triangulation.corners(slot);
                let tried = WEIGHTS.iter().map(|&weights| weighted_mean(corners, weights));
                let vacant = tried.filter(|position| !points.contains(position));
                vacant.map(gain).filter(|&gain| gain > 0).max()
            };
            let error = |&slot: &u32| mesh.triangulation.face_error(slot);
            let least = slots.get(face_count).map_or(0, error).max(1);
            slots.retain(|slot| error(slot) >= least);
            let mut expected: Vec<i64> = slots.iter().filter_map(best).collect();
            expected.sort_unstable_by_key(|&gain| Reverse(gain));
            let found = find_candidates(&mesh, face_count, &()).unwrap();
            for candidate in &found {
                prop_assert_eq!(candidate.gain, gain(candidate.position));
                let mut mesh = measured(&evaluator, &image, points.clone());
                prop_assert!(candidate.insert(&mut mesh, &mut poller()).unwrap().is_some());
                let after = mesh.triangulation.total_error;
                prop_assert_eq!(after as i64, before as i64 - candidate.gain);
            }
            let gains: Vec<i64> = found.iter().map(|candidate| candidate.gain).collect();
            prop_assert_eq!(gains, expected);
        }
    }

    #[test]
    fn candidates_of_replaced_faces_are_outdated() {
        let samples: Vec<u16> = (0..81).map(|i| i * i % 64).collect();
        let (image, points) = picture(9, 9, &samples, &[]);
        let evaluator = evaluator_of(&image);
        let mut mesh = measured(&evaluator, &image, points);
        let found = find_candidates(&mesh, usize::MAX, &()).unwrap();
        assert!(found[0].insert(&mut mesh, &mut poller()).unwrap().is_some());
        assert_eq!(found[0].insert(&mut mesh, &mut poller()), Ok(None));
    }
}
