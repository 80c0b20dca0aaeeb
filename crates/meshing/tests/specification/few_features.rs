//! Pictures most of which are of one color.

use crate::pictures::{gray, image, model};
use pixmesh_meshing::parameters::{ErrorMetric, Parallel, Weights};
use pixmesh_meshing::{Image, Method, OnThreads, Parameters, Target, mesh_image, triangulate};
use std::num::NonZeroUsize;

const SIDE: usize = 200;

/// Pictures by name, each of which a mesh of 4 % models exactly.
fn pages() -> Vec<(&'static str, Image)> {
    let of = |sample: fn(usize, usize) -> bool| {
        gray(SIDE, SIDE, |x, y| if sample(x, y) { 0 } else { 255 })
    };
    vec![
        ("dot", of(|x, y| (x, y) == (SIDE / 2, SIDE / 3))),
        ("dot in a corner", of(|x, y| (x, y) == (0, SIDE - 1))),
        ("two halves", of(|x, _| x < SIDE / 2)),
        ("stripes", of(|x, _| x / 50 % 2 == 0)),
        ("rectangle", of(|x, y| (50..150).contains(&x) && (70..90).contains(&y))),
        ("disc", of(|x, y| x.abs_diff(100).pow(2) + y.abs_diff(100).pow(2) < 900)),
    ]
}

/// Checks the triangulation and that the picture is modelled exactly by `size` vertices.
fn assert_perfect(image: &Image, parameters: &Parameters, size: usize, name: &str) {
    let made = model(image, parameters);
    assert_eq!(made.mesh.validate(), Ok(()), "{name}");
    assert_eq!(made.mesh.points().len(), size, "{name}");
    assert_eq!(made.mesh.faces(), triangulate(made.mesh.points()), "{name}");
    assert_eq!(made.fidelity.squared_error, 0, "{name}");
}

#[test]
fn pages_keep_size_and_quality() {
    let size = SIDE * SIDE / 25;
    for (name, page) in pages() {
        for method in [Method::Mgprfs, Method::Mgpr] {
            for parallel in [Parallel::Exact, Parallel::Tiles] {
                let parameters = method.parameters(Target::Size(size)).parallel(parallel);
                assert_perfect(&page, &parameters, size, name);
            }
        }
    }
}

#[test]
fn pages_keep_quality_by_every_metric() {
    let size = SIDE * SIDE / 25;
    for (name, page) in pages() {
        let plane = &page.components()[0];
        let constant = vec![7; SIDE * SIDE];
        let color = image(SIDE, SIDE, 8, vec![constant, plane.clone(), plane.clone()]);
        for error_metric in [ErrorMetric::MeanCompAe, ErrorMetric::LumaSe, ErrorMetric::VecSe] {
            let parameters = Method::Mgprfs.parameters(Target::Size(size));
            assert_perfect(&color, &parameters.error_metric(error_metric), size, name);
        }
        let weights = (0..SIDE * SIDE).map(|i| (i % 256) as u8).collect();
        let weights = Weights::from_bottom_up(SIDE, SIDE, weights).ok();
        let parameters = Method::Mgprfs.parameters(Target::Size(size)).weights(weights);
        assert_eq!(model(&color, &parameters).mesh.points().len(), size, "{name}");
    }
}

#[test]
fn bounds_leave_few_vertices_of_a_page() {
    for (name, page) in pages() {
        for target in [Target::Psnr(60.0), Target::MaxError(2), Target::MeanError(0.01)] {
            let made = model(&page, &Method::Mgprfs.parameters(target));
            assert_eq!(made.mesh.validate(), Ok(()), "{name}");
            assert!(made.fidelity.psnr_db() >= 60.0, "{name}: {target:?}");
            assert!(made.mesh.points().len() < 500, "{name}: {}", made.mesh.points().len());
        }
    }
}

#[test]
fn removals_name_all_vertices_removed() {
    for (name, page) in pages() {
        let made = model(&page, &Method::Mgpr.parameters(Target::Size(20)));
        let mut all: Vec<_> = made.removals.iter().map(|removal| removal.point).collect();
        all.extend(made.mesh.points());
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), SIDE * SIDE, "{name}");
        let change: i64 = made.removals.iter().map(|removal| removal.change).sum();
        assert_eq!(change, made.fidelity.squared_error as i64, "{name}");
    }
}

#[test]
fn bad_point_removal_raises_no_error() {
    for (name, page) in pages() {
        let [med, plus] = [Method::Med, Method::MedPlus]
            .map(|method| model(&page, &method.parameters(Target::Percent(4.0))));
        assert_eq!(plus.mesh.validate(), Ok(()), "{name}");
        assert!(plus.fidelity.squared_error <= med.fidelity.squared_error, "{name}");
    }
}

#[test]
fn pages_give_one_mesh_on_any_threads() {
    for (name, page) in pages() {
        let parameters = Method::Mgpr.parameters(Target::Size(60));
        let on = |threads| {
            let threads = NonZeroUsize::new(threads).unwrap();
            mesh_image(&page, &parameters, &OnThreads((), threads)).unwrap().mesh
        };
        assert!(on(1) == on(3), "{name}");
    }
}

#[test]
fn thin_and_constant_pages_are_meshed() {
    for (width, height) in [(2, 3000), (3000, 2), (3, 900), (300, 300)] {
        let constant = gray(width, height, |_, _| 200);
        let dotted = gray(width, height, |x, y| u16::from((x, y) == (1, 1)));
        for method in [Method::Mgprfs, Method::Mgpr] {
            let parameters = method.parameters(Target::Percent(4.0));
            let made = model(&constant, &parameters);
            assert_eq!(made.mesh.validate(), Ok(()));
            assert_eq!(made.fidelity.squared_error, 0);
            assert_eq!(model(&dotted, &parameters).mesh.validate(), Ok(()));
        }
        let parameters = Method::Mgpr.parameters(Target::Percent(4.0));
        assert_perfect(&dotted, &parameters, width * height / 25, "dot");
    }
}
