//! pmesh there and back, and damage refused.

// A test is told that something is wrong by a panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use flate2::Compression;
use flate2::write::DeflateEncoder;
use pixmesh_codec::{
    EncodeError, Limits, PmeshError, probe_pmesh, read_pmesh, read_progression, write_pmesh,
    write_progression, write_rounded_pmesh,
};
use pixmesh_meshing::{
    Image, Mesh, Method, Point, Progression, Shape, Target, mesh_image, triangulate,
};
use proptest::prelude::*;
use std::io::Write;

fn image(width: usize, height: usize, components: usize, precision: u8, seed: usize) -> Image {
    let plane = |c: usize| {
        let sample = |i: usize| ((i * 40_503 + c * 9_973 + seed * 7_919) >> 3) as u16;
        (0..width * height).map(|i| sample(i) >> (16 - precision)).collect()
    };
    let planes = (0..components).map(plane).collect();
    Image::from_bottom_up(width, height, precision, planes).unwrap().premultiplied()
}

fn mesh(image: &Image, size: usize) -> Mesh {
    mesh_image(image, &Method::Mgprfs.parameters(Target::Size(size)), &()).unwrap().mesh
}

/// The same mesh with its vertices, faces and the corners of each face in another order.
fn reversed(mesh: &Mesh) -> Mesh {
    let (shape, count) = (mesh.shape(), mesh.points().len() as u32);
    let points = mesh.points().iter().rev().copied().collect();
    let by_vertex = mesh.samples().chunks(shape.component_count).rev();
    let faces = mesh.faces().iter().rev().map(|&[a, b, c]| [b, c, a].map(|v| count - 1 - v));
    let by_face = mesh.face_samples().unwrap().chunks(shape.component_count).rev();
    Mesh::new(shape, points, by_vertex.flatten().copied().collect(), faces.collect(), &())
        .unwrap()
        .with_face_samples(by_face.flatten().copied().collect())
        .unwrap()
}

fn pmesh(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_pmesh(mesh, &mut bytes).unwrap();
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn meshes_and_progressions_read_back_as_they_were(
        (width, height) in (2usize..20, 2usize..20),
        (components, precision) in (1usize..5, 1u8..=16),
        (seed, share) in (0usize..99, 0.0..1.0),
    ) {
        let image = image(width, height, components, precision, seed);
        let size = 4 + (share * (width * height - 4) as f64) as usize;
        let mesh = mesh(&image, size);
        let limits = Limits::default();
        prop_assert_eq!(&read_pmesh(&pmesh(&mesh), &limits).unwrap(), &mesh);
        prop_assert!(matches!(read_progression(&pmesh(&mesh), &limits), Err(PmeshError::NoOrder)));
        let progression =
            Progression::new(&image, &mesh, &Method::Mgprfs.parameters(Target::Size(30)), &()).unwrap();
        let mut bytes = Vec::new();
        write_progression(&progression, None, &mut bytes).unwrap();
        prop_assert_eq!(read_progression(&bytes, &limits).unwrap(), progression);
        prop_assert_eq!(read_pmesh(&bytes, &limits).unwrap(), mesh);
    }

    #[test]
    fn colors_of_faces_read_back_whatever_the_order_of_vertices_and_faces(
        (components, precision) in (1usize..5, 1u8..=16),
        seed in 0usize..99,
    ) {
        let image = image(12, 9, components, precision, seed);
        let (flat, _) = mesh(&image, 30).with_flat_colors(&image, &()).unwrap();
        prop_assert_eq!(&read_pmesh(&pmesh(&flat), &Limits::default()).unwrap(), &flat);
        let reversed = reversed(&flat);
        prop_assert_ne!(&reversed, &flat);
        prop_assert_eq!(pmesh(&reversed), pmesh(&flat));
    }

    #[test]
    fn rounded_samples_differ_by_less_than_two_steps_and_take_fewer_bytes(
        (components, is_flat) in (1usize..5, any::<bool>()),
        (step, seed) in (2f64..20.0, 0usize..99),
    ) {
        let image = image(12, 9, components, 8, seed);
        let mut mesh = mesh(&image, 60);
        if is_flat {
            mesh = mesh.with_flat_colors(&image, &()).unwrap().0;
        }
        let mut bytes = Vec::new();
        write_rounded_pmesh(&mesh, step, &mut bytes).unwrap();
        let rounded = read_pmesh(&bytes, &Limits::default()).unwrap();
        prop_assert!(bytes.len() < pmesh(&mesh).len());
        prop_assert_eq!((rounded.points(), rounded.faces()), (mesh.points(), mesh.faces()));
        let of_faces = |mesh: &Mesh| mesh.straight_face_samples().unwrap_or_default().to_vec();
        let samples = |mesh: &Mesh| [mesh.straight_samples().to_vec(), of_faces(mesh)].concat();
        if components % 2 == 1 {
            for (sample, other) in samples(&mesh).into_iter().zip(samples(&rounded)) {
                prop_assert!(f64::from(sample.abs_diff(other)) < 2.0 * step + 3.0);
            }
        }
    }

    #[test]
    fn damaged_bytes_never_panic_and_what_is_read_is_a_mesh(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        (ordered, has_colors) in any::<(bool, bool)>(),
    ) {
        let image = image(12, 9, 2, 8, 3);
        let mut mesh = mesh(&image, 30);
        if has_colors {
            mesh = mesh.with_flat_colors(&image, &()).unwrap().0;
        }
        let mut bytes = Vec::new();
        let progression =
            Progression::new(&image, &mesh, &Method::Mgprfs.parameters(Target::Size(30)), &()).unwrap();
        if ordered {
            write_progression(&progression, None, &mut bytes).unwrap();
        } else {
            bytes = pmesh(&mesh);
        }
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] ^= value;
        }
        let cut = if ordered { bytes.len() } else { cut.index(bytes.len() + 1) };
        let limits = Limits { max_pixels: 10_000, max_side: 1_000 };
        if let Ok(mesh) = read_pmesh(&bytes[..cut], &limits) {
            prop_assert_eq!(mesh.validate(), Ok(()));
        }
        if let Ok(progression) = read_progression(&bytes[..cut], &limits) {
            prop_assert!(progression.mesh(4, &()).is_ok());
        }
    }
}

