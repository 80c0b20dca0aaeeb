//! The table of parameters: name, values, meaning, and where each value goes.
//!
//! The parser, `GET /v1/methods` and the OpenAPI document are all made from it.

use super::grammar::{decimal, flag, malformed, whole_between};
use super::preset::{NAMES, Preset};
use super::{Choices, MeshOptions};
use crate::error::EngineError;
use pixmesh_codec::Format;
use pixmesh_codec::{
    Alpha, Coloring, Compression, LengthUnit, Nodata, PngCompression, ReliefHeight, ReliefSource,
    Shading, Texturing, UpAxis, ZOffset,
};
use pixmesh_meshing::parameters::{
    Boundary, Connectivity, ErrorMetric, Generator, Guide, InitialSize, MAX_DISTANCE, MAX_EFFORT,
    MAX_GAMMA, MAX_MEAN_ERROR, MAX_PERCENT, MAX_PSNR_DB, MAX_SMOOTHING_ORDER, MIN_PERCENT,
    MIN_SIZE, Parallel, Policy, PscTie, Reconstruction, Scan, Smoothing, SmoothingDirection,
    Startup, Values,
};
use pixmesh_meshing::{Method, ParameterError, Target};
use serde_json::Value;
use std::str::FromStr;

/// One parameter.
pub struct Parameter {
    /// Its name in query, form and JSON.
    pub name: &'static str,
    /// What it means, with its unit.
    pub about: &'static str,
    /// The values it takes.
    pub takes: Takes,
    read: Reader,
    show: fn(&MeshOptions) -> Option<String>,
}

/// The values that a parameter takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Takes {
    /// A decimal number between bounds, both allowed.
    Decimal {
        /// The least.
        least: f64,
        /// The most.
        most: f64,
    },
    /// A whole number between bounds, both allowed.
    Whole {
        /// The least.
        least: u64,
        /// The most.
        most: u64,
    },
    /// `true` or `false`.
    Flag,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A text of this regular expression.
    Pattern(&'static str),
}

/// Puts a value where it belongs.
enum Reader {
    Decimal(fn(&mut Choices, f64)),
    Whole(fn(&mut Choices, u64)),
    Flag(fn(&mut Choices, bool)),
    Word(fn(&mut Choices, &str) -> Result<(), ParameterError>),
}

impl Parameter {
    /// Reads the text of a value and puts the value where it belongs.
    pub(super) fn read(&self, text: &str, choices: &mut Choices) -> Result<(), EngineError> {
        match (&self.read, self.takes) {
            (Reader::Decimal(put), Takes::Decimal { least, most }) => {
                put(choices, decimal(self.name, text, least, most)?);
            }
            (Reader::Whole(put), Takes::Whole { least, most }) => {
                put(choices, whole_between(self.name, text, least, most)?);
            }
            (Reader::Flag(put), _) => put(choices, flag(self.name, text)?),
            (Reader::Word(put), _) => {
                put(choices, text).map_err(|error| called(error, self.name))?;
            }
            _ => return Err(malformed(self.name, "a value").into()),
        }
        Ok(())
    }

    /// The value that some options have; `None` where the parameter plays no part in it.
    #[must_use]
    pub fn show(&self, options: &MeshOptions) -> Option<String> {
        (self.show)(options)
    }

    /// The same as JSON of its type.
    #[must_use]
    pub fn value(&self, options: &MeshOptions) -> Option<Value> {
        Some(self.json(self.show(options)?))
    }

    /// The text of a value as JSON of its type.
    pub(super) fn json(&self, text: String) -> Value {
        match self.takes {
            Takes::Word(_) => text.into(),
            _ => serde_json::from_str(&text).unwrap_or(Value::String(text)),
        }
    }
}

/// The error under the parameter's own name: two of them may take values of one type.
fn called(mut error: ParameterError, name: &'static str) -> ParameterError {
    if let ParameterError::UnknownValue { parameter, .. } = &mut error {
        *parameter = name;
    }
    error
}

