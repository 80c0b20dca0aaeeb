//! The parts whose instructions are counted, and how one is run.

use crate::{Fallible, picture};
use fearless_simd::Level;
use pixmesh_meshing::{
    Image, Method, Parameters, Point, Target, mesh_image, rasterize, sample_points, triangulate,
};
use std::fmt;
use std::hint::black_box;
use std::process::ExitCode;

/// The side of the picture.
const SIDE: u32 = 256;
/// The density of the meshes in per cent.
const DENSITY: f64 = 2.0;

/// What is counted: a stage of a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    method: Method,
    stage: &'static str,
}

impl Part {
    /// All of them.
    pub(crate) const ALL: [Self; 7] = [
        Self { method: Method::Med, stage: "points" },
        Self { method: Method::Med, stage: "triangulation" },
        Self { method: Method::Med, stage: "mesh_image" },
        Self { method: Method::Mgprfs, stage: "points" },
        Self { method: Method::Mgprfs, stage: "triangulation" },
        Self { method: Method::Mgprfs, stage: "mesh_image" },
        Self { method: Method::Mgprfs, stage: "rasterize" },
    ];

    fn named(name: &str) -> Fallible<Self> {
        let part = Self::ALL.into_iter().find(|part| part.to_string() == name);
        part.ok_or_else(|| format!("no part is named {name}").into())
    }
}

impl fmt::Display for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}/{}", self.method, self.stage)
    }
}

/// Prints the machine as it looks from here, valgrind's emulation, and runs a part, or no part.
pub(crate) fn run(name: &str) -> Fallible<ExitCode> {
    println!("{} {}", std::env::consts::ARCH, level());
    if name == "none" {
        return Ok(ExitCode::SUCCESS);
    }
    let part = Part::named(name)?;
    let image = picture::colour(&picture::made_up(SIDE))?;
    let parameters = part.method.parameters(Target::Percent(DENSITY));
    match part.stage {
        "points" => counted(|| initial_points(&image, &parameters))?,
        "triangulation" => {
            let points = initial_points(&image, &parameters)?;
            counted(|| Ok(triangulate(&points)))?;
        }
        "mesh_image" => counted(|| Ok(mesh_image(&image, &parameters, &())?))?,
        _ => {
            let mesh = mesh_image(&image, &parameters, &())?.mesh;
            counted(|| Ok(rasterize(&mesh, &())?))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn initial_points(image: &Image, parameters: &Parameters) -> Fallible<Vec<Point>> {
    let plan = parameters.plan(image.shape())?;
    Ok(sample_points(image, parameters, plan.initial_size, &())?)
}

/// Runs what is to be counted.
fn counted<T>(work: impl FnOnce() -> Fallible<T>) -> Fallible<()> {
    let mut work = Some(work);
    let mut result = None;
    part_that_is_counted(&mut || result = work.take().map(|work| work()));
    black_box(result.transpose()?);
    Ok(())
}

/// Callgrind counts from the call of this function, which it knows by its name, to its return.
#[inline(never)]
fn part_that_is_counted(work: &mut dyn FnMut()) {
    black_box(work)();
    // Something is left to be done: the call above can't become a jump.
    black_box(());
}

/// The name of the vectors that the kernels choose.
fn level() -> String {
    // Like `Avx2(Avx2 { .. })`.
    let level = format!("{:?}", Level::new());
    level.split(['(', ' ']).next().unwrap_or_default().to_owned()
}
