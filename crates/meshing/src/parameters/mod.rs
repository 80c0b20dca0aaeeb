//! The parameters of a mesh, their ranges, and the sizes that they set for an image.

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

/// The largest effort of refinement.
pub const MAX_EFFORT: u8 = 9;
/// The least number of vertices of a mesh: the image's corners.
pub const MIN_SIZE: usize = 4;
/// The smallest density, in percent.
pub const MIN_PERCENT: f64 = 1e-6;
/// The largest density, in percent: every lattice point.
pub const MAX_PERCENT: f64 = 100.0;
/// The largest target PSNR, in decibels.
pub const MAX_PSNR_DB: f64 = 200.0;
/// The largest target mean error: more than any metric of 16 bits gives.
pub const MAX_MEAN_ERROR: f64 = 1e12;
/// The largest distance of a mesh's surface from a sample, in steps.
pub const MAX_DISTANCE: f64 = 65535.0;
/// The largest ratio of initial to final points.
pub const MAX_GAMMA: f64 = 1000.0;
/// The most pixels of an image into which points are inserted; above, that takes seconds.
const MOST_INSERTED_INTO: usize = 1 << 20;
/// The largest smoothing order.
pub const MAX_SMOOTHING_ORDER: usize = 21;

/// A value that a parameter does not allow.
///
/// ```
/// use pixmesh_meshing::{Parameters, Target};
/// let refused = Parameters::default().target(Target::Psnr(-3.0)).check().unwrap_err();
/// assert_eq!(refused.to_string(), "target_psnr is -3, but must lie in 0 to 200");
/// ```
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each variant and its message explain the fields")]
pub enum ParameterError {
    /// A word that names none of the parameter's values.
    #[error("{parameter} cannot be '{value}': allowed are {}", allowed.join(", "))]
    UnknownValue { parameter: &'static str, value: String, allowed: &'static [&'static str] },
    /// A number that is NaN or infinite.
    #[error("{parameter} must be a finite number")]
    NotFinite { parameter: &'static str },
    /// A number out of bounds.
    #[error("{parameter} is {value}, but must lie in {minimum} to {maximum}")]
    OutOfRange { parameter: &'static str, value: f64, minimum: f64, maximum: f64 },
    /// A number that must be odd.
    #[error("{parameter} is {value}, but must be odd")]
    Even { parameter: &'static str, value: usize },
    /// A choice for images of `needed` components, where the image has `actual`.
    #[error(
        "{parameter} '{value}' is for images of {needed} component(s), this one has {actual}: \
        allowed are {}",
        allowed.join(", ")
    )]
    ComponentCount {
        parameter: &'static str,
        value: &'static str,
        needed: usize,
        actual: usize,
        allowed: Vec<&'static str>,
    },
    /// A target PSNR with a metric that is not the squared error.
    #[error(
        "target_psnr needs the error_metric mean_comp_se or vec_se, not {0}: \
        give target_error instead"
    )]
    TargetNeedsSquaredError(ErrorMetric),
    /// Weights for another number of columns and rows than the image has.
    #[error(
        "the weights are for {}x{} points, the image has {}x{}",
        actual.0, actual.1, expected.0, expected.1
    )]
    WeightsSize { actual: (usize, usize), expected: (usize, usize) },
    /// Holes without a bound that keeps their borders, or with vertices that move.
    #[error(
        "a mesh with holes needs max_error, and its vertices may not move: give max_error and leave out \
        effort, values and meshed, or fill the holes with nodata=fill"
    )]
    HolesNeedBound,
    /// The image itself cannot be meshed.
    #[error(transparent)]
    Shape(#[from] ImageError),
}

/// How large or how good the mesh is to be.
///
/// ```
/// use pixmesh_meshing::{Parameters, Shape, Target};
/// let shape = Shape { width: 100, height: 50, component_count: 1, precision: 8 };
/// let plan = |target| Parameters::default().target(target).plan(shape);
/// assert_eq!(plan(Target::Percent(1.0)), plan(Target::Size(50)));
/// assert!(Target::Psnr(30.0).is_quality());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Target {
    /// Vertices in percent of the lattice points, from [`MIN_PERCENT`] to 100; at least the four
    /// corners.
    Percent(f64),
    /// Number of vertices, from 4 to the number of lattice points.
    Size(usize),
    /// At least this PSNR, in decibels: removal stops before a vertex would lower it further.
    Psnr(f64),
    /// At most this mean error per point in the unit of the error metric: greedy removal stops
    /// before the first vertex whose removal would raise it further.
    MeanError(f64),
    /// The largest difference of a sample of the approximation from the image's: greedy removal
    /// passes over the vertices whose removal would exceed it, until none is left.
    MaxError(u16),
    /// The same of the mesh's surface, which is not rounded to whole samples, in steps of the
    /// samples from 0 to 65535.
    MaxDistance(f64),
}

