//! How the image is read and the mesh is written: what the parameters that do not change the mesh
//! itself mean together.

use super::Choices;
use crate::extract::accept::Format;
use crate::problem::Problem;
use pixmesh_codec::{
    Alpha, Compression, DecodeOptions, Geometry, Limits, PngCompression, Relief, ReliefHeight,
    Shading, Texturing,
};
use pixmesh_meshing::Shape;

/// How the image is read and the mesh is written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Output {
    /// What becomes of the image's alpha.
    pub alpha: Alpha,
    /// Whether an image that ends early is taken as far as it goes.
    pub lenient: bool,
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
}

impl Output {
    /// How images are decoded.
    #[must_use]
    pub fn reading(&self, limits: &Limits) -> DecodeOptions {
        DecodeOptions { limits: *limits, alpha: self.alpha, lenient: self.lenient }
    }

    /// Whether the answer shows the image itself.
    #[must_use]
    pub fn shows_image(&self, format: Format) -> bool {
        matches!(format, Format::Glb | Format::Gltf) && self.texture == Texturing::Embed
    }

    /// Checks what is asked for against the image.
    pub(super) fn check(&self, shape: Shape) -> Result<(), Problem> {
        Ok(self.geometry.check(shape.component_count)?)
    }
}

impl Choices {
    /// How to read and write; a height, a step or an inversion makes a relief.
    pub(super) fn output(&self) -> Output {
        let given = self.height.map(ReliefHeight::Total);
        let height = given.or(self.z_scale.map(ReliefHeight::PerSample));
        let wanted = self.relief.is_some() || height.is_some() || self.invert_relief == Some(true);
        let relief = wanted.then(|| Relief {
            source: self.relief.unwrap_or_default(),
            height: height.unwrap_or_default(),
            invert: self.invert_relief.unwrap_or_default(),
        });
        let unlike = Geometry::default();
        Output {
            alpha: self.alpha.unwrap_or_default(),
            lenient: self.lenient.unwrap_or_default(),
            geometry: Geometry {
                pixel_size: self.pixel_size.unwrap_or(unlike.pixel_size),
                relief,
                base: self.base.unwrap_or(unlike.base),
                unit: self.unit.unwrap_or(unlike.unit),
            },
            compression: self.compression.unwrap_or_default(),
            texture: self.texture.unwrap_or_default(),
            shading: self.shading.unwrap_or_default(),
            png_compression: self.png_compression.unwrap_or_default(),
        }
    }
}
