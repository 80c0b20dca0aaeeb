//! The parameters of a mesh, and the only parser of them.
//!
//! Query, form fields and JSON all become pairs of a name and a text, and each pair goes through
//! [`ParameterSet::add`]: an unknown name, a repeated one, a text that is no value of the
//! parameter's grammar, and a value out of its bounds are refused there. What the parameters mean
//! together is decided in [`ParameterSet::finish`]. Every parameter is optional; without a target
//! the mesh has [`DEFAULT_DENSITY`] percent of the image's pixels as vertices.

mod grammar;
mod output;
mod preset;
mod sources;
mod stored;
mod table;

pub use grammar::whole_between;
pub use output::{Output, WRITING, WRITTEN_ALPHAS};
pub use preset::{PRESETS, Preset};
pub use sources::{MOST_MEMBERS, pairs_of_json, pairs_of_query, skip_rest};
pub use table::{Parameter, TABLE, Takes};

use crate::error::{EngineError, InputError};
use pixmesh_codec::Format;
use pixmesh_codec::{
    Alpha, Coloring, Compression, EncodeError, Header, LengthUnit, Nodata, PngCompression,
    ReliefSource, Shading, Texturing, UpAxis, ZOffset,
};
use pixmesh_meshing::parameters::{
    Boundary, Connectivity, ErrorMetric, Generator, Guide, InitialSize, Parallel, Plan, Policy,
    PscTie, Reconstruction, Scan, Smoothing, SmoothingDirection, Startup, Values,
};
use pixmesh_meshing::{Method, ParameterError, Parameters, Target};
use serde_json::{Map, Value, json};

/// The density in percent, where no other target is given.
pub const DEFAULT_DENSITY: f64 = 2.0;

/// The method, where none is given.
pub const DEFAULT_METHOD: Method = Method::Mgprfs;

/// Parameters that say what the mesh must be like, of which each excludes the others.
const TARGETS: &[&str] = &["density", "size", "target_psnr", "target_error", "max_error"];

/// Parameters of which each excludes the others.
const EXCLUSIVE: [&[&str]; 4] = [
    TARGETS,
    &["gamma", "initial_density", "initial_size"],
    &["height", "z_scale"],
    &["pixel_size", "width"],
];

/// The parameters given so far, each at most once.
#[derive(Clone, Debug, Default)]
pub struct ParameterSet {
    seen: Vec<&'static str>,
    choices: Choices,
}

/// The values given, by parameter.
#[derive(Clone, Debug, Default)]
struct Choices {
    preset: Option<&'static Preset>,
    method: Option<Method>,
    density: Option<f64>,
    size: Option<usize>,
    target_psnr: Option<f64>,
    target_error: Option<f64>,
    max_error: Option<f64>,
    gamma: Option<f64>,
    initial_density: Option<f64>,
    initial_size: Option<usize>,
    policy: Option<Policy>,
    psc_tie: Option<PscTie>,
    startup: Option<Startup>,
    initial: Option<Generator>,
    smoothing_order: Option<usize>,
    smoothing: Option<Smoothing>,
    smoothing_direction: Option<SmoothingDirection>,
    double_convolution: Option<bool>,
    smoothing_boundary: Option<Boundary>,
    boundary: Option<Boundary>,
    scan: Option<Scan>,
    leaky: Option<bool>,
    tolerance: Option<usize>,
    meshed: Option<Guide>,
    error_metric: Option<ErrorMetric>,
    bad_point_removal: Option<bool>,
    effort: Option<u8>,
    connectivity: Option<Connectivity>,
    values: Option<Values>,
    reconstruction: Option<Reconstruction>,
    parallel: Option<Parallel>,
    seed: Option<u64>,
    alpha: Option<Alpha>,
    lenient: Option<bool>,
    keep_image: Option<bool>,
    step: Option<f64>,
    nodata: Option<Nodata>,
    relief: Option<ReliefSource>,
    height: Option<f64>,
    z_scale: Option<f64>,
    invert_relief: Option<bool>,
    base: Option<f64>,
    z_offset: Option<ZOffset>,
    pixel_size: Option<f64>,
    width: Option<f64>,
    center: Option<bool>,
    up: Option<UpAxis>,
    color: Option<Coloring>,
    unit: Option<LengthUnit>,
    compression: Option<Compression>,
    texture: Option<Texturing>,
    shading: Option<Shading>,
    png_compression: Option<PngCompression>,
    format: Option<Format>,
}

