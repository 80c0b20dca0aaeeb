//! How close two pictures are, one of which may be of a mesh.

use super::decode;
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
    /// Mean squared error over all pixels and components.
    pub mse: f64,
    /// PSNR in decibels; infinite for a perfect copy.
    pub psnr_db: f64,
    /// Mean structural similarity, 1 for a perfect copy; `None` for pictures with a side shorter
    /// than its window.
    pub ssim: Option<f64>,
}

/// Compares a picture with its approximation.
///
/// # Errors
/// When one of them cannot be read, their shapes differ, or the context stops the work.
pub fn compare<B: AsRef<[u8]>>(
    pair: Pair<B>,
    limits: &Limits,
    context: &Context,
) -> Result<Comparison, EngineError> {
    let Pair { picture, approximation, is_mesh } = pair;
    context.check()?;
    context.begin("decode");
    let reading = DecodeOptions { limits: *limits, ..DecodeOptions::default() };
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
    Ok(Comparison { mse: fidelity.mse(), psnr_db: fidelity.psnr_db(), ssim })
}
