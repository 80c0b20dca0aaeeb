//! Everything that decides which mesh is made of an image, its bounds, and what it means for one.

pub(crate) mod choices;
pub(crate) mod method;
mod weights;

pub use choices::{
    Boundary, Connectivity, ErrorMetric, Generator, Guide, Parallel, Policy, PscTie,
    Reconstruction, Scan, Smoothing, SmoothingDirection, Startup, Values,
};
pub use method::Method;
pub use weights::Weights;

use crate::image::{ImageError, MAX_POINTS, Shape, check_shape};
use thiserror::Error;

/// The most effort that refinement may take.
pub const MAX_EFFORT: u8 = 9;

/// The fewest vertices a mesh may have: the image's corners.
pub const MIN_SIZE: usize = 4;

/// The smallest density, in percent.
pub const MIN_PERCENT: f64 = 1e-6;

/// The largest density, in percent: every lattice point.
pub const MAX_PERCENT: f64 = 100.0;

/// The largest PSNR that may be asked for, in decibels.
pub const MAX_PSNR_DB: f64 = 200.0;

/// The largest mean error that may be asked for: more than any metric of 16 bits gives.
pub const MAX_MEAN_ERROR: f64 = 1e12;

/// The largest ratio of initial to final points.
pub const MAX_GAMMA: f64 = 1000.0;

/// The largest smoothing order.
pub const MAX_SMOOTHING_ORDER: usize = 21;

/// The effort of refinement where the method refines and none is given.
pub(crate) const DEFAULT_EFFORT: u8 = 5;

/// The effort of refinement of the method for flat colours.
pub(crate) const FLAT_EFFORT: u8 = 6;

/// A value that a parameter does not allow.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ParameterError {
    /// A word that names none of the parameter's values.
    #[error("{parameter} cannot be '{value}': allowed are {}", allowed.join(", "))]
    UnknownValue {
        /// Name of the parameter.
        parameter: &'static str,
        /// The word given.
        value: String,
        /// Every word allowed.
        allowed: &'static [&'static str],
    },
    /// A number that is NaN or infinite.
    #[error("{parameter} must be a finite number")]
    NotFinite {
        /// Name of the parameter.
        parameter: &'static str,
    },
    /// A number out of bounds.
    #[error("{parameter} is {value}, but must lie in {minimum} to {maximum}")]
    OutOfRange {
        /// Name of the parameter.
        parameter: &'static str,
        /// The number given.
        value: f64,
        /// The least number allowed.
        minimum: f64,
        /// The largest number allowed.
        maximum: f64,
    },
    /// A number that must be odd.
    #[error("{parameter} is {value}, but must be odd")]
    Even {
        /// Name of the parameter.
        parameter: &'static str,
        /// The number given.
        value: usize,
    },
    /// A choice that is not defined for images of this many components.
    #[error("{parameter} '{value}' is for images of {needed} component(s), this one has {actual}: allowed are {}", allowed.join(", "))]
    ComponentCount {
        /// Name of the parameter.
        parameter: &'static str,
        /// The value given.
        value: &'static str,
        /// Components it needs.
        needed: usize,
        /// Components of the image.
        actual: usize,
        /// Values allowed for this image.
        allowed: Vec<&'static str>,
    },
    /// A target PSNR with a metric that is not the squared error.
    #[error(
        "target_psnr needs the error_metric mean_comp_se or vec_se, not {0}: give target_error instead"
    )]
    TargetNeedsSquaredError(ErrorMetric),
    /// Weights of another size than the image.
    #[error("the weights are for {}x{} points, the image has {}x{}", actual.0, actual.1, expected.0, expected.1)]
    WeightsSize {
        /// Columns and rows of the weights.
        actual: (usize, usize),
        /// Columns and rows of the image.
        expected: (usize, usize),
    },
    /// The image itself cannot be meshed.
    #[error(transparent)]
    Shape(#[from] ImageError),
}

