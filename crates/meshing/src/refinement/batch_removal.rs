//! Batch removal: many of the cheapest vertices leave a mesh together.
//!
//! A batch consists of the vertices whose removal raises the error least, without the neighbours
//! of cheaper ones: the cost of a vertex does not change while its neighbours stay. Then all
//! neighbours of the batch are evaluated together, on all threads. Exact greedy removal would
//! evaluate them one after the other, several times each; its order is a little different.

use crate::control::{Cancelled, Control, Poller, Stage, select, sort};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::evaluator::Evaluator;
use crate::face_error::FaceMeasure;
use crate::removal::Removal;

/// A batch takes at most one in this many of the vertices that are left.
const LARGEST_BATCH: usize = 4;

/// Removes `count` vertices, or all that can be removed, and returns them in order; calls
/// `on_change` with the neighbours of each.
pub(crate) fn remove_in_batches<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    count: usize,
    mut on_change: impl FnMut(&[u32]),
    control: &dyn Control,
) -> Result<Vec<Removal>, Cancelled> {
    let mut is_outdated = vec![false; mesh.triangulation.points.len()];
    let mut outdated: Vec<u32> = (0..is_outdated.len() as u32).collect();
    // The change of the error by the removal of a vertex, and the vertex.
    let mut costs = Vec::<(i64, u32)>::new();
    let mut removals = Vec::new();
    let poll = || control.poll(Stage::Refine, 0, 1);
    let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
    while removals.len() < count {
        outdated.retain(|&v| mesh.triangulation.is_movable(v));
        let changes = mesh.evaluate_all(&outdated, Evaluator::removal_change, control)?;
        costs.extend(changes.into_iter().zip(outdated.iter().copied()));
        outdated.clear();
        if costs.is_empty() {
            break;
        }
        let batch = (count - removals.len()).min(costs.len().div_ceil(LARGEST_BATCH));
        if batch < costs.len() {
            select(&mut costs, batch, &poll)?;
        }
        sort(&mut costs[..batch], &poll)?;
        for &(change, vertex) in &costs[..batch] {
            if is_outdated[vertex as usize] {
                continue;
            }
            poller.poll()?;
            removals.push(Removal { point: mesh.triangulation.points[vertex as usize], change });
            mesh.remove(vertex, poller)?;
            on_change(mesh.link());
            outdated.extend(mesh.link().iter().filter(|&&v| !is_outdated[v as usize]));
            mesh.link().iter().for_each(|&v| is_outdated[v as usize] = true);
        }
        costs.retain(|&(_, v)| mesh.triangulation.is_movable(v) && !is_outdated[v as usize]);
        outdated.iter().for_each(|&v| is_outdated[v as usize] = false);
    }
    Ok(removals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::dynamic_mesh::half_edges::SortedMesh;
    use crate::face_error::tests::evaluator_of;
    use crate::image::{Image, Point, corner_points};
    use crate::refinement::tests::{measured, picture, sum_of_errors};
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::num::NonZeroUsize;

    /// The points that batch removal leaves, triangulated and measured afresh for each batch.
    fn left_by_brute_force(
        image: &Image,
        points: &[Point],
        corners: &[Point],
        count: usize,
    ) -> Vec<Point> {
        let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points)) as i64;
        let (mut kept, mut left) = (points.to_vec(), count);
        while left > 0 {
            let cost = |p: &Point| {
                let without: Vec<Point> = kept.iter().copied().filter(|q| q != p).collect();
                error(&without) - error(&kept)
            };
            let movable = kept.iter().filter(|p| !corners.contains(p));
            let mut costs: Vec<(i64, Point)> = movable.map(|p| (cost(p), *p)).collect();
            costs.sort_unstable();
            let faces = triangulate(&kept);
            let number = |p: &Point| kept.binary_search(p).unwrap() as u32;
            let mut removed: Vec<Point> = Vec::new();
            for (_, p) in costs.iter().take(left.min(costs.len().div_ceil(LARGEST_BATCH))) {
                let is_neighbour = |q: &Point| {
                    let joins = |f: &Face| f.contains(&number(p)) && f.contains(&number(q));
                    faces.iter().any(joins)
                };
                if !removed.iter().any(is_neighbour) {
                    removed.push(*p);
                }
            }
            left -= removed.len();
            kept.retain(|p| !removed.contains(p));
        }
        kept
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_batch_is_the_cheapest_without_neighbours(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..20),
            (part, threads) in (0usize..=100, 1usize..4),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let (evaluator, threads) = (evaluator_of(&image), NonZeroUsize::new(threads).unwrap());
            let mut mesh = measured(&evaluator, &image, points.clone());
            let count = (points.len() - 4) * part / 100;
            let control = OnThreads((), threads);
            let mut changes = 0;
            let removals =
                remove_in_batches(&mut mesh, count, |_| changes += 1, &control).unwrap();
            prop_assert_eq!((removals.len(), changes), (count, count));
            let corners = corner_points(width, height);
            let expected = left_by_brute_force(&image, &points, &corners, count);
            let SortedMesh { points: kept, faces, .. } = mesh.triangulation.sorted(&()).unwrap();
            prop_assert_eq!(&kept, &expected);
            prop_assert_eq!(&faces, &triangulate(&expected));
            let before = sum_of_errors(&image, &points, &triangulate(&points)) as i64;
            let change: i64 = removals.iter().map(|removal| removal.change).sum();
            let after = mesh.triangulation.total_error;
            prop_assert_eq!(after as i64, before + change);
            prop_assert_eq!(after, sum_of_errors(&image, &expected, &faces));
        }
    }

    #[test]
    fn only_the_corners_stay() {
        let seeds: Vec<(usize, usize)> = (0..40).map(|i| (i % 8, i * 3 % 7)).collect();
        let samples: Vec<u16> = (0..81).map(|i| i * i % 64).collect();
        let (image, points) = picture(8, 8, &samples, &seeds);
        let evaluator = evaluator_of(&image);
        let mut mesh = measured(&evaluator, &image, points);
        remove_in_batches(&mut mesh, usize::MAX, |_| (), &()).unwrap();
        assert_eq!(mesh.triangulation.vertex_count(), 4);
    }
}
