//! Triangulation beside spade's bulk loading and delaunator, on points from random to bad.
//!
//! `cargo bench -p pixmesh-meshing --bench triangulation`
//!
//! The other two do not choose between the diagonals of cocircular points and take no care of the
//! order of the faces; ours does both.

use divan::Bencher;
use pixmesh_meshing::{Point, triangulate};
use spade::{DelaunayTriangulation, Point2, Triangulation};

/// Numbers of points, and the side of the square they lie in.
const RANDOM: [(usize, i32); 4] = [(5242, 512), (20_971, 512), (200_000, 1600), (1_000_000, 3600)];

/// Points of a row, of two that are far from each other.
const FAR_ROWS: [i32; 2] = [1000, 10_000];

fn main() {
    divan::main();
}

#[divan::bench(args = RANDOM)]
fn ours(bencher: Bencher<'_, '_>, (count, side): (usize, i32)) {
    let points = random(count, side);
    bencher.bench_local(|| triangulate(&points));
}

#[divan::bench(args = RANDOM)]
fn spade_bulk_load(bencher: Bencher<'_, '_>, (count, side): (usize, i32)) {
    let points = random(count, side);
    bencher.bench_local(|| by_spade(&points));
}

#[divan::bench(args = RANDOM)]
fn delaunator_all(bencher: Bencher<'_, '_>, (count, side): (usize, i32)) {
    let sites = sites(&random(count, side));
    bencher.bench_local(|| delaunator::triangulate(&sites));
}

#[divan::bench(args = FAR_ROWS)]
fn ours_far_rows(bencher: Bencher<'_, '_>, count: i32) {
    let points = far_rows(count);
    bencher.bench_local(|| triangulate(&points));
}

#[divan::bench(args = FAR_ROWS)]
fn spade_bulk_load_far_rows(bencher: Bencher<'_, '_>, count: i32) {
    let points = far_rows(count);
    bencher.bench_local(|| by_spade(&points));
}

#[divan::bench(args = FAR_ROWS)]
fn delaunator_far_rows(bencher: Bencher<'_, '_>, count: i32) {
    let sites = sites(&far_rows(count));
    bencher.bench_local(|| delaunator::triangulate(&sites));
}

/// `count` distinct points of a square, its corners among them, by row, then column.
fn random(count: usize, side: i32) -> Vec<Point> {
    let mut state = 1u64;
    let mut below = |bound: i32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        ((state >> 33) % bound as u64) as i32
    };
    let last = side - 1;
    let mut points =
        [(0, 0), (last, 0), (0, last), (last, last)].map(|(x, y)| Point::new(x, y)).to_vec();
    while points.len() < count {
        let missing = count - points.len();
        points.extend((0..missing).map(|_| Point::new(below(side), below(side))));
        points.sort_unstable();
        points.dedup();
    }
    points
}

/// A row at the right of the foot of a tall picture and one at the left of its top: each point of
/// the upper row takes the edges of those before it to all of the lower row.
fn far_rows(count: i32) -> Vec<Point> {
    let lower = (0..=2 * count).filter(|&x| x == 0 || x >= count);
    let upper = (0..=2 * count).filter(|&x| x < count || x == 2 * count);
    let row = |y: i32| move |x: i32| Point::new(x, y);
    lower.map(row(0)).chain(upper.map(row(6 * count))).collect()
}

fn sites(points: &[Point]) -> Vec<delaunator::Point> {
    points.iter().map(|p| delaunator::Point { x: p.x.into(), y: p.y.into() }).collect()
}

fn by_spade(points: &[Point]) -> usize {
    let sites = points.iter().map(|p| Point2::new(f64::from(p.x), f64::from(p.y))).collect();
    DelaunayTriangulation::<Point2<f64>>::bulk_load(sites).map_or(0, |d| d.num_inner_faces())
}
