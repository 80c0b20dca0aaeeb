//! Elevation models in TIFF files: samples of any type, their place on the Earth, and heights in
//! whole steps.
//!
//! [`Elevation::open`] reads what the first directory says: the type of the samples, GDAL's scale,
//! offset and nodata, and the georeference of a GeoTIFF. [`Elevation::heights`] decodes the samples,
//! and [`Heights::in_steps`] makes whole numbers of 16 bits of them, which meshing works on.
//!
//! ```
//! use pixmesh_terrain::{Elevation, Wish};
//! use std::io::Cursor;
//! use tiff::encoder::{TiffEncoder, colortype::Gray32Float};
//!
//! let mut file = Cursor::new(Vec::new());
//! let depths = [-2.5_f32, -1.0, 0.25, 4.0];
//! TiffEncoder::new(&mut file)?.write_image::<Gray32Float>(2, 2, &depths)?;
//! let mut decoder = tiff::decoder::Decoder::new(Cursor::new(file.into_inner()))?;
//! let elevation = Elevation::open(&mut decoder)?.expect("floating point is no picture");
//! let heights = elevation.heights(&mut decoder)?;
//! let wish = Wish { step: Some(0.25), bound: None };
//! let steps = heights.in_steps(wish)?;
//! assert_eq!((steps.base, steps.step, steps.rounding), (-2.5, 0.25, 0.0));
//! assert_eq!(heights.row(1).map(|height| steps.sample(height)).collect::<Vec<_>>(), [Some(11), Some(26)]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `tags`: the directory's tags; `georeference`: what those of GeoTIFF mean; `ellipsoid`: places on
//!   the Earth in metres.
//! - `heights`: decoded samples as heights; `steps`: heights in whole steps.
//! - `holes`: heights in the place of missing ones.

mod ellipsoid;
mod georeference;
mod heights;
mod holes;
mod steps;
mod tags;

pub use ellipsoid::{HALF_AXES, earth_centered};
pub use georeference::Georeference;
pub use heights::Heights;
pub use holes::filled;
pub use steps::{StepError, Steps, Wish};
pub use tags::Elevation;
