//! The options of `make_model` that decide the mesh: those of the thesis's program, and those of the
//! service where both have the same values.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{ArgGroup, Args};
use pixmesh_meshing::parameters::{
    Boundary, Connectivity, ErrorMetric, Generator, Guide, InitialSize, MAX_DISTANCE, Parallel,
    Policy, PscTie, Reconstruction, Scan, Smoothing, SmoothingDirection, Startup, Values,
};
use pixmesh_meshing::{Method, ParameterError, Parameters, Target};

/// The choices that decide the mesh.
///
/// Each option that is not given has the value that `--method` gives it. Without a method that is
/// mgprfs; but where an option of the thesis's program chooses the initial points, it is the default
/// that its help names, so that the thesis's command lines keep their meaning.
#[derive(Args, Clone, Debug)]
#[command(group = ArgGroup::new("target")
    .args(["density", "size", "target_psnr", "target_error", "max_error"]))]
pub struct MeshOptions {
    /// Method whose parameters are the defaults of all other options: preview and
    /// med are fast, mgprfs is good, optimal best [default: mgprfs]
    #[arg(long, help_heading = SIZE, value_parser = named(Method::NAMES, Method::ALL))]
    pub method: Option<Method>,
    /// Vertices of the mesh, in percent of the picture's points (over 0, at most 100)
    /// [default: 2, without another target]
    #[arg(long, help_heading = SIZE, value_name = "PERCENT")]
    pub density: Option<f64>,
    /// Vertices of the mesh (at least 4)
    #[arg(long, help_heading = SIZE, value_name = "COUNT")]
    pub size: Option<usize>,
    /// Least PSNR of the mesh: removal stops before it would fall below
    #[arg(long, visible_alias = "psnr", help_heading = SIZE, value_name = "DECIBELS")]
    pub target_psnr: Option<f64>,
    /// Largest mean error per point, by --error-metric: removal stops before it would be exceeded
    #[arg(long, visible_alias = "error", help_heading = SIZE, value_name = "ERROR")]
    pub target_error: Option<f64>,
    /// Largest difference of any sample between the picture and its model, of an elevation model that of
    /// any height, 0 to 65535
    #[arg(long, help_heading = SIZE, value_name = "DIFFERENCE")]
    pub max_error: Option<f64>,
    /// Points to start with, in percent of the vertices of the mesh: 400 is gamma = 4
    #[arg(long, help_heading = INITIAL, value_name = "PERCENT", group = "initial_count")]
    pub relative_initial_density: Option<f64>,
    /// Points to start with, in percent of the picture's points [default: 100]
    #[arg(long, help_heading = INITIAL, value_name = "PERCENT", group = "initial_count")]
    pub initial_density: Option<f64>,
    /// Points to start with
    #[arg(long, help_heading = INITIAL, value_name = "COUNT", group = "initial_count")]
    pub initial_size: Option<usize>,
    /// How the points to start with are chosen [default: ed]
    #[arg(long, help_heading = INITIAL, value_parser = choice(GENERATORS))]
    pub initial_generator: Option<Generator>,
    /// Seed of random points and random initial errors
    #[arg(long, help_heading = INITIAL, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// How the picture becomes the density of the points to start with
    /// [default: max_comp_mmsodd_ed]
    #[arg(long, help_heading = DIFFUSION, value_parser = choice(STRATEGIES))]
    pub ed_strategy: Option<Strategy>,
    /// How many points more or fewer than asked for error diffusion may choose [default: 10, of
    /// three united components 15]
    #[arg(long, help_heading = DIFFUSION, value_name = "COUNT")]
    pub ed_size_tolerance: Option<usize>,
    /// The direction in which error diffusion visits the rows [default: serpentine]
    #[arg(long, help_heading = DIFFUSION, value_parser = named(Scan::NAMES, Scan::ALL))]
    pub ed_scan_order: Option<Scan>,
    /// Whether error that would go to points outside the picture is lost [default: no_leaky]
    #[arg(long, help_heading = DIFFUSION, value_parser = choice(LEAKAGES))]
    pub ed_leaky_mode: Option<bool>,
    /// The errors that error diffusion starts with: none, those of the mirrored picture, or random
    /// ones [default: mirror]
    #[arg(long, help_heading = DIFFUSION, value_parser = choice(STARTUPS))]
    pub ed_initial_error_mode: Option<Startup>,
    /// The vector gradient where its rates of change in x and y are equal [default: published]
    #[arg(long, help_heading = DIFFUSION, value_parser = named(PscTie::NAMES, PscTie::ALL))]
    pub psc_tie: Option<PscTie>,
    /// Order of the smoothing filter, odd; 1 is none [default: 3]
    #[arg(long, visible_alias = "smoothing-order", help_heading = FILTERS, value_name = "ORDER")]
    pub smooth_order: Option<usize>,
    /// The smoothing filter [default: binomial]
    #[arg(long, visible_alias = "smoothing", help_heading = FILTERS,
        value_parser = named(Smoothing::NAMES, Smoothing::ALL))]
    pub smooth_operator: Option<Smoothing>,
    /// Whether the picture is smoothed in both directions, or only at right angles to the
    /// derivative [default: both]
    #[arg(long, visible_alias = "smoothing-direction", help_heading = FILTERS,
        value_parser = named(SmoothingDirection::NAMES, SmoothingDirection::ALL))]
    pub smooth_direction: Option<SmoothingDirection>,
    /// What the smoothing filter sees beyond the border, with double convolution
    /// [default: zero_ext]
    #[arg(long, help_heading = FILTERS, value_parser = choice(BOUNDARIES))]
    pub smooth_bound_policy: Option<Boundary>,
    /// What the derivative, or the only filter, sees beyond the border: zero, the nearest point, or
    /// the mirrored picture [default: zero_ext]
    #[arg(long, help_heading = FILTERS, value_parser = choice(BOUNDARIES))]
    pub derivative_bound_policy: Option<Boundary>,
    /// Whether smoothing and derivative are two filters, each with its own boundary policy, instead
    /// of one [default: 0]
    #[arg(long, help_heading = FILTERS, value_parser = choice(SWITCH))]
    pub use_double_convolution: Option<bool>,
    /// What is meshed: all components (mcmg), or the luma, whose mesh then gets the colours back
    /// (lsmg) [default: mcmg]
    #[arg(long, help_heading = REMOVAL, value_parser = choice(GENERATION_POLICIES))]
    pub mesh_generation_policy: Option<Guide>,
    /// The error that removal raises least [default: mean_comp_se]
    #[arg(long, help_heading = REMOVAL, value_parser = named(ErrorMetric::NAMES, ErrorMetric::ALL))]
    pub error_metric: Option<ErrorMetric>,
    /// Whether points go on being removed below the size asked for while that lowers the error
    /// [default: 1]
    #[arg(long, help_heading = REMOVAL, value_parser = choice(SWITCH))]
    pub bad_point_removal: Option<bool>,
    /// How point removal is shared out to threads: as far as the exact order allows, or tile by tile,
    /// which is faster and changes the mesh a little [default: exact]
    #[arg(long, help_heading = REMOVAL, value_parser = named(Parallel::NAMES, Parallel::ALL))]
    pub parallel: Option<Parallel>,
    /// Effort of refinement, 0 (none) to 9: vertices move and change places while that lowers the
    /// error [default: 0, for the method optimal 5]
    #[arg(long, help_heading = REFINEMENT, value_name = "LEVEL")]
    pub effort: Option<u8>,
    /// What decides the faces: the preferred-directions Delaunay triangulation, or flips of edges
    /// that lower the squared error [default: delaunay]
    #[arg(long, help_heading = REFINEMENT,
        value_parser = named(Connectivity::NAMES, Connectivity::ALL))]
    pub connectivity: Option<Connectivity>,
    /// What the vertices carry: the picture's samples, or the values that fit it best
    /// [default: sampled]
    #[arg(long, help_heading = REFINEMENT, value_parser = named(Values::NAMES, Values::ALL))]
    pub values: Option<Values>,
    /// How the picture is rebuilt, which the error of faces is measured by: linear interpolation, or
    /// one colour for each face [default: linear, for the method flat flat]
    #[arg(long, help_heading = REFINEMENT,
        value_parser = named(Reconstruction::NAMES, Reconstruction::ALL))]
    pub reconstruction: Option<Reconstruction>,
    #[command(flatten)]
    service: ServiceOptions,
}

