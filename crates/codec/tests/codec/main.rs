//! The formats, in one program. What measures the memory of its process has a program of its own.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod formats;
mod gltf;
mod jpeg;
mod model;
mod pictures;
mod pmesh;
mod png;
mod png_suite;
mod pnm;
mod quantized_mesh;
mod readers;
mod rendering;
#[path = "../samples/mod.rs"]
mod samples;
mod test_images;
mod wanted;
