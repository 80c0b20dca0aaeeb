//! Every way to triangulate against spade's Delaunay triangulation with the wrong edges flipped, on
//! random points and on those that are hardest for each way.

use super::*;
use crate::control::tests::Recorder;
use crate::image::corner_points;
use crate::triangulation::predicates::{in_circle, orientation};
use proptest::prelude::*;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation as _};
use std::collections::BTreeSet;
use std::time::Instant;

/// A point in spade's triangulation, with its index.
#[derive(Clone, Copy)]
struct Site {
    v: u32,
    point: Point,
}

impl HasPosition for Site {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        Point2::new(f64::from(self.point.x), f64::from(self.point.y))
    }
}

impl Triangulation {
    /// spade's triangulation, with preferred directions.
    fn by_spade(points: Vec<Point>) -> Self {
        let sites: Vec<Site> = (0..).zip(&points).map(|(v, &point)| Site { v, point }).collect();
        let delaunay = DelaunayTriangulation::<Site>::bulk_load(sites).unwrap();
        let mut numbers = vec![NONE; 2 * delaunay.num_undirected_edges()];
        let mut origins = Vec::new();
        for face in delaunay.inner_faces() {
            for edge in face.adjacent_edges() {
                numbers[edge.fix().index()] = origins.len() as u32;
                origins.push(edge.from().data().v);
            }
        }
        let mut twins = vec![NONE; origins.len()];
        for edge in delaunay.directed_edges() {
            let h = numbers[edge.fix().index()];
            if h != NONE {
                twins[h as usize] = numbers[edge.rev().fix().index()];
            }
        }
        let mut triangulation = Self { points, origins, twins };
        triangulation.prefer_directions();
        triangulation
    }

    /// Flips edges until each quadrilateral has the diagonal of the PDDT.
    fn prefer_directions(&mut self) {
        let mut suspects: Vec<u32> = (0..self.origins.len() as u32).collect();
        while let Some(h) = suspects.pop() {
            let twin = self.twins[h as usize];
            if twin != NONE && self.is_wrong(h, twin) {
                let (from_c, from_d) = (previous(h), previous(twin));
                let [beyond_ca, beyond_db] = [from_c, from_d].map(|h| self.twins[h as usize]);
                self.origins[h as usize] = self.origins[from_d as usize];
                self.link(h, beyond_db);
                self.origins[twin as usize] = self.origins[from_c as usize];
                self.link(twin, beyond_ca);
                self.link(from_c, from_d);
                suspects.extend([h, next(h), twin, next(twin)]);
            }
        }
    }

    /// Makes two half-edges opposite to each other.
    fn link(&mut self, h: u32, twin: u32) {
        self.twins[h as usize] = twin;
        if twin != NONE {
            self.twins[twin as usize] = h;
        }
    }

    fn is_wrong(&self, h: u32, twin: u32) -> bool {
        let [a, b, c, d] = [h, next(h), previous(h), previous(twin)]
            .map(|h| self.points[self.origins[h as usize] as usize]);
        in_circle(a, b, c, d)
    }

    /// Asserts that half-edges pair up, every triangle turns counter-clockwise, no edge is wrong,
    /// and the triangles cover the rectangle around the points if its corners are among them.
    fn assert_preferred(&self) {
        let mut double_area = 0;
        for (h, &twin) in (0..).zip(&self.twins) {
            if twin != NONE {
                assert_eq!(self.twins[twin as usize], h);
                assert_eq!(self.origins[twin as usize], self.origins[next(h) as usize]);
                assert!(!self.is_wrong(h, twin));
            }
        }
        for face in self.origins.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|i| self.points[face[i] as usize]);
            assert!(orientation(a, b, c) > 0);
            double_area += orientation(a, b, c);
        }
        if rectangle_area(&self.points, &()).unwrap().is_some() {
            let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
            let sides = (i64::from(last.x - first.x), i64::from(last.y - first.y));
            assert_eq!(double_area, 2 * sides.0 * sides.1);
        }
    }
}

