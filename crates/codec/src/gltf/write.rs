//! The GLB writer: a flat mesh in the plane `z = 0` with one colour per vertex.
//!
//! One unit is one pixel, `x` to the right and `y` up, so that positions are the lattice points
//! themselves. Colours are sixteen-bit RGBA, since glTF wants each vertex's colour to start at a
//! multiple of four bytes. One component is gray, two are gray and alpha, three RGB, four RGBA; of
//! five and more the first three are taken as RGB. Colours are linear, as glTF asks; alpha is linear
//! already. The same mesh always gives the same bytes.

use super::document::*;
use super::srgb::linear_table;
use crate::error::EncodeError;
use pixmesh_meshing::{Mesh as TriangleMesh, Shape};
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
/// Bytes of a position: three 32-bit floating-point numbers.
const POSITION_BYTES: u64 = 12;
/// Bytes of a colour: four 16-bit integers.
const COLOR_BYTES: u64 = 8;
/// The most vertices that 16-bit indices can name: 65535 is no index, it restarts primitives.
const MAX_SHORT_VERTICES: usize = 65_535;
/// Bytes that are collected before they are written.
const BUFFER_BYTES: usize = 1 << 16;

/// Writes a mesh as binary glTF: one primitive of triangles with positions, colours and indices in
/// the smallest type that fits, double-sided and unlit.
///
/// # Errors
/// [`EncodeError::TooLarge`] when the file would take 4 GiB or more, and whatever `out` fails with.
pub fn write_glb(mesh: &TriangleMesh, out: &mut impl Write) -> Result<(), EncodeError> {
    let layout = Layout::of(mesh);
    let mut json = serde_json::to_vec(&document(mesh, &layout)).map_err(io::Error::from)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let bytes = HEADERS_BYTES + json.len() as u64 + layout.padded();
    let length = |bytes: u64| {
        let limit = u64::from(u32::MAX);
        u32::try_from(bytes).map_err(|_| EncodeError::TooLarge { format: "GLB", bytes, limit })
    };
    let mut sink = Sink { out, buffer: Vec::with_capacity(BUFFER_BYTES + 64) };
    sink.put(MAGIC)?;
    sink.put_words([VERSION, length(bytes)?, length(json.len() as u64)?, JSON_CHUNK])?;
    sink.put(&json)?;
    sink.put_words([length(layout.padded())?, BIN_CHUNK])?;
    put_positions(mesh, &mut sink)?;
    put_colors(mesh, &mut sink)?;
    put_indices(mesh, layout.short_indices, &mut sink)?;
    sink.put(&[0; 3][..(layout.padded() - layout.end()) as usize])?;
    sink.flush()?;
    Ok(())
}

/// Where the parts of the buffer lie: positions, then colours, then indices. Every part but the
/// last has a multiple of four bytes.
struct Layout {
    vertex_count: usize,
    index_count: usize,
    /// Indices take two bytes and not four.
    short_indices: bool,
}

impl Layout {
    fn of(mesh: &TriangleMesh) -> Self {
        let vertex_count = mesh.points().len();
        let index_count = 3 * mesh.faces().len();
        Self { vertex_count, index_count, short_indices: vertex_count <= MAX_SHORT_VERTICES }
    }

    /// The parts as views of the buffer.
    fn views(&self) -> [BufferView; 3] {
        let vertices = self.vertex_count as u64;
        let index_bytes = if self.short_indices { 2 } else { 4 };
        let (positions, colors) = (vertices * POSITION_BYTES, vertices * COLOR_BYTES);
        let indices = self.index_count as u64 * index_bytes;
        let view = |byte_offset, byte_length, target| BufferView {
            buffer: 0,
            byte_offset,
            byte_length,
            target,
        };
        [
            view(0, positions, ARRAY_BUFFER),
            view(positions, colors, ARRAY_BUFFER),
            view(positions + colors, indices, ELEMENT_ARRAY_BUFFER),
        ]
    }

    /// Bytes of the buffer.
    fn end(&self) -> u64 {
        self.views().iter().map(|view| view.byte_length).sum()
    }

    /// Bytes of the buffer's chunk, a multiple of four.
    fn padded(&self) -> u64 {
        self.end().next_multiple_of(4)
    }
}

/// The document that describes the buffer.
fn document(mesh: &TriangleMesh, layout: &Layout) -> Document {
    let shape = mesh.shape();
    Document {
        asset: Asset { version: "2.0", generator: concat!("pixmesh ", env!("CARGO_PKG_VERSION")) },
        extensions_used: [UNLIT],
        scene: 0,
        scenes: [Scene { nodes: [0] }],
        nodes: [Node { mesh: 0 }],
        meshes: [Mesh { primitives: [primitive()] }],
        materials: [material(shape)],
        accessors: accessors(shape, layout),
        buffer_views: layout.views(),
        buffers: [Buffer { byte_length: layout.end() }],
    }
}