/// The options that have other names over HTTP, or other names of values, by those names. They mean
/// what they mean there: the method's other parameters stay as they are.
#[derive(Args, Clone, Debug)]
struct ServiceOptions {
    /// Points to start with per vertex of the mesh
    #[arg(long, help_heading = SERVICE, value_name = "RATIO", group = "initial_count")]
    gamma: Option<f64>,
    /// How the points to start with are chosen
    #[arg(long, help_heading = SERVICE, conflicts_with = "initial_generator",
        value_parser = named(Generator::NAMES, Generator::ALL))]
    initial: Option<Generator>,
    /// How the picture becomes a density
    #[arg(long, help_heading = SERVICE, conflicts_with = "ed_strategy",
        value_parser = named(Policy::NAMES, Policy::ALL))]
    policy: Option<Policy>,
    /// How many points more or fewer than asked for error diffusion may choose
    #[arg(long, help_heading = SERVICE, value_name = "COUNT", conflicts_with = "ed_size_tolerance")]
    tolerance: Option<usize>,
    /// The direction in which error diffusion visits the rows
    #[arg(long, help_heading = SERVICE, conflicts_with = "ed_scan_order",
        value_parser = named(Scan::NAMES, Scan::ALL))]
    scan: Option<Scan>,
    /// Whether error that would go to points outside the picture is lost
    #[arg(long, help_heading = SERVICE, conflicts_with = "ed_leaky_mode",
        value_parser = choice(SWITCH))]
    leaky: Option<bool>,
    /// The errors that error diffusion starts with
    #[arg(long, help_heading = SERVICE, conflicts_with = "ed_initial_error_mode",
        value_parser = named(Startup::NAMES, Startup::ALL))]
    startup: Option<Startup>,
    /// What the smoothing filter sees beyond the border, with double convolution
    #[arg(long, help_heading = SERVICE, conflicts_with = "smooth_bound_policy",
        value_parser = named(Boundary::NAMES, Boundary::ALL))]
    smoothing_boundary: Option<Boundary>,
    /// What the derivative, or the only filter, sees beyond the border
    #[arg(long, help_heading = SERVICE, conflicts_with = "derivative_bound_policy",
        value_parser = named(Boundary::NAMES, Boundary::ALL))]
    boundary: Option<Boundary>,
    /// Whether smoothing and derivative are two filters
    #[arg(long, help_heading = SERVICE, conflicts_with = "use_double_convolution",
        value_parser = choice(SWITCH))]
    double_convolution: Option<bool>,
    /// What is meshed
    #[arg(long, help_heading = SERVICE, conflicts_with = "mesh_generation_policy",
        value_parser = named(Guide::NAMES, Guide::ALL))]
    meshed: Option<Guide>,
}