/// The triangulation by the sweep; `None` when that takes too many flips.
fn swept(points: &[Point]) -> Option<Triangulation> {
    let (origins, twins) = sweep::triangulate(points, &()).unwrap()?;
    Some(Triangulation { points: points.to_vec(), origins, twins })
}

/// The triangulation by divide and conquer.
fn merged(points: &[Point]) -> Triangulation {
    let (origins, twins) = divide_and_conquer::triangulate(points, &()).unwrap();
    Triangulation { points: points.to_vec(), origins, twins }
}

/// Asserts that all ways give the triangulation of spade.
fn check(points: &[Point]) {
    let expected = Triangulation::by_spade(points.to_vec()).faces(&()).unwrap();
    let merged = merged(points);
    merged.assert_preferred();
    assert_eq!(merged.faces(&()).unwrap(), expected);
    if rectangle_area(points, &()).unwrap().is_some()
        && let Some(swept) = swept(points)
    {
        swept.assert_preferred();
        assert_eq!(swept.faces(&()).unwrap(), expected);
    }
    let chosen = Triangulation::new(points.to_vec(), &()).unwrap();
    chosen.assert_preferred();
    assert_eq!(chosen.faces(&()).unwrap(), expected);
}

/// Points and the corners of a rectangle from the origin, by row, then column.
fn with_corners(
    points: impl IntoIterator<Item = (i32, i32)>,
    width: i32,
    height: i32,
) -> Vec<Point> {
    let inner = points.into_iter().map(|(x, y)| Point::new(x, y));
    let corners = corner_points(width as usize, height as usize);
    inner.chain(corners).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Pseudorandom numbers.
fn noise(count: usize) -> impl Iterator<Item = i32> {
    let step = |state: &u64| Some(state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1));
    std::iter::successors(Some(1), step).skip(1).take(count).map(|state| (state >> 33) as i32)
}

fn random(count: usize, width: i32, height: i32) -> Vec<Point> {
    let numbers: Vec<i32> = noise(2 * count).collect();
    with_corners(numbers.chunks_exact(2).map(|n| (n[0] % width, n[1] % height)), width, height)
}

/// The right half of the bottom row of a tall rectangle and the left half of its top row: each
/// point of the top row is nearer to the bottom row than the points before it, and takes their
/// edges.
fn far_rows(count: i32) -> Vec<Point> {
    let lower = (count..2 * count).map(|x| (x, 0));
    with_corners(lower.chain((1..count).map(|x| (x, 6 * count))), 2 * count, 6 * count + 1)
}

/// The left side and the right part of the bottom row: each point of the left side takes the edges
/// of those below it to distant points of the row.
fn bottom_and_side(count: i32) -> Vec<Point> {
    let bottom = (count..4 * count).map(|x| (x, 0));
    with_corners((1..count).map(|y| (0, y)).chain(bottom), 4 * count, 4 * count)
}

#[test]
fn translation_keeps_the_faces() {
    let points = random(60, 40, 30);
    let expected = merged(&points).faces(&()).unwrap();
    for (dx, dy) in [(-25, -40), (-1000, 7), (300, -9), (5, 5)] {
        let moved: Vec<Point> = points.iter().map(|p| Point::new(p.x + dx, p.y + dy)).collect();
        assert_eq!(swept(&moved).unwrap().faces(&()).unwrap(), expected);
        assert_eq!(merged(&moved).faces(&()).unwrap(), expected);
        assert_eq!(Triangulation::new(moved, &()).unwrap().faces(&()).unwrap(), expected);
    }
}

#[test]
fn full_grids_match_spade() {
    for (width, height) in [(2, 2), (2, 5), (6, 2), (7, 4)] {
        let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        check(&with_corners(all, width, height));
    }
}

#[test]
fn random_points_match_spade() {
    check(&random(5000, 512, 512));
    check(&random(5000, 80, 80));
    check(&random(3000, 1 << 20, 1 << 20));
    check(&random(3000, 1 << 20, 3));
    check(&random(3000, 3, 1 << 20));
}