/// The one primitive: triangles of the first material.
fn primitive() -> Primitive {
    let attributes = Attributes { position: 0, color: 1 };
    Primitive { attributes, indices: 2, material: 0, mode: TRIANGLES }
}

/// A material that shows the vertices' colours as they are, from both sides.
fn material(shape: Shape) -> Material {
    Material {
        pbr_metallic_roughness: Surface { metallic_factor: 0.0, roughness_factor: 1.0 },
        alpha_mode: has_alpha(shape).then_some("BLEND"),
        double_sided: true,
        extensions: BTreeMap::from([(UNLIT, Empty {})]),
    }
}

/// The accessors of positions, colours and indices. The image's corners are vertices, so that the
/// bounds of the positions are known.
fn accessors(shape: Shape, layout: &Layout) -> [Accessor; 3] {
    let vertex_count = layout.vertex_count;
    let max = [(shape.width - 1) as f32, (shape.height - 1) as f32, 0.0];
    let index_type = if layout.short_indices { UNSIGNED_SHORT } else { UNSIGNED_INT };
    let accessor = |buffer_view, component_type, count, kind| {
        let (normalized, min, max) = (None, None, None);
        Accessor { buffer_view, component_type, normalized, count, kind, min, max }
    };
    [
        Accessor {
            min: Some([0.0; 3]),
            max: Some(max),
            ..accessor(0, FLOAT, vertex_count, "VEC3")
        },
        Accessor { normalized: Some(true), ..accessor(1, UNSIGNED_SHORT, vertex_count, "VEC4") },
        accessor(2, index_type, layout.index_count, "SCALAR"),
    ]
}

/// Tells whether the last component is alpha.
fn has_alpha(shape: Shape) -> bool {
    matches!(shape.component_count, 2 | 4)
}

/// Writes `x`, `y` and 0 of every vertex.
fn put_positions(mesh: &TriangleMesh, sink: &mut Sink<'_, impl Write>) -> io::Result<()> {
    for point in mesh.points() {
        sink.put_words([point.x as f32, point.y as f32, 0.0].map(f32::to_bits))?;
    }
    Ok(())
}

/// Writes red, green, blue and alpha of every vertex.
fn put_colors(mesh: &TriangleMesh, sink: &mut Sink<'_, impl Write>) -> io::Result<()> {
    let shape = mesh.shape();
    let largest = u32::from(u16::MAX >> (16 - shape.precision));
    let table = linear_table(shape.precision);
    let linear = |sample: u16| table.get(usize::from(sample)).copied().unwrap_or(u16::MAX);
    let alpha = |sample: u16| {
        ((2 * u64::from(sample) * 65535 + u64::from(largest)) / (2 * u64::from(largest))) as u16
    };
    for samples in mesh.samples().chunks_exact(shape.component_count) {
        let [red, green, blue, opacity] = match *samples {
            [gray] => [linear(gray), linear(gray), linear(gray), u16::MAX],
            [gray, opacity] => [linear(gray), linear(gray), linear(gray), alpha(opacity)],
            [red, green, blue, opacity] => {
                [linear(red), linear(green), linear(blue), alpha(opacity)]
            }
            [red, green, blue, ..] => [linear(red), linear(green), linear(blue), u16::MAX],
            [] => [0; 4],
        };
        sink.put_shorts([red, green, blue, opacity])?;
    }
    Ok(())
}

/// Writes the faces' indices.
fn put_indices(
    mesh: &TriangleMesh,
    short: bool,
    sink: &mut Sink<'_, impl Write>,
) -> io::Result<()> {
    for &face in mesh.faces() {
        if short {
            sink.put_shorts(face.map(|index| index as u16))?;
        } else {
            sink.put_words(face)?;
        }
    }
    Ok(())
}

/// Little-endian numbers on their way out.
struct Sink<'a, W> {
    out: &'a mut W,
    buffer: Vec<u8>,
}

impl<W: Write> Sink<'_, W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.buffer.extend_from_slice(bytes);
        if self.buffer.len() > BUFFER_BYTES { self.flush() } else { Ok(()) }
    }

    fn put_words<const N: usize>(&mut self, words: [u32; N]) -> io::Result<()> {
        self.put(words.map(u32::to_le_bytes).as_flattened())
    }

    fn put_shorts<const N: usize>(&mut self, shorts: [u16; N]) -> io::Result<()> {
        self.put(shorts.map(u16::to_le_bytes).as_flattened())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }
}
