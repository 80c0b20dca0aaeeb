//! `pixmesh batch`: the meshes of many pictures, each in a file of its own.

use super::mesh::{make, told};
use super::parameters::MeshParameters;
use super::work::Telling;
use crate::{CliError, files};
use clap::Args;
use pixmesh_codec::Format;
use pixmesh_engine::MeshOptions;
use serde_json::json;
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What to make of many pictures.
#[derive(Args, Debug)]
pub struct BatchOrder {
    /// Pictures, or patterns of their file names in which * and ? stand for any characters and any one
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Folder to write to; made where it is missing. Each mesh has the name of its picture
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    parameters: MeshParameters,
    #[command(flatten)]
    telling: Telling,
}

impl BatchOrder {
    /// Makes the meshes one after the other, each on all cores.
    ///
    /// # Errors
    /// When a parameter is refused, and after the others when a picture is.
    pub fn run(&self) -> Result<(), CliError> {
        let options = self.parameters.options()?;
        let format = options.format.or(options.usual_format).unwrap_or_default();
        std::fs::create_dir_all(&self.output)
            .map_err(|source| CliError::File { name: self.output.display().to_string(), source })?;
        let mut written = BTreeSet::new();
        let (mut all, mut failed) = (0, 0);
        for pattern in &self.inputs {
            for input in matching(pattern) {
                all += 1;
                if let Err(error) = self.make_one(&input, &options, format, &mut written) {
                    failed += 1;
                    // The exit status says it too.
                    let _ = writeln!(io::stderr(), "pixmesh: {error}");
                    let facts = json!({ "input": input.display().to_string(),
                        "error": error.to_string() });
                    if self.telling.json {
                        self.telling.tell(&facts, "", false)?;
                    }
                }
            }
        }
        if failed > 0 { Err(CliError::Batch { failed, all }) } else { Ok(()) }
    }

    fn make_one(
        &self,
        input: &Path,
        options: &MeshOptions,
        format: Format,
        written: &mut BTreeSet<PathBuf>,
    ) -> Result<(), CliError> {
        let output = self.output.join(input.file_stem().unwrap_or_default());
        let output = output.with_added_extension(ending(format));
        if !written.insert(output.clone()) {
            let name = input.display().to_string();
            return Err(CliError::SameName { name, output: output.display().to_string() });
        }
        let answer = make(input, None, options, format, &self.telling)?;
        files::replace(Some(&output), &answer.bytes)?;
        let (facts, line) = told(input, Some(&output), format, &answer);
        self.telling.tell(&facts, &line, false)
    }
}

/// The ending of a format's files.
fn ending(format: Format) -> &'static str {
    if format == Format::Progression { Format::Pmesh.name() } else { format.name() }
}

/// The files that a pattern means, by name; the pattern itself where it names a file, or none matches.
fn matching(pattern: &Path) -> Vec<PathBuf> {
    let name = pattern.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if pattern.exists() || !name.contains(['*', '?']) {
        return vec![pattern.to_owned()];
    }
    let folder = pattern.parent().unwrap_or(Path::new(""));
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(listed).into_iter().flatten().flatten();
    let names = entries.filter(|entry| entry.path().is_file()).map(|entry| entry.file_name());
    let is_hidden = |name: &str| name.starts_with('.') && !pattern_shows_hidden(pattern);
    let matches = |text: &str| !is_hidden(text) && fits(name.as_bytes(), text.as_bytes());
    let mut found: Vec<_> = names
        .filter(|name| matches(&name.to_string_lossy()))
        .map(|name| folder.join(name))
        .collect();
    found.sort();
    if found.is_empty() { vec![pattern.to_owned()] } else { found }
}

/// Whether a pattern asks for names that begin with a dot.
fn pattern_shows_hidden(pattern: &Path) -> bool {
    pattern.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// Whether a name is of a pattern. Goes back to the last star alone, so it takes quadratic time at most.
fn fits(pattern: &[u8], name: &[u8]) -> bool {
    let (mut at, mut place, mut star) = (0, 0, None);
    while place < name.len() {
        match (pattern.get(at), star) {
            (Some(b'*'), _) => {
                star = Some((at, place));
                at += 1;
            }
            (Some(&sign), _) if sign == b'?' || sign == name[place] => {
                (at, place) = (at + 1, place + 1);
            }
            (_, Some((before, from))) => {
                star = Some((before, from + 1));
                (at, place) = (before + 1, from + 1);
            }
            _ => return false,
        }
    }
    pattern[at..].iter().all(|&sign| sign == b'*')
}