/// What to make: the method and what is left of it after the parameters given.
#[derive(Clone, Debug)]
pub struct MeshOptions {
    /// The method that the parameters started from.
    pub method: Method,
    /// Everything that decides which mesh is made.
    pub parameters: Parameters,
    /// How the image is read and the mesh is written.
    pub output: Output,
    /// The format asked for by name.
    pub format: Option<Format>,
    /// The format of the preset, where nothing else says one.
    pub usual_format: Option<Format>,
}

impl ParameterSet {
    /// Takes one more parameter.
    ///
    /// # Errors
    /// When the name is unknown or given before, or the text is no value of the parameter.
    pub fn add(&mut self, name: &str, text: &str) -> Result<(), EngineError> {
        let parameter =
            TABLE.iter().find(|row| row.name == name).ok_or_else(|| unknown(name, &names()))?;
        if self.seen.contains(&parameter.name) {
            return Err(InputError::Repeated(name.to_owned()).into());
        }
        self.seen.push(parameter.name);
        parameter.read(text, &mut self.choices)
    }

    /// What the parameters mean together, with those of the preset.
    ///
    /// # Errors
    /// When there is more than one target or initial size, and whatever the methods refuse before
    /// they see an image.
    pub fn finish(&self) -> Result<MeshOptions, EngineError> {
        for exclusive in EXCLUSIVE {
            self.at_most_one_of(exclusive)?;
        }
        match self.choices.preset {
            None => self.options(),
            Some(preset) => {
                let options = self.completed(preset.parameters.iter().copied())?.options()?;
                Ok(MeshOptions { usual_format: preset.format, ..options })
            }
        }
    }

    /// These parameters, and those of the pairs that they leave open.
    fn completed<'a>(
        &self,
        pairs: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, EngineError> {
        let mut set = self.clone();
        for (name, text) in pairs.filter(|(name, _)| !self.settles(name)) {
            set.add(name, text)?;
        }
        Ok(set)
    }

    /// Whether a parameter is given, or excluded by one that is, or set by the method given.
    fn settles(&self, name: &str) -> bool {
        let excluding = EXCLUSIVE.iter().filter(|names| names.contains(&name));
        let is_beside = ["lenient", "format"].contains(&name);
        let is_of_method = !TARGETS.contains(&name) && !WRITING.contains(&name) && !is_beside;
        self.seen.contains(&name)
            || excluding.flat_map(|names| *names).any(|other| self.seen.contains(other))
            || self.choices.method.is_some() && is_of_method
            || self.choices.texture == Some(Texturing::Embed) && name == "color"
            || self.choices.color.is_some_and(|color| color != Coloring::Image) && name == "texture"
    }

    fn options(&self) -> Result<MeshOptions, EngineError> {
        if self.choices.texture == Some(Texturing::Embed)
            && self.choices.color.is_some_and(|color| color != Coloring::Image)
        {
            return Err(InputError::Exclusive("texture", "color").into());
        }
        let method = self.choices.method.unwrap_or(DEFAULT_METHOD);
        let parameters = self.choices.apply(&method.parameters(self.choices.target()));
        parameters.check()?;
        if self.choices.format == Some(Format::Progression) && !parameters.is_of_points_alone() {
            return Err(EncodeError::NotOfPointsAlone { format: "progression" }.into());
        }
        let output = self.choices.output();
        let parameters = parameters.covers_alpha(output.alpha.is_cut());
        let format = self.choices.format;
        Ok(MeshOptions { method, parameters, output, format, usual_format: None })
    }

