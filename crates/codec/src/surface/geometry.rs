//! How a mesh is to lie in space, and the height of each sample vector.

use crate::choices::{Coloring, LengthUnit, ReliefSource, UpAxis};
use crate::color::{LUMA_SUM, luma};
use crate::error::EncodeError;
use crate::rounding::rounded_quotient;
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::{ParameterError, Shape};
use std::fmt;
use std::str::FromStr;

/// A default height is the picture's longer side divided by this.
const SIDE_PER_HEIGHT: f64 = 10.0;

/// How a mesh lies in space; lengths are in `unit`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// The length from one pixel to the next, over 0.
    pub pixel_size: f64,
    /// The length from a row to the next where it is not that of a pixel, over 0.
    pub row_size: Option<f64>,
    /// The length of the whole mesh along `x`, over 0; takes precedence over the size of a pixel.
    pub width: Option<f64>,
    /// What becomes `z`; without it the mesh is flat.
    pub relief: Option<Relief>,
    /// How far a base reaches below `z = 0`; 0 for none, which leaves the surface open.
    pub base: f64,
    /// What is taken off every height.
    pub z_offset: ZOffset,
    /// Whether the middle of the picture lies at `x = 0` and `y = 0`, instead of its lower left
    /// pixel.
    pub center: bool,
    /// Which axis heights follow; `None` for `y` where a glTF file has a relief, else `z`.
    pub up: Option<UpAxis>,
    /// What the vertices' colours show.
    pub color: Coloring,
    /// What the lengths are measured in; `None` for millimetres in an STL, else metres. Formats that
    /// have a unit are converted to it, others get the numbers as they are.
    pub unit: Option<LengthUnit>,
}

/// What is taken off every height.
///
/// ```
/// use pixmesh_codec::ZOffset;
///
/// assert_eq!("min".parse(), Ok(ZOffset::Least));
/// assert_eq!("-12.5".parse(), Ok(ZOffset::Length(-12.5)));
/// assert!("1e10".parse::<ZOffset>().is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ZOffset {
    /// The height of the lowest vertex, which comes to 0.
    Least,
    /// A length.
    Length(f64),
}

impl ZOffset {
    /// Name of the parameter that takes these values.
    pub const PARAMETER: &'static str = "z_offset";
    /// How the values are written.
    pub const NAMES: &'static [&'static str] = &["min", "a number of -1e9 to 1e9"];
    /// The largest length, positive or negative.
    pub const MOST: f64 = 1e9;
}

impl Default for ZOffset {
    fn default() -> Self {
        Self::Length(0.0)
    }
}

impl fmt::Display for ZOffset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Least => f.write_str("min"),
            Self::Length(length) => write!(f, "{length}"),
        }
    }
}

impl FromStr for ZOffset {
    type Err = ParameterError;

    fn from_str(text: &str) -> Result<Self, ParameterError> {
        if text == "min" {
            return Ok(Self::Least);
        }
        let length = text.parse().ok().filter(|length: &f64| length.abs() <= Self::MOST);
        length.map(Self::Length).ok_or_else(|| ParameterError::UnknownValue {
            parameter: Self::PARAMETER,
            value: text.to_owned(),
            allowed: Self::NAMES,
        })
    }
}

impl Default for Geometry {
    /// Flat, one pixel a metre.
    fn default() -> Self {
        Self {
            pixel_size: 1.0,
            row_size: None,
            width: None,
            relief: None,
            base: 0.0,
            z_offset: ZOffset::default(),
            center: false,
            up: None,
            color: Coloring::Image,
            unit: None,
        }
    }
}

/// What becomes a relief's height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Relief {
    /// What the height follows.
    pub source: ReliefSource,
    /// How high it is.
    pub height: ReliefHeight,
    /// Dark is high and bright is low, as lithophanes want it.
    pub invert: bool,
}

impl Relief {
    /// The relief that separate choices ask for: none unless one of them is made. `total` is a
    /// [`ReliefHeight::Total`] and wins over `per_sample`, a [`ReliefHeight::PerSample`].
    #[must_use]
    pub fn of_choices(
        source: Option<ReliefSource>,
        total: Option<f64>,
        per_sample: Option<f64>,
        invert: bool,
    ) -> Option<Self> {
        let height = total.map(ReliefHeight::Total);
        let height = height.or(per_sample.map(ReliefHeight::PerSample));
        (source.is_some() || height.is_some() || invert).then(|| Self {
            source: source.unwrap_or_default(),
            height: height.unwrap_or_default(),
            invert,
        })
    }
}

