//! Meshes beyond the thesis: what refinement, free connectivity and fitted values promise.

use crate::pictures::{cases, model, pictures, size_target};
use crate::twin::interpolation::rasterise;
use crate::twin::triangulation::{triangles_of, triangulate};
use pixmesh_meshing::parameters::{Connectivity, ErrorMetric, Values, Weights};
use pixmesh_meshing::{
    Fidelity, Image, Mesh, Method, Parameters, Point, Target, mesh_image, rasterize,
};
use proptest::prelude::*;

/// The squared error of the picture that a mesh models, by the slow second implementation.
fn squared_error(image: &Image, mesh: &Mesh) -> u64 {
    let pairs = image.components().iter().zip(rasterise(mesh));
    let square = |(a, b): (&u16, &u16)| u64::from(a.abs_diff(*b)).pow(2);
    pairs.map(|(a, b)| a.iter().zip(&b).map(square).sum::<u64>()).sum()
}

/// The largest difference of a sample of the picture that a mesh models, by the same.
fn largest_difference(image: &Image, mesh: &Mesh) -> u16 {
    let pairs = image.components().iter().zip(rasterise(mesh));
    let largest = |(a, b): (&Vec<u16>, Vec<u16>)| a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max();
    pairs.filter_map(largest).max().unwrap()
}

