//! The formats that meshes are written in, and how.

use crate::CliError;
use crate::options::named;
use clap::{Args, ValueEnum};
use pixmesh_codec::{
    Compression, EncodeError, Geometry, GltfOptions, LengthUnit, PngCompression, Relief,
    ReliefHeight, ReliefSource, Shading, Texture, Texturing, model_comments,
};
use pixmesh_meshing::{Approximation, Image, Parameters, rasterize};
use std::borrow::Cow;
use std::path::Path;

/// Headings of the help.
const FILES: &str = "Input and output";
const SPACE: &str = "Three dimensions";

/// The longest length, whatever the unit.
const MAX_LENGTH: f64 = 1e9;

/// What is written, and how.
#[derive(Args, Clone, Debug)]
pub struct OutputOptions {
    /// Format to write [default: by the ending of --output, else model]
    #[arg(long, help_heading = FILES, value_enum)]
    format: Option<MeshFormat>,
    /// How glTF stores vertices and indices: none, 16-bit integers, or those compressed
    #[arg(long, help_heading = FILES, default_value = "none",
        value_parser = named(Compression::NAMES, Compression::ALL))]
    compression: Compression,
    /// What glTF shows: the vertices' colours, or the picture itself, embedded
    #[arg(long, help_heading = FILES, default_value = "none",
        value_parser = named(Texturing::NAMES, Texturing::ALL))]
    texture: Texturing,
    /// How SVG fills triangles
    #[arg(long, help_heading = FILES, default_value = "flat",
        value_parser = named(Shading::NAMES, Shading::ALL))]
    shading: Shading,
    /// Whether a PNG is made fast or small
    #[arg(long, help_heading = FILES, default_value = "fast",
        value_parser = named(PngCompression::NAMES, PngCompression::ALL))]
    png_compression: PngCompression,
    /// What becomes z: the luma, or a component [default: nothing; for STL luma]
    #[arg(long, help_heading = SPACE, value_parser = named(ReliefSource::NAMES, ReliefSource::ALL))]
    relief: Option<ReliefSource>,
    /// Height of the relief at the largest sample; makes a relief [default: a tenth of the longer
    /// side]
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = length)]
    height: Option<f64>,
    /// Height of the relief per step of a sample, as in elevation models; makes a relief
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = length,
        conflicts_with = "height")]
    z_scale: Option<f64>,
    /// Dark is high and bright is low, as lithophanes want it; makes a relief
    #[arg(long, help_heading = SPACE)]
    invert_relief: bool,
    /// How far a base reaches below the relief, which makes a watertight solid [default: none; for
    /// STL a quarter of the height]
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = length)]
    base: Option<f64>,
    /// Length from one pixel to the next
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = positive_length,
        default_value_t = 1.0)]
    pixel_size: f64,
    /// Unit of all lengths; glTF is scaled to metres, other formats hold the numbers as they are
    #[arg(long, help_heading = SPACE, default_value = "m",
        value_parser = named(LengthUnit::NAMES, LengthUnit::ALL))]
    unit: LengthUnit,
}

/// A format that meshes are written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MeshFormat {
    /// MODEL text.
    Model,
    /// glTF 2.0, binary.
    Glb,
    /// glTF 2.0 as JSON, its buffer within.
    Gltf,
    /// The triangles as SVG.
    Svg,
    /// PLY, binary.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// STL of a solid, binary.
    Stl,
    /// The figures and the arrays as JSON.
    Json,
    /// Points and samples, compressed.
    Pmesh,
    /// The picture rebuilt from the mesh, as PNG.
    Png,
    /// The same as PGM, PPM or PAM.
    Pnm,
}

impl MeshFormat {
    /// The format that a file's ending names.
    #[must_use]
    pub fn of_path(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        match ending.as_str() {
            "pgm" | "ppm" | "pam" => Some(Self::Pnm),
            ending => Self::from_str(ending, true).ok(),
        }
    }
}

impl OutputOptions {
    /// The format: the one named, else that of the file's ending, else MODEL.
    fn format(&self, path: Option<&Path>) -> MeshFormat {
        let of_path = || path.and_then(MeshFormat::of_path);
        self.format.or_else(of_path).unwrap_or(MeshFormat::Model)
    }

