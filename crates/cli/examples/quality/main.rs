//! PSNR against vertices and against seconds, for every method, as plots and tables:
//!
//! ```text
//! cargo run --release -p pixmesh-cli --example quality -- PICTURE... --output FOLDER [--thorough]
//! ```
//!
//! Writes two plots (SVG) for each picture and the figures of all (CSV) to the folder, and prints a
//! table for each picture in Markdown. Seconds are those of one run on the machine at hand; everything
//! else is the same on every machine.

// An example speaks on the terminal.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod plot;
mod series;

use clap::Parser;
use pixmesh_meshing::{Image, ImageError, Unattended, generate, rasterize, structural_similarity};
use plot::{Axis, Curve, Plot};
use series::{SERIES, Series};
use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Densities in percent.
const DENSITIES: [f64; 5] = [0.5, 1.0, 2.0, 3.0, 4.0];

/// The density whose seconds are plotted.
const TIMED: f64 = 2.0;

#[derive(Parser)]
struct Arguments {
    /// Pictures; one in colour is measured in gray too with --gray
    pictures: Vec<PathBuf>,
    /// Folder to write to
    #[arg(long)]
    output: PathBuf,
    /// Measure the slow methods too
    #[arg(long)]
    thorough: bool,
    /// Measure the gray version (77 R + 150 G + 29 B + 128) / 256 instead of the colours
    #[arg(long)]
    gray: bool,
}

/// What was measured of one mesh.
struct Figure {
    series: &'static Series,
    density: f64,
    vertices: usize,
    psnr_db: f64,
    ssim: f64,
    seconds: f64,
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
    let mut csv = String::from("picture,series,density_percent,vertices,psnr_db,ssim,seconds\n");
    for path in &arguments.pictures {
        let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let image =
            pixmesh_codec::decode(&std::fs::read(path)?, &pixmesh_codec::Limits::default())?;
        let make_gray = arguments.gray && image.component_count() == 3;
        let image = if make_gray { gray(&image)? } else { image };
        let kind = if image.component_count() == 1 { "gray" } else { "colour" };
        let name = format!("{stem}-{kind}");
        let figures = measure(&image, arguments.thorough)?;
        for figure in &figures {
            let Figure { series, density, vertices, psnr_db, ssim, seconds } = figure;
            let label = series.label;
            writeln!(
                csv,
                "{name},{label},{density},{vertices},{psnr_db:.3},{ssim:.4},{seconds:.3}"
            )?;
        }
        for (what, plot) in
            [("vertices", by_vertices(&name, &figures)), ("seconds", by_seconds(&name, &figures))]
        {
            std::fs::write(arguments.output.join(format!("{name}-{what}.svg")), plot.svg())?;
        }
        println!("{}", table(&name, &figures)?);
    }
    let kind = if arguments.gray { "gray" } else { "colour" };
    let depth = if arguments.thorough { "thorough" } else { "all" };
    std::fs::write(arguments.output.join(format!("{depth}-{kind}.csv")), csv)?;
    Ok(())
}

/// Makes every mesh of an image and measures it.
fn measure(image: &Image, thorough: bool) -> Result<Vec<Figure>, Box<dyn Error>> {
    let mut figures = Vec::new();
    for series in SERIES.iter().filter(|series| thorough || !series.slow) {
        for density in DENSITIES {
            let start = Instant::now();
            let model = generate(image, &series.parameters(density), &Unattended)?;
            let seconds = start.elapsed().as_secs_f64();
            let (vertices, psnr_db) = (model.mesh.points().len(), model.fidelity.psnr_db());
            let rebuilt = match model.flat {
                Some(flat) => flat.picture,
                None => rasterize(&model.mesh, &Unattended)?,
            };
            let ssim = structural_similarity(image, &rebuilt, &Unattended)?.unwrap_or(f64::NAN);
            figures.push(Figure { series, density, vertices, psnr_db, ssim, seconds });
        }
    }
    Ok(figures)
}

/// PSNR against vertices, in thousands.
fn by_vertices(name: &str, figures: &[Figure]) -> Plot {
    let curve = |series: &'static Series| Curve {
        label: series.label,
        color: series.color,
        points: figures
            .iter()
            .filter(|figure| std::ptr::eq(figure.series, series))
            .map(|figure| (figure.vertices as f64 / 1000.0, figure.psnr_db))
            .collect(),
    };
    Plot {
        title: format!("{name}: PSNR (dB) against vertices"),
        x: Axis { label: "vertices (thousands)", logarithmic: false },
        y: Axis { label: "PSNR (dB)", logarithmic: false },
        curves: SERIES.iter().map(curve).filter(|curve| !curve.points.is_empty()).collect(),
    }
}

/// PSNR against seconds, at one density.
fn by_seconds(name: &str, figures: &[Figure]) -> Plot {
    let at = figures.iter().filter(|figure| figure.density == TIMED);
    let curves = at.map(|figure| Curve {
        label: figure.series.label,
        color: figure.series.color,
        points: vec![(figure.seconds, figure.psnr_db)],
    });
    Plot {
        title: format!("{name}: PSNR (dB) against seconds, {TIMED} % of the pixels"),
        x: Axis { label: "seconds", logarithmic: true },
        y: Axis { label: "PSNR (dB)", logarithmic: false },
        curves: curves.collect(),
    }
}

/// A row for each series, PSNR at each density, SSIM and seconds at one of them.
fn table(name: &str, figures: &[Figure]) -> Result<String, std::fmt::Error> {
    let mut text = format!("**{name}**, PSNR (dB)\n\n| |");
    for density in DENSITIES {
        write!(text, " {density} % |")?;
    }
    write!(
        text,
        " vertices at {TIMED} % | SSIM | seconds |\n|---|{}\n",
        "---|".repeat(DENSITIES.len() + 3)
    )?;
    for series in &SERIES {
        let of: Vec<&Figure> = figures.iter().filter(|f| std::ptr::eq(f.series, series)).collect();
        let Some(timed) = of.iter().find(|figure| figure.density == TIMED) else { continue };
        write!(text, "| {} |", series.label)?;
        for figure in &of {
            write!(text, " {:.2} |", figure.psnr_db)?;
        }
        writeln!(text, " {} | {:.4} | {:.3} |", timed.vertices, timed.ssim, timed.seconds)?;
    }
    Ok(text)
}

/// The gray version that the thesis measured.
fn gray(image: &Image) -> Result<Image, ImageError> {
    let weighted = |i: usize| {
        let [red, green, blue] = [0, 1, 2].map(|c| u32::from(image.components()[c][i]));
        ((77 * red + 150 * green + 29 * blue + 128) >> 8) as u16
    };
    let samples = (0..image.pixel_count()).map(weighted).collect();
    Image::new(image.width(), image.height(), image.precision(), vec![samples])
}
