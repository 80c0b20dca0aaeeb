//! The memory that a piece of work takes at its peak, estimated from what the header says.

use pixmesh_codec::Header;
use pixmesh_meshing::Plan;

/// Bytes per sample of an image.
const SAMPLE: u64 = 2;
/// Bytes per pixel of the density and of the picture that simplification compares with.
const PLANES: u64 = 8;
/// Bytes per column of the rows that error diffusion keeps.
const DIFFUSION_ROW: u64 = 8;
/// Bytes per initial point: the list of points, and the triangulation's vertices and faces.
const POINT: u64 = 16 + 160;
/// Bytes per final vertex of the answer, as text, with its two faces.
const ANSWER_VERTEX: u64 = 128;

/// An estimate of the memory that work takes, in whole MiB, 1 or more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost(u32);

impl Cost {
    /// The cost of meshing an image of this header by this plan: the samples, and the larger of
    /// what decoding and what meshing adds to them.
    #[must_use]
    pub fn of_mesh(header: &Header, plan: &Plan) -> Self {
        let [width, height, components] =
            [header.width, header.height, header.component_count].map(|count| count as u64);
        let pixels = width.saturating_mul(height);
        let sample_count = pixels.saturating_mul(components);
        let decoded = sample_count.saturating_mul(u64::from(header.precision).div_ceil(8));
        let meshed = pixels
            .saturating_mul(PLANES)
            .saturating_add(width.saturating_mul(DIFFUSION_ROW))
            .saturating_add((plan.initial_size as u64).saturating_mul(POINT))
            .saturating_add((plan.size as u64).saturating_mul(ANSWER_VERTEX));
        let bytes = sample_count.saturating_mul(SAMPLE).saturating_add(decoded.max(meshed));
        Self(u32::try_from(bytes.div_ceil(1 << 20)).unwrap_or(u32::MAX).max(1))
    }

    /// The estimate in MiB.
    #[must_use]
    pub fn mib(self) -> u32 {
        self.0
    }

    #[cfg(test)]
    pub(super) fn of_mib(mib: u32) -> Self {
        Self(mib)
    }
}
