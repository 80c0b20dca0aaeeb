//! The vertices of a mesh under removal, and the mesh that they make with their stars.

use crate::control::Cancelled;
use crate::image::{Image, Point};
use crate::removal::star::StarBlock;
use crate::removal::vertex_order::tile_order;
use crate::triangulation::Face;

/// Stands for a vertex that is not in the mesh any more.
const REMOVED: u32 = u32::MAX;

/// The positions of the vertices, numbered along [`tile_order`], in blocks of `1 << digits`.
pub(crate) struct Vertices {
    pub(crate) points: Vec<Point>,
    /// The rank of each vertex among all, by row, then column.
    pub(crate) ranks: Vec<u32>,
    /// The binary digits of a vertex's number within its block.
    pub(crate) digits: u32,
    /// The last column and row of the image.
    right: i32,
    top: i32,
}

impl Vertices {
    /// The vertices at points given by row, then column.
    pub(crate) fn new(image: &Image, points: &[Point], digits: u32) -> Self {
        let ranks = tile_order(points, image.width(), image.height());
        let points = ranks.iter().map(|&rank| points[rank as usize]).collect();
        let (right, top) = (image.width() as i32 - 1, image.height() as i32 - 1);
        Self { points, ranks, digits, right, top }
    }

    /// The block of a vertex.
    #[inline(always)]
    pub(crate) fn block_of(&self, vertex: u32) -> usize {
        (vertex >> self.digits) as usize
    }

    /// The points and faces of the vertices that remain: points by row, then column; faces
    /// counter-clockwise, each from its smallest vertex, in ascending order.
    pub(crate) fn mesh(
        &self,
        blocks: &[StarBlock],
        poll: impl Fn() -> Result<(), Cancelled>,
    ) -> Result<(Vec<Point>, Vec<Face>), Cancelled> {
        let view = MeshView { vertices: self, blocks, first_block: 0 };
        let mut by_rank = vec![REMOVED; self.ranks.len()];
        for (vertex, &rank) in (0..).zip(&self.ranks) {
            if !view.stars(vertex).is_removed(vertex) {
                by_rank[rank as usize] = vertex;
            }
        }
        by_rank.retain(|&vertex| vertex != REMOVED);
        let mut numbers = vec![REMOVED; self.ranks.len()];
        for (number, &vertex) in (0..).zip(&by_rank) {
            numbers[vertex as usize] = number;
        }
        let points = by_rank.iter().map(|&vertex| self.points[vertex as usize]).collect();
        let mut faces = Vec::with_capacity(2 * by_rank.len());
        for vertices in by_rank.chunks(1 << 13) {
            poll()?;
            for &vertex in vertices {
                view.add_faces(vertex, &numbers, &mut faces);
            }
        }
        Ok((points, faces))
    }
}

/// A read-only view of some blocks of a mesh.
#[derive(Clone, Copy)]
pub(crate) struct MeshView<'a> {
    pub(crate) vertices: &'a Vertices,
    pub(crate) blocks: &'a [StarBlock],
    /// The number of the first of these blocks.
    pub(crate) first_block: usize,
}

impl MeshView<'_> {
    /// The block that holds the star of a vertex.
    #[inline(always)]
    pub(crate) fn stars(&self, vertex: u32) -> &StarBlock {
        &self.blocks[self.vertices.block_of(vertex) - self.first_block]
    }

    /// The position of a vertex.
    #[inline(always)]
    pub(crate) fn point(&self, vertex: u32) -> Point {
        self.vertices.points[vertex as usize]
    }

    /// Whether a vertex is a corner of the image.
    pub(crate) fn is_corner(&self, vertex: u32) -> bool {
        let Point { x, y } = self.point(vertex);
        (x == 0 || x == self.vertices.right) && (y == 0 || y == self.vertices.top)
    }

    /// Whether a vertex lies on the border of the image.
    pub(crate) fn is_on_border(&self, vertex: u32) -> bool {
        let Point { x, y } = self.point(vertex);
        x == 0 || x == self.vertices.right || y == 0 || y == self.vertices.top
    }

    /// Adds the faces of which a vertex is the one of the smallest number, in ascending order.
    fn add_faces(&self, vertex: u32, numbers: &[u32], faces: &mut Vec<Face>) {
        let neighbours = self.stars(vertex).neighbours(vertex);
        let number = numbers[vertex as usize];
        let start = faces.len();
        for (i, &neighbour) in neighbours.iter().enumerate() {
            let is_last = i + 1 == neighbours.len();
            if is_last && self.is_on_border(vertex) {
                continue;
            }
            let next = neighbours[if is_last { 0 } else { i + 1 }];
            let (second, third) = (numbers[neighbour as usize], numbers[next as usize]);
            if number < second && number < third {
                faces.push([number, second, third]);
            }
        }
        faces[start..].sort_unstable();
    }
}
