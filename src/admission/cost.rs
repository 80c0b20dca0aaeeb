//! What a piece of work takes, estimated from what the header says: memory at its peak, and effort.

use super::effort::Effort;
use super::footprint::{self, Footprint};
use crate::extract::accept::Format;
use crate::extract::params::Output;
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

    /// The same where the mesh is written in a special way: an image that is shown lives on beside
    /// the work, and is written a second time.
    #[must_use]
    pub fn of_output(self, header: &Header, output: &Output, format: Format) -> Self {
        let shown = if output.shows_image(format) { footprint::shown_image(header) } else { 0 };
        let mib = u32::try_from(shown.div_ceil(1 << 20)).unwrap_or(u32::MAX);
        Self { mib: self.mib.saturating_add(mib), ..self }
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
