//! The JSON part of a glTF file, as far as one mesh needs it.
//!
//! Objects whose members stand in the alphabet's order are JSON values, the others structures: the
//! same mesh gives the same bytes whatever order a JSON map keeps.

use serde::Serialize;
use serde_json::Value;
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
pub(super) const TRIANGLES: u32 = 4;
/// `magFilter`: the mean of the four nearest texels.
pub(super) const LINEAR: u32 = 9729;
/// `minFilter`: the same of the two nearest reductions.
pub(super) const LINEAR_MIPMAP_LINEAR: u32 = 9987;
/// `wrapS` and `wrapT`: texels at the border go on beyond it.
pub(super) const CLAMP_TO_EDGE: u32 = 33071;
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
    pub(super) scenes: Value,
    pub(super) nodes: [Node; 1],
    pub(super) meshes: Value,
    pub(super) materials: [Material; 1],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) textures: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) images: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) samplers: Option<Value>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Serialize)]
pub(super) struct Asset {
    pub(super) version: &'static str,
    pub(super) generator: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extras: Option<Value>,
}

#[derive(Serialize)]
pub(super) struct Node {
    pub(super) mesh: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) translation: Option<[f64; 3]>,
    /// A unit quaternion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) alpha_mode: Option<&'static str>,
    pub(super) double_sided: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extensions: Option<Value>,
}

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

/// A view, or the place of the bytes from which one is decompressed.
#[derive(Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) target: Option<u32>,
    /// Of compressed bytes: how many records they hold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) count: Option<usize>,
    /// Of compressed bytes: how they are compressed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mode: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extensions: Option<BTreeMap<&'static str, Box<BufferView>>>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) uri: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extensions: Option<Value>,
}
