//! Tables and plots of what was measured.

use crate::figures::{DENSITIES, Figure, Measured};
use crate::plot::{Axis, Curve, Plot};
use crate::series::{SERIES, Series};
use std::error::Error;
use std::fmt::Write as _;

/// The density whose seconds are plotted.
const TIMED: f64 = 2.0;

/// Between these lines the tables of a document are.
const BEGIN: &str = "<!-- Made by the program above: begin -->\n";
const END: &str = "<!-- Made by the program above: end -->\n";

/// The series whose gain over MGPRFS is told for every picture.
const GAINING: [&str; 3] = ["optimal 1", "optimal 5", "optimal 5 free fitted"];

/// The columns of the figures.
const COLUMNS: &str = "picture,series,density_percent,vertices,psnr_db,ssim,seconds";

/// Every figure, a line each.
pub(crate) fn csv(measured: &[Measured]) -> String {
    let mut csv = format!("{COLUMNS}\n");
    for picture in measured {
        for figure in &picture.figures {
            let Figure { series, density, vertices, psnr_db, ssim, seconds } = figure;
            // Writing to a string does not fail, here and below.
            let _ = writeln!(
                csv,
                "{},{},{density},{vertices},{psnr_db:.3},{ssim:.4},{seconds:.3}",
                picture.name, series.label
            );
        }
    }
    csv
}

/// The figures that [`csv`] wrote; those of series that are no more are left out.
pub(crate) fn read_csv(text: &str) -> Result<Vec<Measured>, Box<dyn Error>> {
    let mut measured: Vec<Measured> = Vec::new();
    let lines = text.strip_prefix(COLUMNS).ok_or("these are not figures of this program")?;
    for line in lines.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [name, label, density, vertices, psnr_db, ssim, seconds] = fields[..] else {
            return Err(format!("not a line of seven fields: {line}").into());
        };
        if measured.last().is_none_or(|picture| picture.name != name) {
            let name = name.to_owned();
            measured.push(Measured { name, is_thorough: false, figures: Vec::new() });
        }
        let series = SERIES.iter().find(|series| series.label == label);
        let (Some(picture), Some(series)) = (measured.last_mut(), series) else { continue };
        picture.is_thorough |= series.slow;
        picture.figures.push(Figure {
            series,
            density: density.parse()?,
            vertices: vertices.parse()?,
            psnr_db: psnr_db.parse()?,
            ssim: ssim.parse()?,
            seconds: seconds.parse()?,
        });
    }
    Ok(measured)
}

/// PSNR against vertices, in thousands.
pub(crate) fn by_vertices(picture: &Measured) -> Plot {
    let place = |figure: &&Figure| (figure.vertices as f64 / 1000.0, figure.psnr_db);
    let curve = |series: &'static Series| Curve {
        label: series.label,
        color: series.color,
        points: picture.of(series.label).iter().map(place).collect(),
    };
    Plot {
        title: format!("{}: PSNR (dB) against vertices", picture.name),
        x: Axis { label: "vertices (thousands)", logarithmic: false },
        y: Axis { label: "PSNR (dB)", logarithmic: false },
        curves: SERIES.iter().map(curve).filter(|curve| !curve.points.is_empty()).collect(),
    }
}

/// PSNR against seconds, at one density.
pub(crate) fn by_seconds(picture: &Measured) -> Plot {
    let at = picture.figures.iter().filter(|figure| figure.density == TIMED);
    let curves = at.map(|figure| Curve {
        label: figure.series.label,
        color: figure.series.color,
        points: vec![(figure.seconds, figure.psnr_db)],
    });
    Plot {
        title: format!("{}: PSNR (dB) against seconds, {TIMED} % of the pixels", picture.name),
        x: Axis { label: "seconds", logarithmic: true },
        y: Axis { label: "PSNR (dB)", logarithmic: false },
        curves: curves.collect(),
    }
}

/// A document with other tables.
pub(crate) fn with_tables(document: &str, tables: &str) -> Result<String, &'static str> {
    let (before, rest) =
        document.split_once(BEGIN).ok_or("the document has no place for tables")?;
    let (_, after) = rest.split_once(END).ok_or("the place for tables has no end")?;
    Ok(format!("{before}{BEGIN}{tables}{END}{after}"))
}

/// All tables in Markdown, and links to the plots.
pub(crate) fn tables(measured: &[Measured]) -> String {
    let mut text = String::from("\n## One picture, everything\n\n");
    for picture in measured.iter().filter(|picture| picture.is_thorough) {
        text += &everything(picture);
    }
    text += &gains(measured);
    text += &similarities(measured);
    text += "## Plots\n\n";
    for Measured { name, .. } in measured {
        let of = |what: &str| format!("[{what}](quality/{name}-{what}.svg)");
        let _ = writeln!(text, "- {name}: {}, {}", of("vertices"), of("seconds"));
    }
    text + "\n"
}

