//! pmesh: meshes in few bytes, optionally with the order of vertices that gives every smaller size.
//!
//! The connectivity is that of the preferred-directions Delaunay triangulation, which the points
//! alone determine, so only points and samples are kept. A mesh is written as version 3, which
//! `compact` codes and docs/pmesh.md specifies, a progression as version 1, or 4 for an elevation model.
//! All versions are read.
//!
//! Versions 1, 2 and 4 have a header of 24 bytes, numbers little-endian:
//!
//! | bytes | what |
//! |---|---|
//! | 4 | `PMSH` |
//! | 1 | version: 4 for a progression of an elevation model, 2 when faces have colours, else 1 |
//! | 1 | 1 when the order of importance is kept, else 0 |
//! | 1 | bits per sample |
//! | 1 | number of components |
//! | 4 | width |
//! | 4 | height |
//! | 4 | number of vertices |
//! | 4 | bytes of what follows once inflated |
//!
//! In version 4 the number of bytes of a text, as 16 bits, and the text follow: what the samples of
//! the [elevation model](crate::Terrain) mean, in words and numbers.
//!
//! Then a deflate stream (RFC 1951). In it, for the vertices by row, then column: the number of
//! lattice points skipped before each, in groups of 7 bits from the lowest, the high bit set in all but the
//! last; then for each component, and where samples have more than 8 bits for their low and high
//! bytes, how each sample differs from the one predicted, as 2d for d >= 0 and -2d - 1 for d < 0, d
//! taken modulo the number of sample values; then, where the order is kept, the rank of each vertex in
//! it, from 0, as 32 bits: first the lowest bytes of all ranks, then the next. After the ranks, in
//! groups of 7 bits as above: the squared error of the mesh of the first 4 vertices, the image's
//! corners, summed over pixels and components; then for each vertex of a higher rank by how much it
//! lowers that sum, as 2d or -2d - 1 as above. From these and the number of pixels, components and bits
//! follows the PSNR of every size.
//!
//! Version 2 then has the samples of the faces, like those of the vertices, component by component:
//! how each differs from the mean of the face's vertices, rounded down. Each face begins with its
//! first vertex, by row, then column, and the faces ascend.
//!
//! Where the last of two or of four components is alpha, colours are straight.
//!
//! A sample is predicted by the nearest vertex before it among the last one of each strip of
//! columns around; components after the first by that and by how the first one differs there.

mod compact;
mod error;
mod read;
mod write;

pub use error::PmeshError;
pub use read::{
    probe_pmesh, read_pmesh, read_pmesh_while, read_progression, read_progression_while,
};
pub use write::{write_pmesh, write_pmesh_while, write_progression, write_rounded_pmesh};

use crate::terrain::Terrain;
use pixmesh_meshing::{Face, Point, Shape};

/// Whether bytes begin as a pmesh does.
#[must_use]
pub fn is_pmesh(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

const MAGIC: [u8; 4] = *b"PMSH";
/// The version of a mesh whose vertices' samples are interpolated.
const VERSION: u8 = 1;
/// The version of a mesh whose faces have colours.
const FLAT_VERSION: u8 = 2;
/// The version with context-modelled arithmetic coding.
const COMPACT_VERSION: u8 = 3;
/// The version of a progression of an elevation model.
const TERRAIN_VERSION: u8 = 4;
const HEADER_BYTES: usize = 24;

/// Bytes of a number of 64 bits in groups of 7.
const NUMBER_BYTES: usize = 10;

/// Bytes of a rank.
const RANK_BYTES: usize = 4;

/// The strip's width is about the mean distance of the vertices, in columns at least.
const LEAST_STRIP: usize = 4;

/// Strips looked at to each side.
const STRIPS: usize = 2;

/// Appends the text of an elevation model: its bytes, as 16 bits, and itself.
fn append_terrain(terrain: &Terrain, bytes: &mut Vec<u8>) {
    let text = terrain.to_string();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
}

/// What the text says of an elevation model, and the bytes after it.
fn read_terrain(shape: Shape, bytes: &[u8]) -> Result<(Terrain, &[u8]), PmeshError> {
    let (length, bytes) = bytes.split_first_chunk().ok_or(PmeshError::Header)?;
    let length = u16::from_le_bytes(*length).into();
    let (text, rest) = bytes.split_at_checked(length).ok_or(PmeshError::Header)?;
    let terrain = Terrain::of_text(text, shape).ok_or(PmeshError::Header)?;
    Ok((terrain.map_err(PmeshError::Terrain)?, rest))
}

/// Tells for each vertex the one before it that its samples are predicted by.
struct Predictor {
    strip: usize,
    /// The last vertex of each strip, with its number.
    last: Vec<Option<(Point, usize)>>,
}

impl Predictor {
    fn new(shape: Shape, vertex_count: usize) -> Self {
        let area = shape.width * shape.height / vertex_count.max(1);
        let strip = area.isqrt().max(LEAST_STRIP);
        Self { strip, last: vec![None; shape.width / strip + 1] }
    }

    /// The nearest vertex among those kept around `point`, which is then kept itself as number
    /// `vertex`.
    fn predict(&mut self, point: Point, vertex: usize) -> Option<usize> {
        let at = point.x as usize / self.strip;
        let around = at.saturating_sub(STRIPS)..(at + STRIPS + 1).min(self.last.len());
        let distance = |p: Point| {
            let (dx, dy) = (i64::from(p.x - point.x), i64::from(p.y - point.y));
            dx * dx + dy * dy
        };
        let nearest = self.last[around].iter().flatten().min_by_key(|(p, v)| (distance(*p), *v));
        let nearest = nearest.map(|&(_, v)| v);
        self.last[at] = Some((point, vertex));
        nearest
    }
}

/// The faces, each from its first vertex on, in ascending order; `number` gives the vertices'
/// numbers by row, then column. With each its former index.
fn ordered_faces(faces: &[Face], number: impl Fn(u32) -> u32) -> Vec<(Face, usize)> {
    let turned = |face: &Face| {
        let [a, b, c] = face.map(&number);
        [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or([a, b, c])
    };
    let mut ordered: Vec<_> = faces.iter().map(turned).zip(0..).collect();
    ordered.sort_unstable();
    ordered
}

/// What a face's samples of a component are predicted by.
fn mean_of_corners(corners: [u16; 3]) -> u32 {
    corners.map(u32::from).iter().sum::<u32>() / 3
}

/// What component `c` is predicted by: the sample of the nearest vertex, raised as the first
/// component is.
fn predicted(c: usize, nearest: &[u16], first: u16, modulus: u32) -> u32 {
    let base = u32::from(nearest.get(c).copied().unwrap_or(0));
    match (c, nearest.first()) {
        (0, _) | (_, None) => base,
        (_, Some(&nearest_first)) => {
            (base + modulus + u32::from(first) - u32::from(nearest_first)) % modulus
        }
    }
}
