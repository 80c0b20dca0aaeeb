//! What refinement gains over MGPRFS, and its time beside that of MGPRFS.
//!
//! `cargo bench -p pixmesh-meshing --bench refinement -- [PICTURE...] [--densities 0.5,1,2,3,4]
//! [--efforts 1,2,3] [--threads 1,2] [--rounds 3]`
//!
//! MGPRFS and `optimal` with each effort run in turns in one process, the whole once in each round;
//! times are the least of all rounds. An effort's time is that of the whole run less that of MGPRFS
//! on as many threads, as a part of the latter. Pictures are PNGs and JPEGs; without one it is made
//! up.

#![allow(clippy::print_stdout, reason = "a program whose result is a table on standard output")]

#[path = "comparison/picture.rs"]
mod picture;

use image::DynamicImage;
use pixmesh_meshing::{Image, Method, OnThreads, Target, mesh_image};
use std::error::Error;
use std::num::NonZeroUsize;
use std::str::FromStr;
use std::time::Instant;

/// The side of the picture made up.
const MADE_UP_SIDE: u32 = 512;

/// What is measured.
struct Choice {
    densities: Vec<f64>,
    efforts: Vec<u8>,
    threads: Vec<NonZeroUsize>,
    rounds: usize,
    pictures: Vec<String>,
}

/// What came of one picture at one density.
struct Measured {
    /// The PSNR of MGPRFS.
    plain: f64,
    /// What each effort gains.
    gains: Vec<f64>,
    /// For each number of threads.
    times: Vec<Times>,
}

/// The least seconds of MGPRFS and of each effort on one number of threads.
struct Times {
    plain: f64,
    refined: Vec<f64>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let choice = choice(std::env::args().skip(1))?;
    let pictures = match &choice.pictures[..] {
        [] => {
            let pixels = picture::made_up(MADE_UP_SIDE);
            let (gray, colour) = (picture::gray(&pixels)?, picture::colour(&pixels)?);
            vec![("made up, gray".into(), gray), ("made up, colour".into(), colour)]
        }
        paths => paths.iter().map(|path| read(path)).collect::<Result<_, _>>()?,
    };
    let threads = choice.threads.iter().map(|t| format!("{t:>8} thr.")).collect::<String>();
    println!("{:<32} {:>5} {:>6} {:>8} {:>8}{threads}", "picture", "%", "effort", "dB", "gain, dB");
    let mut sums: Vec<Times> = choice.threads.iter().map(|_| choice.no_times(0.0)).collect();
    let mut gains = vec![Vec::new(); choice.efforts.len()];
    for (name, image) in &pictures {
        for &density in &choice.densities {
            let Measured { plain, gains: gained, times } = measure(image, density, &choice)?;
            for (e, (&effort, gain)) in choice.efforts.iter().zip(gained).enumerate() {
                let beside = beside(&times, e);
                let psnr = plain + gain;
                println!("{name:<32} {density:>5} {effort:>6} {psnr:>8.2} {gain:>8.3}{beside}");
                gains[e].push(gain);
            }
            for (sum, times) in sums.iter_mut().zip(times) {
                sum.plain += times.plain;
                sum.refined.iter_mut().zip(times.refined).for_each(|(sum, time)| *sum += time);
            }
        }
    }
    for (e, (effort, gains)) in choice.efforts.iter().zip(gains).enumerate() {
        let mean = gains.iter().sum::<f64>() / gains.len() as f64;
        let least = gains.iter().copied().fold(f64::INFINITY, f64::min);
        let enough = gains.iter().filter(|gain| **gain >= 1.0).count();
        let (count, beside) = (gains.len(), beside(&sums, e));
        println!(
            "effort {effort}: {enough} of {count} gain 1 dB or more, {mean:.3} on average, \
             {least:.3} at least; time{beside}"
        );
    }
    Ok(())
}

impl Choice {
    fn no_times(&self, seconds: f64) -> Times {
        Times { plain: seconds, refined: vec![seconds; self.efforts.len()] }
    }
}

/// The arguments; `cargo bench` adds a flag of its own.
fn choice(mut arguments: impl Iterator<Item = String>) -> Result<Choice, Box<dyn Error>> {
    let mut choice = Choice {
        densities: vec![0.5, 1.0, 2.0, 3.0, 4.0],
        efforts: vec![1, 2, 3],
        threads: [1, 2].into_iter().filter_map(NonZeroUsize::new).collect(),
        rounds: 3,
        pictures: Vec::new(),
    };
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match &argument[..] {
            "--bench" => {}
            "--densities" => choice.densities = list(&value()?)?,
            "--efforts" => choice.efforts = list(&value()?)?,
            "--threads" => choice.threads = list(&value()?)?,
            "--rounds" => choice.rounds = value()?.parse()?,
            _ => choice.pictures.push(argument),
        }
    }
    Ok(choice)
}

fn list<T: FromStr>(text: &str) -> Result<Vec<T>, T::Err> {
    text.split(',').map(str::parse).collect()
}

/// A picture's name and its components: one of a gray file, three of any other.
fn read(path: &str) -> Result<(String, Image), Box<dyn Error>> {
    let name = path.rsplit('/').next().unwrap_or(path);
    let image = match image::load_from_memory(&std::fs::read(path)?)? {
        DynamicImage::ImageLuma8(gray) => {
            let samples = gray.iter().map(|&sample| sample.into()).collect();
            Image::from_top_down(gray.width() as usize, gray.height() as usize, 8, vec![samples])?
        }
        DynamicImage::ImageLuma16(gray) => {
            let (width, height) = (gray.width() as usize, gray.height() as usize);
            Image::from_top_down(width, height, 16, vec![gray.into_raw()])?
        }
        other => picture::colour(&other.to_rgb8())?,
    };
    Ok((name.to_owned(), image))
}

/// Runs MGPRFS and all efforts in turns.
fn measure(image: &Image, density: f64, choice: &Choice) -> Result<Measured, Box<dyn Error>> {
    let times = choice.threads.iter().map(|_| choice.no_times(f64::INFINITY)).collect();
    let mut all = Measured { plain: 0.0, gains: vec![0.0; choice.efforts.len()], times };
    for _ in 0..choice.rounds {
        for (&threads, times) in choice.threads.iter().zip(&mut all.times) {
            let (plain, psnr) = run(image, density, 0, threads)?;
            times.plain = times.plain.min(plain);
            all.plain = psnr;
            let efforts = choice.efforts.iter().zip(&mut times.refined).zip(&mut all.gains);
            for ((&effort, least), gain) in efforts {
                let (seconds, refined) = run(image, density, effort, threads)?;
                *least = least.min(seconds);
                *gain = refined - psnr;
            }
        }
    }
    Ok(all)
}

/// The seconds of a run, and the PSNR of its mesh.
fn run(
    image: &Image,
    density: f64,
    effort: u8,
    threads: NonZeroUsize,
) -> Result<(f64, f64), Box<dyn Error>> {
    let method = if effort == 0 { Method::Mgprfs } else { Method::Optimal };
    let mut parameters = method.parameters(Target::Percent(density));
    parameters.effort = effort;
    let begun = Instant::now();
    let model = mesh_image(image, &parameters, &OnThreads((), threads))?;
    Ok((begun.elapsed().as_secs_f64(), model.fidelity.psnr_db()))
}

/// An effort's time as a part of that of MGPRFS, for each number of threads.
fn beside(times: &[Times], effort: usize) -> String {
    let part = |times: &Times| times.refined[effort] / times.plain - 1.0;
    times.iter().map(|times| format!("{:>13.2}", part(times))).collect()
}
