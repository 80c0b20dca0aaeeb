//! From an upload to the bytes of the answer: decode, mesh, encode.
//!
//! Each step takes what the one before it made; a buffer dies as soon as the next exists. The same
//! image, parameters and version give the same bytes, which is what the entity tag says.

use crate::extract::accept::{Format, Representation};
use crate::extract::params::Order;
use crate::extract::upload::Upload;
use crate::pool::Watch;
use crate::problem::Problem;
use crate::telemetry;
use pixmesh_codec::{
    EncodeError, Limits, decode, write_glb, write_model_with_comments, write_png, write_pnm,
};
use pixmesh_meshing::{Image, Mesh, Model, Shape, generate, rasterize};
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::fmt::Write;
use std::time::Duration;

/// Room in bytes for what is in an answer whatever its size, such as the header of a file.
const FRAME: usize = 4096;

/// A mesh as bytes, with what is known of it.
#[derive(Debug)]
pub struct Answer {
    /// The mesh in the format asked for.
    pub bytes: Vec<u8>,
    /// SHA-256 of the bytes, in hexadecimal digits.
    pub digest: String,
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

/// Makes the mesh of an upload.
///
/// # Errors
/// When the image cannot be decoded, the parameters do not fit it, the format cannot hold the
/// result, or the watch stops the work.
pub fn mesh(
    upload: Upload,
    order: &Order,
    representation: Representation,
    limits: &Limits,
    watch: &Watch,
) -> Result<Answer, Problem> {
    watch.check()?;
    watch.begin("decode");
    let image = decode(&upload.image, limits)?;
    drop(upload);
    let pixels = image.pixel_count();
    watch.check()?;
    let model = generate(&image, &order.parameters, watch)?;
    drop(image);
    let bytes = encode(&model, representation.format, watch)?;
    let answer = Answer {
        digest: digest(&bytes),
        bytes,
        vertices: model.mesh.points().len(),
        faces: model.mesh.faces().len(),
        psnr_db: model.fidelity.psnr_db(),
        mse: model.fidelity.mse(),
        timings: watch.finish(),
    };
    telemetry::meshed(pixels, answer.vertices);
    tracing::info!(pixels, vertices = answer.vertices, stages = answer.server_timing(), "meshed");
    Ok(answer)
}

impl Answer {
    /// The time of each stage in milliseconds, as the header `Server-Timing` writes it.
    #[must_use]
    pub fn server_timing(&self) -> String {
        let entry = |(stage, took): &(&str, Duration)| {
            format!("{stage};dur={:.3}", took.as_secs_f64() * 1e3)
        };
        self.timings.iter().map(entry).collect::<Vec<_>>().join(", ")
    }
}

/// The mesh, or the picture rebuilt from it, in a format.
fn encode(model: &Model, format: Format, watch: &Watch) -> Result<Vec<u8>, Problem> {
    let (mesh, room) = (&model.mesh, room(&model.mesh, format));
    match format {
        Format::Model => {
            encoded(room, watch, |bytes| write_model_with_comments(mesh, &model.remarks, bytes))
        }
        Format::Glb => encoded(room, watch, |bytes| write_glb(mesh, bytes)),
        Format::Png => {
            let picture = picture(model, watch)?;
            encoded(room, watch, |bytes| write_png(&picture, bytes))
        }
        Format::Pnm => {
            let picture = picture(model, watch)?;
            encoded(room, watch, |bytes| write_pnm(&picture, bytes))
        }
    }
}

/// The picture rebuilt from a mesh, or that of one colour for each face.
fn picture<'m>(model: &'m Model, watch: &Watch) -> Result<Cow<'m, Image>, Problem> {
    match &model.flat {
        Some(flat) => Ok(Cow::Borrowed(&flat.picture)),
        None => Ok(Cow::Owned(rasterize(&model.mesh, watch)?)),
    }
}

/// About the most bytes that an answer takes: one that must not be copied while it grows.
fn room(mesh: &Mesh, format: Format) -> usize {
    let Shape { width, height, component_count, precision } = mesh.shape();
    let (vertices, faces) = (mesh.points().len(), mesh.faces().len());
    let picture = width * height * component_count * usize::from(precision).div_ceil(8);
    let bytes = match format {
        Format::Model => vertices * (12 + 6 * component_count) + faces * 27,
        Format::Glb => vertices * 20 + faces * 12,
        // What does not compress becomes a little longer.
        Format::Png | Format::Pnm => picture + picture / 8,
    };
    bytes + FRAME
}

/// The bytes of an answer; it gives back the room that it did not need.
fn encoded<E: Into<EncodeError>>(
    room: usize,
    watch: &Watch,
    write: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
) -> Result<Vec<u8>, Problem> {
    watch.begin("encode");
    let mut bytes = Vec::with_capacity(room);
    write(&mut bytes).map_err(Into::into)?;
    bytes.shrink_to_fit();
    Ok(bytes)
}

fn digest(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(64);
    for byte in Sha256::digest(bytes) {
        let _ = write!(text, "{byte:02x}");
    }
    text
}
