//! Meshes with holes, pixel by pixel: the surface ends at the borders of the holes, and is as near to
//! every other pixel as the bound says, without rounding.

use crate::pictures::{cases, image, model};
use pixmesh_meshing::parameters::{Connectivity, ParameterError, Values};
use pixmesh_meshing::{Image, Mesh, MeshingError, Method, Point, Target, mesh_image, orientation};
use proptest::prelude::*;

/// Checks a mesh of heights and alpha against the image.
fn check(image: &Image, mesh: &Mesh, bound: f64) {
    assert_eq!(mesh.validate(), Ok(()));
    let is_hole =
        |p: Point| image.components()[1][p.y as usize * image.width() + p.x as usize] == 0;
    for y in 0..image.height() as i32 {
        for x in 0..image.width() as i32 {
            let at = Point::new(x, y);
            let height = f64::from(image.components()[0][y as usize * image.width() + x as usize]);
            let mut is_on_surface = false;
            for &face in mesh.faces() {
                let [a, b, c] = mesh.corners(face);
                let weights = [orientation(b, c, at), orientation(c, a, at), orientation(a, b, at)];
                if weights.iter().any(|&weight| weight < 0) {
                    continue;
                }
                let corners = [a, b, c];
                let is_whole = corners.iter().all(|&corner| !is_hole(corner));
                if is_hole(at) {
                    let is_inside = weights.iter().all(|&weight| weight > 0);
                    assert!(!(is_whole && is_inside), "{at:?} is covered by {corners:?}");
                    continue;
                }
                // On the face, or on an edge of it that the surface has.
                if corners.iter().zip(weights).all(|(&corner, w)| w == 0 || !is_hole(corner)) {
                    is_on_surface = true;
                    let values = face.map(|v| f64::from(mesh.vertex_samples(v as usize)[0]));
                    let sum: f64 = values.iter().zip(weights).map(|(v, w)| v * w as f64).sum();
                    let found = sum / orientation(a, b, c) as f64;
                    assert!((found - height).abs() <= bound + 1e-9, "{at:?}: {found} for {height}");
                }
            }
            assert!(is_on_surface || is_hole(at), "{at:?} is lost");
        }
    }
}

/// Heights of 8 bits, and blocks of an alpha that is nothing or all.
fn with_holes() -> impl Strategy<Value = Image> {
    let sides = (2usize..=11, 2usize..=11, 1usize..4);
    let blocks = prop::collection::vec(0u8..4, 121);
    (sides, prop::collection::vec(0u16..30, 121), blocks).prop_map(|(sides, heights, blocks)| {
        let (width, height, block) = sides;
        let alpha = |i: usize| {
            let (x, y) = (i % width / block, i / width / block);
            if blocks[y * 11 + x] == 0 { 0 } else { 255 }
        };
        let alpha: Vec<u16> = (0..width * height).map(alpha).collect();
        let of_surface = |(height, alpha): (&u16, &u16)| *height.min(alpha);
        let heights = heights.iter().zip(&alpha).map(of_surface).collect();
        image(width, height, 8, vec![heights, alpha])
    })
}

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn surface_ends_at_holes_and_keeps_the_bound(
        image in with_holes(),
        bound in 0.0..30.0,
        method in prop::sample::select(&[Method::Mgprfs, Method::Mgpr, Method::Preview][..]),
        connectivity in prop::sample::select(Connectivity::ALL),
    ) {
        let own = method.parameters(Target::MaxDistance(bound)).holes(true);
        let made = model(&image, &own.connectivity(connectivity));
        check(&image, &made.mesh, bound);
        let samples = |p: &Point| image.components()[1][p.y as usize * image.width() + p.x as usize];
        for (v, point) in made.mesh.points().iter().enumerate() {
            prop_assert_eq!(made.mesh.vertex_samples(v)[1], samples(point));
        }
    }
}

#[test]
fn holes_without_a_bound_are_refused() {
    let image = image(4, 4, 8, vec![vec![0; 16], vec![255; 16]]);
    let bounded = Method::Mgprfs.parameters(Target::MaxDistance(1.0)).holes(true);
    for refused in [
        Method::Mgprfs.parameters(Target::Size(8)).holes(true),
        bounded.clone().effort(1),
        bounded.values(Values::Fitted),
    ] {
        let error = mesh_image(&image, &refused, &()).unwrap_err();
        assert_eq!(error, MeshingError::Parameter(ParameterError::HolesNeedBound));
    }
}

#[test]
fn flat_border_of_a_hole_has_few_vertices() {
    let side = 40;
    let alpha = (0..side * side).map(|i| if i % side >= 12 && i / side < 20 { 0 } else { 255 });
    let image = image(side, side, 8, vec![vec![0; side * side], alpha.collect()]);
    let own = Method::Mgprfs.parameters(Target::MaxDistance(0.5)).holes(true);
    let mesh = model(&image, &own).mesh;
    check(&image, &mesh, 0.5);
    let count = (0..mesh.points().len()).filter(|&v| mesh.vertex_samples(v)[1] > 0).count();
    assert!(count <= 12, "{count} vertices of the surface");
}
