//! What the samples of an elevation model mean, and what a mesh of it is by default: a relief at its
//! true size, within a bound on its heights.

use crate::choices::ReliefSource;
use crate::surface::{Geometry, Relief, ReliefHeight, ZOffset};
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::parameters::MAX_DISTANCE;
use pixmesh_meshing::{ParameterError, Parameters, Target, named_values};
use pixmesh_terrain::{Elevation, Steps};
use serde_json::{Value, json};

named_values! {
    /// What becomes of samples of an elevation model that are missing.
    ///
    /// ```
    /// use pixmesh_codec::Nodata;
    /// assert_eq!("fill".parse(), Ok(Nodata::Fill));
    /// ```
    #[derive(Default)]
    "nodata" Nodata {
        /// They are holes of the mesh.
        #[default]
        Hole = "hole",
        /// They get heights between those around them.
        Fill = "fill",
    }
}

/// The least and the largest length that a mesh has by default; others are no elevations.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-6..=1e9;

/// An elevation model whose heights are samples of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terrain {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// The heights of samples.
    pub steps: Steps,
    /// Metres of a unit of the heights.
    pub unit: f64,
    /// Metres from a column and from a row to the next, where the file tells its place.
    pub pixel_metres: Option<[f64; 2]>,
    /// The coordinates of the lower left pixel's middle and the EPSG code of their system, if known.
    pub origin: Option<([f64; 2], Option<u32>)>,
    /// Whether samples are missing: pixels of alpha 0.
    pub has_holes: bool,
}

impl Terrain {
    /// An elevation model of these steps.
    pub(crate) fn new(elevation: &Elevation, steps: Steps, has_holes: bool) -> Self {
        let Elevation { width, height, unit, georeference, .. } = *elevation;
        let pixel_metres = georeference.map(|place| place.pixel_metres(width, height));
        let origin = georeference.map(|place| (place.at(0.0, (height - 1) as f64), place.epsg));
        Self { width, height, steps, unit, pixel_metres, origin, has_holes }
    }

    /// The parameters of a mesh whose heights are at most `bound` from those of the file, in its
    /// units, where the target is a largest error; rounding to steps counts. Holes stay holes.
    ///
    /// # Errors
    /// When rounding to steps alone is more than the bound.
    pub fn parameters(
        &self,
        parameters: Parameters,
        bound: Option<f64>,
    ) -> Result<Parameters, ParameterError> {
        let target = match (parameters.target, bound) {
            (Target::MaxError(_), Some(bound)) => {
                let refusal = ParameterError::OutOfRange {
                    parameter: "max_error",
                    value: bound,
                    minimum: self.steps.rounding,
                    maximum: MAX_DISTANCE,
                };
                // More than all steps is no bound.
                Target::MaxDistance(self.steps.within(bound).ok_or(refusal)?.min(MAX_DISTANCE))
            }
            (target, _) => target,
        };
        Ok(parameters.target(target).holes(self.has_holes))
    }

    /// How the mesh lies in space by default: in metres, its heights those above 0. What is said of the
    /// relief, its height or the size of a pixel takes precedence.
    #[must_use]
    pub fn geometry(&self, given: Geometry) -> Geometry {
        let unlike = Geometry::default();
        let mut geometry = given;
        let Steps { base, step, .. } = self.steps;
        let (step, base) = (step * self.unit, base * self.unit);
        let fits =
            step > 0.0 && LENGTHS.contains(&(step * 65_535.0)) && base.abs() <= *LENGTHS.end();
        if given.relief.is_none() && given.z_offset == unlike.z_offset && fits {
            let height = ReliefHeight::PerSample(step);
            geometry.relief = Some(Relief { source: ReliefSource::First, height, invert: false });
            geometry.z_offset = ZOffset::Length(0.0 - base);
        }
        let metres = self.pixel_metres.filter(|metres| metres.iter().all(|m| LENGTHS.contains(m)));
        if let Some([column, row]) = metres
            && given.pixel_size == unlike.pixel_size
            && given.width.is_none()
        {
            (geometry.pixel_size, geometry.row_size) = (column, Some(row));
        }
        geometry
    }

    /// What a file says of the model: where its first pixel lies, and how its heights were made.
    pub(crate) fn extras(&self) -> Value {
        let (origin, epsg) = self.origin.unzip();
        json!({ "elevation": {
            "epsg": epsg.flatten(),
            "origin": origin,
            "pixel_metres": self.pixel_metres,
            "rounding": self.steps.rounding,
            "step": self.steps.step,
            "unit_metres": self.unit,
        }})
    }
}

/// The components of an image of an elevation model.
pub(crate) fn component_count(has_holes: bool) -> usize {
    let count = 1 + usize::from(has_holes);
    debug_assert_eq!(has_alpha(count), has_holes);
    count
}
