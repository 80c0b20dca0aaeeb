//! The mesh of an image, and its other forms: image, buffers, progression, flat colours.

pub(crate) mod buffers;
pub(crate) mod flat_color;
pub(crate) mod mesh;
pub(crate) mod outline;
pub(crate) mod progression;
pub(crate) mod rasterize;
pub(crate) mod seen;
pub(crate) mod surface;
