//! Passes against brute force, patches against the whole mesh, and ties.

use super::*;
use crate::control::OnThreads;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, corner_points};
use crate::parameters::choices::ErrorMetric;
use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
use crate::triangulation::triangulate;
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;

/// The positions after one visit of each vertex, with a fresh triangulation for each candidate.
fn relocated_by_brute_force(
    image: &Image,
    mut points: Vec<Point>,
    order: &[u32],
    search: Search,
) -> Vec<Point> {
    let measure = measure_of(image);
    let mesh = measured(&measure, image, points.clone());
    let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
    let (width, height) = (image.width() as i32, image.height() as i32);
    let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
    for &v in order.iter().filter(|&&v| mesh.is_movable(v)) {
        let from = points[v as usize];
        let around = window(2).into_iter().map(|(x, y)| Point::new(from.x + x, from.y + y));
        let positions: Vec<Point> = match search {
            Search::Exhaustive => around.filter(inside).collect(),
            Search::Predicted => {
                let mut sorted = points.clone();
                sorted.sort_unstable();
                let vertex = sorted.binary_search(&from).unwrap() as u32;
                let mut mesh = measured(&measure, image, sorted);
                let mut candidates = Vec::new();
                mesh.begin_move(vertex);
                assert!(mesh.find_candidates(&window(2), CANDIDATES, TOLERANCE, &mut candidates));
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
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let mut relocation = Relocation::new(&mesh);
        let order = relocation.order.clone();
        relocation.pass(&mut mesh, search, Scope::All, &()).unwrap();
        let expected = relocated_by_brute_force(&image, points, &order, search);
        prop_assert_eq!(&mesh.triangulation().points, &expected);
        let total = sum_of_errors(&image, &expected, &triangulate(&expected));
        prop_assert_eq!(mesh.total_error(), total);
        for slot in 0..mesh.triangulation().slot_count() as u32 {
            let used = mesh.triangulation().is_used(slot);
            let error = used.then(|| FaceErrors::new(&measure).error(mesh.triangulation().corners(slot)));
            prop_assert_eq!(mesh.face_error(slot), error.unwrap_or(0));
        }
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
        let measure = measure_of(&image);
        let new_mesh = || measured(&measure, &image, points.clone());
        let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
        let (mut mesh, mut whole) = (new_mesh(), new_mesh());
        let mut in_patches = Relocation::new(&mesh);
        let mut in_turn = in_patches.clone();
        let all = in_turn.order.clone();
        for cuts in [Cuts::Straight, Cuts::Diagonal] {
            let was_pending = in_patches.is_pending.clone();
            in_patches.visit_patches(&mut mesh, search, cuts, halvings, &control).unwrap();
            // The same visits on the whole mesh, one patch after the other.
            let partition = Partition::new(whole.triangulation(), cuts, halvings, &()).unwrap();
            let orders = partition.by_patch(all.iter().copied());
            let by_patch = orders.iter().zip(&partition.patches).flat_map(|(order, patch)| {
                order.iter().map(|&index| patch.vertices[index as usize])
            });
            let visited = |&v: &u32| was_pending[v as usize] && !in_patches.is_pending[v as usize];
            in_turn.order = by_patch.filter(visited).collect();
            in_turn.visit_in_order(&mut whole, search, &()).unwrap();
            prop_assert_eq!(&in_turn.is_pending, &in_patches.is_pending);
            prop_assert_eq!(&in_turn.is_outdated, &in_patches.is_outdated);
            assert_same(&mesh, &whole)?;
        }
        let (left, faces, _) = mesh.triangulation().mesh();
        prop_assert_eq!(&faces, &triangulate(&left));
        prop_assert_eq!(mesh.total_error(), sum_of_errors(&image, &left, &faces));
    }

    #[test]
    fn candidates_are_the_vacant_of_least_prediction(
        samples in prop::collection::vec(0u16..64, 81),
        seeds in prop::collection::vec((0usize..9, 0usize..9), 1..8),
    ) {
        let (image, points) = picture(9, 9, &samples, &seeds);
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let (mut all, mut two, mut likely) = (Vec::new(), Vec::new(), Vec::new());
        for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
            mesh.begin_move(v);
            assert!(mesh.find_candidates(&window(2), 24, f32::MAX, &mut all));
            assert!(mesh.find_candidates(&window(2), 2, f32::MAX, &mut two));
            assert!(mesh.find_candidates(&window(2), 24, TOLERANCE, &mut likely));
            let from = points[v as usize];
            let near = |p: &Point| (p.x - from.x).abs() <= 2 && (p.y - from.y).abs() <= 2;
            let lattice = (0..9).flat_map(|y| (0..9).map(move |x| Point::new(x, y)));
            let vacant = lattice.filter(near).filter(|p| !points.contains(p)).count();
            // Where there is no error nothing can be gained, though rounding may predict a gain.
            let slots = 0..mesh.triangulation().slot_count() as u32;
            let around = slots.filter(|&t| mesh.triangulation().corners(t).contains(&from));
            let error = around.map(|t| mesh.face_error(t)).sum::<u64>();
            if error == 0 {
                prop_assert!(all.iter().all(|&(change, _)| change < 0.0));
            } else {
                // A vertex that is no neighbour may be in the window too.
                prop_assert!(all.len() >= vacant);
            }
            prop_assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
            prop_assert_eq!(&two[..], &all[..two.len()]);
            prop_assert_eq!(two.len(), all.len().min(2));
            all.retain(|&(change, _)| change < TOLERANCE * error as f32);
            prop_assert_eq!(&likely, &all);
        }
    }
}

#[test]
fn equal_weights_change_no_candidates() {
    let samples: Vec<u16> = (0..81).map(|i| (i * i / 3 % 64) as u16).collect();
    let seeds: Vec<(usize, usize)> = (0..12).map(|i| (i * 5 % 9, i * 7 % 9)).collect();
    let (plain, points) = picture(9, 9, &samples, &seeds);
    let weights = [77; 81];
    let measures = [None, Some(&weights[..])]
        .map(|weights| ErrorEvaluator::new(&plain, ErrorMetric::MeanCompSe, weights).with_model());
    let [mut plain_mesh, mut weighted_mesh] =
        [0, 1].map(|i| measured(&measures[i], &plain, points.clone()));
    assert_eq!(weighted_mesh.total_error(), 77 * plain_mesh.total_error());
    let mut refused = 0;
    for v in (0..points.len() as u32).filter(|&v| plain_mesh.is_movable(v)).collect::<Vec<_>>() {
        let found = [&mut plain_mesh, &mut weighted_mesh].map(|mesh| {
            let (mut any, mut likely) = (Vec::new(), Vec::new());
            mesh.begin_move(v);
            assert!(mesh.find_candidates(&window(2), 24, f32::MAX, &mut any));
            assert!(mesh.find_candidates(&window(2), 24, TOLERANCE, &mut likely));
            refused += any.len() - likely.len();
            (any, likely)
        });
        assert_eq!(found[0], found[1]);
    }
    assert!(refused > 0);
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
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap() as u32;
    let mut candidates = Vec::new();
    mesh.begin_move(vertex);
    assert!(mesh.find_candidates(&window(2), 9, TOLERANCE, &mut candidates));
    let found: Vec<(i32, i32)> = candidates.iter().map(|(_, p)| (p.x - 5, p.y - 5)).collect();
    let nearest = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1), (0, -2)];
    assert_eq!(found, nearest);
    assert!(candidates.iter().all(|&(change, _)| change == 0.0));
}