impl ServiceOptions {
    /// Sets what is given.
    fn set(&self, parameters: &mut Parameters, component_count: usize) {
        set(&mut parameters.initial_size, self.gamma.map(InitialSize::Gamma));
        set(&mut parameters.generator, self.initial);
        set(&mut parameters.policy, self.policy);
        parameters.tolerance = self.tolerance.or(parameters.tolerance);
        set(&mut parameters.scan, self.scan);
        set(&mut parameters.leaky, self.leaky);
        set(&mut parameters.startup, self.startup);
        set(&mut parameters.smoothing_boundary, self.smoothing_boundary);
        set(&mut parameters.boundary, self.boundary);
        set(&mut parameters.double_convolution, self.double_convolution);
        set(&mut parameters.guide, self.meshed.filter(|_| component_count > 1));
    }
}

/// The density in percent without a target, that of the service.
const DEFAULT_DENSITY: f64 = 2.0;

/// Headings of the help, in order.
const SIZE: &str = "Method and size of the mesh";
const INITIAL: &str = "Points to start with";
const DIFFUSION: &str = "Error diffusion";
const FILTERS: &str = "Filters";
const REMOVAL: &str = "Removal of points";
const REFINEMENT: &str = "Refinement";
const SERVICE: &str = "The service's names";