/// Checks what holds for every mesh, and returns its squared error.
fn check(image: &Image, parameters: &Parameters) -> u64 {
    let made = model(image, parameters);
    assert_eq!(made.mesh.validate(), Ok(()));
    assert_eq!(made.fidelity.squared_error, squared_error(image, &made.mesh));
    let rebuilt = rasterize(&made.mesh, &()).unwrap();
    assert_eq!(Fidelity::between(image, &rebuilt, &()).unwrap(), made.fidelity);
    let faces = triangles_of(made.mesh.points(), made.mesh.faces());
    let is_delaunay = faces == triangulate(made.mesh.points());
    assert_eq!(made.mesh.is_preferred_delaunay(&()), Ok(is_delaunay));
    assert!(is_delaunay || parameters.connectivity == Connectivity::Free);
    assert_eq!(made, model(image, parameters));
    made.fidelity.squared_error
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn refinement_never_raises_error(
        image in pictures(2..=12, 1..=3),
        share in 0.0..0.4,
    ) {
        let Target::Size(size) = size_target(&image, share) else { unreachable!() };
        let own = Method::Mgprfs.parameters(Target::Size(size));
        let plain = check(&image, &own);
        for &connectivity in Connectivity::ALL {
            for &values in Values::ALL {
                let free = own.clone().connectivity(connectivity).values(values);
                let with = |effort| free.clone().effort(effort);
                prop_assert!(check(&image, &with(0)) <= plain);
                prop_assert!(check(&image, &with(2)) <= plain);
            }
        }
    }

    #[test]
    fn more_effort_is_never_worse(
        image in pictures(2..=12, 1..=3),
        share in 0.0..0.4,
    ) {
        let own = Method::Mgprfs.parameters(size_target(&image, share));
        let plain = model(&image, &own);
        let mut last = plain.fidelity.squared_error;
        for effort in [1, 3, 5, 9] {
            let refined = model(&image, &own.clone().effort(effort));
            prop_assert_eq!(refined.mesh.points().len(), plain.mesh.points().len());
            prop_assert!(refined.fidelity.squared_error <= last);
            last = refined.fidelity.squared_error;
            for (v, p) in refined.mesh.points().iter().enumerate() {
                for (c, &sample) in refined.mesh.vertex_samples(v).iter().enumerate() {
                    prop_assert_eq!(sample, image.sample(c, p.x as usize, p.y as usize));
                }
            }
        }
    }

    #[test]
    fn largest_error_is_kept_and_no_vertex_more_may_go(
        image in pictures(3..=8, 1..=2),
        bound in 0u16..300,
        method in prop::sample::select(&[Method::Mgpr, Method::Mgprfs][..]),
    ) {
        let made = model(&image, &method.parameters(Target::MaxError(bound)).lists_removals(true));
        prop_assert!(largest_difference(&image, &made.mesh) <= bound);
        let (points, size) = (made.mesh.points(), made.mesh.points().len());
        prop_assert_eq!(size + made.removals.len(), made.plan.initial_size);
        let corners = [0, image.width() as i32 - 1].map(|x| [0, image.height() as i32 - 1].map(|y| (x, y)));
        for removed in points.iter().filter(|p| !corners.as_flattened().contains(&(p.x, p.y))) {
            let left: Vec<_> = points.iter().copied().filter(|point| point != removed).collect();
            let samples = |p: &Point| {
                image.components().iter().map(|c| c[p.y as usize * image.width() + p.x as usize])
                    .collect::<Vec<_>>()
            };
            let samples = left.iter().flat_map(samples).collect();
            let faces = pixmesh_meshing::triangulate(&left);
            let smaller = Mesh::new(image.shape(), left, samples, faces, &()).unwrap();
            prop_assert!(largest_difference(&image, &smaller) > bound, "{removed:?}");
        }
    }

    #[test]
    fn largest_error_is_kept_by_every_method(
        image in pictures(2..=12, 1..=3),
        bound in 0u16..300,
        effort in 0u8..3,
        connectivity in prop::sample::select(Connectivity::ALL),
        values in prop::sample::select(Values::ALL),
        weighted in any::<bool>(),
    ) {
        for method in [Method::Mgprfs, Method::Preview, Method::Med, Method::Optimal] {
            let target = Target::MaxError(bound);
            let own = method.parameters(target);
            let own = own.connectivity(connectivity).values(values).effort(effort);
            let weights = (0..image.pixel_count()).map(|i| (i * 37 % 256) as u8).collect();
            let weights = Weights::from_bottom_up(image.width(), image.height(), weights).ok();
            let own = own.weights(weights.filter(|_| weighted));
            check(&image, &own);
            let made = model(&image, &own);
            prop_assert!(largest_difference(&image, &made.mesh) <= bound, "{method}");
        }
    }

    #[test]
    fn size_search_keeps_bound(
        image in pictures(3..=10, 1..=2),
        psnr_db in 5.0..60.0,
        mean_error in 0.0..50.0,
        method in prop::sample::select(&[Method::Med, Method::Optimal][..]),
    ) {
        let effort = if method == Method::Med { 0 } else { 1 };
        let with = |target| method.parameters(target).effort(effort);
        prop_assert!(model(&image, &with(Target::Psnr(psnr_db))).fidelity.psnr_db() >= psnr_db);
        let made = model(&image, &with(Target::MeanError(mean_error)));
        prop_assert!(made.fidelity.mse() <= mean_error);
        let perfect = model(&image, &with(Target::MaxError(0)));
        prop_assert_eq!(perfect.fidelity.squared_error, 0);
    }

    #[test]
    fn med_plus_is_no_worse_and_no_larger_than_med(
        image in pictures(3..=12, 1..=3),
        share in 0.1..0.6,
    ) {
        let target = size_target(&image, share);
        let med = model(&image, &Method::Med.parameters(target));
        let plus = model(&image, &Method::MedPlus.parameters(target));
        prop_assert!(plus.mesh.points().len() <= med.mesh.points().len());
    }
}

#[test]
fn fitted_values_smooth_a_noisy_plane() {
    let noise = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 9) as u16;
    let samples = (0..32).flat_map(|y| (0..32).map(move |x| 40 + 4 * x as u16 + noise(x, y)));
    let image = Image::from_bottom_up(32, 32, 8, vec![samples.collect()]).unwrap();
    let own = Method::Mgprfs.parameters(Target::Size(4));
    let sampled = model(&image, &own).fidelity.mse();
    let fitted = model(&image, &own.values(Values::Fitted)).fidelity.mse();
    // Noise of 9 equally likely levels has a variance of 80 / 12.
    assert!(fitted < 80.0 / 12.0 + 0.3 && fitted < sampled, "{fitted} of {sampled}");
}

/// A gray picture of noise.
fn noise(side: usize) -> Image {
    let sample = |i: usize| ((i * 40_503 + i / side * 977) >> 4) as u16 % 256;
    Image::from_bottom_up(side, side, 8, vec![(0..side * side).map(sample).collect()]).unwrap()
}