#[test]
fn no_candidates_without_error() {
    let (image, points) = level_but_for(&[], &[(5, 5), (3, 7)]);
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
        let mut candidates = Vec::new();
        mesh.begin_move(v);
        assert!(mesh.find_candidates(&window(2), 24, f32::MAX, &mut candidates));
        assert_eq!(candidates, []);
    }
}

#[test]
fn ties_take_the_nearest_then_the_leftmost() {
    // Wherever the vertex goes from its odd point, that alone is wrong then.
    for (taken, expected) in [
        (&[][..], (5, 4)),
        (&[(5, 4)], (4, 5)),
        (&[(5, 4), (4, 5)], (6, 5)),
        (&[(5, 4), (4, 5), (6, 5)], (5, 6)),
    ] {
        let (image, points) = level_but_for(&[(5, 5)], &[&[(5, 5)], taken].concat());
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap();
        assert!(mesh.begin_move(vertex as u32));
        assert_eq!(move_to_best(&mut mesh, vertex as u32, &window(2)), Outcome::Moved);
        let moved = mesh.triangulation().points[vertex];
        assert_eq!((moved.x, moved.y), expected);
    }
}

#[test]
fn small_meshes_are_visited_wholly() {
    let (image, points) = level_but_for(&[(5, 9)], &[(5, 5), (2, 3), (7, 8)]);
    let measure = measure_of(&image);
    for scope in [Scope::OnePartition, Scope::TwoPartitions, Scope::All] {
        let mut mesh = measured(&measure, &image, points.clone());
        let mut whole = measured(&measure, &image, points.clone());
        let mut relocation = Relocation::new(&mesh);
        let mut in_order = relocation.clone();
        relocation.pass(&mut mesh, Search::Exhaustive, scope, &()).unwrap();
        in_order.visit_in_order(&mut whole, Search::Exhaustive, &()).unwrap();
        assert_eq!(mesh.triangulation().points, whole.triangulation().points);
    }
}

