//! Times of every stage, by size of the picture, number of components and threads.
//!
//! `cargo bench -p pixmesh-meshing --bench stages [-- FILTER]`
//!
//! Short unless told otherwise: `DIVAN_MAX_TIME=10` gives each more seconds.

#![allow(clippy::expect_used, reason = "a benchmark that can't be prepared may end in any way")]

#[path = "comparison/picture.rs"]
mod picture;

use divan::Bencher;
use divan::counter::ItemsCount;
use pixmesh_meshing::parameters::Parallel;
use pixmesh_meshing::{
    Image, Mesh, Method, OnThreads, Parameters, Point, Target, mesh_image, rasterize,
    sample_points, triangulate,
};
use std::fmt;
use std::num::NonZeroUsize;

/// The density of the meshes in per cent.
const DENSITY: f64 = 2.0;

/// Sides of the pictures.
const SIDES: [u32; 3] = [256, 512, 1024];

/// The largest of them that removal from all points is timed on: it takes seconds.
const LARGEST_FULL_GRID: u32 = 512;

/// The side of a picture whose vertices fill many tiles.
const LARGE_SIDE: u32 = 2048;

/// On what a stage runs.
#[derive(Clone, Copy)]
struct Case {
    method: Method,
    side: u32,
    is_colour: bool,
    threads: usize,
}

fn main() {
    divan::main();
}

#[divan::bench(args = cases(&[Method::Med, Method::Mgprfs], &[1, 2]), max_time = 0.5)]
fn points(bencher: Bencher<'_, '_>, case: Case) {
    let image = case.image();
    bencher
        .counter(ItemsCount::new(image.pixel_count()))
        .bench_local(|| case.initial_points(&image));
}

#[divan::bench(args = cases(&[Method::Med, Method::Mgprfs], &[1]), max_time = 0.5)]
fn triangulation(bencher: Bencher<'_, '_>, case: Case) {
    let points = case.initial_points(&case.image());
    bencher.counter(ItemsCount::new(points.len())).bench_local(|| triangulate(&points));
}

#[divan::bench(args = cases(&[Method::Med, Method::Mgprfs, Method::Mgpr], &[1, 2]), max_time = 0.5)]
fn all(bencher: Bencher<'_, '_>, case: Case) {
    let image = case.image();
    bencher.counter(ItemsCount::new(image.pixel_count())).bench_local(|| case.mesh(&image));
}

#[divan::bench(args = cases(&[Method::Mgprfs], &[1, 2]), max_time = 0.5)]
fn rebuilt(bencher: Bencher<'_, '_>, case: Case) {
    let image = case.image();
    let mesh = case.mesh(&image);
    bencher
        .counter(ItemsCount::new(image.pixel_count()))
        .bench_local(|| rasterize(&mesh, &case.control()));
}

/// A first sight shall take less than a tenth of a second at 512 by 512.
#[divan::bench(args = cases(&[Method::Preview], &[1]), max_time = 1.0)]
fn first_sight(bencher: Bencher<'_, '_>, case: Case) {
    let image = case.image();
    bencher.counter(ItemsCount::new(image.pixel_count())).bench_local(|| case.mesh(&image));
}

/// Both orders of removal on a large picture in colour: `src/removal/NOTES.md` compares them.
#[divan::bench(args = orders(), sample_count = 3)]
fn orders_of_removal(bencher: Bencher<'_, '_>, Order { parallel, threads }: Order) {
    let case = Case { method: Method::Mgprfs, side: LARGE_SIDE, is_colour: true, threads };
    let (image, parameters) = (case.image(), case.parameters().parallel(parallel));
    bencher
        .counter(ItemsCount::new(image.pixel_count()))
        .bench_local(|| mesh_image(&image, &parameters, &case.control()));
}

/// An order of removal, and on how many threads.
#[derive(Clone, Copy)]
struct Order {
    parallel: Parallel,
    threads: usize,
}

fn orders() -> Vec<Order> {
    let on = |threads| Parallel::ALL.iter().map(move |&parallel| Order { parallel, threads });
    [1, 2].into_iter().flat_map(on).collect()
}

impl fmt::Display for Order {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}, threads: {}", self.parallel, self.threads)
    }
}

/// The methods in gray and colour, on pictures of all sizes, by number of threads.
fn cases(methods: &[Method], threads: &[usize]) -> Vec<Case> {
    let mut cases = Vec::new();
    for &method in methods {
        let largest = if method == Method::Mgpr { LARGEST_FULL_GRID } else { u32::MAX };
        for side in SIDES.into_iter().filter(|&side| side <= largest) {
            for is_colour in [false, true] {
                cases.extend(threads.iter().map(|&threads| Case {
                    method,
                    side,
                    is_colour,
                    threads,
                }));
            }
        }
    }
    cases
}

impl Case {
    fn image(self) -> Image {
        let pixels = picture::made_up(self.side);
        let image = if self.is_colour { picture::colour(&pixels) } else { picture::gray(&pixels) };
        image.expect("the picture has allowed sides")
    }

    fn parameters(self) -> Parameters {
        self.method.parameters(Target::Percent(DENSITY))
    }

    fn control(self) -> OnThreads<()> {
        OnThreads((), NonZeroUsize::new(self.threads).unwrap_or(NonZeroUsize::MIN))
    }

    fn initial_points(self, image: &Image) -> Vec<Point> {
        let parameters = self.parameters();
        let plan = parameters.plan(image.shape()).expect("the parameters fit the picture");
        sample_points(image, &parameters, plan.initial_size, &self.control())
            .expect("nobody cancels")
    }

    fn mesh(self, image: &Image) -> Mesh {
        mesh_image(image, &self.parameters(), &self.control()).expect("nobody cancels").mesh
    }
}

impl fmt::Display for Case {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { method, side, is_colour, threads } = self;
        let colours = if *is_colour { "colour" } else { "gray" };
        let plural = if *threads == 1 { "" } else { "s" };
        write!(formatter, "{method} {side} {colours}, {threads} thread{plural}")
    }
}
