//! What the samples of an elevation model mean, and what a mesh of it is by default: a relief at its
//! true size, within a bound on its heights.

mod text;

use crate::choices::ReliefSource;
use crate::surface::{Geometry, Relief, ReliefHeight, ZOffset};
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::parameters::MAX_DISTANCE;
use pixmesh_meshing::{ParameterError, Parameters, Target, named_values};
use pixmesh_terrain::{Elevation, Georeference, Steps};
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
    /// The largest error of the mesh's heights in their units, where it was asked for.
    pub bound: Option<f64>,
    /// Its place on the Earth, where the file tells it.
    pub georeference: Option<Georeference>,
    /// Whether samples are missing: pixels of alpha 0.
    pub has_holes: bool,
}

impl Terrain {
    /// An elevation model of these steps.
    pub(crate) fn new(
        elevation: &Elevation,
        steps: Steps,
        bound: Option<f64>,
        has_holes: bool,
    ) -> Self {
        let Elevation { width, height, unit, georeference, .. } = *elevation;
        Self { width, height, steps, unit, bound, georeference, has_holes }
    }

    /// The model of a mesh of `size` of `all` vertices, for which the bound holds where it has all.
    #[must_use]
    pub fn of_size(self, size: usize, all: usize) -> Self {
        Self { bound: self.bound.filter(|_| size == all), ..self }
    }

    /// West, south, east and north of the middles of the outermost pixels in degrees of WGS 84, where
    /// rows and columns follow them.
    #[must_use]
    pub fn degrees(&self) -> Option<[f64; 4]> {
        self.georeference.and_then(|place| place.degrees(self.width, self.height))
    }

    /// Metres from a column and from a row to the next.
    fn pixel_metres(&self) -> Option<[f64; 2]> {
        self.georeference.map(|place| place.pixel_metres(self.width, self.height))
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
        let metres =
            self.pixel_metres().filter(|metres| metres.iter().all(|m| LENGTHS.contains(m)));
        if let Some([column, row]) = metres
            && given.pixel_size == unlike.pixel_size
            && given.width.is_none()
        {
            (geometry.pixel_size, geometry.row_size) = (column, Some(row));
        }
        geometry
    }

    /// What a file says of the model: where its local origin, the middle of the lower left pixel,
    /// lies, and how its heights were made.
    pub(crate) fn extras(&self) -> Value {
        let origin = self.georeference.map(|place| place.at(0.0, (self.height - 1) as f64));
        json!({ "elevation": {
            "degrees": self.degrees(),
            "epsg": self.georeference.and_then(|place| place.epsg),
            "max_error": self.bound,
            "origin": origin,
            "pixel_metres": self.pixel_metres(),
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
