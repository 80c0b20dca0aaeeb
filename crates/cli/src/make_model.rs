//! The program that makes a mesh model of a picture.

use crate::attendant::Attendant;
use crate::document::DocumentOptions;
use crate::options::{MeshOptions, named};
use crate::output::{OutputOptions, positive_length};
use crate::{CliError, files};
use clap::{CommandFactory, Parser};
use pixmesh_codec::{
    Alpha, DecodeOptions, Encodable, EncodeError, Format, Nodata, Terrain, Texture, model_comments,
};
use pixmesh_meshing::parameters::Weights;
use pixmesh_meshing::{
    Approximation, Image, MeshingError, OnThreads, Parameters, Progression, Removal, Stage,
    mesh_image, rasterize, structural_similarity,
};
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Makes a triangle-mesh model of a picture.
///
/// Reads a picture (PNM, PNG, JPEG, WebP, GIF, TIFF or BMP) on standard input and writes its mesh on
/// standard output, as MODEL text: width, height, number of components and bits per sample, then the
/// mesh as OFF. --format and the ending of --output choose glTF, SVG, PLY, OBJ, STL, JSON or the
/// rebuilt picture instead.
/// One of --density, --size, --target-psnr, --target-error and --max-error says how large or how good
/// the mesh is to be. Without one the mesh has 2 % of the picture's points as vertices.
///
/// Points are chosen by error diffusion of a density that follows the picture's second derivatives,
/// connected by the preferred-directions Delaunay triangulation, and removed one by one, the least
/// useful first, until the size asked for is reached. The same picture and options give the same
/// model on every machine.
#[derive(Parser, Debug)]
#[command(name = "make_model", version, after_long_help = MANUAL)]
pub struct MakeModel {
    #[command(flatten)]
    mesh: MeshOptions,
    /// Picture to read instead of standard input
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    input: Option<PathBuf>,
    /// File to write instead of standard output
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    output: Option<PathBuf>,
    /// What becomes of the picture's alpha: keep; cut or cut:0 to cut:254, which makes pixels of at
    /// most that alpha transparent (cut alone: 8) and leaves the triangles that show nothing out of
    /// every format but MODEL, pmesh and pictures; drop; or over:#rrggbb, composed over that colour
    #[arg(long, help_heading = FILES, value_name = "CHOICE", default_value_t = Alpha::Keep)]
    alpha: Alpha,
    /// Take a JPEG, PNG, GIF or PNM that ends early as far as it goes
    #[arg(long, help_heading = FILES)]
    lenient: bool,
    /// Height of a step of an elevation model's samples, over 0 [default: that of whole numbers, an
    /// eighth of --max-error, or the smallest that 16 bits allow]
    #[arg(long, help_heading = FILES, value_name = "HEIGHT", value_parser = positive_length)]
    step: Option<f64>,
    /// Whether an elevation model's missing samples are holes of the mesh or are filled
    #[arg(long, help_heading = FILES, default_value = Nodata::Hole.name(),
        value_parser = named(Nodata::NAMES, Nodata::ALL))]
    nodata: Nodata,
    #[command(flatten)]
    written: OutputOptions,
    /// File to write a line to for each removed point, in order: column, row from the bottom, and
    /// the change of the error in whole numbers
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    history_file: Option<PathBuf>,
    /// File to write the mesh to as pmesh, the compact binary form; not of --connectivity free
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    pmesh: Option<PathBuf>,
    /// File to write the mesh to as pmesh with the order of importance of its vertices, from which
    /// rasterize_model --size makes the mesh of any smaller size; not of --connectivity free,
    /// --values fitted or --reconstruction flat
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    progressive: Option<PathBuf>,
    /// Picture of the same size, gray or in colour: how much each point matters, black not at all
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// File to write the picture to that the model gives, as PNG
    #[arg(long, help_heading = FILES, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Print vertices, faces, MSE, PSNR, structural similarity (of pictures of at least 11 columns and
    /// rows) and the time of each stage on standard error
    #[arg(long, help_heading = FILES)]
    stats: bool,
    /// Threads to work on; the model does not depend on it [default: one for each core]
    #[arg(long, help_heading = FILES, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    #[command(flatten)]
    document: DocumentOptions,
}

