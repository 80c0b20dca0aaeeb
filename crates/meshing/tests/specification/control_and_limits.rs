//! What is refused, what is cancelled, what is reported, and the smallest and largest cases.

use crate::pictures::{gray, image, methods_for, model, noise};
use crate::twin::interpolation::rasterise;
use pixmesh_meshing::parameters::{Boundary, Generator, Policy};
use pixmesh_meshing::{
    Cancelled, Control, Fidelity, Image, ImageError, MeshingError, Method, ParameterError,
    Parameters, Progression, Shape, Stage, Target, mesh_image, rasterize, structural_similarity,
};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Records every poll.
#[derive(Default)]
struct Listener(Mutex<Vec<(Stage, usize, usize)>>);

impl Control for Listener {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        self.0.lock().unwrap().push((stage, done, total));
        Ok(())
    }
}

/// Cancels at a poll given by its number, counted down to 0, and at every later one.
struct Countdown(AtomicUsize);

impl Control for Countdown {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        let enough = |left: usize| left.checked_sub(1);
        let left = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, enough);
        left.map(drop).map_err(|_| Cancelled)
    }
}

fn polls(image: &Image, parameters: &Parameters) -> Vec<(Stage, usize, usize)> {
    let listener = Listener::default();
    mesh_image(image, parameters, &listener).unwrap();
    listener.0.into_inner().unwrap()
}

/// Noise of several components.
fn noisy(width: usize, height: usize, component_count: usize) -> Image {
    let component = |c| (0..width * height).map(|i| noise(i % width + 99 * c, i / width)).collect();
    image(width, height, 8, (0..component_count).map(component).collect())
}

#[test]
fn refuses_single_row_or_column() {
    for (width, height) in [(1, 1), (1, 2), (2, 1), (1, 40), (40, 1), (0, 0), (0, 5), (5, 0)] {
        let refused = Image::from_bottom_up(width, height, 8, vec![vec![0; width * height]]);
        assert_eq!(refused, Err(ImageError::TooSmall { width, height }));
        let shape = Shape { width, height, component_count: 1, precision: 8 };
        for method in [Method::Med, Method::Mgprfs, Method::Mgpr] {
            let plan = method.parameters(Target::Size(4)).plan(shape);
            assert!(matches!(plan, Err(ParameterError::Shape(ImageError::TooSmall { .. }))));
        }
    }
}

#[test]
fn constant_image_gives_two_triangles() {
    for component_count in 1..=4 {
        for (width, height, value) in [(2, 2, 0), (9, 7, 0), (9, 7, 200), (30, 2, 255)] {
            let flat = image(width, height, 8, vec![vec![value; width * height]; component_count]);
            for method in methods_for(component_count) {
                let made = model(&flat, &method.parameters(Target::Size(4)));
                assert_eq!(made.mesh.points().len(), 4, "{method} of {width}x{height}");
                assert_eq!(made.mesh.faces(), [[0, 1, 3], [0, 3, 2]]);
                assert_eq!(made.fidelity.psnr_db(), f64::INFINITY);
            }
        }
    }
}

#[test]
fn diffusion_of_constant_image_gives_corners() {
    let flat = image(20, 10, 16, vec![vec![40_000; 200]; 3]);
    let policies = Policy::ALL.iter().filter(|p| p.component_count().is_none_or(|n| n == 3));
    for &policy in policies {
        for method in [Method::Med, Method::Mgprfs] {
            let own = method.parameters(Target::Percent(20.0));
            let made = model(&flat, &own.policy(policy));
            assert_eq!(made.mesh.points().len(), 4, "{method} by {policy}");
            assert_eq!(made.fidelity.psnr_db(), f64::INFINITY);
        }
    }
}

#[test]
fn zero_density_gives_corners() {
    // Smoothing removes stripes one pixel wide, so no point has any significance.
    let stripes = gray(11, 8, |x, _| (x % 2) as u16 * 255);
    for policy in [Policy::PsaD, Policy::PsdMaxD, Policy::PsdAvgL, Policy::PseD, Policy::PseL] {
        let own = Method::Med.parameters(Target::Size(20));
        let parameters = own.policy(policy).boundary(Boundary::Symmetric);
        assert_eq!(model(&stripes, &parameters).mesh.points().len(), 4, "{policy}");
    }
}

#[test]
fn constant_first_component_keeps_point_count() {
    // The search for the threshold of PSE begins with the first component's sum.
    let component = |c| (0..88).map(|i| noise(i % 11 + c, i / 11)).collect::<Vec<u16>>();
    let picture = image(11, 8, 8, vec![vec![0; 88], component(3), component(50)]);
    for policy in [Policy::PseD, Policy::PseL] {
        for boundary in [Boundary::Zero, Boundary::Symmetric] {
            let own = Method::Med.parameters(Target::Size(20));
            let made = model(&picture, &own.policy(policy).boundary(boundary));
            let count = made.mesh.points().len();
            assert!((5..=39).contains(&count), "{count} points by {policy}, {boundary}");
        }
    }
}

#[test]
fn meshes_two_by_two_pixels() {
    for component_count in 1..=4 {
        let picture = noisy(2, 2, component_count);
        for method in methods_for(component_count) {
            for target in [Target::Size(4), Target::Percent(100.0), Target::Psnr(40.0)] {
                let made = model(&picture, &method.parameters(target));
                assert_eq!(made.mesh.points().len(), 4);
            }
        }
    }
}

