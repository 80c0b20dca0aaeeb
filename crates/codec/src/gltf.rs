//! glTF 2.0, out: binary (GLB) and as JSON with its buffer within.
//!
//! Literature: Khronos Group, "glTF 2.0 Specification", 2021 (ISO/IEC 12113:2022), and its
//! extensions `KHR_materials_unlit`, `KHR_mesh_quantization` and `EXT_meshopt_compression`.

mod attributes;
mod buffer;
mod document;
mod linear_light;
mod srgb;
mod texture;
mod write;

pub use texture::Texture;
pub(crate) use write::{write_glb, write_gltf};