/// A decimal parameter.
macro_rules! decimal {
    ($name:ident, $about:literal, $least:expr, $most:expr, $show:expr) => {
        Parameter {
            name: stringify!($name),
            about: $about,
            takes: Takes::Decimal { least: $least, most: $most },
            read: Reader::Decimal(|choices, value| choices.$name = Some(value)),
            show: $show,
        }
    };
}

/// A whole-number parameter.
macro_rules! whole {
    ($name:ident, $about:literal, $least:expr, $most:expr, $show:expr) => {
        Parameter {
            name: stringify!($name),
            about: $about,
            takes: Takes::Whole { least: $least, most: $most },
            read: Reader::Whole(|choices, value| choices.$name = value.try_into().ok()),
            show: $show,
        }
    };
}

/// A parameter that is true or false.
macro_rules! flag {
    ($name:ident, $about:literal, $show:expr) => {
        Parameter {
            name: stringify!($name),
            about: $about,
            takes: Takes::Flag,
            read: Reader::Flag(|choices, value| choices.$name = Some(value)),
            show: $show,
        }
    };
}

/// A parameter that takes one of a type's names.
macro_rules! word {
    ($name:ident: $type:ident, $about:literal, $show:expr) => {
        Parameter {
            name: stringify!($name),
            about: $about,
            takes: Takes::Word($type::NAMES),
            read: Reader::Word(|choices, text| put_word(&mut choices.$name, text)),
            show: $show,
        }
    };
}

fn put_word<T: FromStr<Err = ParameterError>>(
    place: &mut Option<T>,
    text: &str,
) -> Result<(), ParameterError> {
    *place = Some(text.parse()?);
    Ok(())
}

/// In a query or a form an unescaped plus means a blank, and no method's name ends with one.
fn plus_of_a_form(name: &str) -> &str {
    if name == "med " { Method::MedPlus.name() } else { name }
}

