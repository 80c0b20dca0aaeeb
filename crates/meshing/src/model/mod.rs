//! The mesh of an image, and what is made of it.

pub(crate) mod buffers;
pub(crate) mod flat_color;
pub(crate) mod mesh;
pub(crate) mod progression;
pub(crate) mod rasterize;
