//! The formats that meshes are written in, and how.

use crate::CliError;
use crate::options::named;
use clap::Args;
use pixmesh_codec::{
    Alpha, Coloring, Compression, Encodable, EncodeOptions, Format, Geometry, LengthUnit,
    PngCompression, Relief, ReliefSource, Shading, Terrain, Texture, Texturing, UpAxis, ZOffset,
    encode,
};
use pixmesh_meshing::Image;
use std::ffi::OsStr;
use std::path::Path;

/// Headings of the help.
const FILES: &str = "Input and output";
const SPACE: &str = "Three dimensions";

/// The longest length, whatever the unit.
const MAX_LENGTH: f64 = 1e9;

/// What is written, and how.
#[derive(Args, Clone, Debug)]
pub struct OutputOptions {
    /// Format to write [default: by the ending of --output, else MODEL text of a picture, and the
    /// picture of a mesh as PNM]
    #[arg(long, help_heading = FILES, value_parser = named(Format::NAMES, Format::ALL))]
    format: Option<Format>,
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
    /// What is taken off every height: a length, or min for the height of the lowest vertex
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", default_value_t = ZOffset::default(),
        allow_negative_numbers = true)]
    z_offset: ZOffset,
    /// Length from one pixel to the next
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = positive_length,
        default_value_t = 1.0)]
    pixel_size: f64,
    /// Length of the mesh along x, instead of --pixel-size
    #[arg(long, help_heading = SPACE, value_name = "LENGTH", value_parser = positive_length,
        conflicts_with = "pixel_size")]
    width: Option<f64>,
    /// The middle of the picture lies at x = 0 and y = 0
    #[arg(long, help_heading = SPACE)]
    center: bool,
    /// Axis that heights follow [default: y for a relief in glTF, else z]
    #[arg(long, help_heading = SPACE, value_parser = named(UpAxis::NAMES, UpAxis::ALL))]
    up: Option<UpAxis>,
    /// What the vertices of glTF, PLY and OBJ show
    #[arg(long, help_heading = SPACE, default_value = "image",
        value_parser = named(Coloring::NAMES, Coloring::ALL))]
    color: Coloring,
    /// Unit of all lengths; glTF is scaled to metres, other formats hold the numbers as they are
    /// [default: mm for STL, else m]
    #[arg(long, help_heading = SPACE, value_parser = named(LengthUnit::NAMES, LengthUnit::ALL))]
    unit: Option<LengthUnit>,
}

impl OutputOptions {
    /// The format: the one named, else that of the file's ending, else `otherwise`.
    ///
    /// # Errors
    /// When no format has the ending.
    pub fn format(&self, path: Option<&Path>, otherwise: Format) -> Result<Format, CliError> {
        let ending = path.and_then(Path::extension).and_then(OsStr::to_str);
        match (self.format, ending) {
            (Some(format), _) => Ok(format),
            (None, None) => Ok(otherwise),
            (None, Some(ending)) => Format::of_file_ending(ending)
                .ok_or_else(|| CliError::Ending { ending: ending.to_owned() }),
        }
    }

    /// Whether the file shows the picture itself.
    #[must_use]
    pub fn shows_image(&self, format: Format) -> bool {
        format.holds_texture() && self.texture == Texturing::Embed
    }

    /// The picture to embed, if that is asked for.
    ///
    /// # Errors
    /// Never in practice: the file is made in memory.
    pub fn texture(
        &self,
        format: Format,
        picture: &[u8],
        image: &Image,
    ) -> Result<Option<Texture>, CliError> {
        let texture = || Texture::of_file_while(picture, image, &|| Ok(()));
        Ok(self.shows_image(format).then(texture).transpose()?)
    }

    /// Checks that a picture of so many components can be written so.
    ///
    /// # Errors
    /// When the relief is to follow a component that the picture does not have.
    pub fn check(&self, component_count: usize) -> Result<(), CliError> {
        Ok(self.geometry().check(component_count)?)
    }

    /// Writes a mesh in a format as the options say.
    ///
    /// # Errors
    /// When the format cannot hold the mesh.
    pub fn write(
        &self,
        source: &Encodable<'_>,
        format: Format,
        texture: Option<&Texture>,
        alpha: Alpha,
        terrain: Option<Terrain>,
    ) -> Result<Vec<u8>, CliError> {
        let options = EncodeOptions {
            cut: alpha.is_cut(),
            geometry: match terrain {
                Some(terrain) => terrain.geometry(self.geometry()),
                None => self.geometry(),
            },
            terrain,
            compression: self.compression,
            texture,
            shading: self.shading,
            png_compression: self.png_compression,
        };
        let mut bytes = Vec::new();
        encode(source, format, &options, &mut bytes, &|| Ok(()))?;
        Ok(bytes)
    }

    /// How the mesh lies in space.
    fn geometry(&self) -> Geometry {
        let relief = Relief::of_choices(self.relief, self.height, self.z_scale, self.invert_relief);
        let base = self.base.unwrap_or(0.0);
        Geometry {
            pixel_size: self.pixel_size,
            row_size: None,
            width: self.width,
            relief,
            base,
            z_offset: self.z_offset,
            center: self.center,
            up: self.up,
            color: self.color,
            unit: self.unit,
        }
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
pub(crate) fn positive_length(text: &str) -> Result<f64, String> {
    match length(text)? {
        length if length >= 1e-9 => Ok(length),
        _ => Err(format!("this length must lie in 1e-9 to {MAX_LENGTH}")),
    }
}