    fn at_most_one_of(&self, names: &[&'static str]) -> Result<(), InputError> {
        let given: Vec<&'static str> =
            names.iter().copied().filter(|n| self.seen.contains(n)).collect();
        if let [first, second, ..] = given[..] {
            return Err(InputError::Exclusive(first, second));
        }
        Ok(())
    }
}

fn names() -> [&'static str; TABLE.len()] {
    TABLE.each_ref().map(|row| row.name)
}

/// The error for a name that is none of those known.
#[must_use]
pub fn unknown(name: &str, known: &[&str]) -> InputError {
    let name: String = name.chars().take(64).collect();
    let nearest = nearest_name(&name, known.iter().copied()).map(str::to_owned);
    InputError::Unknown { name, nearest }
}

/// Names that are not known, and those that mean the same.
const SYNONYMS: [(&str, &str); 5] = [
    ("vertices", "size"),
    ("points", "size"),
    ("count", "size"),
    ("percent", "density"),
    ("quality", "target_psnr"),
];

/// The known name that means the same as an unknown one, or is most like it: that it is a part of,
/// or a misspelling of.
#[must_use]
pub fn nearest_name<'a>(given: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let given: String = given.chars().take(64).collect();
    let synonym = SYNONYMS.iter().find(|(name, _)| given.eq_ignore_ascii_case(name));
    let distance = |name: &str| strsim::osa_distance(&given, name);
    let is_part = |name: &str| given.len() >= 3 && name.split('_').any(|word| word == given);
    let alike = |name: &&str| distance(name) <= name.len().div_ceil(2) || is_part(name);
    let rank = |name: &&str| {
        let means = synonym.is_some_and(|(_, meant)| meant == name);
        (!means, !is_part(name), distance(name))
    };
    known.filter(|name| alike(name) || !rank(name).0).min_by_key(rank)
}

impl Choices {
    fn target(&self) -> Target {
        let size = self.size.map(Target::Size);
        let psnr = self.target_psnr.map(Target::Psnr);
        let error = self.target_error.map(Target::MeanError);
        // Differences of whole samples are whole.
        let largest = self.max_error.map(|most| Target::MaxError(most.floor() as u16));
        size.or(psnr)
            .or(error)
            .or(largest)
            .unwrap_or(Target::Percent(self.density.unwrap_or(DEFAULT_DENSITY)))
    }

    /// The parameters of a method, but for those given explicitly.
    fn apply(&self, method: &Parameters) -> Parameters {
        let gamma = self.gamma.map(InitialSize::Gamma);
        let density = self.initial_density.map(InitialSize::Percent);
        let size = self.initial_size.map(InitialSize::Size);
        method
            .clone()
            .initial_size(gamma.or(density).or(size).unwrap_or(method.initial_size))
            .generator(self.initial.unwrap_or(method.generator))
            .policy(self.policy.unwrap_or(method.policy))
            .startup(self.startup.unwrap_or(method.startup))
            .scan(self.scan.unwrap_or(method.scan))
            .leaky(self.leaky.unwrap_or(method.leaky))
            .tolerance(self.tolerance.or(method.tolerance))
            .smoothing(self.smoothing.unwrap_or(method.smoothing))
            .smoothing_order(self.smoothing_order.unwrap_or(method.smoothing_order))
            .smoothing_direction(self.smoothing_direction.unwrap_or(method.smoothing_direction))
            .double_convolution(self.double_convolution.unwrap_or(method.double_convolution))
            .smoothing_boundary(self.smoothing_boundary.unwrap_or(method.smoothing_boundary))
            .boundary(self.boundary.unwrap_or(method.boundary))
            .psc_tie(self.psc_tie.unwrap_or(method.psc_tie))
            .guide(self.meshed.unwrap_or(method.guide))
            .error_metric(self.error_metric.unwrap_or(method.error_metric))
            .bad_point_removal(self.bad_point_removal.unwrap_or(method.bad_point_removal))
            .effort(self.effort.unwrap_or(method.effort))
            .connectivity(self.connectivity.unwrap_or(method.connectivity))
            .values(self.values.unwrap_or(method.values))
            .reconstruction(self.reconstruction.unwrap_or(method.reconstruction))
            .parallel(self.parallel.unwrap_or(method.parallel))
            .seed(self.seed.unwrap_or(method.seed))
    }
}