/// How high a relief is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ReliefHeight {
    /// The largest sample that the precision allows has a tenth of the picture's longer side.
    #[default]
    Tenth,
    /// The largest sample that the precision allows has this height.
    Total(f64),
    /// Each step of a sample has this height, as in elevation models.
    PerSample(f64),
}

impl Geometry {
    /// Checks that the image has the component that the relief follows.
    ///
    /// # Errors
    /// [`EncodeError::NoSuchComponent`] when an image of `component_count` has not got it.
    pub fn check(&self, component_count: usize) -> Result<(), EncodeError> {
        let Some(component) = self.relief.and_then(|relief| component(relief.source)) else {
            return Ok(());
        };
        if component < component_count {
            return Ok(());
        }
        Err(EncodeError::NoSuchComponent { component, count: component_count })
    }

    /// The same with the size of a pixel that the width gives.
    pub(crate) fn sized(self, shape: Shape) -> Self {
        let steps = (shape.width - 1).max(1) as f64;
        Self { pixel_size: self.width.map_or(self.pixel_size, |width| width / steps), ..self }
    }

    /// The lengths from a column and from a row to the next.
    pub(crate) fn steps(&self) -> [f64; 2] {
        [self.pixel_size, self.row_size.unwrap_or(self.pixel_size)]
    }

    /// The height of the largest sample that the precision allows.
    #[must_use]
    pub fn total_height(&self, shape: Shape) -> f64 {
        let largest = f64::from(u16::MAX >> (16 - shape.precision));
        match self.relief.map(|relief| relief.height) {
            None => 0.0,
            Some(ReliefHeight::Tenth) => self.tenth(shape),
            Some(ReliefHeight::Total(height)) => height,
            Some(ReliefHeight::PerSample(height)) => height * largest,
        }
    }

    /// The same with a base, where it has none, that a solid can stand on: a quarter of the
    /// relief's height, of a flat mesh a fortieth of its longer side.
    #[must_use]
    pub fn with_base(self, shape: Shape) -> Self {
        if self.base > 0.0 {
            return self;
        }
        let sized = self.sized(shape);
        let height = sized.total_height(shape);
        let height = if height > 0.0 { height } else { sized.tenth(shape) };
        Self { base: height / 4.0, ..self }
    }

    /// A tenth of the longer side.
    fn tenth(&self, shape: Shape) -> f64 {
        (shape.width.max(shape.height)) as f64 * self.pixel_size / SIDE_PER_HEIGHT
    }

    /// The height of a sample vector of an image of this shape.
    pub(super) fn height(&self, samples: &[u16], shape: Shape) -> f64 {
        let Some(Relief { source, invert, .. }) = self.relief else { return 0.0 };
        let largest = u32::from(u16::MAX >> (16 - shape.precision)) * LUMA_SUM;
        let steps = steps(samples, source, shape);
        let steps = if invert { largest - steps.min(largest) } else { steps };
        f64::from(steps) * self.total_height(shape) / f64::from(largest)
    }
}

/// What a relief follows of a sample vector, in thousandths of a step.
pub(super) fn steps(samples: &[u16], source: ReliefSource, shape: Shape) -> u32 {
    let largest = u64::from(u16::MAX >> (16 - shape.precision));
    match component(source) {
        None => match *samples {
            // Seen on black.
            [.., alpha] if has_alpha(samples.len()) => {
                rounded_quotient(u64::from(luma(samples)) * u64::from(alpha), largest) as u32
            }
            _ => luma(samples),
        },
        Some(component) => samples.get(component).map_or(0, |&sample| luma(&[sample])),
    }
}

/// The component that a relief follows, counted from 0; `None` for the luma.
fn component(source: ReliefSource) -> Option<usize> {
    match source {
        ReliefSource::Luma => None,
        ReliefSource::First => Some(0),
        ReliefSource::Second => Some(1),
        ReliefSource::Third => Some(2),
        ReliefSource::Fourth => Some(3),
    }
}
