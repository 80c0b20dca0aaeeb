//! The owner of each pixel, and the interpolant in 128 bits.

use super::*;
use crate::image::corner_points;
use crate::triangulation::triangulate;
use proptest::prelude::*;
use std::collections::BTreeSet;

/// The face that owns a pixel by the rule in words: the one that holds the pixel after a move
/// by `(-1, -e)` infinitesimals, or to the right or upwards where there is no left or below.
fn owner(points: &[Point], faces: &[[u32; 3]], p: Point) -> usize {
    let horizontal = if p.x == 0 { 1 } else { -1 };
    let vertical = if p.y == 0 { 1 } else { -1 };
    let inside = |a: Point, b: Point| {
        // Orientation of (a, b, p + (h e, v e^2)), sign by sign.
        let first = -i64::from(b.y - a.y) * horizontal;
        let second = i64::from(b.x - a.x) * vertical;
        [orientation(a, b, p), first, second].into_iter().find(|&term| term != 0) > Some(0)
    };
    let holds = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| points[v as usize]);
        inside(a, b) && inside(b, c) && inside(c, a)
    };
    let owners: Vec<usize> = (0..faces.len()).filter(|&f| holds(&faces[f])).collect();
    assert_eq!(owners.len(), 1, "{p:?} has the owners {owners:?}");
    owners[0]
}

proptest! {
    #[test]
    fn each_pixel_belongs_to_the_face_of_the_rule(
        width in 2i32..10,
        height in 2i32..10,
        seeds in prop::collection::vec((0i32..10, 0i32..10), 0..25),
    ) {
        let inner = seeds.iter().map(|&(x, y)| Point::new(x % width, y % height));
        let corners = corner_points(width as usize, height as usize);
        let points: BTreeSet<Point> = inner.chain(corners).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let faces = triangulate(&points);
        let mut owners = vec![None; (width * height) as usize];
        for (f, face) in faces.iter().enumerate() {
            for_each_row(face.map(|v| points[v as usize]), |y, first, end| {
                for x in first..end {
                    let owner = &mut owners[(y * width + x) as usize];
                    assert_eq!(owner.replace(f), None, "({x}, {y}) is owned twice");
                }
            });
        }
        for (pixel, found) in (0..).zip(owners) {
            let p = Point::new(pixel % width, pixel / width);
            prop_assert_eq!(found, Some(owner(&points, &faces, p)));
        }
    }
}

/// Compares all rows of a face with those of the walk.
#[inline(always)]
fn assert_same_rows<S: Simd>(simd: S, corners: [Point; 3]) {
    let face = SmallFace::new(corners).unwrap();
    let mut found = Vec::new();
    for first_row in (0..face.rows).step_by(ROWS) {
        let rows = face.rows(simd, first_row);
        for i in 0..ROWS.min((face.rows - first_row) as usize) {
            if rows.counts[i] > 0 {
                let y = face.bottom + first_row + 1 + i as i32;
                found.push((y, rows.firsts[i], rows.firsts[i] + rows.counts[i]));
            }
        }
    }
    let mut expected = Vec::new();
    for_each_row(corners, |y, first, end| expected.push((y, first, end)));
    assert_eq!(found, expected);
}

#[test]
fn small_face_crosses_every_edge_as_the_walk() {
    let extent = MAX_EXTENT;
    for (rows, columns) in (1..=extent).flat_map(|r| (-extent..=extent).map(move |c| (r, c))) {
        let (low, high) = (Point::new(64, 1), Point::new(64 + columns, 1 + rows));
        let beside = if columns < 0 { high.x.max(1) } else { low.x };
        // A third vertex at the left of the edge, level with its upper end.
        let third = Point::new(beside.min(high.x - 1).max(high.x.max(64) - extent), high.y);
        if orientation(low, high, third) > 0 {
            dispatch!(Level::new(), simd => assert_same_rows(simd, [low, high, third]));
        }
    }
}

proptest! {
    #[test]
    fn small_face_has_the_rows_of_the_walk(numbers in prop::array::uniform6(1i32..65)) {
        let mut corners = [0, 2, 4].map(|i| Point::new(numbers[i], numbers[i + 1]));
        if orientation(corners[0], corners[1], corners[2]) < 0 {
            corners.swap(1, 2);
        }
        if orientation(corners[0], corners[1], corners[2]) > 0 {
            dispatch!(Level::new(), simd => assert_same_rows(simd, corners));
        }
    }
}

#[test]
fn larger_faces_are_not_small() {
    let face = |columns, rows| {
        SmallFace::new([Point::new(1, 1), Point::new(1 + columns, 1), Point::new(1, 1 + rows)])
    };
    assert!(face(MAX_EXTENT, MAX_EXTENT).is_some());
    assert!(face(MAX_EXTENT + 1, 1).is_none() && face(1, MAX_EXTENT + 1).is_none());
}

/// The definition, in 128 bits.
fn rounded([a, b, c]: [Point; 3], samples: [u16; 3], p: Point) -> i128 {
    let double_area = i128::from(orientation(a, b, c));
    let weights = [orientation(b, c, p), orientation(c, a, p), orientation(a, b, p)];
    let numerator: i128 =
        weights.iter().zip(samples).map(|(&w, z)| i128::from(w) * i128::from(z)).sum();
    (2 * numerator + double_area).div_euclid(2 * double_area)
}

/// The value that the interpolant gives at one point.
fn value(interpolant: &Interpolant, p: Point) -> i128 {
    let mut sample = [0];
    interpolant.fill(p.x, p.y, &mut sample);
    sample[0].into()
}

proptest! {
    #[test]
    fn rounds_faces_of_any_size_exactly(
        side in prop::sample::select(&[12u32, 16_384, 1 << 20][..]),
        seeds: [u32; 8],
        samples: [u16; 3],
    ) {
        let at =
            |i: usize| Point::new((seeds[i] % side) as i32, (seeds[i + 1] % side) as i32);
        let mut face = [at(0), at(2), at(4)];
        if orientation(face[0], face[1], face[2]) < 0 {
            face.swap(1, 2);
        }
        let [a, b, c] = face;
        prop_assume!(orientation(a, b, c) > 0);
        let interpolant = Interpolant::new(face, samples);
        let inside = |p: Point| {
            orientation(a, b, p) >= 0 && orientation(b, c, p) >= 0 && orientation(c, a, p) >= 0
        };
        let middle = Point::new((a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3);
        for p in [a, b, c, at(6), middle].into_iter().filter(|&p| inside(p)) {
            assert_eq!(value(&interpolant, p), rounded(face, samples, p), "{face:?} at {p:?}");
        }
    }
}

#[test]
fn rounds_halves_up() {
    let face = [Point::new(0, 0), Point::new(2, 0), Point::new(0, 2)];
    let interpolant = Interpolant::new(face, [0, 1, 2]);
    assert_eq!(value(&interpolant, Point::new(1, 0)), 1);
    assert_eq!(value(&interpolant, Point::new(1, 1)), 2);
    // A face whose numerators have more digits than a floating-point number.
    let side = 1 << 19;
    let face = [Point::new(0, 0), Point::new(side, 0), Point::new(0, side)];
    let interpolant = Interpolant::new(face, [40_000, 40_001, 40_000]);
    assert_eq!(value(&interpolant, Point::new(side / 2, 0)), 40_001);
    assert_eq!(value(&interpolant, Point::new(side / 2 - 1, 0)), 40_000);
}
