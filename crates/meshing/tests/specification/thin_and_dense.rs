//! Shapes that make naive algorithms quadratic finish in time: long rows of collinear points, full
//! lattices of cocircular ones, vertices with thousands of neighbours.
//!
//! The bounds are far above what the crate takes, and far below what a quadratic algorithm would.

use crate::pictures::{gray, noise};
use pixmesh_meshing::parameters::Generator;
use pixmesh_meshing::{
    Approximation, Cancelled, Control, Image, Method, Parameters, Point, Stage, Target, mesh_image,
    triangulate,
};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// More time than any of these tests takes.
const LONG: Duration = Duration::from_secs(60);

/// The longest time from a cancellation to the return of the call.
const DEAF: Duration = Duration::from_secs(1);

/// Cancels a call that takes too long and records the longest time between two polls.
struct Watch {
    start: Instant,
    /// The last poll and the longest time before any.
    polls: Mutex<(Instant, Duration)>,
}

impl Watch {
    fn new() -> Self {
        let start = Instant::now();
        Self { start, polls: Mutex::new((start, Duration::ZERO)) }
    }

    fn longest_silence(&self) -> Duration {
        let (last, longest) = *self.polls.lock().unwrap();
        longest.max(last.elapsed())
    }
}

impl Control for Watch {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        let mut polls = self.polls.lock().unwrap();
        *polls = (Instant::now(), polls.1.max(polls.0.elapsed()));
        if self.start.elapsed() < LONG { Ok(()) } else { Err(Cancelled) }
    }
}

/// Counts the polls of the triangulation.
#[derive(Default)]
struct TriangulationPolls(AtomicUsize);

impl Control for TriangulationPolls {
    fn poll(&self, stage: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        self.0.fetch_add(usize::from(stage == Stage::Triangulate), Ordering::Relaxed);
        Ok(())
    }
}

/// Makes a mesh and checks its time and the time between its polls.
fn meshed_soon(name: &str, image: &Image, parameters: &Parameters) -> Approximation {
    // Other work on the machine may delay one attempt.
    for _ in 0..3 {
        let watch = Watch::new();
        let made = mesh_image(image, parameters, &watch);
        let silence = watch.longest_silence();
        report(&format!("{name}, silent for {silence:.2?}"), watch.start);
        let made = made.unwrap_or_else(|error| panic!("{name}: {error} after {LONG:?}"));
        assert_eq!(made.mesh.validate(), Ok(()), "{name}");
        if silence < DEAF {
            return made;
        }
    }
    panic!("{name}: no poll for {DEAF:?}");
}

/// Prints how long something took (shown with `--nocapture`).
#[allow(clippy::print_stderr)]
fn report(name: &str, start: Instant) {
    eprintln!("{:8.2?} {name}", start.elapsed());
}

/// A line of bright noise in the middle row of a picture 3 high.
fn middle_row(width: usize) -> Image {
    gray(width, 3, |x, y| if y == 1 { noise(x, 7) } else { 0 })
}

#[test]
fn triangulates_long_row_in_time() {
    for transposed in [false, true] {
        let point = |along: i32, across: i32| {
            if transposed { Point::new(across, along) } else { Point::new(along, across) }
        };
        let last = (1 << 14) - 1;
        let mut points: Vec<Point> = (0..=last).map(|along| point(along, 1)).collect();
        points.extend([point(0, 0), point(last, 0), point(0, 2), point(last, 2)]);
        points.sort_unstable();
        let start = Instant::now();
        let faces = triangulate(&points);
        report("16384 points of one line", start);
        assert!(start.elapsed() < LONG);
        // The ends of the line lie on the border, with the corners.
        assert_eq!(faces.len(), 2 * points.len() - 2 - 6);
    }
}

#[test]
fn meshes_three_rows_in_time() {
    let picture = middle_row(16_384);
    for (method, density) in [(Method::Med, 20.0), (Method::Mgprfs, 2.0), (Method::Mgprfs, 20.0)] {
        let name = format!("{method} of 16384x3 at {density} %");
        meshed_soon(&name, &picture, &method.parameters(Target::Percent(density)));
    }
}

#[test]
fn removes_all_points_of_three_rows_in_time() {
    let strips = [("a line in 4096x3", middle_row(4096)), ("flat 4096x3", gray(4096, 3, |_, _| 9))];
    for (name, picture) in strips {
        for size in [4, 100] {
            let parameters = Method::Gpr.parameters(Target::Size(size));
            meshed_soon(&format!("{name} to {size} points"), &picture, &parameters);
        }
    }
}

/// A page of one colour with a dot in the middle.
fn page(side: usize) -> Image {
    gray(side, side, |x, y| if (x, y) == (side / 2, side / 2) { 255 } else { 240 })
}

#[test]
fn meshes_page_with_one_dot_in_time() {
    for target in [Target::Percent(1.0), Target::Psnr(70.0)] {
        let made = meshed_soon("a page of 800x800", &page(800), &Method::Gpr.parameters(target));
        assert!(made.fidelity.psnr_db() >= 70.0);
    }
}

#[test]
fn meshes_full_lattice_in_time() {
    let checkerboard = gray(128, 128, |x, y| ((x + y) % 2) as u16 * 255);
    let noisy = gray(128, 128, noise);
    for (name, picture) in [("a checkerboard", checkerboard), ("noise", noisy)] {
        for method in [Method::Med, Method::Mgprfs, Method::Mgpr] {
            for density in [100.0, 10.0, 1.0] {
                let parameters = method.parameters(Target::Percent(density));
                let name = format!("{method} of {name} at {density} %");
                meshed_soon(&name, &picture, &parameters);
            }
        }
    }
}

#[test]
fn triangulation_polls_throughout() {
    // With 131,072 points a cancellation must take effect before the end.
    let polls = TriangulationPolls::default();
    let parameters = Method::Med.parameters(Target::Percent(50.0));
    mesh_image(&gray(512, 512, noise), &parameters, &polls).unwrap();
    let count = polls.0.into_inner();
    assert!(count >= 10, "{count} polls");
}

#[test]
fn meshes_regular_grid_in_time() {
    let own = Method::Mgprfs.parameters(Target::Percent(2.0));
    let parameters = own.generator(Generator::Uniform);
    meshed_soon("a regular grid on 256x256", &gray(256, 256, noise), &parameters);
}
