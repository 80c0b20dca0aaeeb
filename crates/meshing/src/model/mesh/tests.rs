//! Defects of meshes, and how often it is asked whether a mesh is wanted.

use super::*;

const SHAPE: Shape = Shape { width: 3, height: 3, component_count: 1, precision: 8 };

/// Corners counter-clockwise from the origin, then the centre.
fn points() -> Vec<Point> {
    [(0, 0), (2, 0), (2, 2), (0, 2), (1, 1)].map(|(x, y)| Point::new(x, y)).to_vec()
}

fn faces() -> Vec<Face> {
    vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
}

fn defect(points: Vec<Point>, samples: Vec<u16>, faces: Vec<Face>) -> MeshError {
    Mesh::new(SHAPE, points, samples, faces, &()).unwrap_err()
}

#[test]
fn a_fan_around_the_centre_is_a_mesh() {
    let mesh = Mesh::new(SHAPE, points(), vec![1, 2, 3, 4, 5], faces(), &()).unwrap();
    assert_eq!(mesh.edge_count(), 8);
    assert_eq!(mesh.vertex_samples(4), [5]);
}

#[test]
fn a_square_is_cut_by_its_rising_diagonal() {
    let shape = Shape { width: 2, height: 2, ..SHAPE };
    let points: Vec<Point> =
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| Point::new(x, y)).to_vec();
    let mesh = |faces| Mesh::new(shape, points.clone(), vec![0; 4], faces, &()).unwrap();
    assert!(mesh(vec![[0, 1, 2], [0, 2, 3]]).is_preferred_delaunay());
    assert!(mesh(vec![[2, 3, 0], [1, 2, 0]]).is_preferred_delaunay());
    assert!(!mesh(vec![[0, 1, 3], [1, 2, 3]]).is_preferred_delaunay());
    assert!(!mesh(vec![[2, 3, 1], [3, 0, 1]]).is_preferred_delaunay());
}

#[test]
fn a_mesh_of_many_faces_is_preferred_delaunay_when_no_edge_could_be_flipped() {
    let mut sorted: Vec<Point> = (0..100)
        .map(|i| Point::new(i % 10, i / 10))
        .filter(|p| (p.x % 9 == 0 && p.y % 9 == 0) || (p.x * 7 + p.y * 5) % 4 == 0)
        .collect();
    sorted.sort_unstable();
    let shape = Shape { width: 10, height: 10, component_count: 1, precision: 8 };
    let faces = crate::triangulation::triangulate(&sorted);
    let samples = vec![0; sorted.len()];
    let mesh = |faces: Vec<Face>| Mesh::from_kernel(shape, sorted.clone(), samples.clone(), faces);
    assert!(mesh(faces.clone()).is_preferred_delaunay());
    let mut flips = 0;
    for (f, &first) in faces.iter().enumerate() {
        for (g, &second) in faces.iter().enumerate().skip(f + 1) {
            let [a, b, c] = first;
            let sides = [[a, b, c], [b, c, a], [c, a, b]];
            let shared =
                sides.iter().find(|[from, to, _]| second.contains(from) && second.contains(to));
            let Some(&[from, to, left]) = shared else { continue };
            let Some(&right) = second.iter().find(|&&v| v != from && v != to) else { continue };
            let is_face = |face: Face| {
                let [a, b, c] = face.map(|v| sorted[v as usize]);
                orientation(a, b, c) > 0
            };
            let flipped_faces = [[right, to, left], [left, from, right]];
            if !flipped_faces.into_iter().all(is_face) {
                continue;
            }
            let mut flipped = faces.clone();
            (flipped[f], flipped[g]) = flipped_faces.into();
            assert!(!mesh(flipped).is_preferred_delaunay());
            flips += 1;
        }
    }
    assert!(flips > 20);
}

