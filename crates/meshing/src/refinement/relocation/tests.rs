//! Passes against trying every place on fresh meshes, patches against the whole, and their order.

use super::*;
use crate::control::OnThreads;
use crate::control::tests::Recorder;
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, corner_points};
use crate::parameters::choices::ErrorMetric;
use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
use crate::triangulation::triangulate;
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;

/// The places after one look at each vertex, each candidate triangulated and measured afresh.
fn relocated_by_brute_force(
    image: &Image,
    mut points: Vec<Point>,
    order: &[u32],
    look: Look,
) -> Vec<Point> {
    let measure = measure_of(image);
    let mesh = measured(&measure, image, points.clone());
    let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
    let (width, height) = (image.width() as i32, image.height() as i32);
    let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
    for &v in order.iter().filter(|&&v| mesh.is_movable(v)) {
        let from = points[v as usize];
        let around = offsets(2).into_iter().map(|(x, y)| Point::new(from.x + x, from.y + y));
        let places: Vec<Point> = match look {
            Look::Thorough => around.filter(inside).collect(),
            Look::Foresighted => {
                let mut mesh = measured(&measure, image, points.clone());
                let mut promising = Vec::new();
                mesh.look_at(v);
                assert!(mesh.find_candidates(&offsets(2), PROMISING, DOUBT, &mut promising));
                promising.into_iter().map(|(_, place)| place).collect()
            }
        };
        let mut best = (error(&points), from);
        for candidate in places {
            if points.contains(&candidate) {
                continue;
            }
            let mut moved = points.clone();
            moved[v as usize] = candidate;
            let error = error(&moved);
            if error < best.0 {
                best = (error, candidate);
                if look == Look::Foresighted {
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
    fn a_pass_moves_vertices_as_trying_every_place_on_a_fresh_mesh_does(
        (width, height) in (2usize..9, 2usize..9),
        samples in prop::collection::vec(0u16..64, 81),
        seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
        look in prop::sample::select(&[Look::Foresighted, Look::Thorough][..]),
    ) {
        let (image, points) = picture(width, height, &samples, &seeds);
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let mut relocation = Relocation::new(&mesh);
        let order = relocation.order.clone();
        relocation.pass(&mut mesh, (look, Scope::All), &()).unwrap();
        let expected = relocated_by_brute_force(&image, points, &order, look);
        prop_assert_eq!(&mesh.triangulation.points, &expected);
        let total = sum_of_errors(&image, &expected, &triangulate(&expected));
        prop_assert_eq!(mesh.total_error(), total);
        for slot in 0..mesh.triangulation.slot_count() as u32 {
            let used = mesh.triangulation.is_used(slot);
            let error = used.then(|| measured_error(&measure, mesh.triangulation.corners(slot)));
            prop_assert_eq!(mesh.face_error(slot), error.unwrap_or(0));
        }
    }

    #[test]
    fn a_pass_with_patches_is_one_of_the_whole_mesh_patch_by_patch(
        (width, height) in (2usize..24, 2usize..24),
        samples in prop::collection::vec(0u16..64, 576),
        seeds in prop::collection::vec((0usize..24, 0usize..24), 0..90),
        look in prop::sample::select(&[Look::Foresighted, Look::Thorough][..]),
        (halvings, threads) in (1u32..4, 1usize..4),
    ) {
        let (image, points) = picture(width, height, &samples, &seeds);
        let measure = measure_of(&image);
        let new_mesh = || measured(&measure, &image, points.clone());
        let threads = OnThreads((), NonZeroUsize::new(threads).unwrap());
        let mut mesh = new_mesh();
        let mut relocation = Relocation::new(&mesh);
        // The same looks on the whole mesh, one patch after the other, then at what is left.
        let mut twin = new_mesh();
        let mut in_turn = Relocation::new(&twin);
        let all = in_turn.order.clone();
        for cuts in [Cuts::Straight, Cuts::Diagonal] {
            let was_due = relocation.is_due.clone();
            let count =
                relocation.look_in_patches(&mut mesh, look, (cuts, halvings), &threads).unwrap();
            let partition = Partition::new(&twin.triangulation, cuts, halvings);
            let orders = partition.in_parts(all.iter().copied());
            let by_part = orders.iter().zip(&partition.parts).flat_map(|(order, part)| {
                order.iter().map(|&number| part.vertices[number as usize])
            });
            let is_looked_at = |v: &u32| was_due[*v as usize] && !relocation.is_due[*v as usize];
            in_turn.order = by_part.filter(is_looked_at).collect();
            let again = in_turn.look_in_order(&mut twin, look, &|_| Ok(())).unwrap();
            prop_assert_eq!(count, again);
            prop_assert_eq!(&in_turn.is_due, &relocation.is_due);
            assert_same(&mesh, &twin)?;
        }
        for (relocation, mesh) in [(&mut relocation, &mut mesh), (&mut in_turn, &mut twin)] {
            relocation.order = all.clone();
            relocation.look_in_order(mesh, look, &|_| Ok(())).unwrap();
        }
        assert_same(&mesh, &twin)?;
        prop_assert_eq!(&relocation.changed, &in_turn.changed);
        let (left, faces, _) = mesh.triangulation.mesh();
        prop_assert_eq!(&faces, &triangulate(&left));
        prop_assert_eq!(mesh.total_error(), sum_of_errors(&image, &left, &faces));
        for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
            mesh.remove(v);
        }
        prop_assert_eq!(mesh.total_error(), sum_of_errors_of_corners(&image));
    }

    #[test]
    fn the_promising_places_are_the_vacant_ones_of_least_forecast_in_order(
        samples in prop::collection::vec(0u16..64, 81),
        seeds in prop::collection::vec((0usize..9, 0usize..9), 1..8),
    ) {
        let (image, points) = picture(9, 9, &samples, &seeds);
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let (mut all, mut few, mut likely) = (Vec::new(), Vec::new(), Vec::new());
        for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
            mesh.look_at(v);
            assert!(mesh.find_candidates(&offsets(2), 24, f32::MAX, &mut all));
            assert!(mesh.find_candidates(&offsets(2), 2, f32::MAX, &mut few));
            assert!(mesh.find_candidates(&offsets(2), 24, DOUBT, &mut likely));
            let from = points[v as usize];
            let near = |p: &Point| (p.x - from.x).abs() <= 2 && (p.y - from.y).abs() <= 2;
            let lattice = (0..9).flat_map(|y| (0..9).map(move |x| Point::new(x, y)));
            let vacant = lattice.filter(near).filter(|p| !points.contains(p)).count();
            // Where there is no error nothing can be gained, though rounding may foresee it.
            let slots = 0..mesh.triangulation.slot_count() as u32;
            let around = slots.filter(|&t| mesh.triangulation.corners(t).contains(&from));
            let error = around.map(|t| mesh.face_error(t)).sum::<u64>();
            if error == 0 {
                prop_assert!(all.iter().all(|&(change, _)| change < 0.0));
            } else {
                prop_assert_eq!(all.len(), vacant);
            }
            prop_assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
            prop_assert_eq!(&few[..], &all[..few.len()]);
            prop_assert_eq!(few.len(), all.len().min(2));
            all.retain(|&(change, _)| change < DOUBT * error as f32);
            prop_assert_eq!(&likely, &all);
        }
    }
}

#[test]
fn equal_weights_change_nothing_of_what_is_promised() {
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
        let promised = [&mut plain_mesh, &mut weighted_mesh].map(|mesh| {
            let (mut any, mut likely) = (Vec::new(), Vec::new());
            mesh.look_at(v);
            assert!(mesh.find_candidates(&offsets(2), 24, f32::MAX, &mut any));
            assert!(mesh.find_candidates(&offsets(2), 24, DOUBT, &mut likely));
            refused += any.len() - likely.len();
            (any, likely)
        });
        assert_eq!(promised[0], promised[1]);
    }
    assert!(refused > 0);
}

/// A picture of one level, but for some points, and the mesh of given vertices and its corners.
fn level_but_for(odd: &[(usize, usize)], inner: &[(usize, usize)]) -> (Image, Vec<Point>) {
    let mut samples = vec![9; 11 * 11];
    odd.iter().for_each(|&(x, y)| samples[y * 11 + x] = 63);
    picture(11, 11, &samples, inner)
}

#[test]
fn places_that_promise_alike_come_nearest_first_then_by_row_then_by_column() {
    // The odd point is of a face around the vertex, so that there is an error, but no place
    // changes it as far as can be foreseen.
    let (image, points) = level_but_for(&[(5, 9)], &[(5, 5)]);
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    let vertex = points.iter().position(|p| (p.x, p.y) == (5, 5)).unwrap() as u32;
    let mut promising = Vec::new();
    mesh.look_at(vertex);
    assert!(mesh.find_candidates(&offsets(2), 9, DOUBT, &mut promising));
    let found: Vec<(i32, i32)> = promising.iter().map(|(_, p)| (p.x - 5, p.y - 5)).collect();
    let nearest = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1), (0, -2)];
    assert_eq!(found, nearest);
    assert!(promising.iter().all(|&(change, _)| change == 0.0));
}