#[test]
fn heavier_pixels_get_more_vertices() {
    let image = noise(24);
    for method in [Method::Mgprfs, Method::Optimal] {
        let own = method.parameters(Target::Size(60));
        let weighted =
            |weights: Vec<u8>| own.clone().weights(Weights::from_bottom_up(24, 24, weights).ok());
        let (with, without) = (model(&image, &weighted(vec![77; 24 * 24])), model(&image, &own));
        assert_eq!(with.mesh, without.mesh);
        assert_eq!(with.fidelity, without.fidelity);
        let left = (0..24 * 24).map(|i| if i % 24 < 12 { 200 } else { 2 }).collect();
        let made = model(&image, &weighted(left));
        let count = |mesh: &Mesh| mesh.points().iter().filter(|p| p.x < 12).count();
        let counts = (count(&made.mesh), count(&without.mesh));
        assert!(counts.0 > counts.1 + 10, "{counts:?}");
        assert_eq!(made.fidelity.squared_error, squared_error(&image, &made.mesh));
    }
}

#[test]
fn refuses_weights_of_another_size() {
    let image = noise(24);
    assert!(Weights::from_top_down(24, 24, vec![1; 9]).is_err());
    let own = Method::Mgprfs.parameters(Target::Size(60));
    let refusal = |side: usize| {
        let weights = Weights::from_top_down(side, side, vec![1; side * side]).ok();
        mesh_image(&image, &own.clone().weights(weights), &())
            .map(|_| ())
            .map_err(|error| error.to_string())
    };
    assert_eq!(refusal(24), Ok(()));
    assert!(refusal(23).unwrap_err().contains("23x23 points, the image has 24x24"));
}

/// The squared error of the columns left of the middle.
fn error_of_left_half(image: &Image, picture: &Image) -> u64 {
    let middle = image.width() / 2;
    let rows = (0..image.component_count())
        .flat_map(|c| (0..image.height()).map(move |y| (image.row(c, y), picture.row(c, y))));
    let square = |(a, b): (&u16, &u16)| u64::from(a.abs_diff(*b)).pow(2);
    rows.map(|(a, b)| a[..middle].iter().zip(&b[..middle]).map(square).sum::<u64>()).sum()
}

#[test]
fn heavier_pixels_have_smaller_errors() {
    let components = (1..4).map(|c| noise(32 + c).components()[0][..32 * 32].to_vec()).collect();
    let image = Image::from_bottom_up(32, 32, 8, components).unwrap();
    let weights = (0..32 * 32).map(|i| if i % 32 < 16 { 255 } else { 1 }).collect();
    let weights = Weights::from_bottom_up(32, 32, weights).unwrap();
    let target = Target::Size(100);
    let own = Method::Mgprfs.parameters(target);
    let with_metric = |&metric| own.clone().error_metric(metric);
    let every_metric = ErrorMetric::ALL.iter().map(with_metric);
    let refined = own.clone().effort(2);
    let others = [
        Method::Flat.parameters(target),
        refined.clone().connectivity(Connectivity::Free),
        refined.values(Values::Fitted),
    ];
    for parameters in every_metric.chain(others) {
        let [with, without] = [Some(weights.clone()), None].map(|weights| {
            let made = model(&image, &parameters.clone().weights(weights));
            let picture = rasterize(&made.mesh, &()).unwrap();
            error_of_left_half(&image, &picture)
        });
        assert!(with < without, "{with}, {without}: {parameters:?}");
    }
}

#[test]
fn flat_method_wins_for_flat_faces() {
    let image = noise(24);
    let with = |method: Method| {
        let made = model(&image, &method.parameters(Target::Size(80)));
        made.mesh.with_flat_colors(&image, &()).unwrap().1.mse()
    };
    assert!(with(Method::Flat) < with(Method::Optimal));
    let made = model(&image, &Method::Flat.parameters(Target::Size(80)));
    assert_eq!(made.mesh.points().len(), 80);
    assert_eq!(
        made.mesh.clone().with_flat_colors(&image, &()).unwrap(),
        (made.mesh, made.fidelity)
    );
}
