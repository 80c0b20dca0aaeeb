//! How soon a call hears of a cancellation: the longest CPU time of a thread between two polls.
//!
//! `cargo bench -p pixmesh-meshing --bench cancellation -- [CALL...]`, where `CALL` is a name of
//! `CALLS`
//!
//! Each call meshes a colour picture of 24 megapixels on one thread. The program fails when a call
//! does not poll for `BOUND_MS`. CPU time leaves out what the thread waits for the processor, but
//! giving memory back to the system takes longer on a busy machine.

#![allow(clippy::print_stdout, reason = "a program whose result is a table on standard output")]

use pixmesh_meshing::parameters::{Connectivity, Reconstruction, Values};
use pixmesh_meshing::{
    Cancelled, Control, Image, ImageError, Method, Parameters, Stage, Target, mesh_image,
};
use rustix::time::{ClockId, clock_gettime};
use std::error::Error;
use std::sync::{Mutex, PoisonError};

const WIDTH: usize = 6000;
const HEIGHT: usize = 4000;
const BOUND_MS: f64 = 20.0;

type Call = (&'static str, fn() -> Parameters);

const CALLS: [Call; 12] = [
    ("few-vertices", few_vertices),
    ("effort-1", || few_vertices().effort(1)),
    ("effort-4", || Method::Mgprfs.parameters(Target::Size(120)).effort(4)),
    ("default", || Method::Mgprfs.parameters(Target::Percent(2.0))),
    ("removal-from-40-percent", || Method::Mgprfs.parameters(Target::Percent(10.0))),
    ("preview", || Method::Preview.parameters(Target::Percent(2.0))),
    ("preview-of-few-vertices", || Method::Preview.parameters(Target::Size(24))),
    ("half-of-the-points", || Method::Med.parameters(Target::Percent(50.0))),
    ("flat", || few_vertices().effort(1).reconstruction(Reconstruction::Flat)),
    ("fitted", || few_vertices().effort(1).values(Values::Fitted)),
    ("free", || few_vertices().effort(1).connectivity(Connectivity::Free)),
    ("max-error", || Method::Med.parameters(Target::MaxError(90))),
];

/// The fewest vertices have the largest faces.
fn few_vertices() -> Parameters {
    Method::Med.parameters(Target::Size(24))
}

/// The CPU time of the last poll, and the longest from one poll to the next, in milliseconds.
struct Gaps(Mutex<State>);

struct State {
    last: f64,
    stage: Stage,
    longest: f64,
    stages: (Stage, Stage),
}

impl Gaps {
    fn new() -> Self {
        let stage = Stage::Density;
        let state = State { last: cpu_ms(), stage, longest: 0.0, stages: (stage, stage) };
        Self(Mutex::new(state))
    }

    fn record(&self, stage: Stage) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = cpu_ms();
        if now - state.last > state.longest {
            (state.longest, state.stages) = (now - state.last, (state.stage, stage));
        }
        (state.last, state.stage) = (now, stage);
    }
}

impl Control for Gaps {
    fn poll(&self, stage: Stage, _done: usize, _total: usize) -> Result<(), Cancelled> {
        self.record(stage);
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` adds a flag of its own.
    let names: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let image = picture()?;
    println!("{:<24} {:>8} {:>8}  between", "call", "s", "gap, ms");
    let mut is_within = true;
    for (name, parameters) in CALLS {
        if !names.is_empty() && !names.iter().any(|n| n == name) {
            continue;
        }
        let (start, gaps) = (cpu_ms(), Gaps::new());
        mesh_image(&image, &parameters(), &gaps)?;
        let seconds = (cpu_ms() - start) / 1e3;
        let state = gaps.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let (longest, (before, after)) = (state.longest, state.stages);
        println!("{name:<24} {seconds:>8.1} {longest:>8.1}  {before:?} and {after:?}");
        is_within &= longest <= BOUND_MS;
    }
    if is_within { Ok(()) } else { Err(format!("a call polls later than {BOUND_MS} ms").into()) }
}

/// Waves with noise, so that all densities have points everywhere.
fn picture() -> Result<Image, ImageError> {
    let component = |c: usize| {
        let sample = |i: usize| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let wave = (x as f64 / (13.0 + c as f64)).sin() * (y as f64 / 17.0).cos();
            let noise = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503 + c)) >> 7 & 15;
            (wave * 90.0 + 128.0) as u16 + noise as u16
        };
        (0..WIDTH * HEIGHT).map(sample).collect()
    };
    Image::from_top_down(WIDTH, HEIGHT, 8, (0..3).map(component).collect())
}

fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}
