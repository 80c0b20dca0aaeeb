//! Simplification against trying every point at every step.

use crate::pictures::{cases, gray, image, model, noise, pictures, size_target};
use crate::twin::density::{luma, thesis_gray};
use crate::twin::interpolation::total_error;
use crate::twin::removal;
use crate::twin::triangulation::{triangles_of, triangulate};
use pixmesh_meshing::parameters::{ErrorMetric, Generator, Guide, InitialSize, Policy};
use pixmesh_meshing::{Image, Method, Parameters, Point, Target, sample_points};
use proptest::prelude::*;

/// The metrics that do not depend on where a point lies.
const WITHOUT_WEIGHTS: &[ErrorMetric] = &[
    ErrorMetric::MeanCompSe,
    ErrorMetric::MeanCompAe,
    ErrorMetric::LumaSe,
    ErrorMetric::LumaAe,
    ErrorMetric::YcbcrVecSe,
    ErrorMetric::YcbcrVecAe,
    ErrorMetric::VecSe,
];

/// Checks that the model is what brute force makes of the same initial points.
fn check(image: &Image, parameters: &Parameters) {
    let made = model(image, parameters);
    let (ruling, parameters) = ruling_image(image, parameters);
    let initial = sample_points(&ruling, &parameters, made.plan.initial_size, &()).unwrap();
    let trimmed = made.plan.initial_size > made.plan.size
        || parameters.target.is_quality()
        || parameters.bad_point_removal;
    let expected =
        if trimmed { removal::simplify(&ruling, initial, made.plan, &parameters) } else { initial };
    assert_eq!(made.mesh.points(), expected, "{parameters:?}");
    let faces = triangles_of(made.mesh.points(), made.mesh.faces());
    assert_eq!(faces, triangulate(&expected));
}

/// The image whose error rules the removal and the parameters that mean the same for it.
fn ruling_image(picture: &Image, parameters: &Parameters) -> (Image, Parameters) {
    if parameters.guide == Guide::Components {
        return (picture.clone(), parameters.clone());
    }
    let (width, height) = (picture.width(), picture.height());
    let gray = if parameters.guide == Guide::Gray { thesis_gray(picture) } else { luma(picture) };
    let gray = image(width, height, picture.precision(), vec![gray]);
    let error_metric = match parameters.error_metric {
        ErrorMetric::MeanCompAe | ErrorMetric::LumaAe | ErrorMetric::YcbcrVecAe => {
            ErrorMetric::MeanCompAe
        }
        _ => ErrorMetric::MeanCompSe,
    };
    let (policy, guide) = (Policy::PsaD, Guide::Components);
    let own = parameters.clone().policy(policy).guide(guide).error_metric(error_metric);
    (gray, own)
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn gprfsed_matches_reference(
        image in pictures(2..=9, 1..=4),
        share in 0.0..0.4,
        gamma in 2.0..6.0,
        bad_point_removal in any::<bool>(),
    ) {
        let parameters = Method::Mgprfs.parameters(size_target(&image, share));
        let initial_size = InitialSize::Gamma(gamma);
        check(&image, &parameters.initial_size(initial_size).bad_point_removal(bad_point_removal));
    }

    #[test]
    fn gpr_matches_reference(
        image in pictures(2..=6, 1..=4),
        share in 0.0..1.0,
        bad_point_removal in any::<bool>(),
    ) {
        let parameters = Method::Mgpr.parameters(size_target(&image, share));
        check(&image, &parameters.bad_point_removal(bad_point_removal));
    }

    #[test]
    fn gray_removal_matches_reference(
        image in pictures(2..=6, 3..=3),
        share in 0.0..1.0,
        method in prop::sample::select(vec![Method::Cgpr, Method::Ced, Method::Cgprfsed]),
        bad_point_removal in any::<bool>(),
    ) {
        let parameters = method.parameters(size_target(&image, share));
        check(&image, &parameters.bad_point_removal(bad_point_removal));
    }

    #[test]
    fn psnr_bound_matches_reference(
        image in pictures(2..=6, 1..=4),
        psnr_db in 3.0..60.0,
        method in prop::sample::select(vec![Method::Mgprfs, Method::Mgpr]),
        bad_point_removal in any::<bool>(),
    ) {
        let parameters = method.parameters(Target::Psnr(psnr_db));
        check(&image, &parameters.clone().bad_point_removal(bad_point_removal));
        let made = model(&image, &parameters);
        prop_assert!(made.fidelity.psnr_db() >= psnr_db);
    }

    #[test]
    fn each_metric_matches_reference(
        image in pictures(2..=6, 1..=4),
        colour in pictures(2..=5, 3..=3),
        share in 0.0..0.8,
        error_metric in prop::sample::select(WITHOUT_WEIGHTS),
        guide in prop::sample::select(Guide::ALL),
    ) {
        let parameters = Method::Mgpr.parameters(size_target(&colour, share));
        check(&colour, &parameters.error_metric(error_metric).guide(guide));
        if error_metric.component_count().is_none() {
            let parameters = Method::Mgprfs.parameters(size_target(&image, share));
            check(&image, &parameters.error_metric(error_metric));
        }
    }

    #[test]
    fn mean_error_bound_matches_reference(
        colour in pictures(2..=5, 3..=3),
        error in 0.0..3000.0,
        error_metric in prop::sample::select(WITHOUT_WEIGHTS),
    ) {
        let parameters = Method::Mgpr.parameters(Target::MeanError(error));
        check(&colour, &parameters.error_metric(error_metric));
    }

    #[test]
    fn removals_lead_from_initial_to_final_points(
        image in pictures(2..=9, 1..=4),
        share in 0.0..0.4,
    ) {
        let parameters = Method::Mgprfs.parameters(size_target(&image, share));
        let made = model(&image, &parameters);
        let mut points =
            sample_points(&image, &parameters, made.plan.initial_size, &()).unwrap();
        let before = total_error(&image, &triangulate(&points), ErrorMetric::MeanCompSe);
        points.retain(|&p| made.removals.iter().all(|removal| removal.point != p));
        prop_assert_eq!(made.mesh.points(), points);
        let change: i64 = made.removals.iter().map(|removal| removal.change).sum();
        prop_assert_eq!(made.fidelity.squared_error, before.wrapping_add_signed(change));
    }

    #[test]
    fn random_and_uniform_points_match_reference(
        image in pictures(2..=8, 1..=4),
        share in 0.0..0.6,
        generator in prop::sample::select(vec![Generator::Random, Generator::Uniform]),
        seed in any::<u64>(),
    ) {
        let parameters = Method::Mgprfs.parameters(size_target(&image, share));
        check(&image, &parameters.generator(generator).seed(seed));
    }
}

