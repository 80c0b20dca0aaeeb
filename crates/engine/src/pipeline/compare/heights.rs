//! How close the heights of a mesh, or of another elevation model, are to those of an elevation model.

use super::Comparison;
use crate::context::Context;
use crate::error::EngineError;
use crate::pipeline::memory_beside;
use pixmesh_codec::{DecodeOptions, Heights, Limits, Terrain, probe_mesh, read_mesh_while};
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::{Mesh, visit_surface};

/// The errors of heights, in their units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightErrors {
    /// The largest difference of a height.
    pub max_error: f64,
    /// Root mean squared difference.
    pub rmse: f64,
    /// The step that the heights of the mesh are multiples of, and the largest difference that rounding
    /// to it made; `None` for elevation models.
    pub steps: Option<(f64, f64)>,
    /// Pixels that have a height in both.
    pub compared: u64,
    /// Pixels that have a height in one of them only.
    pub unmatched: u64,
}

/// Compares heights with an approximation.
///
/// # Errors
/// When the approximation cannot be read, has other sides or no heights, or the context stops the work.
pub(super) fn compare(
    heights: &Heights,
    approximation: &impl AsRef<[u8]>,
    is_mesh: bool,
    limits: &Limits,
    context: &Context,
) -> Result<Comparison, EngineError> {
    let wanted = || context.check();
    let file = approximation.as_ref();
    let mut sums = Sums::default();
    if is_mesh {
        let terrain = probe_mesh(file, limits)?.terrain.ok_or(EngineError::NoHeights)?;
        let mesh = read_mesh_while(file, limits, &wanted)?;
        context.begin("measure");
        sums.add_mesh(heights, &mesh, &terrain, context)?;
    } else {
        let max_bytes = memory_beside(heights.bytes(), context);
        let reading = DecodeOptions { limits: *limits, max_bytes, ..DecodeOptions::default() };
        let other = reading.heights_while(file, &wanted)?.ok_or(EngineError::NoHeights)?;
        check_size(heights, (other.elevation().width, other.elevation().height))?;
        context.begin("measure");
        for y in 0..heights.elevation().height {
            context.check()?;
            heights.row(y).zip(other.row(y)).for_each(|(height, other)| sums.add(height, other));
        }
    }
    Ok(sums.comparison())
}

fn check_size(heights: &Heights, mesh: (usize, usize)) -> Result<(), EngineError> {
    let picture = (heights.elevation().width, heights.elevation().height);
    if picture == mesh { Ok(()) } else { Err(EngineError::OtherSize { picture, mesh }) }
}

/// Errors summed up.
#[derive(Default)]
struct Sums {
    squares: f64,
    max_error: f64,
    /// The lowest and the highest height compared.
    range: Option<(f64, f64)>,
    compared: u64,
    unmatched: u64,
    steps: Option<(f64, f64)>,
}

impl Sums {
    /// The surface of a mesh, which has no height where the interpolant of its alpha says a hole. On the
    /// borders of holes alpha is whole.
    fn add_mesh(
        &mut self,
        heights: &Heights,
        mesh: &Mesh,
        terrain: &Terrain,
        context: &Context,
    ) -> Result<(), EngineError> {
        let shape = mesh.shape();
        check_size(heights, (shape.width, shape.height))?;
        self.steps = Some((terrain.steps.step, terrain.steps.rounding));
        let whole = f64::from(u16::MAX >> (16 - shape.precision));
        let is_cut = terrain.has_holes && has_alpha(shape.component_count);
        visit_surface(mesh, context, |point, samples| {
            let height = heights.at(point.x as usize, shape.height - 1 - point.y as usize);
            let is_hole = is_cut && samples[samples.len() - 1] < whole;
            self.add(height, (!is_hole).then(|| terrain.steps.height(samples[0])));
        })?;
        Ok(())
    }

    fn add(&mut self, height: Option<f64>, other: Option<f64>) {
        let (Some(height), Some(other)) = (height, other) else {
            self.unmatched += u64::from(height.is_some() != other.is_some());
            return;
        };
        let (least, most) = self.range.unwrap_or((height, height));
        self.range = Some((least.min(height), most.max(height)));
        let error = (height - other).abs();
        self.max_error = self.max_error.max(error);
        self.squares += error * error;
        self.compared += 1;
    }

    fn comparison(self) -> Comparison {
        let mse = self.squares / self.compared.max(1) as f64;
        let peak = self.range.map_or(0.0, |(least, most)| most - least);
        let psnr_db = if mse == 0.0 { f64::INFINITY } else { 20.0 * (peak / mse.sqrt()).log10() };
        let Self { max_error, steps, compared, unmatched, .. } = self;
        let heights = HeightErrors { max_error, rmse: mse.sqrt(), steps, compared, unmatched };
        Comparison { mse, psnr_db, ssim: None, heights: Some(heights) }
    }
}
