//! The methods that are compared.

use pixmesh_meshing::parameters::{Connectivity, ErrorMetric, InitialSize, Values};
use pixmesh_meshing::{Method, Parameters, Target};

/// A method with a name and a colour.
pub(crate) struct Series {
    /// Name in legends and tables.
    pub(crate) label: &'static str,
    /// Colour of its curve.
    pub(crate) color: &'static str,
    /// Whether it takes seconds.
    pub(crate) slow: bool,
    change: Change,
}

/// What makes a series: a method with something changed.
enum Change {
    Method(Method),
    Gamma(f64),
    Effort(u8),
    Free(bool, bool, u8),
    Metric(ErrorMetric),
}

/// Every series, from fast to good.
pub(crate) static SERIES: [Series; 18] = [
    series("preview", "#999999", false, Change::Method(Method::Preview)),
    series("med", "#c8a200", false, Change::Method(Method::Med)),
    series("med+", "#8c6d00", false, Change::Method(Method::MedPlus)),
    series("gamma 1.25", "#a6cee3", true, Change::Gamma(1.25)),
    series("gamma 2", "#5fa8d3", true, Change::Gamma(2.0)),
    series("mgprfs", "#1f4e9c", false, Change::Method(Method::Mgprfs)),
    series("mgprfs by ssim", "#7a7acc", false, Change::Metric(ErrorMetric::Ssim)),
    series("mgprfs free", "#a1d99b", true, Change::Free(true, false, 0)),
    series("mgprfs fitted", "#74c476", true, Change::Free(false, true, 0)),
    series("mgprfs free fitted", "#238b45", false, Change::Free(true, true, 0)),
    series("optimal 1", "#fcae91", false, Change::Effort(1)),
    series("optimal 3", "#fb6a4a", true, Change::Effort(3)),
    series("optimal 5", "#de2d26", false, Change::Effort(5)),
    series("optimal 7", "#a50f15", true, Change::Effort(7)),
    series("optimal 9", "#67000d", true, Change::Effort(9)),
    series("optimal 5 free fitted", "#c51b8a", false, Change::Free(true, true, 5)),
    series("optimal 9 free fitted", "#49006a", true, Change::Free(true, true, 9)),
    series("flat", "#000000", true, Change::Method(Method::Flat)),
];

const fn series(label: &'static str, color: &'static str, slow: bool, change: Change) -> Series {
    Series { label, color, slow, change }
}

impl Series {
    /// The parameters at a density in percent.
    pub(crate) fn parameters(&self, density: f64) -> Parameters {
        let target = Target::Percent(density);
        let mgprfs = Method::Mgprfs.parameters(target);
        match self.change {
            Change::Method(method) => method.parameters(target),
            Change::Gamma(gamma) => mgprfs.initial_size(InitialSize::Gamma(gamma)),
            Change::Effort(effort) => mgprfs.effort(effort),
            Change::Free(free, fitted, effort) => mgprfs
                .connectivity(if free { Connectivity::Free } else { Connectivity::Delaunay })
                .values(if fitted { Values::Fitted } else { Values::Sampled })
                .effort(effort),
            Change::Metric(error_metric) => mgprfs.error_metric(error_metric),
        }
    }
}
