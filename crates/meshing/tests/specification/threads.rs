//! Several threads: the same models as one, and a prompt end when cancelled.
//!
//! The pictures are large enough for work to be shared: removals are from 30,000 vertices on, rows
//! by the hundred, faces and vertices by the thousand.

use crate::pictures::{image, noise};
use pixmesh_meshing::parameters::{ErrorMetric, Parallel, Policy};
use pixmesh_meshing::{
    Approximation, Cancelled, Control, Image, MeshingError, Method, OnThreads, Parameters, Stage,
    Target, mesh_image, rasterize,
};
use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const WIDTH: usize = 128;
const HEIGHT: usize = 400;

/// Numbers of threads, those beside 1.
const THREADS: [usize; 3] = [2, 3, 8];

/// Discs with noise: some areas of one colour, edges, and noise where every point matters.
fn picture(component_count: usize) -> Image {
    let component = |c: usize| {
        let sample = |i: usize| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let disc = (x as i32 % 40 - 20).pow(2) + (y as i32 % 50 - 25).pow(2) < 250;
            let grain = if x < WIDTH / 2 { noise(x + 7 * c, y) % 16 } else { 0 };
            40 * c as u16 + grain + if disc { 90 } else { (y / 8) as u16 }
        };
        (0..WIDTH * HEIGHT).map(sample).collect()
    };
    image(WIDTH, HEIGHT, 8, (0..component_count).map(component).collect())
}

fn on_threads<C>(control: C, threads: usize) -> OnThreads<C> {
    OnThreads(control, NonZeroUsize::new(threads).unwrap())
}

fn model_on(threads: usize, picture: &Image, parameters: &Parameters) -> Approximation {
    mesh_image(picture, &parameters.clone().lists_removals(true), &on_threads((), threads)).unwrap()
}

fn assert_same_on_all(picture: &Image, parameters: &Parameters, title: &str) -> Approximation {
    let expected = model_on(1, picture, parameters);
    for threads in THREADS {
        // Not `assert_eq`, which would print both meshes.
        let made = model_on(threads, picture, parameters);
        assert!(made == expected, "{title} on {threads} threads");
    }
    expected
}

/// Allows one, two and three threads in turns.
#[derive(Default)]
struct MoreAndLess(AtomicUsize);

impl Control for MoreAndLess {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        Ok(())
    }

    fn threads(&self) -> NonZeroUsize {
        NonZeroUsize::MIN.saturating_add(self.0.fetch_add(1, Ordering::Relaxed) % 3)
    }
}

#[test]
fn changing_thread_count_keeps_result() {
    let picture = picture(3);
    let tiles = |own: Parameters| own.parallel(Parallel::Tiles);
    for parameters in [
        Method::Med.parameters(Target::Percent(10.0)),
        Method::Mgprfs.parameters(Target::Percent(18.0)),
        tiles(Method::Mgprfs.parameters(Target::Percent(18.0))),
        Method::Optimal.parameters(Target::Percent(6.0)).effort(2),
    ] {
        let parameters = parameters.lists_removals(true);
        let expected = model_on(1, &picture, &parameters);
        for seed in 0..3 {
            let control = MoreAndLess(AtomicUsize::new(seed));
            assert!(mesh_image(&picture, &parameters, &control).unwrap() == expected);
            assert!(control.0.into_inner() > seed + 3, "it was asked");
        }
    }
}

#[test]
fn gpr_is_independent_of_threads() {
    for component_count in [1, 3] {
        let parameters = Method::Mgpr.parameters(Target::Percent(50.0));
        let title = format!("MGPR of {component_count} components");
        let model = assert_same_on_all(&picture(component_count), &parameters, &title);
        assert_eq!(model.plan.initial_size, WIDTH * HEIGHT);
        assert_eq!(model.mesh.points().len(), WIDTH * HEIGHT / 2);
    }
}

#[test]
fn gprfsed_is_independent_of_threads() {
    use Policy::{PsaL, PsbD, Psc, PsdAvgL, PsdMaxD, PseD};
    for (component_count, policy) in
        [(1, PsaL), (2, PsdAvgL), (3, PsbD), (3, Psc), (4, PsdMaxD), (4, PseD)]
    {
        // 4 times 18 % is more than 30,000 points.
        let own = Method::Mgprfs.parameters(Target::Percent(18.0));
        let parameters = own.policy(policy);
        let title = format!("MGPRFS of {component_count} components by {policy}");
        let model = assert_same_on_all(&picture(component_count), &parameters, &title);
        assert!(model.removals.len() + model.mesh.points().len() > 32_000, "{title}");
    }
}

