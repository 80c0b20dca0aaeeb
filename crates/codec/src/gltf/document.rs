//! The JSON part of a glTF file, as far as one mesh needs it.

use serde::Serialize;
use std::collections::BTreeMap;

/// `componentType` of 16-bit integers.
pub(super) const SHORT: u32 = 5122;
/// `componentType` of 16-bit unsigned integers.
pub(super) const UNSIGNED_SHORT: u32 = 5123;
/// `componentType` of 32-bit unsigned integers.
pub(super) const UNSIGNED_INT: u32 = 5125;
/// `componentType` of 32-bit floating-point numbers.
pub(super) const FLOAT: u32 = 5126;
/// `target` of a view that holds vertices.
pub(super) const ARRAY_BUFFER: u32 = 34962;
/// `target` of a view that holds indices of vertices.
pub(super) const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// `mode` of a primitive whose indices are triangles.
const TRIANGLES: u32 = 4;
/// `magFilter`: the mean of the four nearest texels.
const LINEAR: u32 = 9729;
/// `minFilter`: the same of the two nearest reductions.
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
/// `wrapS` and `wrapT`: texels at the border go on beyond it.
const CLAMP_TO_EDGE: u32 = 33071;
/// The extension for materials that no light changes.
pub(super) const UNLIT: &str = "KHR_materials_unlit";
/// The extension for positions and normals of 16-bit integers.
pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// The extension for compressed views.
pub(super) const MESHOPT: &str = "EXT_meshopt_compression";

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) extensions_required: Vec<&'static str>,
    pub(super) scene: usize,
    pub(super) scenes: [Scene; 1],
    pub(super) nodes: [Node; 1],
    pub(super) meshes: [Mesh; 1],
    pub(super) materials: [Material; 1],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) textures: Vec<TextureReference>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) images: Vec<ImageReference>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) samplers: Vec<Sampler>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Serialize)]
pub(super) struct Asset {
    pub(super) version: &'static str,
    pub(super) generator: &'static str,
}

#[derive(Serialize)]
pub(super) struct Scene {
    pub(super) nodes: [usize; 1],
}

#[derive(Serialize)]
pub(super) struct Node {
    pub(super) mesh: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) translation: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Serialize)]
pub(super) struct Mesh {
    pub(super) primitives: [Primitive; 1],
}

#[derive(Serialize)]
pub(super) struct Primitive {
    /// The accessor of each attribute, by its name.
    pub(super) attributes: BTreeMap<&'static str, usize>,
    pub(super) indices: usize,
    pub(super) material: usize,
    mode: u32,
}

impl Primitive {
    /// Triangles of the first material.
    pub(super) fn triangles(attributes: BTreeMap<&'static str, usize>, indices: usize) -> Self {
        Self { attributes, indices, material: 0, mode: TRIANGLES }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Appearance,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) alpha_mode: Option<&'static str>,
    pub(super) double_sided: bool,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) extensions: BTreeMap<&'static str, Empty>,
}

/// A matt surface.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Appearance {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) base_color_texture: Option<TextureUse>,
    pub(super) metallic_factor: f32,
    pub(super) roughness_factor: f32,
}

#[derive(Serialize)]
pub(super) struct TextureUse {
    pub(super) index: usize,
}

#[derive(Serialize)]
pub(super) struct TextureReference {
    pub(super) sampler: usize,
    pub(super) source: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ImageReference {
    pub(super) buffer_view: usize,
    pub(super) mime_type: &'static str,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    mag_filter: u32,
    min_filter: u32,
    wrap_s: u32,
    wrap_t: u32,
}

impl Sampler {
    /// Smooth, and without the opposite side's texels at the border.
    pub(super) fn smooth() -> Self {
        Self {
            mag_filter: LINEAR,
            min_filter: LINEAR_MIPMAP_LINEAR,
            wrap_s: CLAMP_TO_EDGE,
            wrap_t: CLAMP_TO_EDGE,
        }
    }
}

/// An object without members.
#[derive(Serialize)]
pub(super) struct Empty {}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: usize,
    pub(super) component_type: u32,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max: Option<[f32; 3]>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) target: Option<u32>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) extensions: BTreeMap<&'static str, CompressedView>,
}

/// Where the compressed form of a view lies.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct CompressedView {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: usize,
    pub(super) count: usize,
    pub(super) mode: &'static str,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) uri: Option<String>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) extensions: BTreeMap<&'static str, Fallback>,
}

/// A buffer that has no bytes, only the views that decompression makes.
#[derive(Serialize)]
pub(super) struct Fallback {
    pub(super) fallback: bool,
}