#[test]
fn distant_clusters_match_spade() {
    let side = 60_000;
    let cluster = |x: i32, y: i32| {
        let numbers: Vec<i32> = noise(2000).collect();
        numbers.chunks_exact(2).map(|n| (x + n[0] % 90, y + n[1] % 90)).collect::<Vec<_>>()
    };
    let beside = [cluster(100, 300), cluster(59_000, 320)].concat();
    check(&with_corners(beside, side, side));
    let above = [cluster(30_000, 100), cluster(30_020, 59_000)].concat();
    check(&with_corners(above, side, side));
    let across = [cluster(100, 100), cluster(59_000, 59_000)].concat();
    check(&with_corners(across, side, side));
}

#[test]
fn circles_and_lines_match_spade() {
    let circle = |squared_radius: i32| {
        let on = move |&(x, y): &(i32, i32)| (x - 200).pow(2) + (y - 200).pow(2) == squared_radius;
        (0..400).flat_map(|y| (0..400).map(move |x| (x, y))).filter(on)
    };
    // Of the numbers below 40,000 these are among those that are most often a sum of two squares.
    check(&with_corners(circle(27_625), 400, 400));
    check(&with_corners([5525, 27_625, 32_045].into_iter().flat_map(circle), 400, 400));
    let cross = (0..401).flat_map(|i| [(i, 200), (200, i), (i, i), (i, 400 - i)]);
    check(&with_corners(cross, 401, 401));
    let parabola = (0..300).map(|x| (x, x * x));
    check(&with_corners(parabola, 300, 90_001));
    check(&with_corners((0..300).map(|y| (y * y, y)), 90_001, 300));
    check(&bottom_and_side(40));
    check(&far_rows(60));
}

#[test]
fn points_without_a_rectangle_cover_their_hull() {
    let points = [(5, 1), (1, 2), (9, 4), (5, 5), (2, 9)];
    let mut points = points.map(|(x, y)| Point::new(x, y)).to_vec();
    points.sort_unstable();
    assert_eq!(rectangle_area(&points, &()).unwrap(), None);
    check(&points);
    let numbers: Vec<i32> = noise(800).collect();
    let disc = numbers.chunks_exact(2).map(|n| (n[0] % 101 - 50, n[1] % 101 - 50));
    let disc: BTreeSet<Point> = disc
        .filter(|(x, y)| x * x + y * y <= 2500)
        .map(|(x, y)| Point::new(x + 60, y + 70))
        .collect();
    check(&disc.into_iter().collect::<Vec<_>>());
    for line in [[(0, 0); 0].as_slice(), &[(3, 4)], &[(0, 0), (9, 9)], &[(0, 1), (3, 3), (6, 5)]] {
        let line: Vec<Point> = line.iter().map(|&(x, y)| Point::new(x, y)).collect();
        assert_eq!(triangulate(&line), [[0; 3]; 0]);
    }
}

#[test]
fn first_of_equal_points_is_the_vertex() {
    let points = [(0, 0), (3, 0), (0, 0), (3, 3), (0, 3), (3, 0)].map(|(x, y)| Point::new(x, y));
    assert_eq!(triangulate(&points), [[0, 1, 3], [0, 3, 4]]);
}

#[test]
fn points_out_of_range_have_no_faces() {
    let far = 1 + MAX_SIDE as i32;
    let square = [(0, 0), (3, 0), (3, 3), (0, 3), (far, 1), (1, -far), (i32::MIN, i32::MAX)];
    assert_eq!(triangulate(&square.map(|(x, y)| Point::new(x, y))), [[0, 1, 2], [0, 2, 3]]);
    let widest = [(1 - far, 1 - far), (far - 1, 1 - far), (0, far - 1)];
    assert_eq!(triangulate(&widest.map(|(x, y)| Point::new(x, y))), [[0, 1, 2]]);
}

#[test]
fn too_many_flips_end_the_sweep() {
    let points = far_rows(300);
    assert!(swept(&points).is_none());
    Triangulation::new(points, &()).unwrap().assert_preferred();
}

