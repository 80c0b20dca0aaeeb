//! The report: every level with its figure, then what each run saw, with its plots.

use crate::levels::Levels;
use crate::plot::{Axis, Curve, Plot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What a run found.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Result {
    /// Levels and their figures.
    pub(crate) figures: Vec<(String, f64)>,
    /// A table, its head first; empty where there is none.
    pub(crate) rows: Vec<Vec<String>>,
    /// What else is to be said.
    pub(crate) notes: Vec<String>,
    pub(crate) plots: Vec<Curves>,
}

/// Curves to draw.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Curves {
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) x: String,
    pub(crate) y: String,
    pub(crate) is_logarithmic: bool,
    pub(crate) curves: Vec<(String, Vec<(f64, f64)>)>,
}

/// A run that was made, when, and with what.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    scale: f64,
    commit: String,
    result: Result,
}

/// The results so far, and where they are kept.
pub(crate) struct Report {
    folder: PathBuf,
    runs: BTreeMap<String, Kept>,
}

const COLORS: [&str; 6] = ["#1f6fb4", "#d1495b", "#3a7d44", "#8d5fa8", "#c77d0a", "#4a4a4a"];

impl Report {
    /// The report of a folder, with the results of earlier runs.
    pub(crate) fn open(folder: &Path) -> Self {
        let folder = folder.to_owned();
        let kept = fs::read_to_string(folder.join("load/results.json"));
        let runs = kept.ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default();
        Self { folder, runs }
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.join("load.md")
    }

    /// Takes a result in, and writes everything anew.
    pub(crate) fn keep(&mut self, run: &str, scale: f64, result: Result, levels: &Levels) {
        let kept = Kept { scale, commit: commit(), result };
        self.runs.insert(run.to_owned(), kept);
        let plots = self.folder.join("load");
        fs::create_dir_all(&plots).unwrap();
        let json = serde_json::to_string_pretty(&self.runs).unwrap() + "\n";
        fs::write(plots.join("results.json"), json).unwrap();
        for curves in self.runs.values().flat_map(|kept| &kept.result.plots) {
            fs::write(plots.join(format!("{}.svg", curves.name)), drawn(curves)).unwrap();
        }
        fs::write(self.path(), self.text(levels)).unwrap();
    }

    fn text(&self, levels: &Levels) -> String {
        let mut text = String::from(HEAD);
        let _ = writeln!(text, "{}\n", machine());
        text += "| level | objective | bound | figure | | run |\n|---|---|---|---|---|---|\n";
        for name in levels.names() {
            let _ = writeln!(text, "{}", self.row(name, levels));
        }
        let mut runs: Vec<_> = self.runs.iter().collect();
        runs.sort_by_key(|(name, _)| (name.len(), name.as_str()));
        for (name, kept) in runs {
            section(&mut text, name, kept);
        }
        text
    }

    /// The row of a level: its figure from the run that measured it, or that none did.
    fn row(&self, name: &str, levels: &Levels) -> String {
        let level = levels.get(name);
        let found = self.runs.iter().find_map(|(run, kept)| {
            let figure = kept.result.figures.iter().find(|(known, _)| known == name)?;
            Some((figure.1, format!("{run}, scale {}", kept.scale)))
        });
        let (figure, verdict, run) = match found {
            Some((figure, run)) => {
                let verdict = if level.is_met(figure, false) { "met" } else { "**not met**" };
                (format!("{figure:.2} {}", level.unit), verdict, run)
            }
            None => (String::new(), "not measured", String::new()),
        };
        let (objective, bound) = (&level.objective, level.bound());
        format!("| {name} | {objective} | {bound} | {figure} | {verdict} | {run} |")
    }
}

const HEAD: &str = "# The service under load\n\n\
    Made by `cargo bench --bench load -- --report docs`. The driver ran on the same machine as the \
    service, and took a part of it. A scale under 1 means that periods were as much shorter than \
    the run's full ones: what shows only after an hour is then not shown.\n\n";

fn section(text: &mut String, name: &str, kept: &Kept) {
    let what = crate::runs::RUNS.iter().find(|run| run.name == name).map_or("", |run| run.what);
    let result = &kept.result;
    let _ =
        writeln!(text, "\n## {name}: {what}\n\nScale {}, commit {}.\n", kept.scale, kept.commit);
    if let Some((head, rows)) = result.rows.split_first() {
        let _ = writeln!(text, "| {} |\n|{}", head.join(" | "), "---|".repeat(head.len()));
        for row in rows {
            let _ = writeln!(text, "| {} |", row.join(" | "));
        }
        text.push('\n');
    }
    for note in &result.notes {
        let _ = writeln!(text, "{note}\n");
    }
    for plot in &result.plots {
        let _ = writeln!(text, "![{}](load/{}.svg)", plot.title, plot.name);
    }
}

/// The curves as a picture.
fn drawn(curves: &Curves) -> String {
    // The plots' labels live as long as the program.
    let leak = |text: &str| -> &'static str { text.to_owned().leak() };
    let axis = |label: &str, logarithmic| Axis { label: leak(label), logarithmic };
    let numbered = curves.curves.iter().enumerate();
    let drawn_curves = numbered.map(|(number, (label, points))| Curve {
        label: leak(label),
        color: COLORS[number % COLORS.len()],
        points: points.clone(),
    });
    let plot = Plot {
        title: curves.title.clone(),
        x: axis(&curves.x, false),
        y: axis(&curves.y, curves.is_logarithmic),
        curves: drawn_curves.collect(),
    };
    plot.svg()
}

/// The machine, in a sentence.
fn machine() -> String {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let field = |text: &str, name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        line.split_once(':').map_or("unknown", |(_, value)| value.trim()).to_owned()
    };
    let model = field(&read("/proc/cpuinfo"), "model name");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let memory = field(&read("/proc/meminfo"), "MemTotal");
    let kib: f64 = memory.trim_end_matches(" kB").parse().unwrap_or(0.0);
    format!("{cores} processors ({model}), {:.0} GiB.", kib / f64::from(1 << 20))
}

fn commit() -> String {
    let output = Command::new("git").args(["rev-parse", "--short", "HEAD"]).output();
    let known = output.ok().filter(|output| output.status.success());
    known.map_or("unknown".into(), |it| String::from_utf8_lossy(&it.stdout).trim().to_owned())
}