impl Target {
    /// Whether the target bounds the error and not the number of vertices.
    #[must_use]
    pub fn is_quality(self) -> bool {
        !matches!(self, Self::Percent(_) | Self::Size(_))
    }

    /// The name of the parameter that sets it.
    #[must_use]
    pub fn parameter(self) -> &'static str {
        match self {
            Self::Percent(_) => "density",
            Self::Size(_) => "size",
            Self::Psnr(_) => "target_psnr",
            Self::MeanError(_) => "target_error",
            Self::MaxError(_) | Self::MaxDistance(_) => "max_error",
        }
    }
}

/// How many initial points there are.
///
/// ```
/// use pixmesh_meshing::{Parameters, Shape, Target, parameters::InitialSize};
/// let shape = Shape { width: 100, height: 50, component_count: 1, precision: 8 };
/// let own = Parameters::default().target(Target::Size(30)).initial_size(InitialSize::Gamma(5.0));
/// assert_eq!(own.plan(shape)?.initial_size, 150);
/// # Ok::<(), pixmesh_meshing::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum InitialSize {
    /// The number of vertices of the mesh: there is no removal.
    Target,
    /// This many times the vertices of the mesh, 1 or more; 4 to 5.5 is the useful range.
    Gamma(f64),
    /// Percent of the lattice points, from [`MIN_PERCENT`] to 100.
    Percent(f64),
    /// A number of points, from 4 to the number of lattice points.
    Size(usize),
}

