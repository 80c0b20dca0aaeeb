//! `pixmesh convert` and `pixmesh render`: a mesh file in, another format or its picture out.

use super::parameters::{WritingParameters, format};
use super::work::Telling;
use crate::{CliError, files};
use clap::Args;
use pixmesh_codec::{Format, PmeshError, probe_mesh};
use pixmesh_engine::EngineError;
use pixmesh_engine::params::whole_between;
use pixmesh_engine::pipeline::{self, Conversion, Shown};
use pixmesh_meshing::parameters::MIN_SIZE;
use serde_json::json;
use std::path::PathBuf;

/// A mesh to write in another format.
#[derive(Args, Debug)]
pub struct ConvertOrder {
    /// Mesh to read: MODEL or pmesh; - for standard input
    input: PathBuf,
    /// File to write; - for standard output
    #[arg(short, long, default_value = "-")]
    output: PathBuf,
    /// Picture that the mesh was made of, which --texture embed shows
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    #[command(flatten)]
    parameters: WritingParameters,
    #[command(flatten)]
    telling: Telling,
}

/// A mesh to make the picture of.
#[derive(Args, Debug)]
pub struct RenderOrder {
    #[command(flatten)]
    order: ConvertOrder,
}

impl ConvertOrder {
    /// Converts the mesh, and writes it when it is whole.
    ///
    /// # Errors
    /// When the mesh or a parameter is refused, or a file cannot be read or written.
    pub fn run(&self) -> Result<(), CliError> {
        self.write(self.format(Format::Model)?)
    }

    fn format(&self, otherwise: Format) -> Result<Format, CliError> {
        let given = self.parameters.options()?.format;
        format(given, files::named(&self.output), otherwise)
    }

    fn write(&self, format: Format) -> Result<(), CliError> {
        let (input, output) = (files::named(&self.input), files::named(&self.output));
        let mut written = self.parameters.writing()?.output;
        let reconstruction = self.parameters.get("reconstruction").map(str::parse).transpose();
        written.reconstruction = reconstruction.map_err(EngineError::from)?;
        let shown = match &self.image {
            Some(image) => Some(Shown::Picture(files::read(Some(image))?)),
            None if written.shows_image(format) => return Err(CliError::NoImage),
            None => None,
        };
        let file = files::read(input)?;
        let size = self.size(&file).map_err(|source| CliError::of_file(input, source))?;
        let order = Conversion { file, shown, size, format, output: written, mse: None };
        let made = self.telling.work(|context| pipeline::convert(order, &files::LIMITS, context));
        let made = made.map_err(|source| CliError::of_file(input, source))?;
        files::replace(output, &made.bytes)?;
        let (name, bytes) = (files::name(output, "standard output"), made.bytes.len());
        let (vertices, faces) = (made.vertices, made.faces);
        let facts = json!({
            "input": self.input.display().to_string(), "output": name, "format": format.name(),
            "bytes": bytes, "vertices": vertices, "faces": faces,
        });
        let line = format!("{name}: {vertices} vertices, {faces} faces, {bytes} bytes");
        self.telling.tell(&facts, &line, output.is_none())
    }

    /// The number of vertices asked for, where it is less than the mesh has.
    fn size(&self, file: &[u8]) -> Result<Option<usize>, EngineError> {
        let Some(text) = self.parameters.get("size") else { return Ok(None) };
        let header = probe_mesh(file, &files::LIMITS)?;
        let size = whole_between("size", text, MIN_SIZE as u64, header.vertices as u64)? as usize;
        if size < header.vertices && header.format != Format::Progression {
            return Err(pixmesh_codec::MeshFileError::from(PmeshError::NoOrder).into());
        }
        Ok((size < header.vertices).then_some(size))
    }
}

impl RenderOrder {
    /// Rebuilds the picture, and writes it when it is whole.
    ///
    /// # Errors
    /// As [`ConvertOrder::run`], and when the format is none of a picture.
    pub fn run(&self) -> Result<(), CliError> {
        let format = self.order.format(Format::Png)?;
        if !matches!(format, Format::Png | Format::Pnm) {
            return Err(CliError::NoPicture { format: format.name() });
        }
        self.order.write(format)
    }
}
