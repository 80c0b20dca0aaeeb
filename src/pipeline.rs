//! From an upload to the bytes of the answer: decode, mesh, encode.
//!
//! Each step takes what the one before it made; a buffer dies as soon as the next exists. The same
//! image, parameters and version give the same bytes, which is what the entity tag says.

mod compare;
mod convert;
mod encode;

pub use compare::{Comparison, Pair, compare};
pub use convert::convert;

use crate::digest::Digest;
use crate::extract::accept::Format;
use crate::extract::params::Order;
use crate::pool::Watch;
use crate::problem::Problem;
use crate::telemetry;
use encode::{Writing, encode};
use pixmesh_codec::{Limits, Texture};
use pixmesh_meshing::generate;
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
/// result, or the watch stops the work.
pub fn mesh(
    image: impl AsRef<[u8]>,
    order: &Order,
    format: Format,
    limits: &Limits,
    watch: &Watch,
) -> Result<Answer, Problem> {
    watch.check()?;
    watch.begin("decode");
    let decoded = order.output.reading(limits).decode(image.as_ref())?;
    let shown = order.output.shows_image(format);
    let texture = shown.then(|| Texture::of_file(image.as_ref(), &decoded)).transpose()?;
    drop(image);
    let image = decoded;
    let pixels = image.pixel_count();
    watch.check()?;
    let model = generate(&image, &order.parameters, watch)?;
    drop(image);
    let writing =
        Writing { format, output: &order.output, texture: texture.as_ref(), model: Some(&model) };
    let bytes = encode(&model.mesh, &writing, watch)?;
    let answer = Answer {
        digest: Digest::of(&bytes),
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