#[test]
fn hardest_points_take_no_quadratic_time() {
    let (long, thick) = (1 << 17, 1 << 12);
    let start = Instant::now();
    for points in [
        with_corners((0..long).map(|x| (x, 1)), long, 3),
        with_corners((0..long).map(|y| (1, y)), 3, long),
        with_corners((0..thick).map(|i| (i, i)), thick, thick),
        with_corners((0..thick).map(|i| (i, thick - 1 - i)), thick, thick),
        with_corners((0..1000).map(|i| (i, i * i)), 1000, 1_000_000),
        with_corners((0..1000).map(|i| (1000 * 1000 - i * i, i)), 1_000_001, 1000),
        bottom_and_side(30_000),
        far_rows(60_000),
    ] {
        Triangulation::new(points, &()).unwrap().assert_preferred();
    }
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 30.0, "{seconds} s");
}

/// The points that each way reports as done, polled with a control of its own.
fn reports_of_all_ways(points: &[Point]) -> [Vec<usize>; 3] {
    let recorders: [Recorder; 3] = Default::default();
    let [sweep, halves, faces] = &recorders;
    sweep::triangulate(points, sweep).unwrap().unwrap();
    divide_and_conquer::triangulate(points, halves).unwrap();
    merged(points).faces(faces).unwrap();
    recorders.map(|recorder| recorder.done(Stage::Triangulate, points.len()))
}

#[test]
fn polls_are_frequent_and_report_progress() {
    let points = random(20_000, 512, 512);
    let [sweep, halves, faces] = reports_of_all_ways(&points);
    for done in [sweep, halves] {
        assert!(done.is_sorted() && done[0] < 10, "{done:?}");
        let leaps = done.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(leaps.max() <= Some(2 * POINTS_PER_POLL / STEPS_PER_POINT), "{done:?}");
        let last = done[done.len() - 1];
        assert!((points.len() * 9 / 10..=points.len()).contains(&last), "{last}");
    }
    // Two passes over the points and two over the faces, of which there are twice as many.
    assert!(faces.len() >= 6 * points.len() / POINTS_PER_POLL - 1, "{faces:?}");
}

#[test]
fn polls_are_frequent_in_a_full_grid() {
    for (width, height) in [(400_000, 2), (2, 400_000), (600, 600)] {
        let all = (0..height).flat_map(|y| (0..width).map(move |x| Point::new(x, y)));
        let points: Vec<Point> = all.collect();
        let (count, recorder) = (points.len(), Recorder::default());
        Triangulation::new(points, &recorder).unwrap();
        let polls = recorder.reports().len();
        // A pass over the points, and one over the squares between them.
        let squares = (width as usize - 1) * (height as usize - 1);
        assert!(polls > (count + squares) / POINTS_PER_POLL, "{polls}");
    }
}

#[test]
fn all_ways_can_be_cancelled_at_any_poll() {
    let points = random(20_000, 512, 512);
    for poll in [0, 5, 11] {
        let control = || Recorder::cancelling_at(poll);
        assert_eq!(sweep::triangulate(&points, &control()), Err(Cancelled));
        assert_eq!(divide_and_conquer::triangulate(&points, &control()), Err(Cancelled));
        assert_eq!(Triangulation::new(points.clone(), &control()), Err(Cancelled));
    }
    let triangulation = Triangulation::new(points, &()).unwrap();
    assert_eq!(triangulation.faces(&Recorder::cancelling_at(1)), Err(Cancelled));
}

proptest! {
    #[test]
    fn points_of_a_small_lattice_match_spade(
        width in 2..12i32,
        height in 2..12i32,
        coordinates in prop::collection::vec((0..12i32, 0..12i32), 0..100),
        has_corners in any::<bool>(),
    ) {
        let inside = coordinates.into_iter().filter(|&(x, y)| x < width && y < height);
        if has_corners {
            check(&with_corners(inside, width, height));
        } else {
            let points: BTreeSet<Point> = inside.map(|(x, y)| Point::new(x, y)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            // spade makes edges without faces of collinear points.
            let is_collinear = points.windows(3).all(|p| orientation(p[0], p[1], p[2]) == 0);
            if points.len() > 2 && !is_collinear {
                check(&points);
            }
        }
    }
}
