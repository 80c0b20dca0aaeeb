//! What a piece of work takes, estimated from what the header says: memory at its peak, and effort.

use super::effort::Effort;
use super::footprint::{self, Compared, Footprint};
use pixmesh_codec::{Format, Header, MeshHeader, Texture};
use pixmesh_meshing::Parameters;
use pixmesh_meshing::parameters::Plan;

/// An estimate of the memory and the effort that work takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Whole MiB, 1 or more.
    mib: u32,
    effort: Effort,
}

impl Cost {
    /// The cost of meshing an image of this header by the parameters that gave this plan, and of
    /// writing the mesh in a format.
    #[must_use]
    pub fn of_mesh(header: &Header, plan: &Plan, parameters: &Parameters, format: Format) -> Self {
        let bytes = Footprint::new(header, plan, parameters, format).peak();
        let mib = u32::try_from(bytes.div_ceil(1 << 20)).unwrap_or(u32::MAX).max(1);
        Self { mib, effort: Effort::of_mesh(header, plan, parameters) }
    }

    /// The cost of reading a mesh file of this header and so many bytes, and of writing its mesh of
    /// `size` vertices in a format.
    #[must_use]
    pub fn of_conversion(header: &MeshHeader, file: u64, size: usize, format: Format) -> Self {
        let bytes = footprint::of_conversion(header, file, size as u64, format);
        Self { mib: 1, effort: Effort::of_samples(header.shape) }.with_file(bytes)
    }

    /// The same where glTF shows a picture of this header.
    #[must_use]
    pub fn with_texture(self, picture: &Header) -> Self {
        self.with_file(picture.decode_bytes()).showing(picture)
    }

    /// The cost of comparing two pictures of these headers, or a picture and a mesh.
    #[must_use]
    pub fn of_comparison(first: &Header, second: Compared) -> Self {
        let bytes = footprint::of_comparison(first, second);
        Self { mib: 1, effort: Effort::of_samples(first.shape()) }.with_file(bytes)
    }

    /// The same where the image is shown: its file lives on beside the work.
    #[must_use]
    pub fn showing(self, header: &Header) -> Self {
        self.with_file(Texture::held_bytes(header.shape()))
    }

    /// The same with weights of this header: decoded beside the image, and kept as 8 bits a pixel.
    #[must_use]
    pub fn with_weights(self, header: &Header) -> Self {
        self.with_file(header.decode_bytes() + (header.width * header.height) as u64)
    }

    /// The same with so many bytes more in memory.
    #[must_use]
    pub fn with_file(self, bytes: u64) -> Self {
        let mib = u32::try_from(bytes.div_ceil(1 << 20)).unwrap_or(u32::MAX);
        Self { mib: self.mib.saturating_add(mib), ..self }
    }

    /// The memory in MiB.
    #[must_use]
    pub fn mib(self) -> u32 {
        self.mib
    }

    /// The effort.
    pub(crate) fn effort(self) -> Effort {
        self.effort
    }

    #[cfg(test)]
    pub(crate) fn of_effort(effort: Effort) -> Self {
        Self { mib: 1, effort }
    }
}