/// A policy by the name of the thesis's program, which means one thing for colour pictures and
/// another for gray ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strategy {
    /// The policy for pictures of several components.
    several: Policy,
    /// The policy for pictures of one component.
    one: Policy,
}

impl Strategy {
    /// The policy for pictures of `component_count` components.
    #[must_use]
    pub fn policy(self, component_count: usize) -> Policy {
        if component_count == 1 { self.one } else { self.several }
    }
}

/// A strategy that means the MMSODD of a gray picture.
const fn mmsodd(several: Policy) -> Strategy {
    Strategy { several, one: Policy::PsaD }
}

/// A strategy that means the Laplacian of a gray picture.
const fn laplacian(several: Policy) -> Strategy {
    Strategy { several, one: Policy::PsaL }
}

const STRATEGIES: &[(&str, Strategy)] = &[
    ("gray_comp_mmsodd_ed", mmsodd(Policy::PsbD)),
    ("gray_comp_laplacian_ed", laplacian(Policy::PsbL)),
    ("vector_space_comb", mmsodd(Policy::Psc)),
    ("max_comp_mmsodd_ed", mmsodd(Policy::PsdMaxD)),
    ("max_comp_laplacian_ed", laplacian(Policy::PsdMaxL)),
    ("mean_comp_mmsodd_ed", mmsodd(Policy::PsdAvgD)),
    ("mean_comp_laplacian_ed", laplacian(Policy::PsdAvgL)),
    ("three_comps_union_mmsodd", mmsodd(Policy::PseD)),
    // Of a gray picture the published program takes the MMSODD here too.
    ("three_comps_union_laplacian", mmsodd(Policy::PseL)),
];

const GENERATORS: &[(&str, Generator)] = &[
    ("all", Generator::All),
    ("random", Generator::Random),
    ("ed", Generator::ErrorDiffusion),
    ("uniform", Generator::Uniform),
    ("insertion", Generator::Insertion),
];

const BOUNDARIES: &[(&str, Boundary)] = &[
    ("zero_ext", Boundary::Zero),
    ("const_ext", Boundary::Constant),
    ("sym_ext", Boundary::Symmetric),
];

const STARTUPS: &[(&str, Startup)] =
    &[("zero", Startup::Classic), ("mirror", Startup::Mirroring), ("random", Startup::Random)];

const GENERATION_POLICIES: &[(&str, Guide)] = &[("mcmg", Guide::Components), ("lsmg", Guide::Luma)];

const LEAKAGES: &[(&str, bool)] = &[("leaky", true), ("no_leaky", false)];

const SWITCH: &[(&str, bool)] = &[("0", false), ("1", true), ("false", false), ("true", true)];

/// A parser of the names in a table.
fn choice<T: Copy + Send + Sync + 'static>(
    table: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let names = PossibleValuesParser::new(table.iter().map(|(name, _)| *name));
    names.try_map(|name| {
        table.iter().find(|entry| entry.0 == name).map(|entry| entry.1).ok_or("unknown name")
    })
}

/// A parser of the names of an enumeration's values.
pub(crate) fn named<T: Copy + Send + Sync + 'static>(
    names: &'static [&'static str],
    values: &'static [T],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names).try_map(|name| {
        let place = names.iter().position(|known| *known == name);
        place.map(|place| values[place]).ok_or("unknown name")
    })
}

impl MeshOptions {
    /// The parameters for a picture of `component_count` components.
    ///
    /// # Errors
    /// When the method is not defined for so many components.
    pub fn parameters(&self, component_count: usize) -> Result<Parameters, ParameterError> {
        if let Some(value) = self.max_error.filter(|most| !(0.0..=MAX_DISTANCE).contains(most)) {
            let (parameter, minimum, maximum) = ("max_error", 0.0, MAX_DISTANCE);
            return Err(ParameterError::OutOfRange { parameter, value, minimum, maximum });
        }
        let mut parameters = match self.method {
            None if self.is_of_thesis() => self.thesis_defaults(),
            method => {
                let method = method.unwrap_or(Method::Mgprfs);
                method.check_component_count(component_count)?;
                method.parameters(self.target())
            }
        };
        self.set_initial_points(&mut parameters, component_count);
        self.set_filters(&mut parameters);
        self.set_diffusion(&mut parameters);
        self.set_removal(&mut parameters, component_count);
        self.service.set(&mut parameters, component_count);
        Ok(parameters)
    }