/// Declares [`Parameters`]: its fields with their defaults, and a setter named after each field.
macro_rules! parameters {
    ($($(#[$doc:meta])* $field:ident: $type:ty = $default:expr;)+) => {
        /// The choices and numbers that determine the mesh of an image.
        ///
        /// The default is MGPRFS at 2 % of the lattice points; [`Method::parameters`] gives those
        /// of every named method. A setter of the same name changes each field:
        ///
        /// ```
        /// use pixmesh_meshing::{Method, Parameters, Target, parameters::Policy};
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
    /// How many initial points there are.
    initial_size: InitialSize = InitialSize::Gamma(4.0);
    /// How the initial points are chosen.
    generator: Generator = Generator::ErrorDiffusion;
    /// How the image becomes the density of the initial points.
    policy: Policy = Policy::PsdMaxD;
    /// The errors that error diffusion starts with.
    startup: Startup = Startup::Mirroring;
    /// The direction in which error diffusion visits each row.
    scan: Scan = Scan::Serpentine;
    /// Whether error diffused to points outside the image is lost.
    leaky: bool = false;
    /// Largest difference of the number of diffused points from the initial size; by default 10,
    /// for PSE 15.
    tolerance: Option<usize> = None;
    /// The smoothing filter.
    smoothing: Smoothing = Smoothing::Binomial;
    /// The order of the smoothing filter, odd; 1 is no smoothing.
    smoothing_order: usize = 3;
    /// The directions in which the image is smoothed.
    smoothing_direction: SmoothingDirection = SmoothingDirection::Both;
    /// Whether the image is smoothed and cropped first, then extended again and differentiated,
    /// instead of both by one filter.
    double_convolution: bool = false;
    /// The samples that the smoothing filter reads beyond the border, with `double_convolution`.
    smoothing_boundary: Boundary = Boundary::Zero;
    /// The samples that filters read beyond the border.
    boundary: Boundary = Boundary::Zero;
    /// The vector gradient where its rates of change in x and y are equal.
    psc_tie: PscTie = PscTie::Published;
    /// The image that guides the choice and the removal of points.
    guide: Guide = Guide::Components;
    /// The error that removal and refinement keep low. Flat reconstruction ignores it: there each
    /// face has the squared error of its best colour.
    error_metric: ErrorMetric = ErrorMetric::MeanCompSe;
    /// Whether removal continues below the target while it lowers the error. Flat reconstruction
    /// ignores it.
    bad_point_removal: bool = false;
    /// Effort of refinement, 0 (none) to [`MAX_EFFORT`]: each level adds steps to the one before.
    effort: u8 = 0;
    /// How the vertices are connected to faces.
    connectivity: Connectivity = Connectivity::Delaunay;
    /// What the vertices carry.
    values: Values = Values::Sampled;
    /// How the image is rebuilt from the mesh, which determines the errors of faces.
    reconstruction: Reconstruction = Reconstruction::Linear;
    /// How greedy removal shares its work among threads; with a target quality in the exact order.
    parallel: Parallel = Parallel::Exact;
    /// Seed of [`Generator::Random`] and [`Startup::Random`].
    seed: u64 = 0;
    /// The weight of the squared error of each lattice point; without weights all count alike.
    weights: Option<Weights> = None;
    /// Whether each pixel of an alpha over 0 belongs to a face that
    /// [is seen](crate::Mesh::is_seen), for which some transparent vertices get the least alpha.
    covers_alpha: bool = false;
    /// Whether pixels of alpha 0 are holes: the surface ends at their borders, exactly. Each face has
    /// corners of an alpha over 0 and no other pixels, or it belongs to a hole and has a corner of
    /// alpha 0. Needs a largest error as the target.
    holes: bool = false;
    /// Whether [`Approximation::removals`](crate::Approximation::removals) lists the removed
    /// vertices: 16 bytes each.
    lists_removals: bool = false;
}

/// The sizes that parameters set for one image.
///
/// ```
/// use pixmesh_meshing::{Method, Shape, Target};
/// let shape = Shape { width: 512, height: 512, component_count: 3, precision: 8 };
/// let plan = Method::Mgprfs.parameters(Target::Percent(2.0)).plan(shape)?;
/// assert_eq!((plan.size, plan.initial_size), (5242, 20971));
/// # Ok::<(), pixmesh_meshing::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Plan {
    /// Vertices that removal keeps, N; where the target is a quality the least, 4.
    pub size: usize,
    /// Initial points, N0.
    pub initial_size: usize,
}

impl Parameters {
    /// Checks every parameter that can be checked without an image.
    ///
    /// # Errors
    /// The first value that is out of its bounds.
    pub fn check(&self) -> Result<(), ParameterError> {
        self.check_holes()?;
        self.check_numbers(MAX_POINTS)
    }

    /// Checks every number, where sizes are at most `all`.
    fn check_numbers(&self, all: usize) -> Result<(), ParameterError> {
        match self.target {
            Target::Percent(percent) => check_range("density", percent, MIN_PERCENT, MAX_PERCENT)?,
            Target::Size(size) => check_size("size", size, all)?,
            Target::Psnr(psnr_db) => {
                check_range("target_psnr", psnr_db, 0.0, MAX_PSNR_DB)?;
                if !self.metric_of_guide().is_squared_difference() {
                    return Err(ParameterError::TargetNeedsSquaredError(self.error_metric));
                }
            }
            Target::MeanError(error) => check_range("target_error", error, 0.0, MAX_MEAN_ERROR)?,
            Target::MaxError(_) => {}
            Target::MaxDistance(most) => check_range("max_error", most, 0.0, MAX_DISTANCE)?,
        }
        match self.initial_size {
            InitialSize::Target => {}
            InitialSize::Gamma(gamma) => check_range("gamma", gamma, 1.0, MAX_GAMMA)?,
            InitialSize::Percent(percent) => {
                check_range("initial_density", percent, MIN_PERCENT, MAX_PERCENT)?;
            }
            InitialSize::Size(size) => check_size("initial_size", size, all)?,
        }
        check_range("effort", self.effort.into(), 0.0, MAX_EFFORT.into())?;
        let (parameter, value) = ("smoothing_order", self.smoothing_order);
        check_range(parameter, value as f64, 1.0, MAX_SMOOTHING_ORDER as f64)?;
        if value.is_multiple_of(2) {
            return Err(ParameterError::Even { parameter, value });
        }
        Ok(())
    }

    /// Checks the parameters for an image of this shape and computes its sizes.
    ///
    /// # Errors
    /// The first parameter that is out of its bounds or not defined for such an image.
    pub fn plan(&self, shape: Shape) -> Result<Plan, ParameterError> {
        check_shape(shape.width, shape.height, shape.precision)?;
        self.check_holes()?;
        let all = shape.width * shape.height;
        self.check_numbers(all)?;
        self.check_components(shape.component_count)?;
        self.check_weights((shape.width, shape.height))?;
        let size = match self.target {
            Target::Percent(percent) => points_of(percent, all),
            Target::Size(size) => size,
            _ => MIN_SIZE,
        };
        let initial_size = self.initial_points(size, all);
        let (parameter, factor, divisor) = match self.initial_size {
            InitialSize::Percent(_) => ("initial_density", 100.0, all as f64),
            _ => ("initial_size", 1.0, 1.0),
        };
        let [value, minimum, maximum] =
            [initial_size, size, all].map(|points| factor * points as f64 / divisor);
        check_range(parameter, value, minimum, maximum)?;
        Ok(Plan { size, initial_size })
    }

    fn initial_points(&self, size: usize, all: usize) -> usize {
        match (self.initial_size, self.target) {
            _ if self.generator == Generator::All => all,
            (InitialSize::Size(size), _) => size,
            (InitialSize::Percent(percent), _) => points_of(percent, all),
            _ if self.target.is_quality() => all,
            (InitialSize::Target, _) => size,
            (InitialSize::Gamma(gamma), Target::Percent(percent)) => {
                points_of(gamma * percent, all).max(size)
            }
            (InitialSize::Gamma(gamma), _) => {
                ((gamma * size as f64 + 1e-9).floor() as usize).clamp(size, all)
            }
        }
    }

    /// Whether the mesh is improved after its points have been chosen and removed.
    #[must_use]
    pub fn refines(&self) -> bool {
        self.effort > 0 || self.is_unconstrained()
    }

    /// Whether edges are flipped or values fitted at the end.
    pub(crate) fn is_unconstrained(&self) -> bool {
        self.connectivity == Connectivity::Free || self.values == Values::Fitted
    }

    /// Whether each face has one colour.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.reconstruction == Reconstruction::Flat
    }

    /// Whether greedy insertion chooses the initial points of an image of this shape.
    #[must_use]
    pub fn inserts(&self, shape: Shape) -> bool {
        self.inserts_within()
            || self.generator == Generator::Insertion
                && shape.width * shape.height <= MOST_INSERTED_INTO
    }

    /// Whether greedy insertion chooses initial points that keep the target's largest error: unless
    /// their number is given, or all points are asked for.
    #[must_use]
    pub fn inserts_within(&self) -> bool {
        let is_free = matches!(self.initial_size, InitialSize::Gamma(_) | InitialSize::Target);
        self.is_within() && is_free && self.generator != Generator::All
    }

    /// Whether greedy removal, or refinement after it, makes the mesh.
    #[must_use]
    pub fn simplifies(&self, plan: &Plan) -> bool {
        (plan.initial_size > plan.size || self.target.is_quality()) && !self.only_inserts()
            || self.bad_point_removal
            || self.effort > 0
    }

    /// Whether insertion until the largest error is kept is all.
    fn only_inserts(&self) -> bool {
        self.inserts_within() && self.initial_size == InitialSize::Target
    }

    /// Whether the points of the mesh alone determine its faces and its picture, so that the mesh
    /// may become a [`Progression`](crate::Progression).
    #[must_use]
    pub fn is_of_points_alone(&self) -> bool {
        !self.is_unconstrained() && !self.is_flat()
    }

    /// Whether a quality takes meshes of several sizes, because the method does not simplify, or
    /// refines after simplification. A largest error needs simplification or insertion alone.
    #[must_use]
    pub fn searches(&self) -> bool {
        let takes_all_points = self.initial_size == InitialSize::Target;
        match self.target {
            Target::Percent(_) | Target::Size(_) => false,
            Target::MaxError(_) | Target::MaxDistance(_) => {
                self.is_flat() || takes_all_points && self.generator != Generator::Insertion
            }
            _ => self.refines() || self.is_flat() || takes_all_points,
        }
    }

    /// Whether removal and insertion themselves see to a largest error of every sample.
    pub(crate) fn is_within(&self) -> bool {
        let is_largest = matches!(self.target, Target::MaxError(_) | Target::MaxDistance(_));
        is_largest && !self.searches()
    }

    /// Holes are made where a bound keeps their borders, by vertices that stay where they are.
    fn check_holes(&self) -> Result<(), ParameterError> {
        let moves = self.effort > 0 || self.values == Values::Fitted;
        let is_made = self.is_within() && !moves && self.guide == Guide::Components;
        if !self.holes || is_made { Ok(()) } else { Err(ParameterError::HolesNeedBound) }
    }

    /// The metric for the components that guide.
    pub(crate) fn metric_of_guide(&self) -> ErrorMetric {
        match self.guide {
            Guide::Components => self.error_metric,
            Guide::Luma | Guide::Gray => self.error_metric.of_one_component(),
        }
    }

    pub(crate) fn check_weights(&self, expected: (usize, usize)) -> Result<(), ParameterError> {
        match self.weights.as_ref().map(Weights::size) {
            Some(actual) if actual != expected => {
                Err(ParameterError::WeightsSize { actual, expected })
            }
            _ => Ok(()),
        }
    }

    pub(crate) fn check_components(&self, actual: usize) -> Result<(), ParameterError> {
        if self.generator == Generator::ErrorDiffusion {
            self.policy.check_component_count(actual)?;
        }
        if self.guide == Guide::Components {
            self.error_metric.check_component_count(actual)?;
        }
        self.guide.check_component_count(actual)
    }
}

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

pub(crate) fn check_size(
    parameter: &'static str,
    size: usize,
    all: usize,
) -> Result<(), ParameterError> {
    check_range(parameter, size as f64, MIN_SIZE as f64, all as f64)
}

/// `floor(percent / 100 * all)` of `all` points, where a product that misses a whole number by the
/// rounding of binary fractions counts as that number; at least the four corners, at most all.
fn points_of(percent: f64, all: usize) -> usize {
    let points = percent * all as f64 / 100.0;
    ((points * (1.0 + 1e-12) + 1e-9).floor() as usize).clamp(MIN_SIZE, all)
}

#[cfg(test)]
mod tests;
