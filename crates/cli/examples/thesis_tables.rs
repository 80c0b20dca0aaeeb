//! The PSNR of MED and MGPRFS on the pictures of a folder, beside the thesis's published figures:
//!
//! ```text
//! cargo run --release -p pixmesh-cli --example thesis_tables -- FOLDER [--published FILE]
//! ```
//!
//! Each picture of three components is meshed in colour and in gray, at 0.5, 1, 2, 3 and 4 %. The
//! gray picture is netpbm's, `(77 R + 150 G + 29 B + 128) / 256`, which the thesis's is. The
//! published figures are read from a CSV file with the columns table, image, components, method,
//! density_percent, unit and value.

use clap::Parser;
use pixmesh_cli::files;
use pixmesh_meshing::{Image, ImageError, Method, Target, Unattended, generate};
use std::collections::HashMap;
use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};

const DENSITIES: [f64; 5] = [0.5, 1.0, 2.0, 3.0, 4.0];

/// Prints the PSNR of MED and MGPRFS on the pictures of a folder.
#[derive(Parser)]
struct Options {
    /// Folder of pictures (PNG, JPEG or PNM)
    folder: PathBuf,
    /// CSV file of published figures
    #[arg(long)]
    published: Option<PathBuf>,
}

/// Published PSNR by image, components, method and density.
type Published = HashMap<(String, usize, Method, String), f64>;

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let published = match &options.published {
        Some(path) => read_published(&String::from_utf8(files::read(Some(path))?)?),
        None => Published::new(),
    };
    let mut output = std::io::stdout().lock();
    writeln!(
        output,
        "| picture | components | method | density % | vertices | PSNR dB | published | difference |"
    )?;
    writeln!(output, "|---|---|---|---|---|---|---|---|")?;
    for path in pictures(&options.folder)? {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let bytes = files::read(Some(&path))?;
        let Ok(picture) = pixmesh_codec::decode(&bytes, &files::LIMITS) else { continue };
        let gray = if picture.component_count() == 3 { Some(netpbm_gray(&picture)?) } else { None };
        for image in std::iter::once(&picture).chain(&gray) {
            print_rows(&mut output, &name, image, &published)?;
        }
    }
    Ok(())
}

/// The files of a folder, by name.
fn pictures(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
    let mut paths: Vec<PathBuf> = entries.collect::<Result<_, _>>()?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}

/// One picture's rows.
fn print_rows(
    output: &mut impl Write,
    name: &str,
    image: &Image,
    published: &Published,
) -> Result<(), Box<dyn Error>> {
    let components = image.component_count();
    for method in [Method::Med, Method::Mgprfs] {
        for density in DENSITIES {
            let parameters = method.parameters(Target::Density(density));
            let model = generate(image, &parameters, &Unattended)?;
            let (vertices, psnr_db) = (model.mesh.points().len(), model.fidelity.psnr_db());
            write!(
                output,
                "| {name} | {components} | {method} | {density} | {vertices} | {psnr_db:.3} |"
            )?;
            let key = (name.to_owned(), components, method, density.to_string());
            match published.get(&key) {
                // Both rounded to the printed hundredth.
                Some(value) => {
                    let difference = (psnr_db * 100.0).round() / 100.0 - value;
                    writeln!(output, " {value:.2} | {difference:+.2} |")?;
                }
                None => writeln!(output, " | |")?,
            }
        }
    }
    Ok(())
}

/// Reads the figures of MED and MGPRFS, also where a table names them by their policy.
fn read_published(csv: &str) -> Published {
    csv.lines().filter_map(|line| read_figure(&line.replace("PSD(Max,D)", "PSD(Max;D)"))).collect()
}

/// One line's figure, when it is one of those compared.
fn read_figure(line: &str) -> Option<((String, usize, Method, String), f64)> {
    let fields: Vec<&str> = line.split(',').map(|field| field.trim_matches('"')).collect();
    let [_, image, components, method, density, "psnr_db", value] = fields[..] else { return None };
    let components: usize = components.parse().ok()?;
    let method = match (method, components) {
        ("MED" | "ED-like PSD(Max;D) mirror", _) => Method::Med,
        ("MGPRFS" | "GPRFSED-like PSD(Max;D) mirror", _) => Method::Mgprfs,
        ("ED-like PSA(D) mirror", 1) => Method::Med,
        ("GPRFSED-like PSA(D) mirror", 1) => Method::Mgprfs,
        _ => return None,
    };
    let density = density.parse::<f64>().ok()?.to_string();
    Some(((image.to_owned(), components, method, density), value.parse().ok()?))
}

/// The gray picture that the thesis used.
fn netpbm_gray(image: &Image) -> Result<Image, ImageError> {
    let weighted = |i: usize| {
        let [red, green, blue] = [0, 1, 2].map(|c| u32::from(image.components()[c][i]));
        ((77 * red + 150 * green + 29 * blue + 128) >> 8) as u16
    };
    let samples = (0..image.pixel_count()).map(weighted).collect();
    Image::new(image.width(), image.height(), image.precision(), vec![samples])
}