    /// The picture to embed, if that is asked for.
    ///
    /// # Errors
    /// Never in practice: the file is made in memory.
    pub fn texture(
        &self,
        path: Option<&Path>,
        picture: &[u8],
        image: &Image,
    ) -> Result<Option<Texture>, CliError> {
        let is_gltf = matches!(self.format(path), MeshFormat::Glb | MeshFormat::Gltf);
        let wanted = is_gltf && self.texture == Texturing::Embed;
        Ok(wanted.then(|| Texture::of_file(picture, image)).transpose()?)
    }

    /// Checks that a picture of so many components can be written so.
    ///
    /// # Errors
    /// When the relief is to follow a component that the picture does not have.
    pub fn check(&self, component_count: usize) -> Result<(), CliError> {
        Ok(self.geometry().check(component_count)?)
    }

    /// Writes a mesh in the format that the options and the file's ending say.
    ///
    /// # Errors
    /// When the format cannot hold the mesh.
    pub fn write(
        &self,
        model: &Approximation,
        parameters: &Parameters,
        path: Option<&Path>,
        texture: Option<&Texture>,
    ) -> Result<Vec<u8>, CliError> {
        let (mesh, geometry) = (&model.mesh, self.geometry());
        let gltf = GltfOptions { geometry, compression: self.compression, texture };
        let mut bytes = Vec::new();
        let out = &mut bytes;
        match self.format(path) {
            MeshFormat::Model => {
                pixmesh_codec::write_model_with_comments(mesh, &model_comments(parameters), out)
                    .map_err(EncodeError::from)?;
            }
            MeshFormat::Glb => pixmesh_codec::write_glb(mesh, &gltf, out)?,
            MeshFormat::Gltf => pixmesh_codec::write_gltf(mesh, &gltf, out)?,
            MeshFormat::Svg => pixmesh_codec::write_svg(mesh, self.shading, out)?,
            MeshFormat::Ply => pixmesh_codec::write_ply(mesh, &geometry, out)?,
            MeshFormat::Obj => pixmesh_codec::write_obj(mesh, &geometry, out)?,
            MeshFormat::Stl => pixmesh_codec::write_stl(mesh, &geometry, out)?,
            MeshFormat::Json => {
                pixmesh_codec::write_json(mesh, Some(&model.fidelity), &geometry, out)?;
            }
            MeshFormat::Pmesh => pixmesh_codec::write_pmesh(mesh, out)?,
            MeshFormat::Png => {
                let picture = picture_of(model)?;
                pixmesh_codec::write_png_with(&picture, self.png_compression, out)?;
            }
            MeshFormat::Pnm => pixmesh_codec::write_pnm(picture_of(model)?.as_ref(), out)?,
        }
        Ok(bytes)
    }

    /// How the mesh lies in space.
    fn geometry(&self) -> Geometry {
        let height = self.height.map(ReliefHeight::Total);
        let height = height.or(self.z_scale.map(ReliefHeight::PerSample));
        let wanted = self.relief.is_some() || height.is_some() || self.invert_relief;
        let relief = wanted.then(|| Relief {
            source: self.relief.unwrap_or_default(),
            height: height.unwrap_or_default(),
            invert: self.invert_relief,
        });
        let base = self.base.unwrap_or(0.0);
        Geometry { pixel_size: self.pixel_size, relief, base, unit: self.unit }
    }
}

/// The picture that a model gives: of one colour for each face, where it is made for that.
pub(crate) fn picture_of(model: &Approximation) -> Result<Cow<'_, Image>, CliError> {
    match &model.flat {
        Some(flat) => Ok(Cow::Borrowed(&flat.picture)),
        None => Ok(Cow::Owned(rasterize(&model.mesh, &())?)),
    }
}

/// A length of 0 to [`MAX_LENGTH`].
fn length(text: &str) -> Result<f64, String> {
    let length = text.parse::<f64>().map_err(|error| error.to_string())?;
    if (0.0..=MAX_LENGTH).contains(&length) {
        return Ok(length);
    }
    Err(format!("a length must lie in 0 to {MAX_LENGTH}"))
}

/// A length that is not 0.
fn positive_length(text: &str) -> Result<f64, String> {
    match length(text)? {
        length if length >= 1e-9 => Ok(length),
        _ => Err(format!("this length must lie in 1e-9 to {MAX_LENGTH}")),
    }
}
