//! What a piece of work takes, estimated from what the header says: memory at its peak, and effort.

use super::effort::Effort;
use super::footprint::Footprint;
use crate::extract::accept::Format;
use pixmesh_codec::Header;
use pixmesh_meshing::{Parameters, Plan};

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

    /// The memory in MiB.
    #[must_use]
    pub fn mib(self) -> u32 {
        self.mib
    }

    /// The effort.
    pub(super) fn effort(self) -> Effort {
        self.effort
    }

    #[cfg(test)]
    pub(super) fn of_effort(effort: Effort) -> Self {
        Self { mib: 1, effort }
    }
}
