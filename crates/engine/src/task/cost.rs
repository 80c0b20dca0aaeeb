//! What a piece of work takes, estimated from what the header says: memory at its peak, and effort.

use super::effort::Effort;
use super::footprint::{self, Compared, Footprint, Kept};
use crate::params::Output;
use pixmesh_codec::{Format, Header, Texture};
use pixmesh_meshing::parameters::Plan;
use pixmesh_meshing::{Parameters, Shape};

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

    /// The cost of writing a mesh, whose MODEL has so many bytes, in a format; `is_flat` if its faces
    /// may have colours.
    #[must_use]
    pub fn of_conversion(
        shape: Shape,
        vertices: usize,
        model_bytes: u64,
        format: Format,
        is_flat: bool,
    ) -> Self {
        let bytes = footprint::of_conversion(shape, vertices as u64, model_bytes, format, is_flat);
        Self { mib: 1, effort: Effort::of_samples(shape) }.with_file(bytes)
    }

    /// The cost of making a mesh of some size of the order of vertices that a job keeps, and of
    /// writing it in a format; `is_flat` if its faces get colours.
    #[must_use]
    pub fn of_resizing(kept: Kept, size: usize, format: Format, is_flat: bool) -> Self {
        let bytes = footprint::of_resizing(kept, size as u64, format, is_flat);
        Self { mib: 1, effort: Effort::of_samples(kept.shape) }.with_file(bytes)
    }

    /// The cost of comparing two pictures of these headers, or a picture and a MODEL of so many
    /// bytes.
    #[must_use]
    pub fn of_comparison(first: &Header, second: Compared) -> Self {
        let bytes = footprint::of_comparison(first, second);
        Self { mib: 1, effort: Effort::of_samples(first.shape()) }.with_file(bytes)
    }

    /// The same where the mesh is written in a special way: an image that is shown lives on beside
    /// the work, and is written a second time.
    #[must_use]
    pub fn of_output(self, header: &Header, output: &Output, format: Format) -> Self {
        let shown =
            if output.shows_image(format) { Texture::held_bytes(header.shape()) } else { 0 };
        self.with_file(shown)
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