/// A row for each series, PSNR at each density, SSIM and seconds at one of them.
fn everything(picture: &Measured) -> String {
    let mut text = format!("**{}**, PSNR (dB)\n\n| |", picture.name);
    for density in DENSITIES {
        let _ = write!(text, " {density} % |");
    }
    let rule = "---|".repeat(DENSITIES.len() + 3);
    let _ = write!(text, " vertices at {TIMED} % | SSIM | seconds |\n|---|{rule}\n");
    for series in &SERIES {
        let of = picture.of(series.label);
        let Some(timed) = of.iter().find(|figure| figure.density == TIMED) else { continue };
        let _ = write!(text, "| {} |", series.label);
        for figure in &of {
            let _ = write!(text, " {:.2} |", figure.psnr_db);
        }
        let Figure { vertices, ssim, seconds, .. } = timed;
        let _ = writeln!(text, " {vertices} | {ssim:.4} | {seconds:.3} |");
    }
    text + "\n"
}

/// What is gained over MGPRFS on every picture.
fn gains(measured: &[Measured]) -> String {
    let mut text = String::from(
        "## Every picture at hand\n\nPSNR of MGPRFS at 0.5, 1, 2, 3 and 4 % (dB), and what is \
         gained.\n\n| picture | mgprfs | optimal 1 | optimal 5 | optimal 5, free, fitted |\n\
         |---|---|---|---|---|\n",
    );
    let (mut count, mut reached, mut least) = (0, 0, f64::INFINITY);
    let mut seconds = (0.0, 0.0);
    for picture in measured {
        let base = picture.of("mgprfs");
        let cells = base.iter().map(|figure| format!("{:.2}", figure.psnr_db));
        let cells: Vec<String> = cells.collect();
        let _ = write!(text, "| {} | {} |", picture.name, cells.join(" "));
        for label in GAINING {
            let better = picture.of(label);
            let pairs = base.iter().zip(&better);
            for (base, better) in pairs.clone().filter(|_| label == GAINING[0]) {
                let gain = better.psnr_db - base.psnr_db;
                (count, least) = (count + 1, least.min(gain));
                reached += usize::from(gain >= 1.0);
                seconds = (seconds.0 + base.seconds, seconds.1 + better.seconds);
            }
            let gain = |(base, better): (&&Figure, &&Figure)| {
                format!("{:+.2}", better.psnr_db - base.psnr_db)
            };
            let _ = write!(text, " {} |", pairs.map(gain).collect::<Vec<_>>().join(" "));
        }
        text.push('\n');
    }
    let _ = writeln!(
        text,
        "\nEffort 1 gains at least 1 dB in {reached} of these {count} cases, and {least:.2} dB at \
         the least; all of its meshes take {:.2} times as long as those of MGPRFS.\n",
        seconds.1 / seconds.0
    );
    text
}

/// What the structural similarity as the metric of removal changes, on every picture.
fn similarities(measured: &[Measured]) -> String {
    let mut text = String::from(
        "## Structural similarity as the metric of removal\n\nSSIM of MGPRFS at 0.5, 1, 2, 3 and \
         4 %, what `error_metric=ssim` adds to it (in thousandths), and what that costs of the PSNR \
         (dB).\n\n| picture | SSIM | by ssim | PSNR |\n|---|---|---|---|\n",
    );
    let (mut count, mut better) = (0, 0);
    for picture in measured {
        let (plain, by_ssim) = (picture.of("mgprfs"), picture.of("mgprfs by ssim"));
        let row = |cell: &dyn Fn(&Figure, &Figure) -> String| {
            let pairs = plain.iter().zip(&by_ssim);
            pairs.map(|(plain, by_ssim)| cell(plain, by_ssim)).collect::<Vec<_>>().join(" ")
        };
        let pairs = || plain.iter().zip(&by_ssim);
        count += pairs().count();
        better += pairs().filter(|(plain, by_ssim)| by_ssim.ssim > plain.ssim).count();
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} |",
            picture.name,
            row(&|plain, _| format!("{:.4}", plain.ssim)),
            row(&|plain, by_ssim| format!("{:+.1}", 1e3 * (by_ssim.ssim - plain.ssim))),
            row(&|plain, by_ssim| format!("{:+.2}", by_ssim.psnr_db - plain.psnr_db)),
        );
    }
    let _ = writeln!(text, "\nIt is higher in {better} of these {count} cases.\n");
    text
}
