//! A second implementation of the methods, straight from their description: slow, and with no
//! kernel of the crate in it, so that what both compute alike is what the description says.
//!
//! It takes the crate's types for images, points and parameters and nothing else. Every quantity
//! that the description defines exactly is an exact integer or a quotient of two; floating point
//! begins where the description has it, at the density.

pub(crate) mod density;
pub(crate) mod error_diffusion;
pub(crate) mod interpolation;
pub(crate) mod metric;
pub(crate) mod removal;
pub(crate) mod stencil;
pub(crate) mod triangulation;
