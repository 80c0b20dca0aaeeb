//! The writers: what the options choose is put together here.
//!
//! `x` is to the right, `y` up and `z` towards the viewer. Without a geometry one pixel is one
//! metre, and positions are the lattice points themselves. Colours are linear, as glTF asks, and
//! alpha is linear already; one component is gray, two are gray and alpha, three RGB, four RGBA, and
//! of five and more the first three are taken as RGB. A flat mesh is unlit, so that it shows the
//! picture as it is; a relief has normals and a matt surface. The same mesh and options always give
//! the same bytes.

use super::attributes::{self, Lattice};
use super::buffer::Buffers;
use super::document::*;
use super::texture::Texture;
use crate::choices::{Compression, LengthUnit};
use crate::error::EncodeError;
use crate::face_order;
use crate::surface::{Geometry, Surface};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_meshing::{Face, Mesh as TriangleMesh, Shape};
use std::collections::BTreeMap;
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

/// How a mesh becomes glTF.
#[derive(Clone, Copy, Debug, Default)]
pub struct GltfOptions<'a> {
    /// How the mesh lies in space.
    pub geometry: Geometry,
    /// How vertices and indices are stored.
    pub compression: Compression,
    /// The picture to show instead of the vertices' colours.
    pub texture: Option<&'a Texture>,
}

/// Writes a mesh as binary glTF: one primitive of triangles, double-sided, with positions, colours
/// or a texture, normals where there is a relief, and indices in the smallest type that fits.
///
/// # Errors
/// [`EncodeError::NoSuchComponent`] for a relief that cannot be, [`EncodeError::TooLarge`] when the
/// file would take 4 GiB or more, and whatever `out` fails with.
pub fn write_glb(
    mesh: &TriangleMesh,
    options: &GltfOptions<'_>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let (document, mut buffer) = assemble(mesh, options, |_| None)?;
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
///
/// # Errors
/// As [`write_glb`], but of any length.
pub fn write_gltf(
    mesh: &TriangleMesh,
    options: &GltfOptions<'_>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let uri = |bytes: &[u8]| {
        let mut uri = String::from("data:application/octet-stream;base64,");
        STANDARD.encode_string(bytes, &mut uri);
        Some(uri)
    };
    let (document, _) = assemble(mesh, options, uri)?;
    serde_json::to_writer(&mut *out, &document).map_err(io::Error::from)?;
    out.write_all(b"\n")?;
    Ok(())
}

/// The document and the bytes of its buffer, to which `uri` may give an address.
fn assemble(
    mesh: &TriangleMesh,
    options: &GltfOptions<'_>,
    uri: impl FnOnce(&[u8]) -> Option<String>,
) -> Result<(Document, Vec<u8>), EncodeError> {
    let compressed = options.compression == Compression::Meshopt;
    // Compression lives on neighbours that follow each other.
    let ordered = compressed.then(|| face_order::by_neighbours(mesh));
    let surface = Surface::new(ordered.as_ref().unwrap_or(mesh), &options.geometry)?;
    let lattice = match options.compression {
        Compression::None => None,
        Compression::Quantized | Compression::Meshopt => Lattice::of(&surface),
    };
    let mut buffers = Buffers::new(compressed);
    let attributes = add_attributes(&surface, lattice, options.texture.is_some(), &mut buffers);
    let faces: Vec<Face> = surface.faces().collect();
    let indices = buffers.add_faces(&faces, surface.vertex_count());
    drop(faces);
    let image = options.texture.map(|texture| ImageReference {
        buffer_view: buffers.add_plain(texture.bytes(), None, None),
        mime_type: texture.media_type(),
    });
    let extensions = extensions(&surface, lattice.is_some(), compressed);
    let document = Document {
        asset: Asset { version: "2.0", generator: concat!("pixmesh ", env!("CARGO_PKG_VERSION")) },
        extensions_required: extensions.iter().copied().filter(|&name| name != UNLIT).collect(),
        extensions_used: extensions,
        scene: 0,
        scenes: [Scene { nodes: [0] }],
        nodes: [node(&surface, lattice)],
        meshes: [Mesh { primitives: [Primitive::triangles(attributes, indices)] }],
        materials: [material(&surface, image.is_some())],
        textures: image.iter().map(|_| TextureReference { sampler: 0, source: 0 }).collect(),
        samplers: image.iter().map(|_| Sampler::smooth()).collect(),
        images: image.into_iter().collect(),
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
) -> BTreeMap<&'static str, usize> {
    let mut accessors = BTreeMap::new();
    let mut add = |attribute: attributes::Attribute| {
        accessors.insert(attribute.name, buffers.add_attribute(&attribute));
    };
    add(attributes::positions(surface, lattice));
    if !surface.is_flat() {
        add(attributes::normals(surface, lattice));
    }
    if textured {
        add(attributes::texture_places(surface, lattice.is_some()));
    } else {
        add(attributes::colors(surface));
    }
    accessors
}

/// The extensions that the file uses.
fn extensions(surface: &Surface<'_>, quantized: bool, compressed: bool) -> Vec<&'static str> {
    let used = [(surface.is_flat(), UNLIT), (quantized, QUANTIZATION), (compressed, MESHOPT)];
    used.into_iter().filter_map(|(is_used, name)| is_used.then_some(name)).collect()
}

/// The node, which scales what the file stores to metres.
fn node(surface: &Surface<'_>, lattice: Option<Lattice>) -> Node {
    let metres = match surface.geometry().unit {
        LengthUnit::Metre => 1.0,
        LengthUnit::Millimetre => 0.001,
    };
    let scale = lattice.map_or([1.0; 3], |lattice| lattice.scale).map(|part| part * metres);
    let bottom = lattice.map_or(0.0, |lattice| lattice.bottom * metres);
    Node {
        mesh: 0,
        translation: (bottom != 0.0).then_some([0.0, 0.0, bottom]),
        scale: (scale != [1.0; 3]).then_some(scale),
    }
}

/// A material that shows the vertices' colours or the texture from both sides: as they are where
/// the mesh is flat, else lit.
fn material(surface: &Surface<'_>, textured: bool) -> Material {
    Material {
        pbr_metallic_roughness: Appearance {
            base_color_texture: textured.then_some(TextureUse { index: 0 }),
            metallic_factor: 0.0,
            roughness_factor: 1.0,
        },
        alpha_mode: has_alpha(surface.mesh().shape()).then_some("BLEND"),
        double_sided: true,
        extensions: surface.is_flat().then_some((UNLIT, Empty {})).into_iter().collect(),
    }
}

/// Tells whether the last component is alpha.
fn has_alpha(shape: Shape) -> bool {
    matches!(shape.component_count, 2 | 4)
}
