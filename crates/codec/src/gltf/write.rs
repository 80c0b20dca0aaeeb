//! The writers, which assemble the document that the options choose.
//!
//! `x` is to the right, `y` up and `z` towards the viewer; the node turns a relief so that its heights
//! follow `y`. Without a geometry one pixel is one
//! metre, and positions are the lattice points themselves. Colours are linear, as glTF asks, and
//! alpha is linear already; one component is gray, two are gray and alpha, three RGB, four RGBA, and
//! of five and more the first three are taken as RGB. A flat mesh is unlit, so that it shows the
//! picture as it is; a relief has normals and a matt surface. The same mesh and options always give
//! the same bytes.

use super::attributes::{self, Lattice};
use super::buffer::Buffers;
use super::document::*;
use crate::choices::{Compression, LengthUnit, UpAxis};
use crate::encode::EncodeOptions;
use crate::error::EncodeError;
use crate::face_order;
use crate::shown::Shown;
use crate::surface::Surface;
use crate::wanted::Wanted;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::{Cancelled, Face};
use serde_json::json;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, Write};

/// The file's first four bytes.
const MAGIC: &[u8; 4] = b"glTF";
/// The version of glTF, which is also that of its binary form.
const VERSION: u32 = 2;
/// Type of the chunk that holds the document, padded with blanks.
const JSON_CHUNK: u32 = 0x4E4F_534A;
/// Type of the chunk that holds the buffer, padded with zeros.
const BIN_CHUNK: u32 = 0x004E_4942;
/// Bytes of the file's header, and of the headers of two chunks.
const HEADERS_BYTES: u64 = 12 + 2 * 8;

/// Writes a mesh as binary glTF: one primitive of triangles, double-sided, with positions, colours
/// or a texture, normals where there is a relief, and indices in the smallest type that fits.
pub(crate) fn write_glb(
    mesh: &Shown<'_>,
    options: &EncodeOptions<'_>,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let (document, mut buffer) = assemble(mesh, options, |_| None, wanted)?;
    let mut json = serde_json::to_vec(&document).map_err(io::Error::from)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let bytes = HEADERS_BYTES + json.len() as u64 + buffer.len() as u64;
    let limit = u64::from(u32::MAX);
    let length =
        u32::try_from(bytes).map_err(|_| EncodeError::TooLarge { format: "GLB", bytes, limit })?;
    let words = |words: [u32; 2]| words.map(u32::to_le_bytes);
    out.write_all(MAGIC)?;
    out.write_all(words([VERSION, length]).as_flattened())?;
    out.write_all(words([json.len() as u32, JSON_CHUNK]).as_flattened())?;
    out.write_all(&json)?;
    out.write_all(words([buffer.len() as u32, BIN_CHUNK]).as_flattened())?;
    out.write_all(&buffer)?;
    Ok(())
}

/// Writes a mesh as glTF in JSON, with its buffer within as base64: a file of its own for readers
/// of text. What it says is the same as [`write_glb`]'s.
pub(crate) fn write_gltf(
    mesh: &Shown<'_>,
    options: &EncodeOptions<'_>,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let uri = |bytes: &[u8]| {
        let mut uri = String::from("data:application/octet-stream;base64,");
        STANDARD.encode_string(bytes, &mut uri);
        Some(uri)
    };
    let (document, _) = assemble(mesh, options, uri, wanted)?;
    serde_json::to_writer(&mut *out, &document).map_err(io::Error::from)?;
    out.write_all(b"\n")?;
    Ok(())
}