/// Heading of the options for files.
const FILES: &str = "Input and output";

/// What the long help and the manual page end with.
const MANUAL: &str = "\
Examples:
  The good method MGPRFS at 2 %, the defaults:
    make_model --input picture.png --output picture.glb
  The fast method MED at 2 %:
    make_model --method med --density 2 < picture.ppm > picture.model
  The good method MGPRFS, which starts with 4 times the points:
    make_model --method mgprfs --density 2 --input picture.png > picture.model
  The same in the words of the thesis:
    make_model --density 2 --relative-initial-density 400 --initial-generator ed \\
      --ed-strategy max_comp_mmsodd_ed --ed-initial-error-mode mirror \\
      --bad-point-removal 0 < picture.ppm > picture.model
  The smallest mesh on the way down that has at least 30 dB:
    make_model --target-psnr 30 --stats < picture.ppm > picture.model

  A watertight lithophane of 100 mm width for a printer, from a picture 400 pixels wide:
    make_model --method mgprfs --density 20 --invert-relief --height 2.2 --base 0.8 \
      --pixel-size 0.25 --unit mm --input picture.jpg --output lithophane.stl
  A compressed relief of an elevation model of 16 bits, a metre a step, 30 metres a pixel:
    make_model --method mgprfs --density 1 --z-scale 1 --pixel-size 30 --compression meshopt \
      --input elevation.tif --output relief.glb

Exit status:
  0 when the model was written, 1 when the picture or an option's value was refused, 2 when the
  command line could not be understood.

See also:
  rasterize_model rebuilds the picture, and writes meshes in other formats. The methods are those of the thesis \"Effective Techniques
  for Generating Delaunay Mesh Models of Single- and Multi-Component Images\", University of
  Victoria.";

impl MakeModel {
    /// The threads to work on.
    fn threads(&self) -> NonZeroUsize {
        let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        self.threads.unwrap_or_else(cores)
    }

    /// Runs the program.
    ///
    /// # Errors
    /// When the picture cannot be read, an option is not allowed for it, or the model cannot be
    /// written.
    pub fn run(&self) -> Result<(), CliError> {
        if let Some(text) = self.document.text(&mut Self::command())? {
            return files::write(None, &text);
        }
        // A wrong ending is refused before any work.
        let format = self.written.format(self.output.as_deref(), Format::Model)?;
        let input = self.input.as_deref();
        let bytes = files::read(input)?;
        let start = Instant::now();
        let Self { alpha, lenient, step, nodata, .. } = *self;
        let (limits, bound, max_bytes) = (files::LIMITS, self.mesh.max_error, None);
        let reading = DecodeOptions { limits, alpha, lenient, step, bound, nodata, max_bytes };
        let (image, terrain) =
            reading.decode_terrain_while(&bytes, &|| Ok(())).map_err(|source| {
                CliError::Picture { name: files::name(input, "standard input"), source }
            })?;
        let decoding = start.elapsed();
        let texture = self.written.texture(format, &bytes, &image)?;
        drop(bytes);
        self.written.check(image.component_count())?;
        let parameters = self.mesh.parameters(image.component_count());
        let parameters = parameters
            .map_err(MeshingError::from)?
            .weights(self.weights(&image)?)
            .covers_alpha(alpha.is_cut())
            .lists_removals(self.history_file.is_some());
        let parameters = match &terrain {
            Some(terrain) => terrain.parameters(parameters, bound).map_err(MeshingError::from)?,
            None => parameters,
        };
        let attendant = Attendant::new();
        let control = OnThreads(&attendant, self.threads());
        let model = mesh_image(&image, &parameters, &control)?;
        let stages = attendant.finish();
        let progression = self.progression(&image, &parameters, &model, format)?;
        let source = Encodable {
            comments: &model_comments(&parameters),
            progression: progression.as_ref(),
            ..Encodable::from(&model)
        };
        let encoding = self.write(&model, &source, format, texture.as_ref(), terrain)?;
        self.write_compact(&model, progression.as_ref(), terrain.as_ref())?;
        if self.stats {
            let ssim = structural_similarity(&image, &rasterize(&model.mesh, &())?, &())?;
            // Statistics that nobody can read are no reason to fail.
            let _ = print_statistics(&model, ssim, decoding, &stages, encoding);
        }
        Ok(())
    }