#[test]
fn nothing_is_promised_where_there_is_no_error() {
    let (image, points) = level_but_for(&[], &[(5, 5), (3, 7)]);
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
        let mut promising = Vec::new();
        mesh.look_at(v);
        assert!(mesh.find_candidates(&offsets(2), 24, f32::MAX, &mut promising));
        assert_eq!(promising, []);
    }
}

#[test]
fn of_places_that_are_as_good_a_vertex_takes_the_nearest_then_the_leftmost() {
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
        assert_eq!(move_to_best(&mut mesh, vertex as u32, &offsets(2)), Moved::Yes);
        let place = mesh.triangulation.points[vertex];
        assert_eq!((place.x, place.y), expected);
    }
}

/// A picture, and a mesh of it of at least as many vertices as patches take.
fn large() -> (Image, Vec<Point>) {
    let (columns, rows) = (50, LEAST_PATCH / 50 + 1);
    let samples: Vec<u16> = (0..6 * columns * rows).map(|i| (i * i / 7 % 64) as u16).collect();
    let seeds: Vec<(usize, usize)> =
        (0..columns * rows).map(|i| (i % columns * 3 + i / columns % 2, i / columns * 2)).collect();
    picture(3 * columns, 2 * rows, &samples, &seeds)
}

#[test]
fn a_third_of_the_progress_of_a_pass_is_that_in_patches_each_time_and_a_third_that_in_order() {
    let (image, points) = large();
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    let mut relocation = Relocation::new(&mesh);
    let count = points.len();
    for (third, cuts) in [Cuts::Straight, Cuts::Diagonal].into_iter().enumerate() {
        let in_patches = Recorder::default();
        let looked_at = relocation
            .look_in_patches(&mut mesh, Look::Foresighted, (cuts, 2), &in_patches)
            .unwrap();
        let done = in_patches.done(Stage::Refine, 3 * count);
        assert!(done.is_sorted_by(|a, b| a < b));
        assert!(done.iter().all(|done| (third * count..(third + 1) * count).contains(done)));
        // Where the vertices at fences are passed over, nothing is reported.
        assert!(looked_at > 0 && done.len() >= looked_at);
        // Nearly all are looked at the first time.
        assert!(third > 0 || done[done.len() / 2] > count / 4);
    }
    let in_order = Recorder::default();
    let (image, points) = level_but_for(&[(5, 9)], &[(5, 5), (2, 3), (7, 8)]);
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    let mut relocation = Relocation::new(&mesh);
    let looked_at = relocation.pass(&mut mesh, (Look::Thorough, Scope::All), &in_order).unwrap();
    let done = in_order.done(Stage::Refine, 3 * points.len());
    assert_eq!((looked_at, done.len()), (3, 3));
    assert!(done.is_sorted_by(|a, b| a < b));
    assert!(done.iter().all(|done| (2 * points.len()..3 * points.len()).contains(done)));
}