#[test]
fn a_sample_out_of_range_is_that_of_its_vertex() {
    let shape = Shape { component_count: 2, ..SHAPE };
    let mut samples = vec![0; 10];
    assert_eq!(
        Mesh::new(shape, points(), samples.clone(), faces(), &()).unwrap().samples(),
        samples
    );
    samples[7] = 256;
    let error = Mesh::new(shape, points(), samples, faces(), &()).unwrap_err();
    assert!(matches!(error, MeshError::SampleRange { vertex: 3, sample: 256, maximum: 255 }));
}

#[test]
fn every_defect_is_found_and_named() {
    use MeshError as E;
    let with_point = |v: usize, x, y| {
        let mut points = points();
        points[v] = Point::new(x, y);
        points
    };
    let with_face = |f: usize, face| {
        let mut faces = faces();
        faces[f] = face;
        faces
    };
    let s = || vec![0; 5];
    assert!(matches!(
        defect(points(), vec![0; 4], faces()),
        E::SampleCount { actual: 4, expected: 5 }
    ));
    assert!(matches!(
        defect(points(), vec![0, 0, 300, 0, 0], faces()),
        E::SampleRange { vertex: 2, .. }
    ));
    assert!(matches!(
        defect(with_point(4, 3, 1), s(), faces()),
        E::PointOutside { vertex: 4, x: 3, .. }
    ));
    assert!(matches!(defect(with_point(4, 1, -1), s(), faces()), E::PointOutside { y: -1, .. }));
    assert!(matches!(
        defect(with_point(4, 2, 2), s(), faces()),
        E::PointRepeated { vertex: 4, first: 2, .. }
    ));
    assert!(matches!(defect(with_point(0, 1, 0), s(), faces()), E::CornerMissing { x: 0, y: 0 }));
    assert!(matches!(
        defect(points(), s(), with_face(1, [1, 2, 5])),
        E::IndexOutOfRange { face: 1, vertex: 5, count: 5 }
    ));
    assert!(matches!(
        defect(points(), s(), with_face(1, [1, 2, 2])),
        E::FaceDegenerate { face: 1 }
    ));
    assert!(matches!(defect(points(), s(), with_face(1, [2, 1, 4])), E::FaceClockwise { face: 1 }));
    assert!(matches!(
        defect(points(), s(), with_face(1, [0, 1, 4])),
        E::FacesOverlap { face: 1, from: 0, to: 1 }
    ));
    assert!(matches!(defect(points(), s(), faces()[..3].to_vec()), E::Gap { .. }));
    assert!(matches!(
        defect(points(), s(), faces()[1..].to_vec()),
        E::Gap { face: 2, from: 0, to: 4 }
    ));
    assert!(matches!(
        defect(points(), s(), vec![[0, 1, 2], [2, 3, 0]]),
        E::VertexUnused { vertex: 4 }
    ));
    assert!(matches!(defect(points(), s(), vec![]), E::Area { actual: 0, expected: 8 }));
    let clockwise =
        Mesh { faces: with_face(1, [2, 1, 4]), ..Mesh::from_kernel(SHAPE, points(), s(), faces()) };
    assert_eq!(clockwise.validate(), Err(E::FaceClockwise { face: 1 }));
}

#[test]
fn sorts_in_parts() {
    for count in [1, 1 << 19, (1 << 19) + 1, 1 << 20] {
        let mut numbers: Vec<u32> = (0..count).map(|i: u32| i.wrapping_mul(0x9E37_79B1)).collect();
        sort(&mut numbers, &()).unwrap();
        assert!(numbers.is_sorted(), "{count}");
    }
}

#[test]
fn checks_cancel_at_every_poll() {
    let mesh = Mesh::from_kernel(SHAPE, points(), vec![0; 5], faces());
    for polls in 0..5 {
        let control = crate::control::tests::Recorder::cancelling_at(polls);
        assert_eq!(mesh.check(&control), Err(MeshError::Cancelled(Cancelled)));
    }
}
