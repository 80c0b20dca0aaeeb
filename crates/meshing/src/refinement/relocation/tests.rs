//! Passes against brute force, patches against the whole mesh, and ties.

use super::*;
use crate::control::OnThreads;
use crate::control::tests::poller;
use crate::face_error::tests::evaluator_of;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, corner_points};
use crate::refinement::tests::{measured, picture, sum_of_errors};
use crate::triangulation::triangulate;
use proptest::prelude::*;
use std::num::NonZeroUsize;

/// The positions after one visit of each vertex, with a fresh triangulation for each candidate.
fn relocated_by_brute_force(
    image: &Image,
    mut points: Vec<Point>,
    order: &[u32],
    search: Search,
) -> Vec<Point> {
    let evaluator = evaluator_of(image);
    let mesh = measured(&evaluator, image, points.clone());
    let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
    let (width, height) = (image.width() as i32, image.height() as i32);
    let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
    for &v in order.iter().filter(|&&v| mesh.triangulation.is_movable(v)) {
        let from = points[v as usize];
        let around = window(2).into_iter().map(|(x, y)| Point::new(from.x + x, from.y + y));
        let positions: Vec<Point> = match search {
            Search::Exhaustive => around.filter(inside).collect(),
            Search::Predicted => {
                let mut sorted = points.clone();
                sorted.sort_unstable();
                let vertex = sorted.binary_search(&from).unwrap() as u32;
                let mut mesh = measured(&evaluator, image, sorted);
                let mut candidates = Vec::new();
                mesh.begin_move(vertex);
                assert!(
                    mesh.find_candidates(
                        &window(2),
                        CANDIDATES,
                        TOLERANCE,
                        &mut candidates,
                        &mut poller()
                    )
                    .unwrap()
                );
                candidates.into_iter().map(|(_, position)| position).collect()
            }
        };
        let mut best = (error(&points), from);
        for candidate in positions {
            if points.contains(&candidate) {
                continue;
            }
            let mut moved = points.clone();
            moved[v as usize] = candidate;
            let error = error(&moved);
            if error < best.0 {
                best = (error, candidate);
                if search == Search::Predicted {
                    break;
                }
            }
        }
        points[v as usize] = best.1;
    }
    points
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn a_pass_equals_brute_force(
        (width, height) in (2usize..9, 2usize..9),
        samples in prop::collection::vec(0u16..64, 81),
        seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        search in prop::sample::select(&[Search::Predicted, Search::Exhaustive][..]),
    ) {
        let (image, points) = picture(width, height, &samples, &seeds);
        let evaluator = evaluator_of(&image);
        let mut mesh = measured(&evaluator, &image, points.clone());
        let mut relocation = Relocation::new(&mesh, &()).unwrap();
        let order = relocation.order.clone();
        relocation.pass(&mut mesh, search, &Cuts::BOTH, &()).unwrap();
        let expected = relocated_by_brute_force(&image, points, &order, search);
        prop_assert_eq!(&mesh.triangulation.points, &expected);
        assert_measured(&mesh, &evaluator);
    }

    #[test]
    fn patches_equal_the_whole_mesh_in_their_order(
        (width, height) in (2usize..24, 2usize..24),
        samples in prop::collection::vec(0u16..64, 576),
        seeds in prop::collection::vec((0usize..24, 0usize..24), 0..90),
        search in prop::sample::select(&[Search::Predicted, Search::Exhaustive][..]),
        (halvings, threads) in (1u32..4, 1usize..4),
    ) {
        let (image, points) = picture(width, height, &samples, &seeds);
        let evaluator = evaluator_of(&image);
        let new_mesh = || measured(&evaluator, &image, points.clone());
        let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
        let (mut mesh, mut whole) = (new_mesh(), new_mesh());
        let mut in_patches = Relocation::new(&mesh, &()).unwrap();
        let mut in_turn = in_patches.clone();
        let all = in_turn.order.clone();
        for cuts in Cuts::BOTH {
            let was_pending = in_patches.is_pending.clone();
            let partition = Partition::new(&mesh.triangulation, cuts, halvings, &()).unwrap();
            in_patches.visit_patches(&mut mesh, search, &partition, 0, &control).unwrap();
            // The same visits on the whole mesh, one patch after the other.
            let orders = partition.by_patch(all.iter().copied());
            let by_patch = orders.iter().zip(&partition.patches).flat_map(|(order, patch)| {
                order.iter().map(|&index| patch.vertices[index as usize])
            });
            let visited = |&v: &u32| was_pending[v as usize] && !in_patches.is_pending[v as usize];
            in_turn.order = by_patch.filter(visited).collect();
            in_turn.visit_in_order(&mut whole, search, &()).unwrap();
            prop_assert_eq!(&in_turn.is_pending, &in_patches.is_pending);
            prop_assert_eq!(&in_turn.is_outdated, &in_patches.is_outdated);
            prop_assert_eq!(mesh.triangulation.sorted(&()), whole.triangulation.sorted(&()));
            prop_assert_eq!(&mesh.triangulation.points, &whole.triangulation.points);
        }
        assert_measured(&mesh, &evaluator);
    }

    #[test]
    fn candidates_ascend_by_predicted_change(
        samples in prop::collection::vec(0u16..64, 81),
        seeds in prop::collection::vec((0usize..9, 0usize..9), 1..8),
    ) {
        let (image, points) = picture(9, 9, &samples, &seeds);
        let evaluator = evaluator_of(&image);
        let mut mesh = measured(&evaluator, &image, points.clone());
        let (mut all, mut two, mut likely) = (Vec::new(), Vec::new(), Vec::new());
        for (v, &from) in (0..).zip(&points) {
            if !mesh.triangulation.is_movable(v) {
                continue;
            }
            mesh.begin_move(v);
            for (count, tolerance, candidates) in
                [(24, f32::MAX, &mut all), (2, f32::MAX, &mut two), (24, TOLERANCE, &mut likely)]
            {
                let far = window(2);
                let found = mesh.find_candidates(&far, count, tolerance, candidates, &mut poller());
                assert_eq!(found, Ok(true));
            }
            let slots = 0..mesh.triangulation.slot_count() as u32;
            let around = slots.filter(|&t| mesh.triangulation.corners(t).contains(&from));
            let error = around.map(|t| mesh.triangulation.face_error(t)).sum::<u64>();
            // Where there is no error, only rounding can predict a gain.
            prop_assert!(error > 0 || all.iter().all(|&(change, _)| change < 0.0));
            prop_assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
            prop_assert_eq!(&two[..], &all[..all.len().min(2)]);
            all.retain(|&(change, _)| change < TOLERANCE * error as f32);
            prop_assert_eq!(&likely, &all);
        }
    }
}

