//! How well the published PSNR figures are met, each rounded to the hundredth that the thesis
//! prints.

use crate::cases::DENSITIES;
use crate::measure::Results;
use crate::published::{Published, PublishedFigure};
use crate::sheets::Sheet;
use crate::statistics::{maximum, mean};

/// Deviations from this many hundredths of a decibel are listed one by one.
const LISTED_HUNDREDTHS: f64 = 5.0;

/// A published figure and the one measured.
struct Pair<'a> {
    figure: &'a PublishedFigure,
    /// The figure measured, rounded, in hundredths.
    measured: f64,
    /// Whether the method removes points.
    simplifies: bool,
}

impl Pair<'_> {
    /// The figure measured less the published one, in hundredths of a decibel.
    fn difference(&self) -> f64 {
        self.measured - (self.figure.value * 100.0).round()
    }
}

/// The agreement of each table, of all one-shot and of all simplified meshes, and the figures that
/// deviate; nothing when nothing can be compared.
#[must_use]
pub fn sheets(published: &Published, results: &Results) -> Vec<Sheet> {
    let pairs = pairs(published, results);
    if pairs.is_empty() {
        return Vec::new();
    }
    let left_out =
        published.figures().iter().filter(|figure| figure.unit == "psnr_db").count() - pairs.len();
    let sheets = [counts(&pairs, left_out), deviations(&pairs)];
    sheets.into_iter().filter(|sheet| !sheet.rows.is_empty()).collect()
}

/// The published PSNR figures whose meshes were made.
fn pairs<'a>(published: &'a Published, results: &Results) -> Vec<Pair<'a>> {
    let pair = |figure: &'a PublishedFigure| {
        let series = published.series(figure)?;
        let known = DENSITIES.contains(&figure.density) && figure.unit == "psnr_db";
        let mut pictures = results.pictures(figure.components);
        let picture = pictures.find(|picture| picture.stem == figure.image)?;
        let outcome = picture.outcome(&series.case(figure.density)).filter(|_| known)?;
        let measured = (outcome.psnr_db * 100.0).round();
        Some(Pair { figure, measured, simplifies: series.simplifies() })
    };
    published.figures().iter().filter_map(pair).collect()
}

/// A row for each table, and for each kind of mesh.
fn counts(pairs: &[Pair<'_>], left_out: usize) -> Sheet {
    let mut tables: Vec<&str> = pairs.iter().map(|pair| pair.figure.table.as_str()).collect();
    tables.sort_unstable();
    tables.dedup();
    let of_table = |table: &&str| {
        let table = *table;
        count_row(&format!("Table {table}"), pairs, |pair| pair.figure.table == table)
    };
    let mut rows: Vec<Vec<String>> = tables.iter().filter_map(of_table).collect();
    rows.extend(count_row("all that are not simplified", pairs, |pair| !pair.simplifies));
    rows.extend(count_row("all that are simplified", pairs, |pair| pair.simplifies));
    let rest = match left_out {
        0 => String::new(),
        count => format!("; {count} more are of meshes that were not made"),
    };
    Sheet {
        caption: format!("agreement with {} published figures of PSNR (dB){rest}", pairs.len()),
        header: ["figures of", "number", "the same", "mean absolute difference", "largest"]
            .map(str::to_owned)
            .to_vec(),
        rows,
        label_columns: 1,
    }
}

/// The agreement of some pairs; none for no pairs.
fn count_row(
    name: &str,
    pairs: &[Pair<'_>],
    belongs: impl Fn(&Pair<'_>) -> bool,
) -> Option<Vec<String>> {
    let belonging = pairs.iter().filter(|pair| belongs(pair));
    let differences: Vec<f64> = belonging.map(|pair| pair.difference().abs()).collect();
    let same = differences.iter().filter(|&&difference| difference == 0.0).count();
    (!differences.is_empty()).then(|| {
        vec![
            name.to_owned(),
            differences.len().to_string(),
            same.to_string(),
            format!("{:.3}", mean(&differences) / 100.0),
            format!("{:.2}", maximum(&differences) / 100.0),
        ]
    })
}

/// The figures that deviate.
fn deviations(pairs: &[Pair<'_>]) -> Sheet {
    let listed = pairs.iter().filter(|pair| pair.difference().abs() >= LISTED_HUNDREDTHS);
    let row = |pair: &Pair<'_>| {
        let PublishedFigure { table, image, components, method, density, value, .. } = pair.figure;
        let (measured, difference) = (pair.measured / 100.0, pair.difference() / 100.0);
        let texts = [table, image, &components.to_string(), method, &density.to_string()];
        let numbers =
            [format!("{measured:.2}"), format!("{value:.2}"), format!("{difference:+.2}")];
        texts.into_iter().cloned().chain(numbers).collect()
    };
    let limit = LISTED_HUNDREDTHS / 100.0;
    Sheet {
        caption: format!("figures that differ by {limit:.2} dB or more"),
        header: ["table", "picture", "components", "method", "density (%)"]
            .into_iter()
            .chain(["PSNR (dB)", "published", "difference"])
            .map(str::to_owned)
            .collect(),
        rows: listed.map(row).collect(),
        label_columns: 4,
    }
}
