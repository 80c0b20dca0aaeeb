//! Our stages beside what the best known libraries do in the same time: ratios, in one process.
//!
//! `cargo bench -p pixmesh-meshing --bench comparison -- [PICTURE.png [ROUNDS]]`
//!
//! The yardsticks are the decoding of the picture by the image crate and the triangulation of the
//! same points by spade's bulk loading, and by delaunator. Everything runs once in each round, so
//! that whatever else the machine does meets all alike; the figures are the least of all rounds.
//! Without a picture one is made up, of which only the ratios to spade mean something.

#![allow(clippy::print_stdout, reason = "a program whose result is a table on standard output")]

mod contest;
mod picture;

use contest::{Contest, Yardstick};
use image::{ImageFormat, RgbImage};
use pixmesh_meshing::{
    Image, Method, Parameters, Point, Target, mesh_image, rasterize, sample_points, triangulate,
};
use spade::{DelaunayTriangulation, Point2, Triangulation};
use std::error::Error;
use std::io::Cursor;

type Outcome = Result<(), Box<dyn Error>>;

/// Rounds, unless told.
const ROUNDS: usize = 15;
/// The number of rounds in which the slow full grid runs once.
const ROUNDS_PER_GRID: usize = 5;
/// The side of the picture made up.
const MADE_UP_SIDE: u32 = 512;
/// The density of the meshes in per cent.
const DENSITY: f64 = 2.0;

fn main() -> Outcome {
    // `cargo bench` adds a flag of its own.
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let path = arguments.next();
    let png = match &path {
        Some(path) => std::fs::read(path)?,
        None => encoded(&picture::made_up(MADE_UP_SIDE))?,
    };
    let pixels = image::load_from_memory(&png)?.to_rgb8();
    let pictures = [("gray", picture::gray(&pixels)?), ("colour", picture::colour(&pixels)?)];
    let rounds = arguments.next().map_or(Ok(ROUNDS), |rounds| rounds.parse())?;
    let mut contest = Contest::default();
    for round in 0..rounds {
        contest.time_yardstick(Yardstick::Decode, || Ok(image::load_from_memory(&png)?))?;
        for (colours, image) in &pictures {
            one_shot(colours, image, &mut contest)?;
            simplified(colours, image, &mut contest)?;
            if round % ROUNDS_PER_GRID == 0 {
                from_full_grid(colours, image, &mut contest)?;
            }
        }
    }
    println!("{}, {rounds} rounds\n{contest}", path.as_deref().unwrap_or("a picture made up"));
    Ok(())
}

fn encoded(pixels: &RgbImage) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut png = Cursor::new(Vec::new());
    pixels.write_to(&mut png, ImageFormat::Png)?;
    Ok(png.into_inner())
}

/// MED, and the picture rebuilt from its mesh.
fn one_shot(colours: &str, image: &Image, contest: &mut Contest) -> Outcome {
    let parameters = Method::Med.parameters(Target::Percent(DENSITY));
    let goal = Some(if colours == "gray" { 4.0 } else { 5.0 });
    let title = format!("MED {DENSITY} %, {colours}");
    let model = contest.time_stages(&title, Yardstick::Decode, goal, |clock| {
        Ok(mesh_image(image, &parameters, clock)?)
    })?;
    let goal = Some(if colours == "gray" { 0.5 } else { 1.0 });
    let title = format!("picture rebuilt, {colours}");
    contest.time(&title, Yardstick::Decode, goal, || Ok(rasterize(&model.mesh, &())?))?;
    let points = initial_points(image, &parameters)?;
    compare_triangulations(&format!("MED, {colours}"), &points, Yardstick::OneShotPoints, contest)
}

/// MGPRFS, all stages.
fn simplified(colours: &str, image: &Image, contest: &mut Contest) -> Outcome {
    let parameters = Method::Mgprfs.parameters(Target::Percent(DENSITY));
    let points = initial_points(image, &parameters)?;
    compare_triangulations(
        &format!("MGPRFS, {colours}"),
        &points,
        Yardstick::InitialPoints,
        contest,
    )?;
    let goal = Some(if colours == "gray" { 4.0 } else { 6.0 });
    let title = format!("MGPRFS {DENSITY} %, {colours}");
    contest.time_stages(&title, Yardstick::InitialPoints, goal, |clock| {
        Ok(mesh_image(image, &parameters, clock)?)
    })?;
    Ok(())
}

/// Greedy removal from all points.
fn from_full_grid(colours: &str, image: &Image, contest: &mut Contest) -> Outcome {
    let parameters = Method::Mgpr.parameters(Target::Percent(DENSITY));
    let points = initial_points(image, &parameters)?;
    contest.time_yardstick(Yardstick::FullGrid, || spade_bulk_load(&points))?;
    let goal = Some(if colours == "gray" { 6.0 } else { 9.0 });
    let title = format!("GPR {DENSITY} %, {colours}");
    contest.time_stages(&title, Yardstick::FullGrid, goal, |clock| {
        Ok(mesh_image(image, &parameters, clock)?)
    })?;
    Ok(())
}

fn compare_triangulations(
    title: &str,
    points: &[Point],
    yardstick: Yardstick,
    contest: &mut Contest,
) -> Outcome {
    contest.time_yardstick(yardstick, || spade_bulk_load(points))?;
    let sites: Vec<delaunator::Point> =
        points.iter().map(|p| delaunator::Point { x: p.x.into(), y: p.y.into() }).collect();
    let title = format!("{} points of {title}", points.len());
    contest.time(&format!("delaunator, {title}"), yardstick, None, || {
        Ok(delaunator::triangulate(&sites))
    })?;
    contest.time(&format!("PDDT, {title}"), yardstick, Some(0.6), || Ok(triangulate(points)))?;
    Ok(())
}

fn initial_points(image: &Image, parameters: &Parameters) -> Result<Vec<Point>, Box<dyn Error>> {
    let plan = parameters.plan(image.shape())?;
    Ok(sample_points(image, parameters, plan.initial_size, &())?)
}

fn spade_bulk_load(points: &[Point]) -> Result<DelaunayTriangulation<Point2<f64>>, Box<dyn Error>> {
    let sites = points.iter().map(|p| Point2::new(f64::from(p.x), f64::from(p.y))).collect();
    Ok(DelaunayTriangulation::bulk_load(sites)?)
}