/// A picture of one level but for some points, and its corners with other vertices.
fn level_but_for(odd: &[(usize, usize)], inner: &[(usize, usize)]) -> (Image, Vec<Point>) {
    let mut samples = vec![9; 11 * 11];
    odd.iter().for_each(|&(x, y)| samples[y * 11 + x] = 63);
    picture(11, 11, &samples, inner)
}

#[test]
fn equal_predictions_come_nearest_first() {
    // The odd point is in a face of the vertex, so that there is an error, but the prediction is
    // the same for all positions.
    let (image, points) = level_but_for(&[(5, 9)], &[(5, 5)]);
    let evaluator = evaluator_of(&image);
    let mut mesh = measured(&evaluator, &image, points.clone());
    let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap() as u32;
    let mut candidates = Vec::new();
    mesh.begin_move(vertex);
    let found = mesh.find_candidates(&window(2), 9, TOLERANCE, &mut candidates, &mut poller());
    assert_eq!(found, Ok(true));
    let found: Vec<(i32, i32)> = candidates.iter().map(|(_, p)| (p.x - 5, p.y - 5)).collect();
    let nearest = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1), (0, -2)];
    assert_eq!(found, nearest);
    assert!(candidates.iter().all(|&(change, _)| change == 0.0));
}

#[test]
fn ties_take_the_nearest_then_the_leftmost() {
    // At every other position of the vertex the odd point alone has an error.
    for (taken, expected) in [
        (&[][..], (5, 4)),
        (&[(5, 4)], (4, 5)),
        (&[(5, 4), (4, 5)], (6, 5)),
        (&[(5, 4), (4, 5), (6, 5)], (5, 6)),
    ] {
        let (image, points) = level_but_for(&[(5, 5)], &[&[(5, 5)], taken].concat());
        let evaluator = evaluator_of(&image);
        let mut mesh = measured(&evaluator, &image, points.clone());
        let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap();
        assert!(mesh.begin_move(vertex as u32));
        let outcome = move_to_best(&mut mesh, vertex as u32, &window(2), &mut poller());
        assert_eq!(outcome, Ok(Outcome::Moved));
        let moved = mesh.triangulation.points[vertex];
        assert_eq!((moved.x, moved.y), expected);
    }
}

#[test]
fn predicted_search_skips_large_faces_in_dense_meshes() {
    // A vertex with large faces beside a slope, where it lowers the error, and others far away.
    let (width, height) = (112_usize, 64);
    let samples: Vec<u16> =
        (0..width * height).map(|i| (i % width).saturating_sub(60) as u16).collect();
    let far = Point::new(66, 40);
    for (others, precision, component_count, skips) in
        [(1, 8, 1, false), (2, 8, 1, true), (2, 16, 3, true), (2, 8, 5, false)]
    {
        let components = vec![samples.clone(); component_count];
        let image = Image::from_bottom_up(width, height, precision, components).unwrap();
        let evaluator = evaluator_of(&image).with_model(&mut poller()).unwrap();
        let near = (0..others).map(|i| Point::new(1 + i % 5 * 2, 1 + i / 5 * 2));
        let mut points: Vec<Point> =
            near.chain(corner_points(width, height)).chain([far]).collect();
        points.sort_unstable();
        // With two others the mesh is just dense.
        assert_eq!(points.len() * DENSE == width * height, others == 2);
        let is_moved = |search| {
            let mut mesh = measured(&evaluator, &image, points.clone());
            let mut relocation = Relocation::new(&mesh, &()).unwrap();
            relocation.pass(&mut mesh, search, &Cuts::BOTH, &()).unwrap();
            !mesh.triangulation.points.contains(&far)
        };
        assert_eq!(is_moved(Search::Predicted), !skips, "{others} others, {precision} bits");
        assert!(is_moved(Search::Exhaustive));
    }
}

/// The faces are those of a new triangulation, with their errors.
fn assert_measured(mesh: &MeasuredMesh<FaceErrors<'_>>, evaluator: &ErrorEvaluator<'_>) {
    let sorted = mesh.triangulation.sorted(&()).unwrap();
    assert_eq!(sorted.faces, triangulate(&sorted.points));
    for slot in 0..mesh.triangulation.slot_count() as u32 {
        let is_used = mesh.triangulation.is_used(slot);
        let corners = || mesh.triangulation.corners(slot);
        let error = if is_used {
            FaceErrors::new(evaluator).error(corners(), &mut poller()).unwrap()
        } else {
            0
        };
        assert_eq!(mesh.triangulation.face_error(slot), error);
    }
    let slots: Vec<u32> = (0..mesh.triangulation.slot_count() as u32).collect();
    assert_eq!(mesh.triangulation.total_error, mesh.triangulation.error_of(&slots));
}
