//! What every mesh is, whatever the picture and the method: valid, Delaunay, preferred, true to
//! its own figures and the same on the next run.

use crate::pictures::{cases, methods_for, model, pictures, size_target};
use crate::twin::interpolation::rasterise;
use crate::twin::removal::psnr_db;
use crate::twin::triangulation::{
    Triangle, circle_sign, double_area, is_to_flip, triangles_of, triangulate,
};
use pixmesh_meshing::parameters::{Generator, Guide, InitialSize};
use pixmesh_meshing::{
    Approximation, Fidelity, Image, Mesh, Parameters, Point, rasterize, sample_points,
};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// An image, a method that is defined for it, and parameters of that method.
fn requests() -> impl Strategy<Value = (Image, Parameters)> {
    let numbers = (0.0..1.0, 1.0..6.0, any::<bool>(), any::<u64>());
    let generators = prop::sample::select(Generator::ALL);
    let requests = (pictures(2..=14, 1..=4), any::<prop::sample::Index>(), generators, numbers);
    requests.prop_map(|(image, method, generator, (share, gamma, bad_point_removal, seed))| {
        let methods = methods_for(image.component_count());
        let method = methods[method.index(methods.len())];
        let own = method.parameters(size_target(&image, share));
        let initial_size = match own.initial_size {
            InitialSize::Gamma(_) => InitialSize::Gamma(gamma),
            other => other,
        };
        let generator = if own.generator == Generator::All { own.generator } else { generator };
        (
            image,
            own.initial_size(initial_size)
                .generator(generator)
                .bad_point_removal(bad_point_removal)
                .seed(seed),
        )
    })
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    mesh.faces().iter().map(|&face| mesh.corners(face)).collect()
}

fn check_counts_and_areas(mesh: &Mesh) {
    let mut edges = BTreeSet::new();
    let mut area = 0;
    for [a, b, c] in triangles(mesh) {
        assert!(double_area(a, b, c) > 0, "the face {a:?} {b:?} {c:?} is not counter-clockwise");
        area += double_area(a, b, c);
        edges.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q))));
    }
    let (width, height) = (mesh.shape().width as i128, mesh.shape().height as i128);
    assert_eq!(area, 2 * (width - 1) * (height - 1));
    assert_eq!(mesh.points().len() + mesh.faces().len(), edges.len() + 1, "Euler's formula");
    assert_eq!(mesh.edge_count(), edges.len());
}

fn check_points(mesh: &Mesh, image: &Image) {
    let points = mesh.points();
    assert!(points.windows(2).all(|pair| pair[0] < pair[1]), "by row, then column");
    let (right, top) = (image.width() as i32 - 1, image.height() as i32 - 1);
    for (x, y) in [(0, 0), (right, 0), (0, top), (right, top)] {
        assert!(points.contains(&Point::new(x, y)), "the corner ({x}, {y}) is a vertex");
    }
    for (v, p) in points.iter().enumerate() {
        let sample = |c| image.sample(c, p.x as usize, p.y as usize);
        let samples: Vec<u16> = (0..image.component_count()).map(sample).collect();
        assert_eq!(mesh.vertex_samples(v), samples);
    }
}

fn check_circles(mesh: &Mesh) {
    for [a, b, c] in triangles(mesh) {
        for &d in mesh.points() {
            assert!(circle_sign(a, b, c, d) <= 0, "{d:?} lies in the circle of {a:?} {b:?} {c:?}");
        }
    }
}

fn check_diagonals(mesh: &Mesh) {
    let mut third_corner = BTreeMap::new();
    for [a, b, c] in triangles(mesh) {
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert_eq!(third_corner.insert((from, to), third), None);
        }
    }
    for (&(a, b), &c) in &third_corner {
        if let Some(&d) = third_corner.get(&(b, a)) {
            assert!(!is_to_flip(a, b, c, d), "{a:?} {b:?} is the wrong diagonal of {c:?} {d:?}");
        }
    }
}

fn check_face_order(mesh: &Mesh) {
    assert!(mesh.faces().windows(2).all(|pair| pair[0] < pair[1]), "faces ascend");
    assert!(mesh.faces().iter().all(|[a, b, c]| a < b && a < c), "faces begin with the smallest");
}

fn check_fidelity(model: &Approximation, image: &Image) {
    let rebuilt = rasterize(&model.mesh, &()).unwrap();
    assert_eq!(rebuilt.components(), rasterise(&model.mesh));
    assert_eq!(Fidelity::between(image, &rebuilt, &()), Ok(model.fidelity));
    let pairs = image.components().iter().flatten().zip(rebuilt.components().iter().flatten());
    let squared_error: u64 = pairs.map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2)).sum();
    assert_eq!(model.fidelity.squared_error, squared_error);
    let expected = psnr_db(image, squared_error);
    let actual = model.fidelity.psnr_db();
    assert!(actual == expected || (actual - expected).abs() < 1e-9, "{actual} is not {expected}");
}

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn meshes_are_valid_delaunay_and_reproducible((image, parameters) in requests()) {
        let made = model(&image, &parameters);
        let mesh = &made.mesh;
        prop_assert_eq!(mesh.validate(), Ok(()));
        prop_assert_eq!(mesh.shape(), image.shape());
        check_points(mesh, &image);
        check_counts_and_areas(mesh);
        check_circles(mesh);
        check_diagonals(mesh);
        check_face_order(mesh);
        prop_assert_eq!(triangles_of(mesh.points(), mesh.faces()), triangulate(mesh.points()));
        prop_assert_eq!(&model(&image, &parameters), &made);
    }

    #[test]
    fn fidelity_matches_rebuilt_picture(
        (image, parameters) in requests()
    ) {
        check_fidelity(&model(&image, &parameters), &image);
    }

    #[test]
    fn mesh_has_requested_size(
        (image, parameters) in requests()
    ) {
        prop_assume!(parameters.guide == Guide::Components);
        let parameters = parameters.bad_point_removal(false);
        let made = model(&image, &parameters);
        let (plan, count) = (made.plan, made.mesh.points().len());
        let initial = sample_points(&image, &parameters, plan.initial_size, &()).unwrap();
        if plan.initial_size > plan.size {
            prop_assert_eq!(count, initial.len().min(plan.size));
        } else if parameters.refines() {
            prop_assert_eq!(count, initial.len());
        } else {
            prop_assert_eq!(made.mesh.points(), initial);
        }
    }
}
