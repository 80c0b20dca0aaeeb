//! How the image is read and the mesh is written: what the parameters that do not change the mesh
//! itself mean together.

use super::Choices;
use crate::error::EngineError;
use pixmesh_codec::{
    Alpha, Compression, DecodeOptions, EncodeOptions, Format, Geometry, Limits, Nodata,
    PngCompression, Relief, Shading, Terrain, Texture, Texturing,
};
use pixmesh_meshing::Shape;
use pixmesh_meshing::parameters::Reconstruction;

/// The parameters that change how a mesh is written, and not the mesh. Of `alpha` these are
/// [`WRITTEN_ALPHAS`].
pub const WRITING: [&str; 17] = [
    "alpha",
    "relief",
    "height",
    "z_scale",
    "invert_relief",
    "base",
    "z_offset",
    "pixel_size",
    "width",
    "center",
    "up",
    "color",
    "unit",
    "compression",
    "texture",
    "shading",
    "png_compression",
];

/// The values of `alpha` that say how a mesh is written.
pub const WRITTEN_ALPHAS: &[&str] = &["keep", "cut"];

/// How the image is read and the mesh is written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Output {
    /// What becomes of the image's alpha.
    pub alpha: Alpha,
    /// Whether an image that ends early is taken as far as it goes.
    pub lenient: bool,
    /// Whether a job keeps the image as it was sent.
    pub keep_image: bool,
    /// The height of a step of an elevation model's samples.
    pub step: Option<f64>,
    /// The largest error that the mesh may have, in units of an elevation model's heights.
    pub bound: Option<f64>,
    /// What becomes of an elevation model's missing samples.
    pub nodata: Nodata,
    /// How the mesh lies in space.
    pub geometry: Geometry,
    /// How glTF stores vertices and indices.
    pub compression: Compression,
    /// What glTF shows.
    pub texture: Texturing,
    /// How SVG fills triangles.
    pub shading: Shading,
    /// How much time a PNG may take.
    pub png_compression: PngCompression,
    /// How a picture of the mesh is rebuilt; `None` as the mesh was made for.
    pub reconstruction: Option<Reconstruction>,
}

impl Output {
    /// How images are decoded.
    #[must_use]
    pub fn reading(&self, limits: &Limits) -> DecodeOptions {
        let Self { alpha, lenient, step, bound, nodata, .. } = *self;
        let limits = *limits;
        DecodeOptions { limits, alpha, lenient, step, bound, nodata, max_bytes: None }
    }

    /// Whether the answer shows the image itself.
    #[must_use]
    pub fn shows_image(&self, format: Format) -> bool {
        format.holds_texture() && self.texture == Texturing::Embed
    }

    /// How the mesh is encoded, with the image to show in it. That of an elevation model lies at its
    /// place and size by default.
    #[must_use]
    pub fn writing<'a>(
        &self,
        texture: Option<&'a Texture>,
        terrain: Option<Terrain>,
    ) -> EncodeOptions<'a> {
        let Self { geometry, compression, shading, png_compression, .. } = *self;
        let cut = self.alpha.is_cut();
        let geometry = terrain.map_or(geometry, |terrain| terrain.geometry(geometry));
        EncodeOptions { geometry, compression, texture, shading, cut, terrain, png_compression }
    }

    /// Checks what is asked for against the image.
    ///
    /// # Errors
    /// When the relief is to follow a component that the image does not have.
    pub fn check(&self, shape: Shape) -> Result<(), EngineError> {
        Ok(self.geometry.check(shape.component_count)?)
    }
}

impl Choices {
    /// How to read and write.
    pub(super) fn output(&self) -> Output {
        let invert = self.invert_relief.unwrap_or_default();
        let relief = Relief::of_choices(self.relief, self.height, self.z_scale, invert);
        let unlike = Geometry::default();
        Output {
            alpha: self.alpha.unwrap_or_default(),
            lenient: self.lenient.unwrap_or_default(),
            keep_image: self.keep_image.unwrap_or_default(),
            step: self.step,
            bound: self.max_error,
            nodata: self.nodata.unwrap_or_default(),
            geometry: Geometry {
                pixel_size: self.pixel_size.unwrap_or(unlike.pixel_size),
                row_size: None,
                relief,
                base: self.base.unwrap_or(unlike.base),
                z_offset: self.z_offset.unwrap_or(unlike.z_offset),
                width: self.width,
                center: self.center.unwrap_or(unlike.center),
                up: self.up,
                color: self.color.unwrap_or(unlike.color),
                unit: self.unit,
            },
            compression: self.compression.unwrap_or_default(),
            texture: self.texture.unwrap_or_default(),
            shading: self.shading.unwrap_or_default(),
            png_compression: self.png_compression.unwrap_or_default(),
            reconstruction: None,
        }
    }
}
