//! The formats, in one program. What measures the memory of its process has a program of its own.

mod formats;
mod gltf;
mod jpeg;
mod model;
mod pictures;
mod pmesh;
mod png;
mod png_suite;
mod pnm;
mod readers;
mod rendering;
#[path = "../samples/mod.rs"]
mod samples;
mod test_images;
mod wanted;