#[test]
fn a_large_mesh_is_looked_at_in_patches_and_then_in_order_as_far_as_the_scope_goes() {
    let (image, points) = large();
    let measure = measure_of(&image);
    let new_mesh = || measured(&measure, &image, points.clone());
    let look = Look::Foresighted;
    let (mut in_steps, mut in_turn) = (new_mesh(), 0);
    let mut relocation = Relocation::new(&in_steps);
    for scope in [Scope::Inner, Scope::Most, Scope::All] {
        in_turn += match scope {
            Scope::All => relocation.look_in_order(&mut in_steps, look, &|_| Ok(())).unwrap(),
            _ => {
                let cuts = if scope == Scope::Inner { Cuts::Straight } else { Cuts::Diagonal };
                relocation.look_in_patches(&mut in_steps, look, (cuts, 1), &()).unwrap()
            }
        };
        let mut whole = new_mesh();
        let mut at_once = Relocation::new(&whole);
        let looked_at = at_once.pass(&mut whole, (look, scope), &()).unwrap();
        assert_eq!(looked_at, in_turn, "{scope:?}");
        assert_eq!(whole.triangulation.points, in_steps.triangulation.points, "{scope:?}");
        // What was left out is due in the next pass, like all that has changed.
        assert_eq!(at_once.changed, relocation.changed, "{scope:?}");
        assert!(at_once.is_due.iter().all(|&is_due| is_due));
        assert_eq!(relocation.is_due.contains(&true), scope != Scope::All, "{scope:?}");
    }
    assert_eq!(in_turn, points.len() - 4);
    let mut in_order = new_mesh();
    Relocation::new(&in_order).look_in_order(&mut in_order, look, &|_| Ok(())).unwrap();
    assert_ne!(in_steps.triangulation.points, in_order.triangulation.points);
}

#[test]
fn a_mesh_too_small_for_patches_is_looked_at_whole_in_every_scope() {
    let (image, points) = level_but_for(&[(5, 9)], &[(5, 5), (2, 3), (7, 8)]);
    let measure = measure_of(&image);
    for scope in [Scope::Inner, Scope::Most, Scope::All] {
        let mut mesh = measured(&measure, &image, points.clone());
        let mut relocation = Relocation::new(&mesh);
        let looked_at = relocation.pass(&mut mesh, (Look::Foresighted, scope), &()).unwrap();
        assert_eq!(looked_at, 3);
    }
}