    /// How large or good the mesh is to be.
    fn target(&self) -> Target {
        let size = self.size.map(Target::Size);
        let psnr_db = self.target_psnr.map(Target::Psnr);
        let error = self.target_error.map(Target::MeanError);
        let largest = self.max_error.map(|most| Target::MaxError(most.floor() as u16));
        let density = Target::Percent(self.density.unwrap_or(DEFAULT_DENSITY));
        size.or(psnr_db).or(error).or(largest).unwrap_or(density)
    }

    /// Whether an option of the thesis's program chooses the initial points.
    fn is_of_thesis(&self) -> bool {
        self.initial_generator.is_some()
            || self.initial_density.is_some()
            || self.relative_initial_density.is_some()
            || self.ed_strategy.is_some()
            || self.ed_size_tolerance.is_some()
            || self.ed_scan_order.is_some()
            || self.ed_leaky_mode.is_some()
            || self.ed_initial_error_mode.is_some()
    }

    /// The defaults of the thesis's program.
    fn thesis_defaults(&self) -> Parameters {
        Parameters::default()
            .target(self.target())
            .initial_size(InitialSize::Percent(100.0))
            .bad_point_removal(true)
    }

    /// Sets how the initial points are chosen.
    fn set_initial_points(&self, parameters: &mut Parameters, component_count: usize) {
        let relative = self.relative_initial_density.map(|p| InitialSize::Gamma(p / 100.0));
        let density = self.initial_density.map(InitialSize::Percent);
        let size = self.initial_size.map(InitialSize::Size);
        set(&mut parameters.initial_size, relative.or(density).or(size));
        set(&mut parameters.generator, self.initial_generator);
        let policy = self.ed_strategy.map(|strategy| strategy.policy(component_count));
        set(&mut parameters.policy, policy);
        parameters.seed = self.seed;
    }

    /// Sets how error diffusion goes about it.
    fn set_diffusion(&self, parameters: &mut Parameters) {
        set(&mut parameters.startup, self.ed_initial_error_mode);
        set(&mut parameters.scan, self.ed_scan_order);
        set(&mut parameters.leaky, self.ed_leaky_mode);
        set(&mut parameters.psc_tie, self.psc_tie);
        parameters.tolerance = self.ed_size_tolerance.or(parameters.tolerance);
    }

    /// Sets what removal goes by. A gray picture is its own luma.
    fn set_removal(&self, parameters: &mut Parameters, component_count: usize) {
        let policy = self.mesh_generation_policy.filter(|_| component_count > 1);
        set(&mut parameters.guide, policy);
        set(&mut parameters.error_metric, self.error_metric);
        set(&mut parameters.bad_point_removal, self.bad_point_removal);
        set(&mut parameters.effort, self.effort);
        set(&mut parameters.connectivity, self.connectivity);
        set(&mut parameters.values, self.values);
        set(&mut parameters.reconstruction, self.reconstruction);
        set(&mut parameters.parallel, self.parallel);
    }

    /// Sets how the picture is smoothed and differentiated.
    fn set_filters(&self, parameters: &mut Parameters) {
        set(&mut parameters.smoothing, self.smooth_operator);
        set(&mut parameters.smoothing_order, self.smooth_order);
        set(&mut parameters.smoothing_direction, self.smooth_direction);
        set(&mut parameters.smoothing_boundary, self.smooth_bound_policy);
        set(&mut parameters.boundary, self.derivative_bound_policy);
        set(&mut parameters.double_convolution, self.use_double_convolution);
    }
}

/// Sets a value where one is given.
fn set<T>(value: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *value = given;
    }
}
