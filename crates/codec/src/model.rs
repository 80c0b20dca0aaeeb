//! The MODEL format of triangle meshes, in and out.
//!
//! Text: width, height, number of components and precision in bits of the image, then an object in
//! the Object File Format: the word `OFF`, the numbers of vertices, faces and edges, for each
//! vertex `x y z0 .. z(M-1)`, for each face `3 i j k`, counter-clockwise with `y` up. A comment after
//! `OFF` says what the samples of an elevation model mean.

mod defect;
mod read;
mod tokens;
mod write;

pub use defect::{ModelDefect, ModelError};
pub use read::{probe_model, read_model, read_model_bytes, read_model_while};
pub use write::{model_comments, write_model, write_model_with_comments};
