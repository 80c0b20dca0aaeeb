//! From an upload to the bytes of the answer: decode, mesh, encode.
//!
//! Each step takes what the one before it made; a buffer dies as soon as the next exists. The same
//! image, parameters and version give the same bytes, which is what the entity tag says.

mod encode;

use crate::extract::accept::Representation;
use crate::extract::params::Order;
use crate::extract::upload::Upload;
use crate::pool::Watch;
use crate::problem::Problem;
use crate::telemetry;
use encode::{Writing, encode};
use pixmesh_codec::{Limits, Texture};
use pixmesh_meshing::generate;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::time::Duration;

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
    let image = order.output.reading(limits).decode(&upload.image)?;
    let shown = order.output.shows_image(representation.format);
    let texture = shown.then(|| Texture::of_file(&upload.image, &image)).transpose()?;
    drop(upload);
    let pixels = image.pixel_count();
    watch.check()?;
    let model = generate(&image, &order.parameters, watch)?;
    drop(image);
    let writing = Writing {
        format: representation.format,
        output: &order.output,
        texture: texture.as_ref(),
        fidelity: Some(&model.fidelity),
    };
    let bytes = encode(&model.mesh, &writing, watch)?;
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

fn digest(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(64);
    for byte in Sha256::digest(bytes) {
        let _ = write!(text, "{byte:02x}");
    }
    text
}