#[test]
fn bounds_and_metrics_are_independent_of_threads() {
    let picture = picture(3);
    let of = |target, error_metric, bad_point_removal| {
        let own = Method::Mgpr.parameters(target);
        own.error_metric(error_metric).bad_point_removal(bad_point_removal)
    };
    let mut sets: Vec<Parameters> = ErrorMetric::ALL
        .iter()
        .map(|&metric| of(Target::Percent(60.0), metric, metric == ErrorMetric::VecSe))
        .collect();
    sets.push(of(Target::Psnr(45.0), ErrorMetric::MeanCompSe, false));
    for parameters in sets {
        let expected = model_on(1, &picture, &parameters);
        assert!(!expected.removals.is_empty());
        let made = model_on(3, &picture, &parameters);
        assert!(made == expected, "{} to {:?}", parameters.error_metric, parameters.target);
    }
}

#[test]
fn tiles_are_independent_of_threads_and_cost_little() {
    for (method, density) in [(Method::Mgprfs, 18.0), (Method::Mgpr, 3.0)] {
        let own = method.parameters(Target::Percent(density));
        let tiles = own.clone().parallel(Parallel::Tiles);
        let model = assert_same_on_all(&picture(3), &tiles, &format!("tiles of {method}"));
        let exact = model_on(1, &picture(3), &own);
        assert_eq!(model.mesh.points().len(), exact.mesh.points().len());
        assert!(model.mesh != exact.mesh, "there are several tiles");
        let (psnr_db, exact_db) = (model.fidelity.psnr_db(), exact.fidelity.psnr_db());
        assert!(psnr_db > exact_db - 0.06, "{method}: {psnr_db} and {exact_db} dB");
    }
}

#[test]
fn tiles_are_exact_for_bounds_and_small_meshes() {
    let picture = picture(1);
    let few = Method::Mgprfs.parameters(Target::Percent(1.5));
    let quality = Method::Mgpr.parameters(Target::Psnr(40.0));
    for own in [few, quality] {
        let tiles = own.clone().parallel(Parallel::Tiles);
        let (tiled, exact) = (model_on(2, &picture, &tiles), model_on(2, &picture, &own));
        assert!(tiled == exact, "{:?}", own.target);
    }
}

#[test]
fn one_shot_methods_are_independent_of_threads() {
    for component_count in [1, 3, 4] {
        let parameters = Method::Med.parameters(Target::Percent(30.0));
        let title = format!("MED of {component_count} components");
        let mesh = assert_same_on_all(&picture(component_count), &parameters, &title).mesh;
        let expected = rasterize(&mesh, &()).unwrap();
        for threads in THREADS {
            let rebuilt = rasterize(&mesh, &on_threads((), threads)).unwrap();
            assert!(rebuilt == expected, "{title} on {threads} threads");
        }
    }
}

#[test]
fn previews_of_large_pictures_are_independent_of_threads() {
    let (width, height) = (1200, 900);
    let sample = |i: usize| noise(i % width / 3, i / width / 5) % 64 + (i / width / 8) as u16;
    let picture = image(width, height, 8, vec![(0..width * height).map(sample).collect()]);
    for density in [0.1, 2.0, 5.0] {
        let parameters = Method::Preview.parameters(Target::Percent(density));
        let expected = model_on(1, &picture, &parameters);
        for threads in [2, 5] {
            let made = model_on(threads, &picture, &parameters);
            assert!(made == expected, "{density} % on {threads} threads");
        }
    }
}

/// A control that cancels from a given step of a stage on, and records when.
struct CancelAt {
    stage: Stage,
    done: usize,
    said: Mutex<Vec<Instant>>,
}

impl Control for CancelAt {
    fn poll(&self, stage: Stage, done: usize, _: usize) -> Result<(), Cancelled> {
        if stage != self.stage || done < self.done {
            return Ok(());
        }
        self.said.lock().unwrap().push(Instant::now());
        Err(Cancelled)
    }
}

#[test]
fn cancels_promptly_on_several_threads() {
    let picture = picture(3);
    let parameters = Method::Mgpr.parameters(Target::Percent(10.0));
    let diffused = Method::Mgprfs.parameters(Target::Percent(18.0));
    let tiles = parameters.clone().parallel(Parallel::Tiles);
    // 5000 removals later there are still enough vertices for threads.
    let moments = [
        (&diffused, Stage::Density, 150),
        (&diffused, Stage::Diffuse, 1),
        (&parameters, Stage::Simplify, 0),
        (&parameters, Stage::Simplify, 5000),
        (&tiles, Stage::Simplify, 5000),
    ];
    for (parameters, stage, done) in moments {
        for threads in THREADS {
            let end = || {
                let control = CancelAt { stage, done, said: Mutex::default() };
                let made = mesh_image(&picture, parameters, &on_threads(&control, threads));
                let ended = Instant::now();
                assert_eq!(made, Err(MeshingError::Cancelled(Cancelled)), "{stage} {done}");
                let said = control.said.into_inner().unwrap();
                assert_eq!(said.len(), 1, "nothing is asked after a cancellation");
                ended - said[0]
            };
            // The whole run takes seconds in this build; other work may delay one attempt.
            let is_prompt = (0..5).any(|_| end() < Duration::from_millis(500));
            assert!(is_prompt, "{stage} {done}");
        }
    }
}