#[test]
fn removes_ties_by_row_then_column() {
    let ramp = gray(6, 5, |x, y| (3 * x + 5 * y) as u16);
    let parameters = Method::Gpr.parameters(Target::Size(20));
    check(&ramp, &parameters);
    // No removal changes the error, so the first ten points in order are removed.
    let kept: Vec<Point> = model(&ramp, &parameters).mesh.points().to_vec();
    let order = (0..30).map(|i| Point::new(i % 6, i / 6));
    let is_corner = |p: &Point| (p.x == 0 || p.x == 5) && (p.y == 0 || p.y == 4);
    let removed: Vec<Point> = order.clone().filter(|p| !is_corner(p)).take(10).collect();
    assert_eq!(kept, order.filter(|p| !removed.contains(p)).collect::<Vec<_>>());
}

#[test]
fn removes_featureless_points_evenly() {
    let flat = gray(6, 5, |_, _| 7);
    let parameters = Method::Gpr.parameters(Target::Size(17));
    check(&flat, &parameters);
    // Of the 26 points that are no corners each second one.
    let made = model(&flat, &parameters);
    let removed: Vec<i32> =
        made.removals.iter().map(|gone| gone.point.x + 6 * gone.point.y).collect();
    assert_eq!(removed, [2, 4, 7, 9, 11, 13, 15, 17, 19, 21, 23, 26, 28]);
}

#[test]
fn ties_match_reference() {
    let checkerboard = gray(7, 7, |x, y| ((x + y) % 2) as u16 * 255);
    let stripes = gray(7, 6, |x, _| (x % 2) as u16 * 200);
    let step = gray(7, 7, |x, _| if x < 3 { 10 } else { 240 });
    let ramp = gray(7, 7, |x, y| (3 * x + 5 * y) as u16);
    let dot = gray(7, 7, |x, y| if (x, y) == (3, 3) { 255 } else { 0 });
    for picture in [checkerboard, stripes, step, ramp, dot] {
        for size in [4, 12, 30] {
            check(&picture, &Method::Gpr.parameters(Target::Size(size)));
            let lowering = Method::Gprfsed.parameters(Target::Size(size));
            check(&picture, &lowering.bad_point_removal(true));
        }
    }
}

#[test]
fn large_degrees_match_reference() {
    for (width, height) in [(22, 2), (2, 22), (17, 3), (3, 17), (11, 4)] {
        let flat = gray(width, height, |_, _| 9);
        let line = gray(width, height, |x, y| if x.min(y) == 1 { noise(x, y) } else { 0 });
        let few_levels = gray(width, height, |x, y| noise(x, y) % 3);
        for picture in [flat, line, few_levels] {
            for size in [4, 15] {
                check(&picture, &Method::Gpr.parameters(Target::Size(size)));
            }
        }
    }
}

#[test]
fn psnr_bound_is_inclusive() {
    let picture = gray(6, 6, noise);
    let mut reached = 0;
    for size in 8..30 {
        let sized = model(&picture, &Method::Gpr.parameters(Target::Size(size)));
        let parameters = Method::Gpr.parameters(Target::Psnr(sized.fidelity.psnr_db()));
        check(&picture, &parameters);
        // A removal that lowers the error may follow one that raises it too much; removal
        // stops before the latter.
        reached += usize::from(model(&picture, &parameters).mesh.points().len() <= size);
    }
    assert!(reached > 10, "{reached} of 22");
}

#[test]
fn bad_points_are_removed_below_size() {
    // In a noisy image some points raise the error more than they lower it.
    let picture = gray(9, 9, noise);
    let initial_size = InitialSize::Target;
    let own = Method::Mgprfs.parameters(Target::Size(12));
    let parameters = own.initial_size(initial_size).generator(Generator::Random);
    let made = |bad_point_removal| {
        let parameters = parameters.clone().bad_point_removal(bad_point_removal);
        check(&picture, &parameters);
        model(&picture, &parameters)
    };
    let (kept, removed) = (made(false), made(true));
    assert_eq!(kept.mesh.points().len(), 12);
    assert!(removed.mesh.points().len() < 12);
    assert!(removed.fidelity.squared_error < kept.fidelity.squared_error);
}
