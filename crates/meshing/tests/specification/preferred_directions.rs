//! `triangulate` against flips of an arbitrary triangulation, on lattices so small that cocircular
//! and collinear points are the rule.

use crate::pictures::cases;
use crate::twin::triangulation::{
    circle_sign, double_area, is_preferred, triangles_of, triangulate as flipped,
};
use pixmesh_meshing::{Point, in_circle, orientation, triangulate};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// The points chosen from a lattice of `width` columns and its corners, by row, then column.
fn chosen_of(width: i32, height: i32, is_chosen: impl Fn(i32, i32) -> bool) -> Vec<Point> {
    let is_corner = |x, y| (x == 0 || x == width - 1) && (y == 0 || y == height - 1);
    let lattice = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    lattice
        .filter(|&(x, y)| is_corner(x, y) || is_chosen(x, y))
        .map(|(x, y)| Point::new(x, y))
        .collect()
}

fn check(points: &[Point]) {
    assert_eq!(triangles_of(points, &triangulate(points)), flipped(points));
}

/// Random subsets of small lattices with the corners, thinly to fully occupied.
fn subsets() -> impl Strategy<Value = Vec<Point>> {
    let lattices = (2..=10i32, 2..=10i32, prop::sample::select(vec![40u8, 128, 200, 255]));
    lattices.prop_flat_map(|(width, height, share)| {
        let marks = prop::collection::vec(any::<u8>(), (width * height) as usize);
        marks.prop_map(move |marks| {
            chosen_of(width, height, |x, y| marks[(y * width + x) as usize] < share)
        })
    })
}

/// Few points spread over a wide lattice, so that circles are large.
fn scattered() -> impl Strategy<Value = Vec<Point>> {
    (2..=300i32, 2..=300i32).prop_flat_map(|(width, height)| {
        let coordinates = prop::collection::btree_set((0..height, 0..width), 0..40);
        coordinates.prop_map(move |coordinates| {
            let corners = [(0, 0), (0, width - 1), (height - 1, 0), (height - 1, width - 1)];
            let all: BTreeSet<_> = coordinates.into_iter().chain(corners).collect();
            all.into_iter().map(|(y, x)| Point::new(x, y)).collect()
        })
    })
}

proptest! {
    #![proptest_config(cases(1500))]

    #[test]
    fn small_lattice_matches_reference(points in subsets()) {
        check(&points);
    }

    #[test]
    fn scattered_points_match_reference(points in scattered()) {
        check(&points);
    }

    #[test]
    fn point_order_keeps_triangles(
        (points, shuffled) in subsets().prop_flat_map(|points| {
            (Just(points.clone()), Just(points).prop_shuffle())
        })
    ) {
        let ordered = triangles_of(&points, &triangulate(&points));
        prop_assert_eq!(triangles_of(&shuffled, &triangulate(&shuffled)), ordered);
    }

    #[test]
    fn predicates_match_determinants(
        coordinates in prop::collection::vec((0..6i32, 0..6i32), 4),
        scale in prop::sample::select(vec![1, 1000, 60_000, 209_000]),
    ) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| {
            let (x, y): (i32, i32) = coordinates[i];
            Point::new(x * scale, y * scale)
        });
        prop_assert_eq!(i128::from(orientation(a, b, c)), double_area(a, b, c));
        // Only a convex quadrilateral a d b c has two diagonals.
        let is_quadrilateral = [(a, b, c), (b, a, d), (a, d, c), (d, b, c)]
            .iter()
            .all(|&(p, q, r)| double_area(p, q, r) > 0);
        if is_quadrilateral {
            let sign = circle_sign(a, b, c, d);
            let expected = if sign == 0 { is_preferred(c, d, a, b) } else { sign > 0 };
            prop_assert_eq!(in_circle(a, b, c, d), expected);
        }
    }
}

#[test]
fn full_lattice_matches_reference() {
    for (width, height) in
        [(2, 2), (2, 3), (3, 2), (3, 3), (2, 9), (9, 2), (5, 7), (8, 8), (12, 12)]
    {
        check(&chosen_of(width, height, |_, _| true));
    }
}

#[test]
fn single_row_or_column_matches_reference() {
    for (width, height) in [(9, 3), (3, 9), (20, 5), (6, 6)] {
        for line in 0..width.min(height) {
            check(&chosen_of(width, height, |_, y| y == line));
            check(&chosen_of(width, height, |x, _| x == line));
            check(&chosen_of(width, height, |x, y| x == y || x + y == line));
        }
    }
}

#[test]
fn cocircular_points_match_reference() {
    for radius_squared in [25, 50, 65, 325, 425, 1105] {
        let on_circle = |x: i32, y: i32| (x - 34).pow(2) + (y - 34).pow(2) == radius_squared;
        check(&chosen_of(69, 69, on_circle));
        check(&chosen_of(69, 69, |x, y| on_circle(x, y) || (x, y) == (34, 34)));
    }
}

#[test]
fn square_has_rising_diagonal() {
    let square = chosen_of(2, 2, |_, _| true);
    assert_eq!(triangulate(&square), [[0, 1, 3], [0, 3, 2]]);
}

#[test]
fn predicates_are_exact_at_largest_coordinates() {
    let last = (1 << 20) - 1;
    let middle = last / 2;
    check(&chosen_of_list(last, &[(middle, middle), (middle + 1, middle), (middle, middle + 1)]));
    check(&chosen_of_list(last, &[(1, 0), (last, last - 1), (last - 1, last), (0, 1)]));
}

/// The corners of a square of side `last` and some more points.
fn chosen_of_list(last: i32, coordinates: &[(i32, i32)]) -> Vec<Point> {
    let corners = [(0, 0), (last, 0), (0, last), (last, last)];
    let all: BTreeSet<Point> =
        corners.iter().chain(coordinates).map(|&(x, y)| Point::new(x, y)).collect();
    all.into_iter().collect()
}
