//! All ways to triangulate against spade's Delaunay triangulation with the wrong edges flipped, on
//! points from random to as bad as can be.

use super::*;
use crate::control::tests::Recorder;
use crate::image::corner_points;
use crate::triangulation::predicates::{in_circle, orientation};
use proptest::prelude::*;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation as _};
use std::collections::BTreeSet;
use std::time::Instant;

/// A point on its way through spade, with its index.
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

    /// Half-edges pair up, every triangle turns counter-clockwise, no edge is wrong, and the border
    /// is the rectangle's, where there is one.
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
        if rectangle_area(&self.points).is_some() {
            let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
            let sides = (i64::from(last.x - first.x), i64::from(last.y - first.y));
            assert_eq!(double_area, 2 * sides.0 * sides.1);
        }
    }
}

/// The triangulation by sweeping, if that comes to an end.
fn swept(points: &[Point]) -> Option<Triangulation> {
    let (origins, twins) = sweep::triangulate(points, &()).unwrap()?;
    Some(Triangulation { points: points.to_vec(), origins, twins })
}

fn merged(points: &[Point]) -> Triangulation {
    let (origins, twins) = divide_and_conquer::triangulate(points, &()).unwrap();
    Triangulation { points: points.to_vec(), origins, twins }
}

/// All ways give the triangulation of spade.
fn check(points: &[Point]) {
    let expected = Triangulation::by_spade(points.to_vec()).faces();
    let merged = merged(points);
    merged.assert_preferred();
    assert_eq!(merged.faces(), expected);
    if rectangle_area(points).is_some()
        && let Some(swept) = swept(points)
    {
        swept.assert_preferred();
        assert_eq!(swept.faces(), expected);
    }
    let chosen = Triangulation::new(points.to_vec(), &()).unwrap();
    chosen.assert_preferred();
    assert_eq!(chosen.faces(), expected);
}

/// Points and the corners of an image around them, by row, then column.
fn with_corners(
    points: impl IntoIterator<Item = (i32, i32)>,
    width: i32,
    height: i32,
) -> Vec<Point> {
    let inner = points.into_iter().map(|(x, y)| Point::new(x, y));
    let corners = corner_points(width as usize, height as usize);
    inner.chain(corners).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Numbers that look random.
fn noise(count: usize) -> impl Iterator<Item = i32> {
    let step = |state: &u64| Some(state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1));
    std::iter::successors(Some(1), step).skip(1).take(count).map(|state| (state >> 33) as i32)
}

fn random(count: usize, width: i32, height: i32) -> Vec<Point> {
    let numbers: Vec<i32> = noise(2 * count).collect();
    with_corners(numbers.chunks_exact(2).map(|n| (n[0] % width, n[1] % height)), width, height)
}

/// A row at the right of the foot of a tall picture and one at the left of its top: each point of
/// the upper row is nearer to all of the lower row than those before it, and takes their edges.
fn far_rows(count: i32) -> Vec<Point> {
    let lower = (count..2 * count).map(|x| (x, 0));
    with_corners(lower.chain((1..count).map(|x| (x, 6 * count))), 2 * count, 6 * count + 1)
}

/// A column at the left and a row at the right of the foot: each point of the column takes the
/// edges of those below it to all of the row that are far enough.
fn foot_and_side(count: i32) -> Vec<Point> {
    let foot = (count..4 * count).map(|x| (x, 0));
    with_corners((1..count).map(|y| (0, y)).chain(foot), 4 * count, 4 * count)
}

#[test]
fn points_elsewhere_on_the_lattice_are_triangulated_as_where_they_stood() {
    let points = random(60, 40, 30);
    let expected = merged(&points).faces();
    for (dx, dy) in [(-25, -40), (-1000, 7), (300, -9), (5, 5)] {
        let moved: Vec<Point> = points.iter().map(|p| Point::new(p.x + dx, p.y + dy)).collect();
        assert_eq!(swept(&moved).unwrap().faces(), expected);
        assert_eq!(merged(&moved).faces(), expected);
        assert_eq!(Triangulation::new(moved, &()).unwrap().faces(), expected);
    }
}

#[test]
fn a_full_grid_written_down_is_the_one_that_the_other_ways_give() {
    for (width, height) in [(2, 2), (2, 5), (6, 2), (7, 4)] {
        let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let points = with_corners(all, width, height);
        let direct = Triangulation::of_full_grid(points.clone());
        direct.assert_preferred();
        assert_eq!(direct.faces(), Triangulation::new(points.clone(), &()).unwrap().faces());
        assert_eq!(direct.faces(), swept(&points).unwrap().faces());
        assert_eq!(direct.faces(), merged(&points).faces());
        check(&points);
    }
}

