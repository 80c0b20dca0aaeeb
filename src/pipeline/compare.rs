//! How close two pictures are, one of which may be a mesh.

use crate::pool::Watch;
use crate::problem::{Kind, Problem};
use pixmesh_codec::{DecodeOptions, Limits, read_model_while};
use pixmesh_meshing::{Fidelity, Image, MeshingError, rasterize, structural_similarity};

/// What is compared.
#[derive(Debug)]
pub struct Pair<B> {
    /// The picture's file.
    pub picture: B,
    /// The file of what approximates it.
    pub approximation: B,
    /// Whether that is a MODEL, and no picture.
    pub is_model: bool,
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
/// When one of them cannot be read, their shapes differ, or the watch stops the work.
pub fn compare<B: AsRef<[u8]>>(
    pair: Pair<B>,
    limits: &Limits,
    watch: &Watch,
) -> Result<Comparison, Problem> {
    let Pair { picture, approximation, is_model } = pair;
    watch.check()?;
    watch.begin("decode");
    let reading = DecodeOptions { limits: *limits, ..DecodeOptions::default() };
    let first = reading.decode_while(picture.as_ref(), &|| watch.check())?;
    drop(picture);
    let second = if is_model {
        let mesh = read_model_while(approximation.as_ref(), limits, &|| watch.check())?;
        drop(approximation);
        rasterize(&mesh, watch)?
    } else {
        reading.decode_while(approximation.as_ref(), &|| watch.check())?
    };
    measure(&first, &second, watch)
}

fn measure(first: &Image, second: &Image, watch: &Watch) -> Result<Comparison, Problem> {
    watch.begin("measure");
    let fidelity = Fidelity::between(first, second, watch).map_err(|error| match error {
        MeshingError::Shape(mismatch) => {
            Problem::new(Kind::ShapeMismatch, mismatch.to_string()).param("approximation")
        }
        other => other.into(),
    })?;
    let ssim = structural_similarity(first, second, watch)?;
    Ok(Comparison { mse: fidelity.mse(), psnr_db: fidelity.psnr_db(), ssim })
}
