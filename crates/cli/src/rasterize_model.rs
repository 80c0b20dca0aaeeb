//! The program that rebuilds the picture of a mesh model.

use crate::attendant::Attendant;
use crate::document::DocumentOptions;
use crate::options::named;
use crate::{CliError, files};
use clap::{CommandFactory, Parser, ValueEnum};
use pixmesh_codec::PngCompression;
use pixmesh_meshing::{Mesh, rasterize};
use std::path::PathBuf;

/// Rebuilds the picture that a mesh model describes.
///
/// Reads MODEL text or a pmesh on standard input and writes the picture on standard output: PGM for one
/// component, PPM for three, PAM for any other number.
#[derive(Parser, Debug)]
#[command(name = "rasterize_model", version, after_long_help = MANUAL)]
pub struct RasterizeModel {
    /// Model to read instead of standard input
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// File to write instead of standard output
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Format of the picture [default: by the ending of --output, else pnm]
    #[arg(long, value_enum)]
    format: Option<PictureOut>,
    /// Whether a PNG is made fast or small
    #[arg(long, default_value = "fast",
        value_parser = named(PngCompression::NAMES, PngCompression::ALL))]
    png_compression: PngCompression,
    /// Vertices of the mesh, of those of a pmesh that keeps the order of their importance
    #[arg(long, value_name = "COUNT")]
    size: Option<usize>,
    #[command(flatten)]
    document: DocumentOptions,
}

/// What the long help and the manual page end with.
const MANUAL: &str = "\
Examples:
  make_model --method mgprfs --density 2 < picture.ppm | rasterize_model > rebuilt.ppm
  rasterize_model --input picture.model --format png --output rebuilt.png

Exit status:
  0 when the picture was written, 1 when the model was refused, 2 when the command line could not be
  understood.

See also:
  make_model makes the models.";

/// A format that pictures are written in.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PictureOut {
    /// PGM, PPM or PAM.
    Pnm,
    /// PNG.
    Png,
}

impl RasterizeModel {
    /// Runs the program.
    ///
    /// # Errors
    /// When the model cannot be read, or the picture cannot be written.
    pub fn run(&self) -> Result<(), CliError> {
        if let Some(text) = self.document.text(&mut Self::command())? {
            return files::write(None, &text);
        }
        let input = self.input.as_deref();
        let bytes = files::read(input)?;
        let mesh = self.mesh(&bytes)?;
        drop(bytes);
        let attendant = Attendant::new();
        let image = rasterize(&mesh, &attendant)?;
        let _stages = attendant.finish();
        let mut picture = Vec::new();
        match self.format() {
            PictureOut::Pnm => pixmesh_codec::write_pnm(&image, &mut picture)?,
            PictureOut::Png => {
                let compression = self.png_compression;
                pixmesh_codec::write_png_while(&image, compression, &mut picture, &|| Ok(()))?;
            }
        }
        files::write(self.output.as_ref(), &picture)
    }

    /// The format: the one named, else that of the file's ending, else PNM.
    fn format(&self) -> PictureOut {
        let ending = self.output.as_deref().and_then(|path| path.extension());
        let is_png = ending.is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
        self.format.unwrap_or(if is_png { PictureOut::Png } else { PictureOut::Pnm })
    }

    /// The mesh that a file holds, or the one of a smaller size.
    fn mesh(&self, bytes: &[u8]) -> Result<Mesh, CliError> {
        let name = || files::name(self.input.as_deref(), "standard input");
        let damaged = |source| CliError::Pmesh { name: name(), source };
        if let Some(size) = self.size {
            let read = pixmesh_codec::read_progression(bytes, &files::LIMITS);
            let mesh = read.map_err(damaged)?.mesh(size, &());
            return mesh.map_err(|source| damaged(source.into()));
        }
        if pixmesh_codec::is_pmesh(bytes) {
            return pixmesh_codec::read_pmesh(bytes, &files::LIMITS).map_err(damaged);
        }
        pixmesh_codec::read_model(bytes, &files::LIMITS)
            .map_err(|source| CliError::Model { name: name(), source })
    }
}
