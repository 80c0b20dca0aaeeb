//! The JSON part of a glTF file, as far as one mesh needs it.

use serde::Serialize;
use std::collections::BTreeMap;

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
/// The extension for materials that no light changes.
pub(super) const UNLIT: &str = "KHR_materials_unlit";

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) asset: Asset,
    pub(super) extensions_used: [&'static str; 1],
    pub(super) scene: usize,
    pub(super) scenes: [Scene; 1],
    pub(super) nodes: [Node; 1],
    pub(super) meshes: [Mesh; 1],
    pub(super) materials: [Material; 1],
    pub(super) accessors: [Accessor; 3],
    pub(super) buffer_views: [BufferView; 3],
    pub(super) buffers: [Buffer; 1],
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
}

#[derive(Serialize)]
pub(super) struct Mesh {
    pub(super) primitives: [Primitive; 1],
}

#[derive(Serialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: usize,
    pub(super) material: usize,
    pub(super) mode: u32,
}

/// The accessors of the vertices' attributes.
#[derive(Serialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(super) position: usize,
    #[serde(rename = "COLOR_0")]
    pub(super) color: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Surface,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) alpha_mode: Option<&'static str>,
    pub(super) double_sided: bool,
    pub(super) extensions: BTreeMap<&'static str, Empty>,
}

/// What viewers that do not know the unlit extension show: a matt surface.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Surface {
    pub(super) metallic_factor: f32,
    pub(super) roughness_factor: f32,
}

/// An object without members.
#[derive(Serialize)]
pub(super) struct Empty {}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: usize,
    pub(super) component_type: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) normalized: Option<bool>,
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
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) target: u32,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: u64,
}