/// How large or how good the mesh is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Target {
    /// Vertices in percent of the lattice points, from [`MIN_PERCENT`] to 100; fewer than the four
    /// corners means the corners.
    Percent(f64),
    /// Number of vertices, from 4 to the number of lattice points.
    Size(usize),
    /// At least this PSNR, in decibels: greedy removal stops before the first vertex that would
    /// take the mesh below it.
    Psnr(f64),
    /// At most this mean error per point in the unit of the error metric: greedy removal stops
    /// before the first vertex that would take the mesh above it.
    MeanError(f64),
    /// No sample of the approximation may differ from the image's by more than this: greedy removal
    /// stops before the first vertex that would take the mesh there.
    MaxError(u16),
}

/// How many points the mesh starts with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum InitialSize {
    /// As many as it ends with: nothing is simplified away.
    Target,
    /// This many times as many as it ends with, 1 or more; 4 to 5.5 is the useful range.
    Gamma(f64),
    /// Percent of the lattice points, from [`MIN_PERCENT`] to 100.
    Percent(f64),
    /// A number of points, from 4 to the number of lattice points.
    Size(usize),
}

/// Declares [`Parameters`]: its fields with their defaults, and a setter named after each field.
macro_rules! parameters {
    ($($(#[$doc:meta])* $field:ident: $type:ty = $default:expr;)+) => {
        /// Everything that decides which mesh is made of an image.
        ///
        /// The default is MGPRFS at 2 % of the lattice points; [`Method::parameters`] gives those
        /// of every named method. A setter of the same name changes each field:
        ///
        /// ```
        /// use pixmesh_meshing::{Method, Parameters, Target, parameters::Policy};
        ///
        /// let own = Parameters::default().target(Target::Psnr(32.0)).policy(Policy::PsdAvgL);
        /// assert_eq!(own.initial_size, Method::Mgprfs.parameters(own.target).initial_size);
        /// ```
        #[derive(Clone, Debug, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
        #[non_exhaustive]
        pub struct Parameters {
            $($(#[$doc])* pub $field: $type,)+
        }

        impl Default for Parameters {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        impl Parameters {
            $($(#[$doc])*
            #[must_use]
            pub fn $field(self, $field: $type) -> Self {
                Self { $field, ..self }
            })+
        }
    };
}

parameters! {
    /// How large or how good the mesh is.
    target: Target = Target::Percent(2.0);
    /// How many points it starts with.
    initial_size: InitialSize = InitialSize::Gamma(4.0);
    /// How the initial points are chosen.
    generator: Generator = Generator::ErrorDiffusion;
    /// How the image becomes the density of the initial points.
    policy: Policy = Policy::PsdMaxD;
    /// The errors that error diffusion starts with.
    startup: Startup = Startup::Mirroring;
    /// The direction in which error diffusion visits each row.
    scan: Scan = Scan::Serpentine;
    /// Whether error that would go to points outside the image is lost.
    leaky: bool = false;
    /// How far the number of diffused points may be from the one wanted; by default the policy's
    /// own tolerance: 10, for PSE 15.
    tolerance: Option<usize> = None;
    /// The smoothing filter.
    smoothing: Smoothing = Smoothing::Binomial;
    /// The order of the smoothing filter, odd; 1 is no smoothing.
    smoothing_order: usize = 3;
    /// The directions in which the picture is smoothed.
    smoothing_direction: SmoothingDirection = SmoothingDirection::Both;
    /// Whether the picture is smoothed and cropped first, then extended again and differentiated,
    /// instead of both by one filter.
    double_convolution: bool = false;
    /// What the smoothing filter sees beyond the border, with `double_convolution`.
    smoothing_boundary: Boundary = Boundary::Zero;
    /// What the filters see beyond the border.
    boundary: Boundary = Boundary::Zero;
    /// The vector gradient where its rates of change in x and y are equal.
    psc_tie: PscTie = PscTie::Published;
    /// The image that guides the choice and the removal of points.
    guide: Guide = Guide::Components;
    /// The error that removal and refinement keep low. Flat reconstruction ignores it: there each
    /// face has the squared error of its best colour.
    error_metric: ErrorMetric = ErrorMetric::MeanCompSe;
    /// Whether removal goes on below the target while it lowers the error. Flat reconstruction
    /// ignores it.
    bad_point_removal: bool = false;
    /// Effort of refinement, 0 (none) to [`MAX_EFFORT`]: each level does all that the one before
    /// does, and more.
    effort: u8 = 0;
    /// What decides the faces over the vertices.
    connectivity: Connectivity = Connectivity::Delaunay;
    /// What the vertices carry.
    values: Values = Values::Sampled;
    /// How the picture is rebuilt, which the error of faces is measured by.
    reconstruction: Reconstruction = Reconstruction::Linear;
    /// How greedy removal shares its work among threads. Removal down to a quality, which stops
    /// within the exact order, ignores it.
    parallel: Parallel = Parallel::Exact;
    /// Seed of [`Generator::Random`] and [`Startup::Random`].
    seed: u64 = 0;
    /// How much the squared error of each lattice point counts; all the same without them.
    weights: Option<Weights> = None;
    /// Whether [`Approximation::removals`](crate::Approximation::removals) lists the removed
    /// vertices: 16 bytes each.
    lists_removals: bool = false;
}

/// The numbers that parameters mean for one image.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Plan {
    /// Vertices to simplify down to: N. With a bound on the error the least, 4.
    pub size: usize,
    /// Points to start with: N0.
    pub initial_size: usize,
    /// The error that removal must not exceed.
    pub bound: Option<ErrorBound>,
}

/// A quality that removal must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ErrorBound {
    /// At least this PSNR, in decibels.
    PsnrDb(f64),
    /// At most this mean error per point, in the unit of the error metric.
    MeanError(f64),
    /// At most this difference of any sample.
    MaxError(u16),
}

impl Parameters {
    /// Checks every parameter that can be checked without an image.
    ///
    /// # Errors
    /// The first value that is out of its bounds.
    pub fn check(&self) -> Result<(), ParameterError> {
        match self.target {
            Target::Percent(density) => check_density("density", density)?,
            Target::Size(size) => check_size("size", size, MAX_POINTS)?,
            Target::Psnr(psnr_db) => {
                check_range("target_psnr", psnr_db, 0.0, MAX_PSNR_DB)?;
                self.check_metric_of_psnr()?;
            }
            Target::MeanError(error) => check_range("target_error", error, 0.0, MAX_MEAN_ERROR)?,
            Target::MaxError(_) => {}
        }
        match self.initial_size {
            InitialSize::Target => {}
            InitialSize::Gamma(gamma) => check_range("gamma", gamma, 1.0, MAX_GAMMA)?,
            InitialSize::Percent(density) => check_density("initial_density", density)?,
            InitialSize::Size(size) => check_size("initial_size", size, MAX_POINTS)?,
        }
        check_range("effort", self.effort.into(), 0.0, MAX_EFFORT.into())?;
        let (parameter, value) = ("smoothing_order", self.smoothing_order);
        check_range(parameter, value as f64, 1.0, MAX_SMOOTHING_ORDER as f64)?;
        if value.is_multiple_of(2) {
            return Err(ParameterError::Even { parameter, value });
        }
        Ok(())
    }

    /// Checks the parameters against the shape of an image and computes what they mean for it.
    ///
    /// # Errors
    /// The first parameter that is out of its bounds or not defined for such an image.
    pub fn plan(&self, shape: Shape) -> Result<Plan, ParameterError> {
        check_shape(shape.width, shape.height, shape.precision)?;
        let all = shape.width * shape.height;
        if let Target::Size(size) = self.target {
            check_size("size", size, all)?;
        }
        if let InitialSize::Size(size) = self.initial_size {
            check_size("initial_size", size, all)?;
        }
        self.check()?;
        self.check_components(shape.component_count)?;
        self.check_weights((shape.width, shape.height))?;
        let (size, bound) = match self.target {
            Target::Percent(density) => (points_of_density(density, shape), None),
            Target::Size(size) => (size, None),
            Target::Psnr(psnr_db) => (MIN_SIZE, Some(ErrorBound::PsnrDb(psnr_db))),
            Target::MeanError(error) => (MIN_SIZE, Some(ErrorBound::MeanError(error))),
            Target::MaxError(error) => (MIN_SIZE, Some(ErrorBound::MaxError(error))),
        };
        let initial_size = self.initial_points(size, shape)?;
        self.check_initial_size(initial_size, size, all)?;
        Ok(Plan { size, initial_size, bound })
    }

    /// A mesh cannot end with more points than it starts with.
    fn check_initial_size(
        &self,
        initial: usize,
        size: usize,
        all: usize,
    ) -> Result<(), ParameterError> {
        let parameter = match self.initial_size {
            InitialSize::Size(_) => "initial_size",
            InitialSize::Percent(_) => "initial_density",
            InitialSize::Target | InitialSize::Gamma(_) => return Ok(()),
        };
        if initial >= size {
            return Ok(());
        }
        let in_unit = |points: usize| match self.initial_size {
            InitialSize::Percent(_) => 100.0 * points as f64 / all as f64,
            _ => points as f64,
        };
        let (value, minimum, maximum) = (in_unit(initial), in_unit(size), in_unit(all));
        Err(ParameterError::OutOfRange { parameter, value, minimum, maximum })
    }

    /// Number of points to start with.
    fn initial_points(&self, size: usize, shape: Shape) -> Result<usize, ParameterError> {
        let all = shape.width * shape.height;
        if self.generator == Generator::All {
            return Ok(all);
        }
        match (self.initial_size, self.target) {
            (InitialSize::Size(size), _) => Ok(size),
            (InitialSize::Percent(density), _) => Ok(points_of_density(density, shape)),
            (
                InitialSize::Gamma(_) | InitialSize::Target,
                Target::Psnr(_) | Target::MeanError(_) | Target::MaxError(_),
            ) => Ok(all),
            (InitialSize::Gamma(gamma), Target::Percent(density)) => {
                Ok(points_of_density(gamma * density, shape).max(size))
            }
            (InitialSize::Gamma(gamma), Target::Size(size)) => {
                Ok(((gamma * size as f64 + 1e-9).floor() as usize).clamp(size, all))
            }
            (InitialSize::Target, _) => Ok(size),
        }
    }

    /// Tells whether the mesh is improved after its points have been chosen and removed.
    #[must_use]
    pub fn refines(&self) -> bool {
        self.effort > 0 || self.is_unconstrained()
    }

    /// Tells whether edges are flipped or values fitted at the end.
    pub(crate) fn is_unconstrained(&self) -> bool {
        self.connectivity == Connectivity::Free || self.values == Values::Fitted
    }

    /// Tells whether faces have one colour each.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.reconstruction == Reconstruction::Flat
    }

    /// Tells whether greedy removal, or refinement after it, makes the mesh.
    #[must_use]
    pub fn simplifies(&self, plan: &Plan) -> bool {
        plan.initial_size > plan.size
            || plan.bound.is_some()
            || self.bad_point_removal
            || self.effort > 0
    }

    /// Tells whether a mesh of these parameters is one of the model of the thesis, whose points
    /// alone say everything else: so it may be a [`Progression`](crate::Progression).
    #[must_use]
    pub fn is_of_points_alone(&self) -> bool {
        !self.is_unconstrained() && !self.is_flat()
    }

    /// Tells whether a quality is reached by making meshes of several sizes: the method does not
    /// simplify, or refines what simplification leaves.
    #[must_use]
    pub fn searches(&self) -> bool {
        let by_quality = !matches!(self.target, Target::Percent(_) | Target::Size(_));
        by_quality && (self.refines() || self.is_flat() || self.initial_size == InitialSize::Target)
    }

    /// The metric for the components that guide.
    pub(crate) fn metric_of_guide(&self) -> ErrorMetric {
        match self.guide {
            Guide::Components => self.error_metric,
            Guide::Luma | Guide::Gray => self.error_metric.of_one_component(),
        }
    }

    /// A PSNR is one of the squared error.
    fn check_metric_of_psnr(&self) -> Result<(), ParameterError> {
        match self.metric_of_guide() {
            ErrorMetric::MeanCompSe | ErrorMetric::VecSe => Ok(()),
            _ => Err(ParameterError::TargetNeedsSquaredError(self.error_metric)),
        }
    }

    /// Weights are for each point of the image.
    pub(crate) fn check_weights(&self, expected: (usize, usize)) -> Result<(), ParameterError> {
        let Some(weights) = &self.weights else { return Ok(()) };
        let actual = weights.size();
        if actual != expected {
            return Err(ParameterError::WeightsSize { actual, expected });
        }
        Ok(())
    }

    /// The policy, the metric and the luma are defined for this many components.
    pub(crate) fn check_components(&self, actual: usize) -> Result<(), ParameterError> {
        if self.generator == Generator::ErrorDiffusion {
            self.check_policy(actual)?;
        }
        if self.guide == Guide::Components {
            let (all, count) = (ErrorMetric::ALL, ErrorMetric::component_count);
            let (parameter, metric) = (ErrorMetric::PARAMETER, self.error_metric);
            check_count(parameter, metric, all, ErrorMetric::name, count, actual)?;
        }
        let needs = |guide| (guide != Guide::Components).then_some(3);
        check_count(Guide::PARAMETER, self.guide, Guide::ALL, Guide::name, needs, actual)
    }

    /// The policy is defined for this many components.
    pub(crate) fn check_policy(&self, actual: usize) -> Result<(), ParameterError> {
        let (all, count) = (Policy::ALL, Policy::component_count);
        check_count(Policy::PARAMETER, self.policy, all, Policy::name, count, actual)
    }
}

/// Checks a choice that may need a number of components, and lists those that fit.
pub(crate) fn check_count<T: Copy>(
    parameter: &'static str,
    chosen: T,
    all: &[T],
    name: fn(T) -> &'static str,
    needs: impl Fn(T) -> Option<usize>,
    actual: usize,
) -> Result<(), ParameterError> {
    let fits = |value: T| needs(value).is_none_or(|needed| needed == actual);
    match needs(chosen) {
        Some(needed) if needed != actual => {
            let allowed = all.iter().copied().filter(|&value| fits(value)).map(name).collect();
            let value = name(chosen);
            Err(ParameterError::ComponentCount { parameter, value, needed, actual, allowed })
        }
        _ => Ok(()),
    }
}

/// Checks that a number is finite and within bounds.
fn check_range(
    parameter: &'static str,
    value: f64,
    minimum: f64,
    maximum: f64,
) -> Result<(), ParameterError> {
    if !value.is_finite() {
        Err(ParameterError::NotFinite { parameter })
    } else if value < minimum || value > maximum {
        Err(ParameterError::OutOfRange { parameter, value, minimum, maximum })
    } else {
        Ok(())
    }
}

/// Checks a density in percent.
fn check_density(parameter: &'static str, density: f64) -> Result<(), ParameterError> {
    check_range(parameter, density, MIN_PERCENT, MAX_PERCENT)
}

/// Checks a number of points against the number of lattice points.
pub(crate) fn check_size(
    parameter: &'static str,
    size: usize,
    all: usize,
) -> Result<(), ParameterError> {
    check_range(parameter, size as f64, MIN_SIZE as f64, all as f64)
}

/// Number of points of a density: `floor(percent / 100 * width * height)`, where a product that
/// misses a whole number by the rounding of binary fractions counts as that number; at least the
/// four corners, at most all.
fn points_of_density(percent: f64, shape: Shape) -> usize {
    let all = shape.width * shape.height;
    let points = percent * all as f64 / 100.0;
    ((points * (1.0 + 1e-12) + 1e-9).floor() as usize).clamp(MIN_SIZE, all)
}

#[cfg(test)]
mod tests;
