//! Defects of meshes, the Delaunay check, and cancellation.

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
fn fan_around_the_centre_is_a_mesh() {
    let shape = Shape { component_count: 2, ..SHAPE };
    let mesh = Mesh::new(shape, points(), (0..10).collect(), faces(), &()).unwrap();
    assert_eq!(mesh.edge_count(), 8);
    assert_eq!(mesh.vertex_samples(4), [8, 9]);
}

#[test]
fn square_has_the_rising_diagonal() {
    let shape = Shape { width: 2, height: 2, ..SHAPE };
    let points: Vec<Point> =
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| Point::new(x, y)).to_vec();
    let mesh = |faces| Mesh::new(shape, points.clone(), vec![0; 4], faces, &()).unwrap();
    assert!(mesh(vec![[0, 1, 2], [0, 2, 3]]).is_preferred_delaunay(&()).unwrap());
    assert!(mesh(vec![[2, 3, 0], [1, 2, 0]]).is_preferred_delaunay(&()).unwrap());
    assert!(!mesh(vec![[0, 1, 3], [1, 2, 3]]).is_preferred_delaunay(&()).unwrap());
    assert!(!mesh(vec![[2, 3, 1], [3, 0, 1]]).is_preferred_delaunay(&()).unwrap());
}

#[test]
fn any_flip_makes_a_mesh_not_preferred_delaunay() {
    let mut sorted: Vec<Point> = (0..100)
        .map(|i| Point::new(i % 10, i / 10))
        .filter(|p| (p.x % 9 == 0 && p.y % 9 == 0) || (p.x * 7 + p.y * 5) % 4 == 0)
        .collect();
    sorted.sort_unstable();
    let shape = Shape { width: 10, height: 10, component_count: 1, precision: 8 };
    let faces = crate::triangulation::triangulate(&sorted);
    let samples = vec![0; sorted.len()];
    let mesh = |faces: Vec<Face>| Mesh::from_kernel(shape, sorted.clone(), samples.clone(), faces);
    assert!(mesh(faces.clone()).is_preferred_delaunay(&()).unwrap());
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
            assert!(!mesh(flipped).is_preferred_delaunay(&()).unwrap());
            flips += 1;
        }
    }
    assert!(flips > 20);
}

#[test]
fn names_every_defect() {
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
    let out_of_range = E::SampleRange { vertex: 2, sample: 300, maximum: 255 };
    assert_eq!(defect(points(), vec![0, 0, 300, 0, 0], faces()), out_of_range);
    assert_eq!(defect(points(), vec![0; 4], faces()), E::SampleCount { actual: 4, expected: 5 });
    let outside = |x, y| E::PointOutside { vertex: 4, x, y, width: 3, height: 3 };
    let repeated = E::PointRepeated { vertex: 4, first: 2, x: 2, y: 2 };
    for (points, expected) in [
        (with_point(4, 3, 1), outside(3, 1)),
        (with_point(4, 1, -1), outside(1, -1)),
        (with_point(4, 2, 2), repeated),
        (with_point(0, 1, 0), E::CornerMissing { x: 0, y: 0 }),
    ] {
        assert_eq!(defect(points, vec![0; 5], faces()), expected);
    }
    for (faces, expected) in [
        (with_face(1, [1, 2, 5]), E::IndexOutOfRange { face: 1, vertex: 5, count: 5 }),
        (with_face(1, [1, 2, 2]), E::FaceDegenerate { face: 1 }),
        (with_face(1, [2, 1, 4]), E::FaceClockwise { face: 1 }),
        (with_face(1, [0, 1, 4]), E::FacesOverlap { face: 1, from: 0, to: 1 }),
        (faces()[1..].to_vec(), E::Gap { face: 2, from: 0, to: 4 }),
        (vec![[0, 1, 2], [2, 3, 0]], E::VertexUnused { vertex: 4 }),
        (vec![], E::Area { actual: 0, expected: 8 }),
    ] {
        assert_eq!(defect(points(), vec![0; 5], faces), expected);
    }
}

#[test]
fn cancels_at_every_poll() {
    let mesh = Mesh::from_kernel(SHAPE, points(), vec![0; 5], faces());
    let cancelling_at = crate::control::tests::Recorder::cancelling_at;
    for polls in 0..6 {
        assert_eq!(mesh.check(&cancelling_at(polls)), Err(MeshError::Cancelled(Cancelled)));
    }
    for polls in 0..3 {
        assert_eq!(mesh.is_preferred_delaunay(&cancelling_at(polls)), Err(Cancelled));
    }
    assert_eq!(mesh.is_preferred_delaunay(&cancelling_at(3)), Ok(true));
}
