//! Pictures with few features beside one that is full of them: time, ratio, and time per point.
//!
//! `cargo bench -p pixmesh-meshing --bench flat_pages -- [MGPRFS|MGPR...] [SIDE...]`
//!
//! Each picture is meshed at 2 % on one thread, `ROUNDS` times in turn with the others; times are
//! the least of all rounds. `ratio` compares a picture with the shaded discs of its size, `growth`
//! its time per point with that at the smallest side.

#![allow(clippy::print_stdout, reason = "a program whose result is a table on standard output")]

#[allow(dead_code, reason = "only gray pictures are meshed here")]
#[path = "comparison/picture.rs"]
mod picture;

use pixmesh_meshing::{Image, ImageError, Method, Target, mesh_image};
use std::error::Error;
use std::time::{Duration, Instant};

/// Sides of the square pictures: 1, 4, 7.8 and 16.8 megapixels.
const SIDES: [usize; 4] = [1024, 2048, 2800, 4096];

/// Removal from all points of shaded discs takes minutes beyond this side.
const LARGEST_SIDE_OF_DISCS_FROM_ALL_POINTS: usize = 1024;

const ROUNDS: usize = 3;

/// Vertices in per cent of the points.
const DENSITY: f64 = 2.0;

/// Whether a page is black at a column and a row, for a side.
type IsBlack = fn(usize, usize, usize) -> bool;

/// White pages by name.
const PAGES: [(&str, IsBlack); 4] = [
    ("disc", |x, y, side| {
        (2 * x).abs_diff(side).pow(2) + (2 * y).abs_diff(side).pow(2) < side * side / 4
    }),
    ("word", |x, y, side| {
        let (column, row) = (x * 64 / side, y * 64 / side);
        (24..40).contains(&column) && (30..34).contains(&row) && (column * 7 + row * 5) % 4 < 2
    }),
    ("dot", |x, y, side| (2 * x, 2 * y) == (side, side)),
    ("empty", |_, _, _| false),
];

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` adds a flag of its own.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (sides, methods): (Vec<_>, Vec<_>) =
        arguments.iter().partition(|argument| argument.parse::<usize>().is_ok());
    let sides = match &sides[..] {
        [] => SIDES.to_vec(),
        sides => sides.iter().map(|side| side.parse()).collect::<Result<_, _>>()?,
    };
    for method in [Method::Mgprfs, Method::Mgpr] {
        if methods.is_empty()
            || methods.iter().any(|name| method.to_string().eq_ignore_ascii_case(name))
        {
            compare(method, &sides)?;
        }
    }
    Ok(())
}

/// Prints a row for each picture of each side.
fn compare(method: Method, sides: &[usize]) -> Result<(), Box<dyn Error>> {
    println!(
        "\n{method:<8} {:>5} {:>9} {:>7} {:>9} {:>7}",
        "side", "s", "ratio", "ns/point", "growth"
    );
    let mut smallest = Vec::new();
    for &side in sides {
        let pictures = pictures(method, side)?;
        let times = times(method, &pictures)?;
        let discs = pictures.iter().position(|(name, _)| *name == "discs");
        for (i, ((name, _), time)) in pictures.iter().zip(&times).enumerate() {
            let per_point = time.as_secs_f64() * 1e9 / (side * side) as f64;
            if smallest.len() == i {
                smallest.push(per_point);
            }
            let ratio =
                discs.map_or(f64::NAN, |discs| time.as_secs_f64() / times[discs].as_secs_f64());
            let (seconds, growth) = (time.as_secs_f64(), per_point / smallest[i]);
            println!(
                "{name:<8} {side:>5} {seconds:>9.3} {ratio:>7.2} {per_point:>9.1} {growth:>7.2}"
            );
        }
    }
    Ok(())
}

/// The pages of a side, and shaded discs unless removal takes too long.
fn pictures(method: Method, side: usize) -> Result<Vec<(&'static str, Image)>, ImageError> {
    let page = |is_black: IsBlack| {
        let sample = |i: usize| if is_black(i % side, i / side, side) { 0 } else { 255 };
        Image::from_top_down(side, side, 8, vec![(0..side * side).map(sample).collect()])
    };
    let mut pictures = Vec::new();
    for (name, is_black) in PAGES {
        pictures.push((name, page(is_black)?));
    }
    if method == Method::Mgprfs || side <= LARGEST_SIDE_OF_DISCS_FROM_ALL_POINTS {
        pictures.push(("discs", picture::gray(&picture::made_up(side as u32))?));
    }
    Ok(pictures)
}

/// The least time of each picture.
fn times(method: Method, pictures: &[(&str, Image)]) -> Result<Vec<Duration>, Box<dyn Error>> {
    let mut times = vec![Duration::MAX; pictures.len()];
    for _ in 0..ROUNDS {
        for ((_, picture), least) in pictures.iter().zip(&mut times) {
            let start = Instant::now();
            mesh_image(picture, &method.parameters(Target::Percent(DENSITY)), &())?;
            *least = start.elapsed().min(*least);
        }
    }
    Ok(times)
}
