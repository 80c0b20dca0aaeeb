//! The buffers of a glTF file: one with bytes, and one that decompression fills.

use super::attributes::Attribute;
use super::document::*;
use crate::meshopt;
use pixmesh_meshing::Face;
use serde_json::json;
use std::collections::BTreeMap;

/// The most vertices that 16-bit indices can name: 65535 is no index, it restarts primitives.
const MAX_SHORT_VERTICES: usize = 65_535;

/// The views, the accessors on them, and the bytes.
#[derive(Default)]
pub(super) struct Buffers {
    /// The first buffer.
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<BufferView>,
    pub(super) accessors: Vec<Accessor>,
    /// Views are compressed.
    compressed: bool,
    /// Bytes of the second buffer, which is never stored.
    decompressed: usize,
}

impl Buffers {
    pub(super) fn new(compressed: bool) -> Self {
        Self { compressed, ..Self::default() }
    }

    /// Adds an attribute of all vertices, and gives the index of its accessor.
    pub(super) fn add_attribute(&mut self, attribute: Attribute) -> usize {
        let Attribute { component_type, normalized, kind, stride, bounds, bytes, .. } = attribute;
        let count = bytes.len() / stride;
        let buffer_view = if self.compressed {
            let packed = meshopt::compress_vertices(&bytes, stride);
            self.add_compressed(&packed, stride, count, "ATTRIBUTES", ARRAY_BUFFER)
        } else {
            self.add_plain(&bytes, Some(stride), Some(ARRAY_BUFFER))
        };
        let [min, max] = bounds.map_or([None; 2], |bounds| bounds.map(Some));
        let accessor = Accessor { buffer_view, component_type, normalized, count, kind, min, max };
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds the faces, with indices in the smallest type, and gives the index of their accessor.
    pub(super) fn add_faces(&mut self, faces: &[Face], vertex_count: usize) -> usize {
        let short = vertex_count <= MAX_SHORT_VERTICES;
        let (component_type, stride) = if short { (UNSIGNED_SHORT, 2) } else { (UNSIGNED_INT, 4) };
        let count = 3 * faces.len();
        let buffer_view = if self.compressed {
            let packed = meshopt::compress_faces(faces);
            self.add_compressed(&packed, stride, count, "TRIANGLES", ELEMENT_ARRAY_BUFFER)
        } else {
            let bytes =
                faces.iter().flatten().flat_map(|i| i.to_le_bytes().into_iter().take(stride));
            self.add_plain(&bytes.collect::<Vec<u8>>(), None, Some(ELEMENT_ARRAY_BUFFER))
        };
        let (normalized, kind, min, max) = (false, "SCALAR", None, None);
        let accessor = Accessor { buffer_view, component_type, normalized, count, kind, min, max };
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a view of bytes as they are, and gives its index.
    pub(super) fn add_plain(
        &mut self,
        bytes: &[u8],
        byte_stride: Option<usize>,
        target: Option<u32>,
    ) -> usize {
        let (byte_offset, byte_length) = (self.append(bytes), bytes.len());
        let view =
            BufferView { byte_offset, byte_length, byte_stride, target, ..BufferView::default() };
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds a view of the second buffer, whose bytes are decompressed from the first.
    fn add_compressed(
        &mut self,
        packed: &[u8],
        stride: usize,
        count: usize,
        mode: &'static str,
        target: u32,
    ) -> usize {
        let compressed = BufferView {
            byte_offset: self.append(packed),
            byte_length: packed.len(),
            byte_stride: Some(stride),
            count: Some(count),
            mode: Some(mode),
            ..BufferView::default()
        };
        let byte_length = stride * count;
        self.views.push(BufferView {
            buffer: 1,
            byte_offset: self.decompressed,
            byte_length,
            byte_stride: (target == ARRAY_BUFFER).then_some(stride),
            target: Some(target),
            extensions: Some(BTreeMap::from([(MESHOPT, Box::new(compressed))])),
            ..BufferView::default()
        });
        self.decompressed += byte_length.next_multiple_of(4);
        self.views.len() - 1
    }

    /// Appends bytes to the first buffer at a multiple of four, and gives their offset.
    fn append(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        offset
    }

    /// The buffers as the document describes them.
    pub(super) fn descriptions(&self, uri: Option<String>) -> Vec<Buffer> {
        let byte_length = self.bytes.len();
        let mut buffers = vec![Buffer { byte_length, uri, extensions: None }];
        if self.compressed {
            let extensions = Some(json!({ MESHOPT: { "fallback": true } }));
            buffers.push(Buffer { byte_length: self.decompressed, uri: None, extensions });
        }
        buffers
    }
}
