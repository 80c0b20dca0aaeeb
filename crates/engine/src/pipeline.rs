//! From an upload to the bytes of the answer: decode, mesh, encode.
//!
//! Each step takes what the one before it made; a buffer dies as soon as the next exists. The same
//! image, parameters and version give the same bytes, which is what the entity tag says.

mod compare;
mod convert;
mod encode;

pub use compare::{Comparison, HeightErrors, Pair, compare};
pub use convert::{Conversion, Converted, Shown, convert};

use crate::context::Context;
use crate::digest::Digest;
use crate::error::EngineError;
use crate::params::MeshOptions;
use crate::task::{Weighed, image_bytes};
use crate::telemetry;
use encode::{encode, encoded};
use pixmesh_codec::{
    DecodeOptions, Encodable, EncodeError, Format, Limits, Terrain, Texture, Texturing,
    model_comments, read_weights_while, write_progression,
};
use pixmesh_meshing::parameters::Weights;
use pixmesh_meshing::{Image, Progression, mesh_image};
use std::time::Duration;

/// A mesh as bytes, with what is known of it.
#[derive(Debug)]
pub struct Answer {
    /// The mesh in the format asked for.
    pub bytes: Vec<u8>,
    /// SHA-256 of the bytes.
    pub digest: Digest,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Faces of the mesh.
    pub faces: usize,
    /// Peak signal-to-noise ratio in decibels; infinite for a perfect copy.
    pub psnr_db: f64,
    /// Mean squared error.
    pub mse: f64,
    /// The time that each stage took, in their order.
    pub timings: Vec<(&'static str, Duration)>,
}

/// Makes the mesh of an image, whose bytes are let go as soon as it is decoded.
///
/// # Errors
/// When the image cannot be decoded, the parameters do not fit it, the format cannot hold the
/// result, or the context stops the work.
pub fn mesh(
    source: Weighed<impl AsRef<[u8]>>,
    options: &MeshOptions,
    format: Format,
    limits: &Limits,
    context: &Context,
) -> Result<Answer, EngineError> {
    let ordered = format == Format::Progression;
    let made = Making { format, ordered, shows_image: options.output.shows_image(format) };
    make(source, options, &made, limits, context).map(|made| made.answer)
}

/// What a job keeps.
#[derive(Debug)]
pub struct JobMesh {
    /// The mesh as MODEL.
    pub answer: Answer,
    /// The order of its vertices as pmesh.
    pub progression: Option<Vec<u8>>,
    /// The bytes of the [`Texture`] that glTF shows.
    pub texture: Option<Vec<u8>>,
}

/// Makes the mesh of an image as MODEL, and what else the job keeps.
///
/// # Errors
/// As [`mesh`].
pub fn mesh_of_job(
    source: Weighed<impl AsRef<[u8]>>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<JobMesh, EngineError> {
    let shows_image = options.output.texture == Texturing::Embed;
    let made = Making { format: Format::Model, ordered: keeps_progression, shows_image };
    let Made { answer, progression, texture, terrain } =
        make(source, options, &made, limits, context)?;
    let written = |progression: Progression| {
        encoded(0, context, |bytes| write_progression(&progression, terrain.as_ref(), bytes))
    };
    let progression = progression.map(written);
    let texture = texture.map(Texture::into_bytes);
    Ok(JobMesh { answer, progression: progression.transpose()?, texture })
}

/// What is made of an image.
struct Making {
    format: Format,
    /// Whether the order of the vertices is made.
    ordered: bool,
    /// Whether the picture that glTF shows is made.
    shows_image: bool,
}

/// A mesh, and what was made beside it.
struct Made {
    answer: Answer,
    progression: Option<Progression>,
    texture: Option<Texture>,
    terrain: Option<Terrain>,
}

fn make(
    source: Weighed<impl AsRef<[u8]>>,
    options: &MeshOptions,
    made: &Making,
    limits: &Limits,
    context: &Context,
) -> Result<Made, EngineError> {
    let Making { format, ordered, shows_image } = *made;
    context.check()?;
    context.begin("decode");
    let Weighed { image: file, weights } = source;
    let reading = options.output.reading(limits);
    let (image, terrain) = decode(file.as_ref(), reading, 0, context)?;
    if format == Format::Terrain && terrain.and_then(|terrain| terrain.degrees()).is_none() {
        return Err(EncodeError::NotInDegrees.into());
    }
    let texture = shows_image.then(|| texture(file.as_ref(), &image, context)).transpose()?;
    drop(file);
    let weights = read_weights(&image, weights, limits, context)?;
    let mut parameters = options.parameters.clone().weights(weights);
    if let Some(terrain) = &terrain {
        parameters = terrain.parameters(parameters, options.output.bound)?;
    }
    let pixels = image.pixel_count();
    context.check()?;
    // Reading and writing are quick.
    let meshed = if ordered { 0.75 } else { 0.97 };
    context.is_part(0.03, meshed);
    let model = mesh_image(&image, &parameters, context)?;
    context.is_part(meshed, 0.97);
    let progression =
        ordered.then(|| Progression::new(&image, &model.mesh, &parameters, context)).transpose()?;
    drop(image);
    let source = Encodable {
        comments: &model_comments(&parameters),
        progression: progression.as_ref(),
        ..Encodable::from(&model)
    };
    let writing = options.output.writing(texture.as_ref(), terrain);
    let bytes = encode(&source, format, &writing, context)?;
    let answer = Answer {
        digest: Digest::of_while(&bytes, || context.check())?,
        bytes,
        vertices: model.mesh.points().len(),
        faces: model.mesh.faces().len(),
        psnr_db: model.fidelity.psnr_db(),
        mse: model.fidelity.mse(),
        timings: context.finish(),
    };
    telemetry::meshed(pixels, answer.vertices);
    tracing::info!(pixels, vertices = answer.vertices, stages = answer.server_timing(), "meshed");
    Ok(Made { answer, progression, texture, terrain })
}

/// The picture that glTF shows, of a file and the image that was decoded from it.
fn texture(file: &[u8], image: &Image, context: &Context) -> Result<Texture, EngineError> {
    Ok(Texture::of_file_while(file, image, &|| context.check())?)
}

/// The weights of an image, if there are any.
fn read_weights(
    image: &Image,
    weights: Option<impl AsRef<[u8]>>,
    limits: &Limits,
    context: &Context,
) -> Result<Option<Weights>, EngineError> {
    let Some(file) = weights else { return Ok(None) };
    let size = (image.width(), image.height());
    let max_bytes = memory_beside(image_bytes(image.shape()), context);
    let options = DecodeOptions { limits: *limits, max_bytes, ..DecodeOptions::default() };
    Ok(Some(read_weights_while(file.as_ref(), size, &options, &|| context.check())?))
}

/// Decodes an image in the memory that the task has beside the bytes that it holds already.
fn decode(
    file: &[u8],
    options: DecodeOptions,
    held_bytes: u64,
    context: &Context,
) -> Result<(Image, Option<Terrain>), EngineError> {
    let options = DecodeOptions { max_bytes: memory_beside(held_bytes, context), ..options };
    Ok(options.decode_terrain_while(file, &|| context.check())?)
}

/// The memory that the task has beside the bytes that it holds already; `None` for any amount.
fn memory_beside(held_bytes: u64, context: &Context) -> Option<u64> {
    context.memory_bytes().map(|bytes| bytes.saturating_sub(held_bytes))
}

impl Answer {
    /// The time of each stage in milliseconds, as the header `Server-Timing` writes it.
    #[must_use]
    pub fn server_timing(&self) -> String {
        server_timing(&self.timings)
    }
}

/// The time of each stage in milliseconds, as the header `Server-Timing` writes it.
#[must_use]
pub fn server_timing(timings: &[(&'static str, Duration)]) -> String {
    let entry =
        |(stage, took): &(&str, Duration)| format!("{stage};dur={:.3}", took.as_secs_f64() * 1e3);
    timings.iter().map(entry).collect::<Vec<_>>().join(", ")
}
