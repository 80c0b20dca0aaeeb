//! glTF 2.0 in its binary form (GLB), out.
//!
//! Literature: Khronos Group, "glTF 2.0 Specification", 2021 (ISO/IEC 12113:2022).

mod document;
mod srgb;
mod write;

pub use write::write_glb;