#[test]
fn predicted_search_skips_large_faces_in_dense_meshes() {
    // One vertex with large faces, at the foot of a slope that it should climb, and others far away.
    let (width, height) = (112_usize, 64);
    let samples: Vec<u16> =
        (0..width * height).map(|i| (i % width).saturating_sub(60) as u16).collect();
    let far = Point::new(66, 40);
    for (others, precision, component_count, skips) in
        [(1, 8, 1, false), (2, 8, 1, true), (2, 16, 3, true), (2, 8, 5, false)]
    {
        let components = vec![samples.clone(); component_count];
        let image = Image::from_bottom_up(width, height, precision, components).unwrap();
        let measure = ErrorEvaluator::new(&image, ErrorMetric::MeanCompSe, None).with_model();
        let near = (0..others).map(|i| Point::new(1 + i % 5 * 2, 1 + i / 5 * 2));
        let mut points: Vec<Point> =
            near.chain(corner_points(width, height)).chain([far]).collect();
        points.sort_unstable();
        // With two others the mesh is just dense.
        assert_eq!(points.len() * DENSE == width * height, others == 2);
        let is_moved = |search| {
            let mut mesh = measured(&measure, &image, points.clone());
            let mut relocation = Relocation::new(&mesh);
            relocation.pass(&mut mesh, search, Scope::All, &()).unwrap();
            !mesh.triangulation().points.contains(&far)
        };
        assert_eq!(is_moved(Search::Predicted), !skips, "{others} others, {precision} bits");
        assert!(is_moved(Search::Exhaustive));
    }
}

/// The meshes have the same vertices at the same positions, the same faces and the same errors.
fn assert_same(
    a: &MeasuredMesh<FaceErrors<'_>>,
    b: &MeasuredMesh<FaceErrors<'_>>,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(&a.triangulation().points, &b.triangulation().points);
    prop_assert_eq!(a.triangulation().mesh(), b.triangulation().mesh());
    prop_assert_eq!(a.total_error(), b.total_error());
    let errors = |mesh: &MeasuredMesh<FaceErrors<'_>>| {
        let triangulation = mesh.triangulation();
        let slots = 0..triangulation.slot_count() as u32;
        let used = slots.filter(|&slot| triangulation.is_used(slot));
        let error = |slot| (triangulation.corners(slot).into_iter().min(), mesh.face_error(slot));
        used.map(error).collect::<BTreeSet<_>>()
    };
    prop_assert_eq!(errors(a), errors(b));
    Ok(())
}
