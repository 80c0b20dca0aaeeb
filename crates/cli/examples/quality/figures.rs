//! What is measured of each mesh.

use crate::series::{SERIES, Series};
use pixmesh_meshing::{Image, mesh_image, rasterize, structural_similarity};
use std::error::Error;
use std::time::Instant;

/// Densities in percent.
pub(crate) const DENSITIES: [f64; 5] = [0.5, 1.0, 2.0, 3.0, 4.0];

/// What was measured of one mesh.
pub(crate) struct Figure {
    pub(crate) series: &'static Series,
    pub(crate) density: f64,
    pub(crate) vertices: usize,
    pub(crate) psnr_db: f64,
    pub(crate) ssim: f64,
    pub(crate) seconds: f64,
}

/// What was measured of one picture.
pub(crate) struct Measured {
    pub(crate) name: String,
    pub(crate) is_thorough: bool,
    pub(crate) figures: Vec<Figure>,
}

impl Measured {
    /// The figures of a series at all densities; none where it was not measured.
    pub(crate) fn of(&self, label: &str) -> Vec<&Figure> {
        self.figures.iter().filter(|figure| figure.series.label == label).collect()
    }
}

/// Makes every mesh of an image so many times and measures it.
pub(crate) fn measure(
    image: &Image,
    is_thorough: bool,
    rounds: usize,
) -> Result<Vec<Figure>, Box<dyn Error>> {
    let mut figures = Vec::new();
    for series in SERIES.iter().filter(|series| is_thorough || !series.slow) {
        for density in DENSITIES {
            let mut fastest = f64::INFINITY;
            let parameters = series.parameters(density);
            let mut model = None;
            for _ in 0..rounds {
                let start = Instant::now();
                model = Some(mesh_image(image, &parameters, &())?);
                fastest = fastest.min(start.elapsed().as_secs_f64());
            }
            let Some(model) = model else { continue };
            let (vertices, psnr_db) = (model.mesh.points().len(), model.fidelity.psnr_db());
            let rebuilt = rasterize(&model.mesh, &())?;
            let ssim = structural_similarity(image, &rebuilt, &())?.unwrap_or(f64::NAN);
            figures.push(Figure { series, density, vertices, psnr_db, ssim, seconds: fastest });
        }
    }
    Ok(figures)
}