#[test]
fn a_mesh_of_another_triangulation_is_refused() {
    let shape = Shape { width: 2, height: 2, component_count: 1, precision: 8 };
    let points = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Point::new(x, y)).to_vec();
    let mesh = Mesh::new(shape, points, vec![1, 2, 3, 4], vec![[0, 1, 2], [1, 3, 2]], &()).unwrap();
    let refused = write_pmesh(&mesh, &mut Vec::new());
    assert!(matches!(refused, Err(EncodeError::Connectivity { format: "pmesh" })));
}

/// A file of an earlier version: two columns, two rows, samples 10, 20, 30 and 40, and faces that are
/// brighter by 1 than the mean of their vertices where there is one of two differences.
fn of_earlier_version(version: u8, of_faces: &[u8]) -> Vec<u8> {
    let stream = [&[0, 0, 0, 0, 20, 20, 20, 20], of_faces].concat();
    let mut bytes = [b"PMSH", &[version, 0, 8, 1][..]].concat();
    for number in [2, 2, 4, stream.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    let mut deflate = DeflateEncoder::new(bytes, Compression::best());
    deflate.write_all(&stream).unwrap();
    deflate.finish().unwrap()
}

#[test]
fn earlier_versions_are_read() {
    let limits = Limits::default();
    let mesh = read_pmesh(&of_earlier_version(1, &[]), &limits).unwrap();
    let points = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Point::new(x, y));
    assert_eq!((mesh.points(), mesh.samples()), (&points[..], &[10, 20, 30, 40][..]));
    assert_eq!(mesh.faces(), triangulate(&points));
    let flat = read_pmesh(&of_earlier_version(2, &[2, 2]), &limits).unwrap();
    let mean = |face: &[u32; 3]| face.iter().map(|&v| 10 + 10 * v as u16).sum::<u16>() / 3;
    let expected: Vec<u16> = flat.faces().iter().map(|face| mean(face) + 1).collect();
    assert_eq!(flat.face_samples(), Some(&expected[..]));
}

#[test]
fn a_header_beyond_the_limits_is_refused() {
    let header = |numbers: &[u8]| [b"PMSH", &[3, 0, 8, 1][..], numbers].concat();
    let limits = Limits { max_pixels: 100, max_side: 20 };
    let refused = |numbers: &[u8]| probe_pmesh(&header(numbers), &limits).unwrap_err();
    assert!(probe_pmesh(&header(&[10, 10, 4, 8]), &limits).is_ok());
    assert!(matches!(refused(&[20, 6, 4, 8]), PmeshError::Size(_)));
    assert!(matches!(refused(&[30, 3, 4, 8]), PmeshError::Size(_)));
    assert!(matches!(
        refused(&[10, 10, 101, 8]),
        PmeshError::VertexCount { count: 101, most: 100 }
    ));
    assert!(matches!(refused(&[10, 10, 3, 8]), PmeshError::VertexCount { count: 3, most: 100 }));
    assert!(matches!(refused(&[10, 10, 4, 7]), PmeshError::Header));
    assert!(matches!(refused(&[10, 10, 4]), PmeshError::Header));
    assert!(matches!(refused(&[10, 10, 4, 0x80, 0x80, 0x80, 0x80, 1]), PmeshError::Header));
    // A stream of nothing ends before 100 vertices do.
    let bytes = header(&[10, 10, 50, 8]);
    assert!(matches!(read_pmesh(&bytes, &limits), Err(PmeshError::Stream)));
    assert!(matches!(read_progression(&bytes, &limits), Err(PmeshError::NoOrder)));
}
