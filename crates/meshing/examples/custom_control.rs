//! Shows progress, and cancels the work after a time.
//!
//! `cargo run --release --example custom_control -- photo.jpg 0.5` stops after half a second.

#![allow(clippy::print_stderr)]

use pixmesh_meshing::{Cancelled, Control, Image, Method, Stage, Target, mesh_image};
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Cancels at a deadline.
struct Deadline(Instant);

impl Control for Deadline {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        if done == 0 {
            eprintln!("{stage} of {total} steps");
        }
        if Instant::now() < self.0 { Ok(()) } else { Err(Cancelled) }
    }

    fn threads(&self) -> NonZeroUsize {
        std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, seconds] = &arguments[..] else {
        return Err("usage: custom_control INPUT SECONDS".into());
    };
    let image = Image::try_from(&image::open(input)?)?;
    let deadline = Deadline(Instant::now() + Duration::from_secs_f64(seconds.parse()?));
    let parameters = Method::Optimal.parameters(Target::Percent(2.0));
    match mesh_image(&image, &parameters, &deadline) {
        Ok(made) => eprintln!("PSNR {:.2} dB", made.fidelity.psnr_db()),
        Err(error) => eprintln!("{error}"),
    }
    Ok(())
}
