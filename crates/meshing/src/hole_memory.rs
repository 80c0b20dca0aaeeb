//! The errors of the triangles that would fill the hole of each vertex, as last evaluated.
//!
//! When a neighbour goes, some triangles of a vertex's hole stay the same, two in five, and when
//! the vertex itself goes, all of them do: their errors need not be computed again.

use crate::mesh::Face;

/// Triangles remembered for each vertex; a hole has four on average.
const SLOTS: usize = 6;

/// Stands in for a triangle that is not remembered: no face has such vertices.
const NOTHING: Remembered = Remembered { face: [u32::MAX; 3], error: 0 };

/// A triangle, beginning with its smallest vertex, and its error.
#[derive(Clone, Copy)]
struct Remembered {
    face: Face,
    /// Errors that do not fit are not remembered.
    error: u32,
}

/// The triangles last evaluated for each vertex.
pub(crate) struct HoleMemory {
    vertices: Vec<[Remembered; SLOTS]>,
    /// What the vertex in work will have.
    next: [Remembered; SLOTS],
    filled: usize,
}

impl HoleMemory {
    /// A memory of nothing, for so many vertices.
    pub(crate) fn new(vertex_count: usize) -> Self {
        let vertices = vec![[NOTHING; SLOTS]; vertex_count];
        Self { vertices, next: [NOTHING; SLOTS], filled: 0 }
    }

    /// The error of a triangle that begins with its smallest vertex: as remembered for `vertex`,
    /// or computed; it is kept until [`HoleMemory::keep`].
    #[inline]
    pub(crate) fn error(&mut self, vertex: u32, face: Face, compute: impl FnOnce() -> u64) -> u64 {
        let known = self.vertices[vertex as usize].iter().find(|known| known.face == face);
        let error = known.map_or_else(compute, |known| known.error.into());
        if let (Ok(error), true) = (u32::try_from(error), self.filled < SLOTS) {
            self.next[self.filled] = Remembered { face, error };
            self.filled += 1;
        }
        error
    }

    /// Remembers for `vertex` what was asked since the last call.
    #[inline]
    pub(crate) fn keep(&mut self, vertex: u32) {
        self.next[self.filled..].fill(NOTHING);
        self.vertices[vertex as usize] = self.next;
        self.filled = 0;
    }
}