    /// The weights that a second picture says, if one is given.
    fn weights(&self, image: &Image) -> Result<Option<Weights>, CliError> {
        let Some(file) = &self.weights else { return Ok(None) };
        let bytes = files::read(Some(file))?;
        let name = || files::name(Some(file), "weights");
        pixmesh_codec::read_weights(&bytes, (image.width(), image.height()), &files::LIMITS)
            .map(Some)
            .map_err(|source| CliError::Weights { name: name(), source })
    }

    /// The order of the mesh's vertices, when a file with it is asked for.
    fn progression(
        &self,
        image: &Image,
        parameters: &Parameters,
        model: &Approximation,
        format: Format,
    ) -> Result<Option<Progression>, CliError> {
        if format != Format::Progression && self.progressive.is_none() {
            return Ok(None);
        }
        if !parameters.is_of_points_alone() {
            return Err(EncodeError::NotOfPointsAlone { format: "progression" }.into());
        }
        Ok(Some(Progression::new(image, &model.mesh, parameters, &())?))
    }

    /// Writes the mesh in the compact forms asked for.
    fn write_compact(
        &self,
        model: &Approximation,
        progression: Option<&Progression>,
        terrain: Option<&Terrain>,
    ) -> Result<(), CliError> {
        if let Some(file) = &self.pmesh {
            let mut bytes = Vec::new();
            pixmesh_codec::write_pmesh_while(&model.mesh, terrain, &mut bytes, &|| Ok(()))?;
            files::write(Some(file), &bytes)?;
        }
        if let (Some(file), Some(progression)) = (&self.progressive, progression) {
            let mut bytes = Vec::new();
            pixmesh_codec::write_progression(progression, terrain, &mut bytes)?;
            files::write(Some(file), &bytes)?;
        }
        Ok(())
    }

    /// Writes the model and the history, and tells how long the model took to encode.
    fn write(
        &self,
        model: &Approximation,
        source: &Encodable<'_>,
        format: Format,
        texture: Option<&Texture>,
        terrain: Option<Terrain>,
    ) -> Result<Duration, CliError> {
        let start = Instant::now();
        let bytes = self.written.write(source, format, texture, self.alpha, terrain)?;
        let encoding = start.elapsed();
        files::write(self.output.as_ref(), &bytes)?;
        if let Some(file) = &self.picture {
            let mut png = Vec::new();
            pixmesh_codec::write_png(&rasterize(&model.mesh, &())?, &mut png)?;
            files::write(Some(file), &png)?;
        }
        if self.history_file.is_some() {
            files::write(self.history_file.as_ref(), history(&model.removals).as_bytes())?;
        }
        Ok(encoding)
    }
}

/// The removed points, a line each.
fn history(removals: &[Removal]) -> String {
    let line = |removal: &Removal| {
        let Removal { point, change } = removal;
        format!("{} {} {change}\n", point.x, point.y)
    };
    removals.iter().map(line).collect()
}

/// Prints the figures of a mesh and where the time went, a line each.
fn print_statistics(
    model: &Approximation,
    ssim: Option<f64>,
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
    if let Some(ssim) = ssim {
        writeln!(errors, "ssim         {ssim:.4}")?;
    }
    let times = stages.iter().map(|(stage, time)| (stage.name(), *time));
    let codec = |name, time| std::iter::once((name, time));
    for (name, time) in codec("decode", decoding).chain(times).chain(codec("encode", encoding)) {
        writeln!(errors, "{name:<12} {:.3} ms", 1e3 * time.as_secs_f64())?;
    }
    Ok(())
}
