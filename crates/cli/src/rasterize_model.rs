//! The program that rebuilds the picture of a mesh model.

use crate::attendant::Attendant;
use crate::{CliError, files};
use clap::{Parser, ValueEnum};
use pixmesh_meshing::rasterize;
use std::path::PathBuf;

/// Rebuilds the picture that a mesh model describes.
///
/// Reads MODEL text on standard input and writes the picture on standard output: PGM for one
/// component, PPM for three, PAM for any other number.
#[derive(Parser, Debug)]
#[command(name = "rasterize_model", version)]
pub struct RasterizeModel {
    /// Model to read instead of standard input
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// File to write instead of standard output
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Format of the picture
    #[arg(long, value_enum, default_value_t = PictureOut::Pnm)]
    format: PictureOut,
}

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
        let input = self.input.as_deref();
        let bytes = files::read(input)?;
        let mesh = pixmesh_codec::read_model(&bytes, &files::LIMITS).map_err(|source| {
            CliError::Model { name: files::name(input, "standard input"), source }
        })?;
        drop(bytes);
        let attendant = Attendant::new();
        let image = rasterize(&mesh, &attendant)?;
        let _stages = attendant.finish();
        let mut picture = Vec::new();
        match self.format {
            PictureOut::Pnm => pixmesh_codec::write_pnm(&image, &mut picture)?,
            PictureOut::Png => pixmesh_codec::write_png(&image, &mut picture)?,
        }
        files::write(self.output.as_ref(), &picture)
    }
}
