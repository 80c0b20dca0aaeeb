//! The choices that parameters offer: enumerations whose values have the names that users write.

use crate::parameters::ParameterError;

/// Declares an enumeration whose values have the names that users write.
///
/// Not part of the API, and exempt from its stability: it is exported only because
/// `pixmesh-codec`, which always has this crate's version, declares its own choices with it.
#[doc(hidden)]
#[macro_export]
macro_rules! named_values {
    (
        $(#[$attribute:meta])*
        $parameter:literal $type:ident {
            $($(#[$doc:meta])* $value:ident = $name:literal),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $type {
            $($(#[$doc])* $value),+
        }

        impl $type {
            /// Name of the parameter that takes these values.
            pub const PARAMETER: &'static str = $parameter;
            /// Every value, in the order of their documentation.
            pub const ALL: &'static [Self] = &[$(Self::$value),+];
            /// The name of every value, in the same order.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// The value's name, as users write it.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name),+
                }
            }
        }

        impl ::std::fmt::Display for $type {
            fn fmt(&self, formatter: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                formatter.write_str(self.name())
            }
        }

        impl ::std::str::FromStr for $type {
            type Err = $crate::ParameterError;

            fn from_str(name: &str) -> Result<Self, $crate::ParameterError> {
                match name {
                    $($name => Ok(Self::$value),)+
                    _ => Err($crate::ParameterError::UnknownValue {
                        parameter: $parameter,
                        value: name.chars().take(64).collect(),
                        allowed: Self::NAMES,
                    }),
                }
            }
        }
    };
}

named_values! {
    /// How an image becomes the density of its initial points: D stands for the maximum-magnitude
    /// second-order directional derivative (MMSODD), L for the magnitude of the Laplacian (MoL).
    ///
    /// ```
    /// use pixmesh_meshing::parameters::Policy;
    /// assert_eq!("psd_avg_l".parse(), Ok(Policy::PsdAvgL));
    /// assert_eq!(Policy::Psc.component_count(), Some(3));
    /// ```
    "policy" Policy {
        /// MMSODD of the only component.
        PsaD = "psa_d",
        /// MoL of the only component.
        PsaL = "psa_l",
        /// MMSODD of the luma of three components.
        PsbD = "psb_d",
        /// MoL of the luma of three components.
        PsbL = "psb_l",
        /// Vector gradient of three components.
        Psc = "psc",
        /// Maximum over the components of MMSODD.
        PsdMaxD = "psd_max_d",
        /// Maximum over the components of MoL.
        PsdMaxL = "psd_max_l",
        /// Mean over the components of MMSODD.
        PsdAvgD = "psd_avg_d",
        /// Mean over the components of MoL.
        PsdAvgL = "psd_avg_l",
        /// Each component diffused by its own MMSODD, the points united.
        PseD = "pse_d",
        /// Each component diffused by its own MoL, the points united.
        PseL = "pse_l",
    }
}

named_values! {
    /// How the initial points are chosen.
    ///
    /// ```
    /// use pixmesh_meshing::{Method, Target, parameters::Generator};
    /// assert_eq!(Method::Mgpr.parameters(Target::Size(4)).generator, Generator::All);
    /// ```
    "initial" Generator {
        /// Error diffusion of the density.
        ErrorDiffusion = "ed",
        /// Greedy insertion into the face of largest error; above a megapixel error diffusion in a
        /// reduced picture, which is quick.
        Insertion = "insertion",
        /// Every lattice point.
        All = "all",
        /// Points drawn at random, the same for the same seed.
        Random = "random",
        /// A regular grid.
        Uniform = "uniform",
    }
}

named_values! {
    /// The errors that error diffusion starts row 0 with.
    ///
    /// ```
    /// use pixmesh_meshing::{Method, Target, parameters::Startup};
    /// assert_eq!(Method::Ed.parameters(Target::Size(4)).startup, Startup::Classic);
    /// ```
    "startup" Startup {
        /// No errors.
        Classic = "classic",
        /// The errors at the end of a pass over the image mirrored at row 0.
        Mirroring = "mirroring",
        /// Drawn at random between minus and plus the first threshold, the same for the same seed.
        Random = "random",
    }
}

named_values! {
    /// The direction in which error diffusion visits each row.
    ///
    /// ```
    /// use pixmesh_meshing::{Parameters, parameters::Scan};
    /// assert_eq!(Parameters::default().scan, Scan::Serpentine);
    /// ```
    "scan" Scan {
        /// Always left to right.
        Raster = "raster",
        /// Alternating, the first row left to right.
        Serpentine = "serpentine",
    }
}

named_values! {
    /// The smoothing filter.
    ///
    /// ```
    /// use pixmesh_meshing::parameters::Smoothing;
    /// assert_eq!("mean".parse(), Ok(Smoothing::Mean));
    /// ```
    "smoothing" Smoothing {
        /// Binomial weights; order 3 is 1/4, 1/2, 1/4.
        Binomial = "binomial",
        /// Equal weights.
        Mean = "mean",
    }
}

named_values! {
    /// The directions in which the image is smoothed before it is differentiated.
    ///
    /// ```
    /// use pixmesh_meshing::parameters::SmoothingDirection;
    /// assert_eq!("orthogonal".parse(), Ok(SmoothingDirection::Orthogonal));
    /// ```
    "smoothing_direction" SmoothingDirection {
        /// Rows and columns.
        Both = "both",
        /// Only at right angles to the derivative: along rows for the derivative along columns,
        /// along columns for the one along rows, not at all for the mixed one.
        Orthogonal = "orthogonal",
    }
}

named_values! {
    /// The vector gradient where its rates of change in x and y are equal.
    ///
    /// ```
    /// use pixmesh_meshing::{Parameters, parameters::{Policy, PscTie}};
    /// assert!(Parameters::default().policy(Policy::Psc).psc_tie(PscTie::Exact).check().is_ok());
    /// ```
    "psc_tie" PscTie {
        /// As if the mixed term were 0, as in the published results.
        Published = "published",
        /// The larger eigenvalue, as at all other points.
        Exact = "exact",
    }
}

named_values! {
    /// The error that greedy removal raises least.
    ///
    /// ```
    /// use pixmesh_meshing::parameters::ErrorMetric;
    /// assert!(ErrorMetric::VecSe.check_component_count(2).is_ok());
    /// assert!(ErrorMetric::LumaSe.check_component_count(2).is_err());
    /// ```
    "error_metric" ErrorMetric {
        /// Squared error, mean over the components.
        MeanCompSe = "mean_comp_se",
        /// Absolute error, mean over the components.
        MeanCompAe = "mean_comp_ae",
        /// Squared error of the luma of three components.
        LumaSe = "luma_se",
        /// Absolute error of the luma of three components.
        LumaAe = "luma_ae",
        /// Squared length of the difference of two colours in the YCbCr space.
        YcbcrVecSe = "ycbcr_vec_se",
        /// Length of the difference of two colours in the YCbCr space.
        YcbcrVecAe = "ycbcr_vec_ae",
        /// Squared length of the difference of two sample vectors.
        VecSe = "vec_se",
        /// Squared error, weighted by how much an error lowers the structural similarity there.
        Ssim = "ssim",
    }
}

named_values! {
    /// The samples that filters read beyond the border of the image.
    ///
    /// ```
    /// use pixmesh_meshing::parameters::Boundary;
    /// assert_eq!(Boundary::NAMES, ["zero", "constant", "symmetric"]);
    /// ```
    "boundary" Boundary {
        /// Zero.
        Zero = "zero",
        /// The nearest sample of the image.
        Constant = "constant",
        /// The image mirrored at its border samples, which are not repeated.
        Symmetric = "symmetric",
    }
}

named_values! {
    /// The image that guides the choice and the removal of points.
    ///
    /// ```
    /// use pixmesh_meshing::{Method, Target, parameters::Guide};
    /// assert_eq!(Method::Cgpr.parameters(Target::Size(4)).guide, Guide::Gray);
    /// ```
    "meshed" Guide {
        /// The image itself.
        Components = "components",
        /// The luma of its three components; the mesh still carries their colours.
        Luma = "luma",
        /// The gray picture `(77 R + 150 G + 29 B + 128) >> 8` of its three components, as the
        /// thesis made its gray images; the mesh still carries their colours.
        Gray = "gray",
    }
}

named_values! {
    /// How the vertices are connected to faces.
    ///
    /// ```
    /// use pixmesh_meshing::{Parameters, parameters::Connectivity};
    /// assert!(Parameters::default().connectivity(Connectivity::Free).refines());
    /// ```
    "connectivity" Connectivity {
        /// The preferred-directions Delaunay triangulation.
        Delaunay = "delaunay",
        /// Edges are flipped where that lowers the squared error.
        Free = "free",
    }
}

named_values! {
    /// What the vertices carry.
    ///
    /// ```
    /// use pixmesh_meshing::{Parameters, parameters::Values};
    /// assert!(!Parameters::default().values(Values::Fitted).is_of_points_alone());
    /// ```
    "values" Values {
        /// The image's samples.
        Sampled = "sampled",
        /// The values that fit the image best by least squares.
        Fitted = "fitted",
    }
}

named_values! {
    /// How an image is rebuilt from a mesh.
    ///
    /// ```
    /// use pixmesh_meshing::{Parameters, parameters::Reconstruction};
    /// assert!(Parameters::default().reconstruction(Reconstruction::Flat).is_flat());
    /// ```
    "reconstruction" Reconstruction {
        /// The linear interpolant of the vertices' values.
        Linear = "linear",
        /// One colour for each face, the one that fits best.
        Flat = "flat",
    }
}

named_values! {
    /// How greedy point removal shares its work among threads.
    ///
    /// ```
    /// use pixmesh_meshing::{Method, Target, parameters::Parallel};
    /// assert_eq!(Method::Optimal.parameters(Target::Size(4)).parallel, Parallel::Tiles);
    /// ```
    "parallel" Parallel {
        /// In the exact order.
        Exact = "exact",
        /// Tile by tile where there are many points: faster, on one thread too, in an order that
        /// differs from the exact one near the borders of tiles.
        Tiles = "tiles",
    }
}

pub(crate) use named_values;

/// Declares the choices that are defined for one number of components only.
macro_rules! for_component_counts {
    ($type:ident: $($($value:ident)|+ => $count:literal),+) => {
        impl $type {
            /// The number of components this choice is made for; `None` for any.
            #[must_use]
            pub fn component_count(self) -> Option<usize> {
                match self {
                    $($(Self::$value)|+ => Some($count),)+
                    _ => None,
                }
            }

            /// Checks that this choice is defined for images of `actual` components.
            ///
            /// # Errors
            /// [`ParameterError::ComponentCount`], which names the choices that are.
            pub fn check_component_count(self, actual: usize) -> Result<(), ParameterError> {
                let misfit = |choice: Self| choice.component_count().filter(|&n| n != actual);
                let Some(needed) = misfit(self) else { return Ok(()) };
                let fitting = Self::ALL.iter().filter(|&&choice| misfit(choice).is_none());
                let allowed = fitting.map(|choice| choice.name()).collect();
                let (parameter, value) = (Self::PARAMETER, self.name());
                Err(ParameterError::ComponentCount { parameter, value, needed, actual, allowed })
            }
        }
    };
}

pub(crate) use for_component_counts;

for_component_counts!(Policy: PsaD | PsaL => 1, PsbD | PsbL | Psc => 3);
for_component_counts!(ErrorMetric: LumaSe | LumaAe | YcbcrVecSe | YcbcrVecAe => 3);
for_component_counts!(Guide: Luma | Gray => 3);

impl Policy {
    pub(crate) fn of_one_component(self) -> Self {
        match self {
            Self::PsbD | Self::Psc => Self::PsaD,
            Self::PsbL => Self::PsaL,
            any => any,
        }
    }
}

impl ErrorMetric {
    pub(crate) fn of_one_component(self) -> Self {
        match self {
            Self::MeanCompAe | Self::LumaAe | Self::YcbcrVecAe => Self::MeanCompAe,
            Self::Ssim => Self::Ssim,
            Self::MeanCompSe | Self::LumaSe | Self::YcbcrVecSe | Self::VecSe => Self::MeanCompSe,
        }
    }

    /// Whether the error is the sum of the squared differences of the components.
    pub(crate) fn is_squared_difference(self) -> bool {
        matches!(self, Self::MeanCompSe | Self::VecSe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luma_has_policies_and_metrics_of_one_component() {
        use ErrorMetric::*;
        let of_one = [Policy::PsbD, Policy::PsbL, Policy::Psc].map(Policy::of_one_component);
        assert_eq!(of_one, [Policy::PsaD, Policy::PsaL, Policy::PsaD]);
        for &policy in Policy::ALL.iter().filter(|policy| policy.component_count() != Some(3)) {
            assert_eq!(policy.of_one_component(), policy);
        }
        for &metric in ErrorMetric::ALL {
            assert_eq!(metric.of_one_component().component_count(), None);
        }
        let of_one = [LumaSe, YcbcrVecAe, Ssim].map(ErrorMetric::of_one_component);
        assert_eq!(of_one, [MeanCompSe, MeanCompAe, Ssim]);
    }
}
