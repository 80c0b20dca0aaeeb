//! `preview` beside MED at 12 megapixels: the ratio of their times, and the difference in PSNR.
//!
//! `cargo bench -p pixmesh-meshing --bench preview -- [PICTURE...]`
//!
//! Both run in turns on two threads, from the decoded picture to the measured mesh; the times are
//! the least of all rounds. The program fails where a preview is worse than MED or takes longer.
//! Without a picture one is made up.

#![allow(clippy::print_stdout, reason = "a program whose result is a table on standard output")]

#[path = "comparison/picture.rs"]
#[allow(dead_code, reason = "previews are of the picture in colour alone")]
mod picture;

use pixmesh_meshing::{Approximation, Image, Method, OnThreads, Target, mesh_image};
use std::error::Error;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

const ROUNDS: usize = 5;
const THREADS: NonZeroUsize = NonZeroUsize::new(2).unwrap();
/// The side of the picture made up: 12 megapixels.
const MADE_UP_SIDE: u32 = 3464;
/// The densities of the meshes in per cent.
const DENSITIES: [f64; 3] = [0.1, 0.5, 2.0];

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` adds a flag of its own.
    let paths: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let mut pictures = Vec::new();
    for path in &paths {
        pictures.push((path.as_str(), picture::colour(&image::open(path)?.to_rgb8())?));
    }
    if pictures.is_empty() {
        let made_up = picture::colour(&picture::made_up(MADE_UP_SIDE))?;
        pictures.push(("a picture made up", made_up));
    }
    let mut is_within = true;
    for (name, image) in &pictures {
        println!("{name}, {} x {}", image.width(), image.height());
        println!(
            "{:>8} {:>9} {:>11} {:>7} {:>9}",
            "density", "MED, ms", "preview, ms", "ratio", "dB"
        );
        for density in DENSITIES {
            is_within &= compare(image, density)?;
        }
    }
    if is_within { Ok(()) } else { Err("a preview is worse than MED or takes longer".into()) }
}

/// Compares the methods at a density; returns whether the preview is not worse, nor slower.
fn compare(image: &Image, density: f64) -> Result<bool, Box<dyn Error>> {
    let [mut least_med, mut least] = [Duration::MAX; 2];
    let mut gain_db = 0.0;
    for _ in 0..ROUNDS {
        let (of_med, med) = timed(image, Method::Med, density)?;
        let (of_preview, preview) = timed(image, Method::Preview, density)?;
        (least_med, least) = (least_med.min(of_med), least.min(of_preview));
        gain_db = preview.fidelity.psnr_db() - med.fidelity.psnr_db();
    }
    let [med_ms, ms] = [least_med, least].map(|time| time.as_secs_f64() * 1e3);
    println!("{density:>6} % {med_ms:>9.0} {ms:>11.0} {:>7.2} {gain_db:>+9.2}", ms / med_ms);
    Ok(gain_db >= 0.0 && ms <= med_ms)
}

fn timed(
    image: &Image,
    method: Method,
    density: f64,
) -> Result<(Duration, Approximation), Box<dyn Error>> {
    let (control, begun) = (OnThreads((), THREADS), Instant::now());
    let made = mesh_image(image, &method.parameters(Target::Percent(density)), &control)?;
    Ok((begun.elapsed(), made))
}
