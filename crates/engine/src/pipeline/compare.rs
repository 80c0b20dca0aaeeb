//! How close two pictures are, one of which may be of a mesh.

mod heights;

pub use heights::HeightErrors;

use super::{decode, memory_beside};
use crate::context::Context;
use crate::error::EngineError;
use crate::task::image_bytes;
use pixmesh_codec::{DecodeOptions, Limits, read_mesh_while};
use pixmesh_meshing::{Fidelity, Image, rasterize, structural_similarity};

/// What is compared.
#[derive(Debug)]
pub struct Pair<B> {
    /// The picture's file.
    pub picture: B,
    /// The file of what approximates it.
    pub approximation: B,
    /// Whether that is a mesh as MODEL or pmesh, and no picture.
    pub is_mesh: bool,
}

/// What came of a comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean squared error over all pixels and components; of elevation models over the heights, in the
    /// square of their units.
    pub mse: f64,
    /// PSNR in decibels; infinite for a perfect copy. Of elevation models the peak is the difference
    /// between the highest and the lowest point.
    pub psnr_db: f64,
    /// Mean structural similarity, 1 for a perfect copy; `None` for elevation models, and for pictures
    /// with a side shorter than its window.
    pub ssim: Option<f64>,
    /// The errors of the heights of elevation models.
    pub heights: Option<HeightErrors>,
}

/// Compares a picture with its approximation: elevation models by their heights, others by their
/// samples.
///
/// # Errors
/// When one of them cannot be read, their shapes differ, an elevation model is compared with what has
/// no heights, or the context stops the work.
pub fn compare<B: AsRef<[u8]>>(
    pair: Pair<B>,
    limits: &Limits,
    context: &Context,
) -> Result<Comparison, EngineError> {
    let Pair { picture, approximation, is_mesh } = pair;
    context.check()?;
    context.begin("decode");
    let reading = DecodeOptions { limits: *limits, ..DecodeOptions::default() };
    let max_bytes = memory_beside(0, context);
    let heights = DecodeOptions { max_bytes, ..reading }
        .heights_while(picture.as_ref(), &|| context.check())?;
    if let Some(heights) = heights {
        drop(picture);
        return heights::compare(&heights, &approximation, is_mesh, limits, context);
    }
    let (first, _) = decode(picture.as_ref(), reading, 0, context)?;
    drop(picture);
    let second = if is_mesh {
        let mesh = read_mesh_while(approximation.as_ref(), limits, &|| context.check())?;
        drop(approximation);
        rasterize(&mesh, context)?
    } else {
        decode(approximation.as_ref(), reading, image_bytes(first.shape()), context)?.0
    };
    measure(&first, &second, context)
}

fn measure(first: &Image, second: &Image, context: &Context) -> Result<Comparison, EngineError> {
    context.begin("measure");
    let fidelity = Fidelity::between(first, second, context)?;
    let ssim = structural_similarity(first, second, context)?;
    Ok(Comparison { mse: fidelity.mse(), psnr_db: fidelity.psnr_db(), ssim, heights: None })
}
