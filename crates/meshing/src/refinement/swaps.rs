//! Swaps: the cheapest vertices go where they are of most use.
//!
//! Relocation reaches places nearby only. A swap takes out the vertex whose removal raises the
//! error least and inserts it in one of the worst faces, at the place that lowers the error most
//! among a few; it stays where both together, computed one after the other on the mesh as it then
//! is, lower the error. Otherwise the vertex goes back, which restores the mesh exactly.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::refinement::insertion_candidates::{Opening, Openings};
use crate::refinement::relocation::Relocation;
use crate::refinement::removal_costs::RemovalCosts;

/// Swaps that fail one after the other before a round of them ends.
const MOST_FAILURES: usize = 32;

/// Swaps vertices with openings in `face_count` of the worst faces while that lowers the error.
///
/// # Errors
/// When the control cancels.
pub(crate) fn swap_vertices<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    face_count: usize,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let mut costs = RemovalCosts::new(mesh, control)?;
    let Some((least, _)) = costs.cheapest() else { return Ok(()) };
    let mut openings = Openings::find(mesh, face_count, least, control)?;
    let mut failed = 0;
    while let (Some(opening), Some((cost, vertex))) = (openings.pop(mesh), costs.cheapest()) {
        control.poll(Stage::Refine, 0, 1)?;
        if opening.gain <= cost || failed == MOST_FAILURES {
            break;
        }
        let swapped = swap(mesh, vertex, opening);
        openings.forget_fan(mesh);
        if !swapped {
            failed += 1;
            continue;
        }
        failed = 0;
        let around = [mesh.left(), mesh.reached(), &[vertex]].concat();
        relocation.note(&around);
        costs.update(mesh, &around);
        openings.look_into_fan(mesh, cost);
    }
    Ok(())
}

/// Moves a vertex to an opening if that lowers the error; else it stays where it is.
fn swap<M: FaceMeasure>(mesh: &mut MeasuredMesh<M>, vertex: u32, opening: Opening) -> bool {
    let from = mesh.triangulation.points[vertex as usize];
    let (cost, slot) = mesh.remove(vertex);
    let pays = mesh.insertion_change(opening.place, slot, -cost).is_some();
    mesh.insert(vertex, if pays { opening.place } else { from }, slot);
    pays
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    /// Which swaps are tried, and when a round of them ends, changes these numbers; nothing else may.
    #[test]
    fn rounds_of_swaps_come_to_the_same_errors_on_every_machine() {
        let errors = [1_usize, 2, 3, 5, 8, 13].map(|step| {
            let samples: Vec<u16> =
                (0..40 * 40).map(|i| (i * i / (50 * step) % 64 / step * step) as u16).collect();
            let seeds: Vec<(usize, usize)> =
                (0..160).map(|i| (i * 17 * step % 40, i * 29 % 40)).collect();
            let (image, points) = picture(40, 40, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points);
            let mut relocation = Relocation::new(&mesh);
            swap_vertices(&mut mesh, usize::MAX, &mut relocation, &()).unwrap();
            mesh.total_error()
        });
        assert_eq!(errors, [17288, 16770, 18354, 18038, 7338, 15639]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_swap_is_made_when_triangulating_afresh_says_that_it_pays_and_else_changes_nothing(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mesh = measured(&measure, &image, points.clone());
            let mut openings = Openings::find(&mesh, usize::MAX, 0, &()).unwrap();
            let vertices: Vec<u32> =
                (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect();
            let Some(opening) = openings.pop(&mesh) else { return Ok(()) };
            let error = |points: &[_]| {
                let mut sorted = points.to_vec();
                sorted.sort_unstable();
                sum_of_errors(&image, &sorted, &triangulate(&sorted))
            };
            for vertex in vertices {
                let mut mesh = measured(&measure, &image, points.clone());
                let mut moved = points.clone();
                moved[vertex as usize] = opening.place;
                let pays = error(&moved) < error(&points);
                prop_assert_eq!(swap(&mut mesh, vertex, opening), pays);
                let expected = if pays { moved } else { points.clone() };
                prop_assert_eq!(mesh.total_error(), error(&expected));
                let (_, faces, _) = mesh.triangulation.mesh();
                let mut sorted = expected.clone();
                sorted.sort_unstable();
                prop_assert_eq!(faces, triangulate(&sorted));
                prop_assert_eq!(&mesh.triangulation.points, &expected);
            }
        }

        #[test]
        fn a_round_of_swaps_never_raises_the_error_nor_loses_a_vertex(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..64, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let before = mesh.total_error();
            let mut relocation = Relocation::new(&mesh);
            swap_vertices(&mut mesh, usize::MAX, &mut relocation, &()).unwrap();
            let (left, faces, _) = mesh.triangulation.mesh();
            prop_assert_eq!(left.len(), points.len());
            prop_assert_eq!(&faces, &triangulate(&left));
            prop_assert_eq!(mesh.total_error(), sum_of_errors(&image, &left, &faces));
            prop_assert!(mesh.total_error() <= before);
        }
    }
}
