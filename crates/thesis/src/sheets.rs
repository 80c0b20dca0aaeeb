//! The tables as text, Markdown and CSV.

use crate::cases::DENSITIES;
use crate::csv;
use crate::grid::{Figure, Grid, Row, Unit};
use clap::ValueEnum;

/// A form that the tables are written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TableFormat {
    /// Aligned columns.
    Text,
    /// One line for each figure.
    Csv,
    /// Markdown.
    Markdown,
}

/// Cells under a caption, as readers see them.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// What the cells show.
    pub caption: String,
    /// A name for each column.
    pub header: Vec<String>,
    /// The cells.
    pub rows: Vec<Vec<String>>,
    /// How many columns hold words; the others hold numbers.
    pub label_columns: usize,
}

/// Sheets under a heading.
#[derive(Clone, Debug)]
pub struct Section {
    /// The heading.
    pub heading: String,
    /// What stands below it.
    pub sheets: Vec<Sheet>,
}

/// A grid for readers: in parentheses the published figures.
#[must_use]
pub fn sheet(grid: &Grid) -> Sheet {
    let same_unit = grid.rows.windows(2).all(|pair| pair[0].unit == pair[1].unit);
    let names = [(!grid.is_summary(), "picture"), (true, "method"), (!same_unit, "figure")];
    let names: Vec<&str> =
        names.iter().filter(|(shown, _)| *shown).map(|(_, name)| *name).collect();
    let row = |row: &Row| {
        let label = |name: &&str| match *name {
            "picture" => row.image.clone().unwrap_or_default(),
            "method" => row.method.clone(),
            _ => row.unit.words().to_owned(),
        };
        let figures = row.figures.iter().map(|&figure| cell(row.unit, figure));
        names.iter().map(label).chain(figures).collect()
    };
    Sheet {
        caption: grid.caption.clone(),
        header: names.iter().map(|name| (*name).to_owned()).chain(columns(grid)).collect(),
        rows: grid.rows.iter().map(row).collect(),
        label_columns: names.len(),
    }
}

/// The names of the columns of figures.
fn columns(grid: &Grid) -> impl Iterator<Item = String> + use<> {
    let all = grid.is_summary().then(|| "all".to_owned());
    DENSITIES.iter().map(|density| format!("{density} %")).chain(all)
}

/// A figure, in parentheses the published one.
fn cell(unit: Unit, figure: Figure) -> String {
    let value = unit.print(figure.value);
    match figure.published {
        // The published seconds have two decimals.
        Some(published) if unit == Unit::Seconds => format!("{value} ({published:.2})"),
        Some(published) => format!("{value} ({})", unit.print(published)),
        None => value,
    }
}

/// Sections as text in aligned columns.
#[must_use]
pub fn text(sections: &[Section]) -> String {
    let mut lines = Vec::new();
    for section in sections {
        lines.extend([section.heading.clone(), "=".repeat(section.heading.len()), String::new()]);
        for sheet in &section.sheets {
            lines.extend([sheet.caption.clone(), String::new()]);
            let widths = widths(sheet);
            let all = std::iter::once(&sheet.header).chain(&sheet.rows);
            lines.extend(all.map(|row| align(row, &widths, sheet.label_columns)));
            lines.push(String::new());
        }
    }
    lines.join("\n")
}

/// The width of every column, in characters.
fn widths(sheet: &Sheet) -> Vec<usize> {
    let all = || std::iter::once(&sheet.header).chain(&sheet.rows);
    let width = |i: usize| all().map(|row| row[i].chars().count()).max().unwrap_or(0);
    (0..sheet.header.len()).map(width).collect()
}

/// A row of words to the left and numbers to the right of their columns.
fn align(row: &[String], widths: &[usize], label_columns: usize) -> String {
    let cell = |(i, (cell, &width)): (usize, (&String, &usize))| {
        if i < label_columns { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
    };
    let cells: Vec<String> = row.iter().zip(widths).enumerate().map(cell).collect();
    cells.join("  ").trim_end().to_owned()
}

/// Sections as Markdown.
#[must_use]
pub fn markdown(sections: &[Section]) -> String {
    let mut lines = Vec::new();
    for section in sections {
        lines.extend([format!("## {}", section.heading), String::new()]);
        for sheet in &section.sheets {
            lines.extend([format!("{}:", capitalized(&sheet.caption)), String::new()]);
            let rule = (0..sheet.header.len())
                .map(|i| if i < sheet.label_columns { "---" } else { "---:" }.to_owned());
            lines.extend([markdown_row(&sheet.header), markdown_row(&rule.collect::<Vec<_>>())]);
            lines.extend(sheet.rows.iter().map(|row| markdown_row(row)));
            lines.push(String::new());
        }
    }
    lines.join("\n")
}

/// A row of a Markdown table.
fn markdown_row(cells: &[String]) -> String {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    format!("| {} |", cells.join(" | "))
}

/// A sentence's first letter made a capital.
fn capitalized(words: &str) -> String {
    let mut letters = words.chars();
    letters
        .next()
        .map_or(String::new(), |first| format!("{}{}", first.to_uppercase(), letters.as_str()))
}

/// Grids as CSV, in the columns of the published figures and two more; statistics over all
/// pictures or densities name them `all`.
#[must_use]
pub fn csv(grids: &[Grid]) -> String {
    let mut text = String::from(
        "table,image,components,method,density_percent,unit,value,published,difference\n",
    );
    for grid in grids {
        for row in &grid.rows {
            let densities = DENSITIES.iter().map(f64::to_string).chain(["all".to_owned()]);
            for (density, &figure) in densities.zip(&row.figures) {
                text.push_str(&csv_line(grid, row, &density, figure));
                text.push('\n');
            }
        }
    }
    text
}

/// The line of a figure.
fn csv_line(grid: &Grid, row: &Row, density: &str, figure: Figure) -> String {
    let number =
        |value: f64| if value.is_nan() { String::new() } else { rounded(value).to_string() };
    let published = figure.published.map_or(String::new(), number);
    let difference = figure.published.map(|published| figure.value - published);
    csv::join(&[
        &grid.table,
        row.image.as_deref().unwrap_or("all"),
        &grid.components.to_string(),
        &row.method,
        density,
        row.unit.name(),
        &number(figure.value),
        &published,
        &difference.map_or(String::new(), number),
    ])
}

/// A number to the fourth decimal, without a negative zero.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4 + 0.0
}
