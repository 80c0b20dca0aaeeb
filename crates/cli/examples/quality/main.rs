//! PSNR against vertices and against seconds, for every method, as plots and tables:
//!
//! ```text
//! cargo run --release -p pixmesh-cli --example quality -- PICTURE... --thorough lena --gray lena \
//!     --output docs/quality --document docs/quality.md
//! ```
//!
//! Pictures can be measured one by one, or on several machines: `--measured FIGURES.csv...` takes what
//! earlier runs wrote in the place of measuring again.
//!
//! Writes two plots (SVG) for each picture and the figures of all (CSV) to the folder, and puts the
//! tables in Markdown where the document has them, or prints them. Seconds are the least of some
//! rounds on the machine at hand; everything else is the same on every machine.

// An example speaks on the terminal.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod figures;
mod plot;
mod report;
mod series;

use clap::Parser;
use figures::{Measured, measure};
use pixmesh_meshing::{Image, ImageError};
use report::{by_seconds, by_vertices, csv, read_csv, tables, with_tables};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Parser)]
struct Arguments {
    /// Pictures
    pictures: Vec<PathBuf>,
    /// Pictures, by the name of their file without its ending, that all methods are measured on
    #[arg(long, value_name = "NAME", num_args = 1..)]
    thorough: Vec<String>,
    /// Pictures in colour, named so, that are measured in gray too: (77 R + 150 G + 29 B + 128) / 256
    #[arg(long, value_name = "NAME", num_args = 1..)]
    gray: Vec<String>,
    /// Figures that earlier runs wrote, which come after those of the pictures given
    #[arg(long, value_name = "FILE", num_args = 1..)]
    measured: Vec<PathBuf>,
    /// Folder to write plots and figures to
    #[arg(long)]
    output: PathBuf,
    /// Markdown file whose tables are replaced
    #[arg(long)]
    document: Option<PathBuf>,
    /// Rounds of each measurement, the fastest of which counts
    #[arg(long, default_value_t = 3)]
    rounds: usize,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("quality: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&arguments.output)?;
    let mut measured = Vec::new();
    for path in &arguments.pictures {
        for (name, image) in images(path, arguments)? {
            let is_thorough = arguments.thorough.contains(&stem(path));
            eprintln!("{name}");
            let figures = measure(&image, is_thorough, arguments.rounds.max(1))?;
            measured.push(Measured { name, is_thorough, figures });
        }
    }
    for file in &arguments.measured {
        measured.extend(read_csv(&std::fs::read_to_string(file)?)?);
    }
    for picture in &measured {
        for (what, plot) in [("vertices", by_vertices(picture)), ("seconds", by_seconds(picture))] {
            let file = format!("{}-{what}.svg", picture.name);
            std::fs::write(arguments.output.join(file), plot.svg())?;
        }
    }
    std::fs::write(arguments.output.join("figures.csv"), csv(&measured))?;
    let tables = tables(&measured);
    match &arguments.document {
        Some(document) => {
            let text = with_tables(&std::fs::read_to_string(document)?, &tables)?;
            std::fs::write(document, text)?;
        }
        None => println!("{tables}"),
    }
    Ok(())
}

/// A picture with its name, and its gray version where that is wanted.
fn images(path: &Path, arguments: &Arguments) -> Result<Vec<(String, Image)>, Box<dyn Error>> {
    let stem = stem(path);
    let image = pixmesh_codec::decode(&std::fs::read(path)?, &pixmesh_codec::Limits::default())?;
    let mut images = Vec::new();
    if image.component_count() == 3 && arguments.gray.contains(&stem) {
        images.push((format!("{stem}-gray"), gray(&image)?));
    }
    let kind = if image.component_count() == 1 { "gray" } else { "colour" };
    images.push((format!("{stem}-{kind}"), image));
    Ok(images)
}

/// The name of a file without its ending.
fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

/// The gray version that the thesis measured.
fn gray(image: &Image) -> Result<Image, ImageError> {
    let weighted = |i: usize| {
        let [red, green, blue] = [0, 1, 2].map(|c| u32::from(image.components()[c][i]));
        ((77 * red + 150 * green + 29 * blue + 128) >> 8) as u16
    };
    let samples = (0..image.pixel_count()).map(weighted).collect();
    Image::from_bottom_up(image.width(), image.height(), image.precision(), vec![samples])
}