#[test]
fn thousands_of_random_points_are_triangulated_as_by_spade() {
    check(&random(5000, 512, 512));
    check(&random(5000, 80, 80));
    check(&random(3000, 1 << 20, 1 << 20));
    check(&random(3000, 1 << 20, 3));
    check(&random(3000, 3, 1 << 20));
}

#[test]
fn clusters_far_from_each_other_are_triangulated_as_by_spade() {
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
fn points_on_few_circles_and_lines_are_triangulated_as_by_spade() {
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
    check(&foot_and_side(40));
    check(&far_rows(60));
}

#[test]
fn points_in_no_rectangle_have_the_triangles_of_their_hull() {
    let places = [(5, 1), (1, 2), (9, 4), (5, 5), (2, 9)];
    let mut points = places.map(|(x, y)| Point::new(x, y)).to_vec();
    points.sort_unstable();
    assert_eq!(rectangle_area(&points), None);
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
fn of_points_at_one_place_the_first_is_taken() {
    let points = [(0, 0), (3, 0), (0, 0), (3, 3), (0, 3), (3, 0)].map(|(x, y)| Point::new(x, y));
    assert_eq!(triangulate(&points), [[0, 1, 3], [0, 3, 4]]);
}

#[test]
fn a_sweep_that_would_take_too_many_flips_gives_way() {
    let points = far_rows(300);
    assert!(swept(&points).is_none());
    Triangulation::new(points, &()).unwrap().assert_preferred();
}

#[test]
fn the_worst_places_for_points_take_no_longer_than_others() {
    let (long, thick) = (1 << 17, 1 << 12);
    let start = Instant::now();
    for points in [
        with_corners((0..long).map(|x| (x, 1)), long, 3),
        with_corners((0..long).map(|y| (1, y)), 3, long),
        with_corners((0..thick).map(|i| (i, i)), thick, thick),
        with_corners((0..thick).map(|i| (i, thick - 1 - i)), thick, thick),
        with_corners((0..1000).map(|i| (i, i * i)), 1000, 1_000_000),
        with_corners((0..1000).map(|i| (1000 * 1000 - i * i, i)), 1_000_001, 1000),
        foot_and_side(30_000),
        far_rows(60_000),
    ] {
        Triangulation::new(points, &()).unwrap().assert_preferred();
    }
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 30.0, "{seconds} s");
}

#[test]
fn the_control_is_told_of_the_points_every_thousand_steps_or_so() {
    let points = random(20_000, 512, 512);
    let (sweeping, merging) = (Recorder::default(), Recorder::default());
    sweep::triangulate(&points, &sweeping).unwrap().unwrap();
    divide_and_conquer::triangulate(&points, &merging).unwrap();
    for recorder in [sweeping, merging] {
        let done = recorder.done(Stage::Triangulate, points.len());
        // A few steps are made for each point.
        let least = points.len() / POINTS_PER_POLL;
        assert!((least..20 * least).contains(&done.len()), "{} times", done.len());
        assert!(done.is_sorted() && done[0] < points.len() / 10);
        let last = done[done.len() - 1];
        assert!((points.len() * 9 / 10..=points.len()).contains(&last), "{last}");
        let leaps = done.windows(2).filter(|pair| pair[1] - pair[0] > 2 * POINTS_PER_POLL);
        assert_eq!(leaps.count(), 0, "{done:?}");
    }
}

/// Cancels at the poll with this number.
struct CancelAt(std::sync::atomic::AtomicUsize);

impl Control for CancelAt {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        match self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) {
            0 => Err(Cancelled),
            _ => Ok(()),
        }
    }
}

#[test]
fn both_ways_can_be_cancelled_in_the_middle() {
    let points = random(20_000, 512, 512);
    let control = || CancelAt(5.into());
    assert_eq!(sweep::triangulate(&points, &control()), Err(Cancelled));
    assert_eq!(divide_and_conquer::triangulate(&points, &control()), Err(Cancelled));
}

proptest! {
    #[test]
    fn any_points_of_a_small_lattice_are_triangulated_as_by_spade(
        width in 2..12i32,
        height in 2..12i32,
        places in prop::collection::vec((0..12i32, 0..12i32), 0..100),
        has_corners in any::<bool>(),
    ) {
        let inside = places.into_iter().filter(|&(x, y)| x < width && y < height);
        if has_corners {
            check(&with_corners(inside, width, height));
        } else {
            let points: BTreeSet<Point> = inside.map(|(x, y)| Point::new(x, y)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let is_flat = |a: Point| points.iter().all(|&b| points.iter().all(|&c| orientation(a, b, c) == 0));
            // spade takes collinear points for edges without faces, and has no fewer than 2.
            if points.len() > 2 && !points.iter().all(|&a| is_flat(a)) {
                check(&points);
            }
        }
    }
}