#[test]
fn a_foresighted_look_passes_over_large_faces_where_they_are_few_and_forecasts_are_made() {
    // One vertex at large faces, at the foot of a slope that it should climb, and others together
    // elsewhere.
    let (width, height) = (112_usize, 64);
    let samples: Vec<u16> =
        (0..width * height).map(|i| (i % width).saturating_sub(60) as u16).collect();
    let far = Point::new(66, 40);
    for (others, precision, component_count, passes_over) in
        [(1, 8, 1, false), (2, 8, 1, true), (2, 16, 3, true), (2, 8, 5, false)]
    {
        let components = vec![samples.clone(); component_count];
        let image = Image::from_bottom_up(width, height, precision, components).unwrap();
        let measure = ErrorEvaluator::new(&image, ErrorMetric::MeanCompSe, None).with_model();
        let near = (0..others).map(|i| Point::new(1 + i % 5 * 2, 1 + i / 5 * 2));
        let mut points: Vec<Point> =
            near.chain(corner_points(width, height)).chain([far]).collect();
        points.sort_unstable();
        // With two others there are just as many as it takes.
        assert_eq!(points.len() * DENSE == width * height, others == 2);
        let is_moved = |look| {
            let mut mesh = measured(&measure, &image, points.clone());
            let mut relocation = Relocation::new(&mesh);
            relocation.pass(&mut mesh, (look, Scope::All), &()).unwrap();
            !mesh.triangulation.points.contains(&far)
        };
        assert_eq!(is_moved(Look::Foresighted), !passes_over, "{others} others, {precision} bits");
        assert!(is_moved(Look::Thorough));
    }
}

#[test]
fn patches_are_two_in_a_mesh_of_256_vertices_and_have_2048_vertices_or_more_in_larger_ones() {
    let counts = [0, 255, 256, 2047, 4096, 8191, 8192, 16_383, 16_384, 1 << 20];
    assert_eq!(counts.map(halvings), [0, 0, 1, 1, 1, 1, 2, 2, 3, 9]);
}

#[test]
fn nearly_all_vertices_are_looked_at_in_patches_and_nearly_all_others_in_those_askew() {
    let samples: Vec<u16> = (0..90 * 90).map(|i| (i * i / 7 % 64) as u16).collect();
    let seeds: Vec<(usize, usize)> =
        (0..30 * 30).map(|i| (i % 30 * 3, i / 30 * 3 + i % 2)).collect();
    let (image, points) = picture(90, 90, &samples, &seeds);
    let measure = measure_of(&image);
    let mut mesh = measured(&measure, &image, points.clone());
    let mut relocation = Relocation::new(&mesh);
    let mut look = |cuts| {
        let how = (cuts, 1);
        relocation.look_in_patches(&mut mesh, Look::Foresighted, how, &()).unwrap()
    };
    let (first, second) = (look(Cuts::Straight), look(Cuts::Diagonal));
    let all = points.len() - 4;
    assert!(first > all * 3 / 4, "{first} of {all}");
    assert!((all - first) * 3 / 4 < second && second <= all - first, "{second} after {first}");
}

/// Two meshes have the same vertices at the same places, the same faces and the same errors.
fn assert_same(
    a: &MeasuredMesh<FaceErrors<'_>>,
    b: &MeasuredMesh<FaceErrors<'_>>,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(&a.triangulation.points, &b.triangulation.points);
    prop_assert_eq!(a.triangulation.mesh(), b.triangulation.mesh());
    prop_assert_eq!(a.total_error(), b.total_error());
    let errors = |mesh: &MeasuredMesh<FaceErrors<'_>>| {
        let slots = 0..mesh.triangulation.slot_count() as u32;
        let used = slots.filter(|&slot| mesh.triangulation.is_used(slot));
        used.map(|slot| {
            (mesh.triangulation.corners(slot).iter().min().copied(), mesh.face_error(slot))
        })
        .collect::<BTreeSet<_>>()
    };
    prop_assert_eq!(errors(a), errors(b));
    for y in 0..a.size().1 as i32 {
        for x in 0..a.size().0 as i32 {
            prop_assert_eq!(a.is_vacant(Point::new(x, y)), b.is_vacant(Point::new(x, y)));
        }
    }
    Ok(())
}

/// The error of the mesh that has the corners alone.
fn sum_of_errors_of_corners(image: &Image) -> u64 {
    let mut corners = corner_points(image.width(), image.height());
    corners.sort_unstable();
    sum_of_errors(image, &corners, &triangulate(&corners))
}

/// The error of a face, measured afresh.
fn measured_error(measure: &ErrorEvaluator<'_>, corners: [Point; 3]) -> u64 {
    FaceErrors::new(measure).error(corners)
}
