//! The program that reads a mesh file, and writes its picture or the mesh in another format.

use crate::document::DocumentOptions;
use crate::output::OutputOptions;
use crate::{CliError, files};
use clap::{CommandFactory, Parser};
use pixmesh_codec::{Alpha, Encodable, Format, PmeshError, Terrain, Texture};
use pixmesh_meshing::{Fidelity, Mesh, Progression, ProgressionError};
use std::path::PathBuf;

/// Rebuilds the picture that a mesh describes, or writes the mesh in another format.
///
/// Reads MODEL text or a pmesh on standard input and writes the picture on standard output: PGM for one
/// component, PPM for three, PAM for any other number. --format and the ending of --output choose PNG,
/// glTF, SVG, PLY, OBJ, STL, JSON, MODEL or pmesh instead.
#[derive(Parser, Debug)]
#[command(name = "rasterize_model", version, after_long_help = MANUAL)]
pub struct RasterizeModel {
    /// Mesh to read instead of standard input
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// File to write instead of standard output
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    written: OutputOptions,
    /// Vertices of the mesh, of those of a pmesh that keeps the order of their importance
    #[arg(long, value_name = "COUNT")]
    size: Option<usize>,
    /// Whether triangles that show nothing are left out, but of MODEL, pmesh and pictures: keep or cut
    #[arg(long, value_name = "CHOICE", default_value_t = Alpha::Keep, value_parser = written_alpha)]
    alpha: Alpha,
    /// Picture that the mesh was made of, which --texture embed shows
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    #[command(flatten)]
    document: DocumentOptions,
}

/// A choice for alpha that says how a mesh is written.
fn written_alpha(text: &str) -> Result<Alpha, String> {
    match text {
        "keep" => Ok(Alpha::Keep),
        "cut" => Ok(Alpha::Cut(Alpha::CUT)),
        _ => Err("allowed are keep and cut".into()),
    }
}

/// What the long help and the manual page end with.
const MANUAL: &str = "\
Examples:
  make_model --method mgprfs --density 2 < picture.ppm | rasterize_model > rebuilt.ppm
  rasterize_model --input picture.model --output rebuilt.png
  make_model --input picture.png --format progression --output picture.pmesh
  rasterize_model --input picture.pmesh --size 500 --output small.glb

Exit status:
  0 when the picture or the mesh was written, 1 when the mesh was refused, 2 when the command line could
  not be understood.

See also:
  make_model makes the meshes.";

/// A mesh, and what its file says of it.
struct Source {
    mesh: Mesh,
    progression: Option<Progression>,
    fidelity: Option<Fidelity>,
    terrain: Option<Terrain>,
}

impl RasterizeModel {
    /// Runs the program.
    ///
    /// # Errors
    /// When the mesh cannot be read, or the result cannot be written.
    pub fn run(&self) -> Result<(), CliError> {
        if let Some(text) = self.document.text(&mut Self::command())? {
            return files::write(None, &text);
        }
        // A wrong ending is refused before any work.
        let format = self.written.format(self.output.as_deref(), Format::Pnm)?;
        let bytes = files::read(self.input.as_deref())?;
        let Source { mesh, progression, fidelity, terrain } = self.source(&bytes, format)?;
        drop(bytes);
        self.written.check(mesh.shape().component_count)?;
        let texture = self.texture(&mesh, format)?;
        let source = Encodable {
            progression: progression.as_ref(),
            fidelity: fidelity.as_ref(),
            ..Encodable::new(&mesh)
        };
        files::write(
            self.output.as_ref(),
            &self.written.write(&source, format, texture.as_ref(), self.alpha, terrain)?,
        )
    }

    /// The mesh that a file holds, or the one of a smaller size.
    fn source(&self, bytes: &[u8], format: Format) -> Result<Source, CliError> {
        let name = || files::name(self.input.as_deref(), "standard input");
        let damaged = |source| CliError::Mesh { name: name(), source };
        let header = pixmesh_codec::probe_mesh(bytes, &files::LIMITS).map_err(damaged)?;
        let needs_order = self.size.is_some() || format == Format::Progression;
        if header.format != Format::Progression {
            if needs_order {
                return Err(damaged(PmeshError::NoOrder.into()));
            }
            let mesh = pixmesh_codec::read_mesh_while(bytes, &files::LIMITS, &|| Ok(()));
            let (mesh, terrain) = (mesh.map_err(damaged)?, header.terrain);
            return Ok(Source { mesh, progression: None, fidelity: None, terrain });
        }
        let damaged = |source: PmeshError| damaged(source.into());
        let read = pixmesh_codec::read_progression(bytes, &files::LIMITS).map_err(damaged)?;
        let size = self.size.unwrap_or(header.vertices);
        let terrain = header.terrain.map(|terrain| terrain.of_size(size, header.vertices));
        let cut = || {
            let progression = read.shortened(size)?;
            let (mesh, fidelity) = (progression.mesh(size, &())?, progression.fidelity(size)?);
            Ok(Source { mesh, progression: Some(progression), fidelity: Some(fidelity), terrain })
        };
        cut().map_err(|error: ProgressionError| damaged(error.into()))
    }

    /// The picture to embed, if that is asked for.
    fn texture(&self, mesh: &Mesh, format: Format) -> Result<Option<Texture>, CliError> {
        if !self.written.shows_image(format) {
            return Ok(None);
        }
        let file = self.image.as_ref().ok_or(CliError::NoImage)?;
        let bytes = files::read(Some(file))?;
        let image = pixmesh_codec::decode(&bytes, &files::LIMITS)
            .map_err(|source| CliError::Picture { name: file.display().to_string(), source })?;
        let (picture, shape) = ((image.width(), image.height()), mesh.shape());
        if picture != (shape.width, shape.height) {
            return Err(CliError::OtherSize { picture, mesh: (shape.width, shape.height) });
        }
        self.written.texture(format, &bytes, &image)
    }
}
