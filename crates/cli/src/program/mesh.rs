//! `pixmesh mesh`: a picture in, its mesh out.

use super::parameters::{MeshParameters, format};
use super::work::Telling;
use crate::{CliError, files};
use clap::Args;
use pixmesh_codec::Format;
use pixmesh_engine::pipeline::{self, Answer};
use pixmesh_engine::{MeshOptions, MeshTask, Weighed};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// What to make of a picture.
#[derive(Args, Debug)]
pub struct MeshOrder {
    /// Picture to read: PNG, JPEG, WebP, GIF, TIFF, BMP or PNM; - for standard input
    input: PathBuf,
    /// File to write; - for standard output
    #[arg(short, long, default_value = "-")]
    output: PathBuf,
    /// Picture of the same size: how much each pixel matters, black not at all
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    #[command(flatten)]
    parameters: MeshParameters,
    #[command(flatten)]
    telling: Telling,
}

impl MeshOrder {
    /// Makes the mesh, and writes it when it is whole.
    ///
    /// # Errors
    /// When the picture or a parameter is refused, or a file cannot be read or written.
    pub fn run(&self) -> Result<(), CliError> {
        let options = self.parameters.options()?;
        let output = files::named(&self.output);
        let format = format(options.format, output, options.usual_format.unwrap_or_default())?;
        let weights = self.weights.as_deref().map(|file| files::read(Some(file))).transpose()?;
        let answer = make(&self.input, weights, &options, format, &self.telling)?;
        files::replace(output, &answer.bytes)?;
        let (facts, line) = told(&self.input, output, format, &answer);
        self.telling.tell(&facts, &line, output.is_none())
    }
}

/// Makes the mesh of one picture.
pub(super) fn make(
    input: &Path,
    weights: Option<Vec<u8>>,
    options: &MeshOptions,
    format: Format,
    telling: &Telling,
) -> Result<Answer, CliError> {
    let input = files::named(input);
    let source = Weighed { image: files::read(input)?, weights };
    let limits = &files::LIMITS;
    let made = MeshTask::for_response(source.as_bytes(), options, format, limits).and_then(|_| {
        telling.work(|context| pipeline::mesh(source, options, format, limits, context))
    });
    made.map_err(|source| CliError::of_file(input, source))
}

/// What is told of a mesh, to machines and to people.
pub(super) fn told(
    input: &Path,
    output: Option<&Path>,
    format: Format,
    answer: &Answer,
) -> (Value, String) {
    let Answer { vertices, faces, psnr_db, mse, .. } = answer;
    let seconds: f64 = answer.timings.iter().map(|(_, took)| took.as_secs_f64()).sum();
    let (bytes, name) = (answer.bytes.len(), files::name(output, "standard output"));
    let facts = json!({
        "input": input.display().to_string(), "output": name, "format": format.name(),
        "bytes": bytes, "vertices": vertices, "faces": faces, "psnr_db": psnr_db, "mse": mse,
        "seconds": seconds,
    });
    let line = format!(
        "{name}: {vertices} vertices, {faces} faces, {psnr_db:.2} dB, {bytes} bytes, {seconds:.2} s"
    );
    (facts, line)
}
