//! What is fuzzed: one function of bytes per target, which panics where it finds something wrong.
//!
//! | target | bytes | what must hold |
//! |---|---|---|
//! | [`decode_image`] | a picture | the header tells the shape of what is decoded; no panic |
//! | [`parse_params`] | a query and JSON | what was understood, written as a query, means the same |
//! | [`multipart`] | the body of a form | the same outcome however the bytes arrive |
//! | [`headers`] | values of request headers | no panic; what is chosen is what is offered |
//! | [`read_model`] | a MODEL | what is read is a mesh, and reads back as the same |
//! | [`read_pmesh`] | a pmesh | the same, as a mesh and as a progression |
//! | [`roundtrip_mesh`] | a small mesh | MODEL and pmesh read back as the same mesh |
//! | [`triangulate`] | points of a small grid | the faces are those of a slow twin |
//! | [`simplify`] | a picture of a few pixels | the mesh is that of a slow twin |
//! | [`job_record`] | what is kept of a job | no panic; what is read is written as the same |
//!
//! The tests of the service replay every corpus with these functions, on any compiler.

pub mod decode_image;
pub mod headers;
mod input;
pub mod job_record;
pub mod multipart;
pub mod parse_params;
pub mod read_model;
pub mod read_pmesh;
pub mod roundtrip_mesh;
pub mod simplify;
pub mod triangulate;
#[path = "../../crates/meshing/tests/twin/mod.rs"]
#[allow(dead_code, reason = "the twins do more than is fuzzed")]
mod twin;

/// A function of bytes.
pub type Target = fn(&[u8]);

/// Every target by its name.
pub const TARGETS: [(&str, Target); 10] = [
    ("decode_image", decode_image::run),
    ("parse_params", parse_params::run),
    ("multipart", multipart::run),
    ("headers", headers::run),
    ("read_model", read_model::run),
    ("read_pmesh", read_pmesh::run),
    ("roundtrip_mesh", roundtrip_mesh::run),
    ("triangulate", triangulate::run),
    ("simplify", simplify::run),
    ("job_record", job_record::run),
];
