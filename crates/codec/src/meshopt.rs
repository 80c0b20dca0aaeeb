//! The compressed views of `EXT_meshopt_compression`: vertices and triangles.
//!
//! Literature: Arseny Kapoulkine, "EXT_meshopt_compression", glTF 2.0 vendor extension, with the
//! bitstreams of its attributes (version 0) and triangles (version 1) in an appendix. The encoders
//! are written from that text; the original library is C++ behind a foreign interface, which would
//! need a C++ toolchain to build.

mod faces;
mod vertices;

pub(crate) use faces::compress_faces;
pub(crate) use vertices::compress_vertices;