#[test]
fn meshes_sixteen_bits_and_many_components() {
    for component_count in [1, 2, 3, 4, 7] {
        let component = |c: usize| {
            let sample = |i: usize| noise(i % 12 + 50 * c, i / 12) * 257;
            (0..120).map(sample).collect::<Vec<u16>>()
        };
        let picture = image(12, 10, 16, (0..component_count).map(component).collect());
        for method in methods_for(component_count) {
            let made = model(&picture, &method.parameters(Target::Size(30)));
            assert_eq!(made.mesh.shape(), picture.shape());
            let rebuilt = rasterize(&made.mesh, &()).unwrap();
            assert_eq!(rebuilt.components(), rasterise(&made.mesh));
        }
    }
}

#[test]
fn all_points_reproduce_image() {
    let picture = noisy(13, 8, 3);
    for method in methods_for(3) {
        let made = model(&picture, &method.parameters(Target::Percent(100.0)));
        assert_eq!(made.mesh.points().len(), 104);
        if method == Method::Flat {
            continue; // One colour for a triangle of three points of different colours.
        }
        assert_eq!(made.fidelity.psnr_db(), f64::INFINITY);
        assert_eq!(rasterize(&made.mesh, &()).unwrap(), picture);
    }
}

#[test]
fn refuses_wrong_component_count() {
    for component_count in 1..=4 {
        let picture = noisy(6, 6, component_count);
        for &method in Method::ALL {
            let fits = method.check_component_count(component_count).is_ok();
            let expected = match method {
                Method::Ced | Method::Cgprfsed | Method::Cgpr => component_count == 3,
                Method::Ed | Method::Gprfsed | Method::Gpr => component_count == 1,
                _ => true,
            };
            assert_eq!(fits, expected, "{method} of {component_count}");
        }
        for &policy in Policy::ALL {
            let own = Method::Med.parameters(Target::Size(9));
            let made = mesh_image(&picture, &own.policy(policy), &());
            let expected = match policy {
                Policy::PsaD | Policy::PsaL => component_count == 1,
                Policy::PsbD | Policy::PsbL | Policy::Psc => component_count == 3,
                _ => true,
            };
            assert_eq!(made.is_ok(), expected, "{policy} of {component_count}");
        }
    }
}

#[test]
fn meshing_cancels_at_every_poll() {
    for component_count in [1, 3] {
        let picture = noisy(24, 20, component_count);
        for method in methods_for(component_count) {
            let parameters = method.parameters(Target::Size(60)).lists_removals(true);
            let count = polls(&picture, &parameters).len();
            assert!(count > 2, "{method} polls {count} times");
            // Refinement polls thousands of times: then not every one of them.
            for k in (0..count).step_by(1 + count / 40) {
                let control = Countdown(AtomicUsize::new(k));
                let made = mesh_image(&picture, &parameters, &control);
                assert_eq!(made, Err(MeshingError::Cancelled(Cancelled)), "{method}, poll {k}");
            }
            let control = Countdown(AtomicUsize::new(count));
            assert_eq!(
                mesh_image(&picture, &parameters, &control),
                Ok(model(&picture, &parameters))
            );
        }
    }
}

#[test]
fn rasterize_cancels_at_every_poll() {
    let picture = noisy(30, 30, 2);
    let mesh = model(&picture, &Method::Med.parameters(Target::Percent(50.0))).mesh;
    let listener = Listener::default();
    rasterize(&mesh, &listener).unwrap();
    let reports = listener.0.into_inner().unwrap();
    assert_eq!(reports[0], (Stage::Rasterize, 0, mesh.faces().len()));
    for k in 0..reports.len() {
        assert_eq!(rasterize(&mesh, &Countdown(AtomicUsize::new(k))), Err(Cancelled));
    }
}

#[test]
fn stages_come_in_order_within_totals() {
    let picture = noisy(40, 30, 3);
    for method in methods_for(3) {
        for &generator in Generator::ALL {
            let own = method.parameters(Target::Size(100));
            let parameters = own.generator(generator);
            let reports = polls(&picture, &parameters);
            for (stage, done, total) in &reports {
                assert!(done <= total, "{done} of {total} in {stage}");
            }
            for pair in reports.windows(2) {
                assert!(pair[0].0 <= pair[1].0, "{method}: {} then {}", pair[0].0, pair[1].0);
                let is_same_stage = pair[0].0 == pair[1].0;
                assert!(!is_same_stage || pair[0].1 <= pair[1].1, "{method}: {pair:?}");
                assert!(is_same_stage || pair[1].1 == 0, "{method}: {pair:?}");
            }
            assert_eq!(reports[0].1, 0);
        }
    }
}

#[test]
fn refuses_other_shape() {
    let (picture, other) = (gray(20, 15, noise), gray(20, 16, noise));
    let parameters = Method::Mgprfs.parameters(Target::Size(30));
    let mesh = model(&picture, &parameters).mesh;
    let error = Fidelity::between(&other, &picture, &()).unwrap_err();
    assert!(matches!(error, MeshingError::Shape(_)));
    let refused = Err(error.clone());
    assert_eq!(Progression::new(&other, &mesh, &parameters, &()).map(|_| ()), refused);
    assert_eq!(mesh.with_flat_colors(&other, &()).map(|_| ()), refused);
    assert_eq!(structural_similarity(&other, &picture, &()).map(|_| ()), refused);
    assert_eq!(
        error.to_string(),
        "images of different shape cannot be compared: \
        20x16 with 1 components of 8 bits and 20x15 with 1 components of 8 bits"
    );
}