/// The most vertices: indices of vertices have 32 bits.
const MAX_SIZE: u64 = u32::MAX as u64;
const LEAST_SIZE: u64 = MIN_SIZE as u64;
const MOST_EFFORT: u64 = MAX_EFFORT as u64;
const MOST_SMOOTHING: u64 = MAX_SMOOTHING_ORDER as u64;
/// The longest length, whatever the unit, and the smallest pixel: 32-bit floating-point positions
/// hold both.
const MAX_LENGTH: f64 = 1e9;
const MIN_PIXEL_SIZE: f64 = 1e-9;
/// Every parameter, in the order of their documentation.
pub static TABLE: [Parameter; 54] = [
    Parameter {
        name: "preset",
        about: "Parameters for a purpose, as /v1/presets lists them; those given beside it win.",
        takes: Takes::Word(&NAMES),
        read: Reader::Word(|choices, text| {
            choices.preset = Some(Preset::named(text)?);
            Ok(())
        }),
        show: |_| None,
    },
    Parameter {
        name: "method",
        about: "The method, which sets every other parameter; one given explicitly wins. The plus of med+ may be written as it is, as %2B, or as the blank that forms make of it. Default: mgprfs.",
        takes: Takes::Word(Method::NAMES),
        read: Reader::Word(|choices, text| put_word(&mut choices.method, plus_of_a_form(text))),
        show: |options| Some(options.method.to_string()),
    },
    decimal!(
        density,
        "Vertices in percent of the image's pixels, the four corners at least. The default is 2, where no other target is given.",
        MIN_PERCENT,
        MAX_PERCENT,
        |options| match options.parameters.target {
            Target::Percent(density) => Some(density.to_string()),
            _ => None,
        }
    ),
    whole!(
        size,
        "Number of vertices, at most that of pixels; instead of density.",
        LEAST_SIZE,
        MAX_SIZE,
        |options| match options.parameters.target {
            Target::Size(size) => Some(size.to_string()),
            _ => None,
        }
    ),
    decimal!(
        target_psnr,
        "At least this PSNR in decibels: removal stops before it would fall below, methods that do not simplify and those that refine search for the smallest mesh; instead of density.",
        0.0,
        MAX_PSNR_DB,
        |options| match options.parameters.target {
            Target::Psnr(psnr_db) => Some(psnr_db.to_string()),
            _ => None,
        }
    ),
    decimal!(
        target_error,
        "At most this mean error per pixel in the unit of error_metric: removal stops before it would be exceeded, methods that do not simplify and those that refine search for the smallest mesh; instead of density.",
        0.0,
        MAX_MEAN_ERROR,
        |options| match options.parameters.target {
            Target::MeanError(error) => Some(error.to_string()),
            _ => None,
        }
    ),
    decimal!(
        max_error,
        "No sample of the picture that the mesh models may differ from the image's by more than this, and no height of the mesh from an elevation model's, in its units: vertices go until none more may, and connectivity, values and effort make room for fewer; method preview inserts until it holds; instead of density.",
        0.0,
        MAX_DISTANCE,
        |options| options.output.bound.map(|bound| bound.to_string())
    ),
    decimal!(
        gamma,
        "How many times as many points the mesh starts with as it ends with; 4 to 5.5 is the useful range.",
        1.0,
        MAX_GAMMA,
        |options| match options.parameters.initial_size {
            InitialSize::Gamma(gamma) => Some(gamma.to_string()),
            _ => None,
        }
    ),
    decimal!(
        initial_density,
        "Points the mesh starts with, in percent of the image's pixels; instead of gamma.",
        MIN_PERCENT,
        MAX_PERCENT,
        |options| match options.parameters.initial_size {
            InitialSize::Percent(density) => Some(density.to_string()),
            _ => None,
        }
    ),
    whole!(
        initial_size,
        "Number of points the mesh starts with; instead of gamma.",
        LEAST_SIZE,
        MAX_SIZE,
        |options| match options.parameters.initial_size {
            InitialSize::Size(size) => Some(size.to_string()),
            _ => None,
        }
    ),
    word!(initial: Generator, "How the initial points are chosen: by error diffusion, by greedy insertion (above a megapixel by error diffusion in a reduced picture), all, at random, or on a regular grid.",
        |options| Some(options.parameters.generator.to_string())),
    word!(policy: Policy, "How the image becomes the density of the initial points.",
        |options| Some(options.parameters.policy.to_string())),
    word!(psc_tie: PscTie, "For policy psc: the vector gradient where its rates of change in x and y are equal.",
        |options| (options.parameters.policy == Policy::Psc).then(|| options.parameters.psc_tie.to_string())),
    word!(startup: Startup, "The errors that error diffusion starts with.",
        |options| Some(options.parameters.startup.to_string())),
    word!(scan: Scan, "The direction in which error diffusion visits each row.",
        |options| Some(options.parameters.scan.to_string())),
    flag!(leaky, "Whether error that would leave the image is lost.", |options| Some(
        options.parameters.leaky.to_string()
    )),
    whole!(
        tolerance,
        "How many more or fewer points error diffusion may choose than asked for; the default is the policy's own.",
        0,
        MAX_SIZE,
        |options| options.parameters.tolerance.map(|points| points.to_string())
    ),
    word!(smoothing: Smoothing, "The smoothing filter.",
        |options| Some(options.parameters.smoothing.to_string())),
    whole!(
        smoothing_order,
        "The order of the smoothing filter, odd; 1 is no smoothing.",
        1,
        MOST_SMOOTHING,
        |options| Some(options.parameters.smoothing_order.to_string())
    ),
    word!(smoothing_direction: SmoothingDirection, "Whether the image is smoothed in both directions, or only at right angles to the derivative.",
        |options| Some(options.parameters.smoothing_direction.to_string())),
    flag!(
        double_convolution,
        "Whether smoothing and derivative are two filters, the image cropped in between, instead of one.",
        |options| Some(options.parameters.double_convolution.to_string())
    ),
    word!(smoothing_boundary: Boundary, "With double_convolution: what the smoothing filter sees beyond the image's border.",
        |options| options.parameters.double_convolution.then(|| options.parameters.smoothing_boundary.to_string())),
    word!(boundary: Boundary, "What the filters see beyond the image's border.",
        |options| Some(options.parameters.boundary.to_string())),
    word!(meshed: Guide, "What removal goes by: all components, the luma or the thesis's gray picture; the mesh gets the colours back.",
        |options| Some(options.parameters.guide.to_string())),
    word!(error_metric: ErrorMetric, "The error that removal raises least.",
        |options| Some(options.parameters.error_metric.to_string())),
    flag!(
        bad_point_removal,
        "Whether removal goes on below the target while it lowers the error.",
        |options| Some(options.parameters.bad_point_removal.to_string())
    ),
    whole!(
        effort,
        "Effort of refinement after removal, from 0 (none): vertices move and change places while that lowers the error.",
        0,
        MOST_EFFORT,
        |options| Some(options.parameters.effort.to_string())
    ),
    word!(connectivity: Connectivity, "What decides the faces: the preferred-directions Delaunay triangulation, or flips of edges that lower the squared error.",
        |options| Some(options.parameters.connectivity.to_string())),
    word!(values: Values, "What the vertices carry: the image's samples, or the values that fit it best.",
        |options| Some(options.parameters.values.to_string())),
    word!(reconstruction: Reconstruction, "How the picture is rebuilt, which the error of faces is measured by: linear interpolation, or one colour for each face.",
        |options| Some(options.parameters.reconstruction.to_string())),
    word!(parallel: Parallel, "How point removal is shared out to threads: as far as the exact order allows, or tile by tile, which is faster and changes the mesh a little (by less than 0.05 dB); method=optimal begins with tiles.",
        |options| Some(options.parameters.parallel.to_string())),
    whole!(seed, "Seed of the random initial points.", 0, u64::MAX, |options| Some(
        options.parameters.seed.to_string()
    )),
    Parameter {
        name: "alpha",
        about: "What becomes of the image's alpha: keep; cut or cut:0 to cut:254, which makes pixels of at most that alpha transparent (cut alone: 8) and leaves the triangles that show nothing out of every format but MODEL, pmesh and pictures; drop; or over:#rrggbb, composed over that colour (in a query the # is %23, or is left out). Default: keep.",
        takes: Takes::Pattern("^(keep|cut(:[0-9]{1,3})?|drop|over:#?[0-9A-Fa-f]{6})$"),
        read: Reader::Word(|choices, text| put_word(&mut choices.alpha, text)),
        show: |options| {
            (options.output.alpha != Alpha::Keep).then(|| options.output.alpha.to_string())
        },
    },
    flag!(
        lenient,
        "Whether a JPEG, PNG, GIF or PNM that ends early is taken as far as it goes instead of refused. Default: false.",
        |options| options.output.lenient.then(|| "true".to_owned())
    ),
    flag!(
        keep_image,
        "Whether a job keeps the image as it was sent, so that another job can be made of it (image_of) and GET /v1/jobs/{id}/image returns it. Default: false.",
        |options| options.output.keep_image.then(|| "true".to_owned())
    ),
    decimal!(
        step,
        "Elevation models: the height of a step of the samples. Default: that of whole numbers, an eighth of max_error, or the smallest that 16 bits allow.",
        MIN_PIXEL_SIZE,
        MAX_LENGTH,
        |options| options.output.step.map(|step| step.to_string())
    ),
    word!(nodata: Nodata, "Elevation models: whether missing samples, those of the file's nodata value or NaN, are holes of the mesh, which need max_error, or are filled. Default: hole.",
        |options| Some(options.output.nodata).filter(|kind| *kind != Nodata::default()).map(|kind| kind.to_string())),
    word!(relief: ReliefSource, "Formats with three dimensions: the luma or the component whose samples become z. Without it the mesh is flat, and an STL follows the luma.",
        |options| options.output.geometry.relief.map(|relief| relief.source.to_string())),
    decimal!(
        height,
        "The relief's height at the largest sample that the precision allows, in unit; makes a relief. Default: a tenth of the longer side.",
        0.0,
        MAX_LENGTH,
        |options| match options.output.geometry.relief?.height {
            ReliefHeight::Total(height) => Some(height.to_string()),
            _ => None,
        }
    ),
    decimal!(
        z_scale,
        "The relief's height per step of a sample, in unit, as in elevation models; makes a relief; instead of height.",
        0.0,
        MAX_LENGTH,
        |options| match options.output.geometry.relief?.height {
            ReliefHeight::PerSample(height) => Some(height.to_string()),
            _ => None,
        }
    ),
    flag!(
        invert_relief,
        "Whether dark is high and bright is low, as lithophanes want it; makes a relief. Default: false.",
        |options| options.output.geometry.relief?.invert.then(|| "true".to_owned())
    ),
    decimal!(
        base,
        "How far a base reaches below the least height, in unit, which makes the mesh a watertight solid. Default: 0, none; for an STL a quarter of the relief's height.",
        0.0,
        MAX_LENGTH,
        |options| Some(options.output.geometry.base)
            .filter(|base| *base > 0.0)
            .map(|base| base.to_string())
    ),
    Parameter {
        name: "z_offset",
        about: "What is taken off every height, in unit: a length, or min for the height of the lowest vertex, which comes to 0. Default: 0.",
        takes: Takes::Pattern("^(min|-?[0-9]+([.][0-9]+)?([eE][-+]?[0-9]+)?)$"),
        read: Reader::Word(|choices, text| put_word(&mut choices.z_offset, text)),
        show: |options| {
            Some(options.output.geometry.z_offset)
                .filter(|offset| *offset != ZOffset::default())
                .map(|offset| offset.to_string())
        },
    },
    decimal!(
        pixel_size,
        "The length from one pixel to the next in formats with three dimensions, in unit. Default: 1.",
        MIN_PIXEL_SIZE,
        MAX_LENGTH,
        |options| Some(options.output.geometry.pixel_size)
            .filter(|size| *size != 1.0)
            .map(|size| size.to_string())
    ),
    decimal!(
        width,
        "The length of the mesh along x in formats with three dimensions, in unit; instead of pixel_size.",
        MIN_PIXEL_SIZE,
        MAX_LENGTH,
        |options| options.output.geometry.width.map(|width| width.to_string())
    ),
    flag!(
        center,
        "Whether the middle of the picture lies at x = 0 and y = 0, instead of its lower left pixel. Default: false.",
        |options| options.output.geometry.center.then(|| "true".to_owned())
    ),
    word!(up: UpAxis, "Which axis heights follow, y or z. Default: y for a relief in glTF, else z.",
        |options| options.output.geometry.up.map(|axis| axis.to_string())),
    word!(color: Coloring, "What the vertices of glTF, PLY and OBJ show: image, the picture (a gray relief of more than 8 bits from its least sample to its largest); none; hillshade, the relief in the light from the upper left; ramp, from green over brown to white between the lowest and the highest vertex. Default: image.",
        |options| Some(options.output.geometry.color).filter(|color| *color != Coloring::default()).map(|color| color.to_string())),
    word!(unit: LengthUnit, "The unit of lengths, m or mm: glTF, whose unit is the metre, is scaled to it; other formats hold the numbers as they are. Default: mm for STL, else m.",
        |options| options.output.geometry.unit.map(|unit| unit.to_string())),
    word!(compression: Compression, "How glTF stores vertices and indices: none, as 16-bit integers (KHR_mesh_quantization), or those compressed (EXT_meshopt_compression). Default: none.",
        |options| Some(options.output.compression).filter(|kind| *kind != Compression::default()).map(|kind| kind.to_string())),
    word!(texture: Texturing, "What glTF shows: the vertices' colours, or the image itself, embedded. Default: none.",
        |options| Some(options.output.texture).filter(|kind| *kind != Texturing::default()).map(|kind| kind.to_string())),
    word!(shading: Shading, "How SVG fills triangles: flat, or with the gradients that the mesh stands for. Default: flat.",
        |options| Some(options.output.shading).filter(|kind| *kind != Shading::default()).map(|kind| kind.to_string())),
    word!(png_compression: PngCompression, "Whether a PNG is made fast, or small at many times the time. Default: fast.",
        |options| Some(options.output.png_compression).filter(|kind| *kind != PngCompression::default()).map(|kind| kind.to_string())),
    word!(format: Format, "The format of the answer; wins over the Accept header. pmesh holds points and samples, compressed, and progression every smaller mesh with it; terrain is quantized-mesh 1.0 of an elevation model in EPSG:4326. Default: model.",
        |options| options.format.map(|format| format.name().to_owned())),
];
