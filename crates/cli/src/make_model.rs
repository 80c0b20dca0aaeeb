//! The program that makes a mesh model of a picture.

use crate::attendant::Attendant;
use crate::options::MeshOptions;
use crate::{CliError, files};
use clap::Parser;
use pixmesh_meshing::{Model, Stage, generate};
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Makes a triangle-mesh model of a picture.
///
/// Reads a picture (PNM, PNG or JPEG) on standard input and writes its mesh as MODEL text on
/// standard output: width, height, number of components and bits per sample, then the mesh as OFF.
/// One of --density, --size and --psnr says how large or how good the mesh is to be.
#[derive(Parser, Debug)]
#[command(name = "make_model", version, after_help = EXAMPLES)]
pub struct MakeModel {
    #[command(flatten)]
    mesh: MeshOptions,
    /// Picture to read instead of standard input
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// File to write instead of standard output
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print vertices, faces, MSE, PSNR and the time of each stage on standard error
    #[arg(long)]
    stats: bool,
}

/// What the help ends with.
const EXAMPLES: &str = "\
Examples:
  The fast method MED at 2 %:
    make_model --method med --density 2 < picture.ppm > picture.model
  The good method MGPRFS, which starts with 4 times the points:
    make_model --method mgprfs --density 2 --input picture.png > picture.model
  The same in the words of the thesis:
    make_model --density 2 --relative-initial-density 400 --initial-generator ed
      --ed-strategy max_comp_mmsodd_ed --ed-initial-error-mode mirror --bad-point-removal 0";

impl MakeModel {
    /// Runs the program.
    ///
    /// # Errors
    /// When the picture cannot be read, an option is not allowed for it, or the model cannot be
    /// written.
    pub fn run(&self) -> Result<(), CliError> {
        let input = self.input.as_deref();
        let bytes = files::read(input)?;
        let start = Instant::now();
        let image = pixmesh_codec::decode(&bytes, &files::LIMITS).map_err(|source| {
            CliError::Picture { name: files::name(input, "standard input"), source }
        })?;
        drop(bytes);
        let decoding = start.elapsed();
        let parameters = self
            .mesh
            .parameters(image.component_count())
            .map_err(pixmesh_meshing::GenerateError::from)?;
        let attendant = Attendant::new();
        let model = generate(&image, &parameters, &attendant)?;
        let stages = attendant.finish();
        let start = Instant::now();
        let mut text = Vec::new();
        pixmesh_codec::write_model(&model.mesh, &mut text)
            .map_err(pixmesh_codec::EncodeError::from)?;
        let encoding = start.elapsed();
        files::write(self.output.as_ref(), &text)?;
        if self.stats {
            // Statistics that nobody can read are no reason to fail.
            let _ = print_statistics(&model, decoding, &stages, encoding);
        }
        Ok(())
    }
}

/// Prints the figures of a mesh and where the time went, a line each.
fn print_statistics(
    model: &Model,
    decoding: Duration,
    stages: &[(Stage, Duration)],
    encoding: Duration,
) -> std::io::Result<()> {
    let mut errors = std::io::stderr().lock();
    let fidelity = model.fidelity;
    writeln!(errors, "vertices     {}", model.mesh.points().len())?;
    writeln!(errors, "faces        {}", model.mesh.faces().len())?;
    writeln!(errors, "mse          {:.4}", fidelity.mse())?;
    writeln!(errors, "psnr_db      {:.4}", fidelity.psnr_db())?;
    let times = stages.iter().map(|(stage, time)| (stage.name(), *time));
    let codec = |name, time| std::iter::once((name, time));
    for (name, time) in codec("decode", decoding).chain(times).chain(codec("encode", encoding)) {
        writeln!(errors, "{name:<12} {:.3} ms", 1e3 * time.as_secs_f64())?;
    }
    Ok(())
}