impl Preset {
    /// Its parameters as a JSON object, each value of its type.
    #[must_use]
    pub fn object(&self) -> Map<String, Value> {
        let typed = |&(name, text): &(&str, &str)| {
            let row = TABLE.iter().find(|row| row.name == name)?;
            Some((name.to_owned(), row.json(text.to_owned())))
        };
        self.parameters.iter().filter_map(typed).collect()
    }

    /// All of it as a JSON object, as `GET /v1/presets` tells it.
    #[must_use]
    pub fn row(&self) -> Value {
        let &Self { name, title, about, not_for, format, .. } = self;
        let (format, parameters) = (format.map(Format::name), self.object());
        json!({ "name": name, "title": title, "about": about, "not_for": not_for, "format": format, "parameters": parameters })
    }
}

impl MeshOptions {
    /// Checks the order against an image's header, and computes what it means for that image.
    ///
    /// # Errors
    /// The first parameter that does not fit such an image.
    pub fn plan(&self, header: &Header) -> Result<Plan, EngineError> {
        self.method.check_component_count(header.component_count)?;
        self.output.check(header.shape())?;
        Ok(self.parameters.plan(header.shape())?)
    }

    /// Whether a job of this order keeps the order of its vertices, from which it makes meshes of
    /// every smaller size: where removal ends the method, or where it was asked for.
    #[must_use]
    pub fn keeps_progression(&self, plan: &Plan) -> bool {
        let removes = self.parameters.simplifies(plan);
        self.parameters.is_of_points_alone()
            && (removes || self.format == Some(Format::Progression))
    }

    /// The options of the same mesh written in another way. The pairs name parameters of
    /// [`WRITING`], and take precedence over those of these options.
    ///
    /// # Errors
    /// As [`ParameterSet::add`] and [`ParameterSet::finish`].
    pub fn written_by<'a>(
        &self,
        pairs: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, EngineError> {
        let mut set = ParameterSet::default();
        pairs.into_iter().try_for_each(|(name, text)| set.add(name, text))?;
        if let Some(alpha) = set.choices.alpha
            && !WRITTEN_ALPHAS.contains(&alpha.to_string().as_str())
        {
            let (parameter, allowed) = (Alpha::PARAMETER, WRITTEN_ALPHAS);
            return Err(ParameterError::UnknownValue {
                parameter,
                value: alpha.to_string(),
                allowed,
            }
            .into());
        }
        let own: Vec<_> = pairs_of_query(Some(&self.query())).collect::<Result<_, _>>()?;
        set.completed(own.iter().map(|(name, text)| (name.as_str(), text.as_str())))?.finish()
    }

    /// What was run, as a query that asks for the same.
    #[must_use]
    pub fn query(&self) -> String {
        let pairs =
            TABLE.iter().filter_map(|row| Some(format!("{}={}", row.name, row.show(self)?)));
        // The sign before a colour, which would end a query.
        let pairs = pairs.map(|pair| pair.replace('#', "%23"));
        pairs.collect::<Vec<_>>().join("&")
    }

    /// The same as a JSON object, each value of its type.
    #[must_use]
    pub fn object(&self) -> Map<String, Value> {
        let members = TABLE.iter().filter_map(|row| Some((row.name.to_owned(), row.value(self)?)));
        members.collect()
    }
}