/// The document and the bytes of its buffer, to which `uri` may give an address.
fn assemble(
    mesh: &Shown<'_>,
    options: &EncodeOptions<'_>,
    uri: impl FnOnce(&[u8]) -> Option<String>,
    wanted: &Wanted<'_>,
) -> Result<(Document, Vec<u8>), EncodeError> {
    let compressed = options.compression == Compression::Meshopt;
    // Compression lives on neighbours that follow each other.
    let ordered = compressed.then(|| face_order::by_neighbours(mesh));
    let ordered = ordered.as_ref().unwrap_or(mesh);
    let surface = match options.texture {
        Some(_) => Surface::new(ordered, &options.geometry)?,
        None => Surface::colored(ordered, &options.geometry)?,
    };
    let lattice = match options.compression {
        Compression::None => None,
        Compression::Quantized | Compression::Meshopt => Lattice::of(&surface),
    };
    let mut buffers = Buffers::new(compressed);
    let attributes =
        add_attributes(&surface, lattice, options.texture.is_some(), &mut buffers, wanted)?;
    let faces: Vec<Face> = surface.faces().collect();
    let indices = buffers.add_faces(&faces, surface.vertex_count());
    drop(faces);
    let image = options.texture.map(|texture| {
        let view = buffers.add_plain(&texture.bytes, None, None);
        json!([{ "bufferView": view, "mimeType": texture.media_type }])
    });
    let mut used = Vec::new();
    used.extend(is_unlit(&surface).then_some(UNLIT));
    used.extend(lattice.is_some().then_some(QUANTIZATION));
    used.extend(compressed.then_some(MESHOPT));
    let primitive = json!({
        "attributes": attributes, "indices": indices, "material": 0, "mode": TRIANGLES,
    });
    let sampler = json!({
        "magFilter": LINEAR,
        "minFilter": LINEAR_MIPMAP_LINEAR,
        "wrapS": CLAMP_TO_EDGE,
        "wrapT": CLAMP_TO_EDGE,
    });
    let document = Document {
        asset: Asset {
            version: "2.0",
            generator: concat!("pixmesh ", env!("CARGO_PKG_VERSION")),
            extras: options.terrain.map(|terrain| terrain.extras()),
        },
        extensions_required: used.iter().copied().filter(|&name| name != UNLIT).collect(),
        extensions_used: used,
        scene: 0,
        scenes: json!([{ "nodes": [0] }]),
        nodes: [node(&surface, lattice)],
        meshes: json!([{ "primitives": [primitive] }]),
        materials: [material(&surface, image.is_some())],
        textures: image.is_some().then(|| json!([{ "sampler": 0, "source": 0 }])),
        samplers: image.is_some().then(|| json!([sampler])),
        images: image,
        buffers: buffers.descriptions(uri(&buffers.bytes)),
        accessors: buffers.accessors,
        buffer_views: buffers.views,
    };
    Ok((document, buffers.bytes))
}

/// Adds what each vertex has, and gives the accessors by name.
fn add_attributes(
    surface: &Surface<'_>,
    lattice: Option<Lattice>,
    textured: bool,
    buffers: &mut Buffers,
    wanted: &Wanted<'_>,
) -> Result<BTreeMap<&'static str, usize>, Cancelled> {
    let mut accessors = BTreeMap::new();
    let mut add = |attribute: attributes::Attribute| {
        accessors.insert(attribute.name, buffers.add_attribute(attribute));
    };
    add(attributes::positions(surface, lattice));
    if !is_unlit(surface) {
        add(attributes::normals(surface, lattice));
    }
    if textured {
        add(attributes::texture_places(surface, lattice.is_some()));
    } else if let Some(shape) = surface.color_shape() {
        add(attributes::colors(surface, shape, wanted)?);
    }
    Ok(accessors)
}

/// Whether no light changes the colours: of a picture that lies flat, and of a relief that is shaded
/// already.
fn is_unlit(surface: &Surface<'_>) -> bool {
    surface.is_flat() || surface.is_shaded()
}

/// The node, which scales what the file stores to metres, and moves and turns it: of a relief the
/// heights follow `y`, which is up in glTF.
fn node(surface: &Surface<'_>, lattice: Option<Lattice>) -> Node {
    let metres = match surface.unit() {
        LengthUnit::Metre => 1.0,
        LengthUnit::Millimetre => 0.001,
    };
    let scale = lattice.map_or([1.0; 3], |lattice| lattice.scale).map(|part| part * metres);
    let bottom = lattice.map_or(0.0, |lattice| lattice.bottom * metres);
    let [center_x, center_y] = surface.center().map(|place| place * metres);
    let up = if surface.is_flat() { UpAxis::Z } else { UpAxis::Y };
    let translation = surface.turned([0.0 - center_x, 0.0 - center_y, bottom], up);
    let is_turned = surface.turned([0.0, 0.0, 1.0], up) == [0.0, 1.0, 0.0];
    Node {
        mesh: 0,
        translation: (translation != [0.0; 3]).then_some(translation),
        rotation: is_turned.then_some([-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]),
        scale: (scale != [1.0; 3]).then_some(scale),
    }
}

/// A material that shows the vertices' colours or the texture from both sides: as they are where
/// the mesh is flat, else lit.
fn material(surface: &Surface<'_>, textured: bool) -> Material {
    let matt = match textured {
        true => json!({
            "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 1.0,
        }),
        false => json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 }),
    };
    Material {
        pbr_metallic_roughness: matt,
        alpha_mode: has_alpha(surface.mesh.shape().component_count).then_some("BLEND"),
        double_sided: true,
        extensions: is_unlit(surface).then(|| json!({ UNLIT: {} })),
    }
}
