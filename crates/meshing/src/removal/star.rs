//! The mesh under removal: for each vertex its star, that is its neighbours, counter-clockwise, and
//! the errors of the faces between them.
//!
//! A star of up to nine neighbours is inline in its [`Record`] of two cache lines. The stars of six
//! in a thousand, of more neighbours or a face error of more than 32 bits, are spilled to lists.

use crate::image::Point;
use crate::triangulation::hole::CAPACITY;
use std::borrow::Cow;
use std::collections::HashMap;
use std::hint::black_box;
use std::ops::Range;

pub(crate) const INLINE_CAPACITY: usize = 9;

/// Triangles cached for each vertex; a hole has four on average.
pub(crate) const CACHED_TRIANGLES: usize = 6;

/// The binary digits of a vertex's index in its tile where all vertices are one tile.
pub(crate) const ONE_TILE: u32 = u32::BITS - 1;
const SPILLED: u32 = u32::MAX;
const NOT_CACHED: u32 = u32::MAX;

// The points of an inline star's neighbours fit the arrays that holes are filled in.
const _: () = assert!(INLINE_CAPACITY <= CAPACITY);

/// The triangles that filled the hole of a vertex when it was last evaluated, and their errors.
///
/// When a neighbour is removed, two in five of them stay the same, and when the vertex itself is
/// removed, all do. The indices of a triangle's vertices among the neighbours identify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FillCache {
    /// The ascending indices of each triangle, a byte each.
    triangles: [u32; CACHED_TRIANGLES],
    errors: [u32; CACHED_TRIANGLES],
}

impl FillCache {
    pub(crate) const EMPTY: Self =
        Self { triangles: [NOT_CACHED; CACHED_TRIANGLES], errors: [0; CACHED_TRIANGLES] };

    /// Whether the error of a triangle is cached, and the error, or 0.
    #[inline(always)]
    pub(crate) fn error(&self, [a, b, c]: [u8; 3]) -> (bool, u32) {
        let wanted = u32::from_le_bytes([a, b, c, 0]);
        // All slots are compared, without a branch for each.
        let (mut is_cached, mut error) = (false, 0);
        for (&triangle, &cached) in self.triangles.iter().zip(&self.errors) {
            is_cached |= triangle == wanted;
            error |= if triangle == wanted { cached } else { 0 };
        }
        (is_cached, error)
    }

    /// Writes a triangle to a slot, if there is a slot of this number.
    #[inline(always)]
    pub(crate) fn set_triangle(&mut self, slot: usize, [a, b, c]: [u8; 3]) {
        if let Some(triangle) = self.triangles.get_mut(slot) {
            *triangle = u32::from_le_bytes([a, b, c, 0]);
        }
    }

    /// Writes the error of the triangle in a slot, if there is a slot of this number. A triangle
    /// whose error needs more than 32 bits leaves the cache.
    #[inline(always)]
    pub(crate) fn set_error(&mut self, slot: usize, error: u64) {
        if let (Some(triangle), Some(cached)) =
            (self.triangles.get_mut(slot), self.errors.get_mut(slot))
        {
            *triangle = if error > u32::MAX.into() { NOT_CACHED } else { *triangle };
            *cached = error as u32;
        }
    }

    /// The triangles and errors of a fill of `count` triangles; `None` unless all are cached.
    #[inline(always)]
    pub(crate) fn all(&self, count: usize) -> Option<impl Iterator<Item = ([u8; 3], u32)>> {
        let triangles = self.triangles.get(..count)?;
        let unpacked = triangles.iter().map(|triangle| {
            let [a, b, c, _] = triangle.to_le_bytes();
            [a, b, c]
        });
        (!triangles.contains(&NOT_CACHED)).then(|| unpacked.zip(self.errors))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub(crate) struct Record {
    pub(crate) fill: FillCache,
    /// Number of neighbours, 0 for a removed vertex, [`SPILLED`] for a spilled star.
    degree: u32,
    /// The neighbours, 0 for each that is missing.
    pub(crate) neighbours: [u32; INLINE_CAPACITY],
    /// The error of the face between each neighbour and the next one.
    errors: [u32; INLINE_CAPACITY],
}

impl Record {
    const REMOVED: Self = Self {
        fill: FillCache::EMPTY,
        degree: 0,
        neighbours: [0; INLINE_CAPACITY],
        errors: [0; INLINE_CAPACITY],
    };

    /// The inline star, with nothing cached, after a neighbour is replaced, and the index of that
    /// neighbour; `None` when either star is not inline. [`Star::without`] is its specification.
    ///
    /// Copies fixed-size blocks; later copies overwrite the surplus of earlier ones.
    #[inline]
    pub(crate) fn without(
        &self,
        removed: u32,
        replacement: &InlineReplacement,
    ) -> Option<(Self, usize)> {
        let InlineReplacement { successors, count, errors: between } = replacement;
        let degree = (self.degree as usize).wrapping_sub(1) + count;
        let is_too_large = degree > INLINE_CAPACITY || *count >= between.len();
        if self.degree == SPILLED || is_too_large {
            return None;
        }
        let indices = self.neighbours.iter().enumerate();
        let found = indices.fold(0, |found, (i, &v)| found | u32::from(v == removed) << i);
        let at = (found.trailing_zeros() as usize).min(INLINE_CAPACITY - 1);
        let mut neighbours = [0; 4 * INLINE_CAPACITY];
        neighbours[..INLINE_CAPACITY].copy_from_slice(&self.neighbours);
        let mut after = [0; 2 * INLINE_CAPACITY];
        after[..INLINE_CAPACITY].copy_from_slice(&self.neighbours);
        neighbours[at..at + INLINE_CAPACITY - 1].copy_from_slice(successors);
        neighbours[at + count..][..INLINE_CAPACITY]
            .copy_from_slice(&after[at + 1..][..INLINE_CAPACITY]);
        // The error before each neighbour; before the first one it is that after the last.
        let mut errors = [0; 4 * INLINE_CAPACITY];
        errors[1..=INLINE_CAPACITY].copy_from_slice(&self.errors);
        after[..INLINE_CAPACITY].copy_from_slice(&self.errors);
        errors[at..at + INLINE_CAPACITY - 1].copy_from_slice(between);
        errors[at + count + 1..][..INLINE_CAPACITY]
            .copy_from_slice(&after[at + 1..][..INLINE_CAPACITY]);
        errors[degree] = errors[if at == 0 { 0 } else { degree }];
        let mut record = Self { degree: degree as u32, ..Self::REMOVED };
        for i in 0..INLINE_CAPACITY {
            record.neighbours[i] = if i < degree { neighbours[i] } else { 0 };
            record.errors[i] = if i < degree { errors[i + 1] } else { 0 };
        }
        Some((record, at))
    }
}

/// What replaces a removed vertex in the star of a neighbour, where that star stays inline.
#[derive(Default)]
pub(crate) struct InlineReplacement {
    successors: [u32; INLINE_CAPACITY - 1],
    pub(crate) count: usize,
    /// The errors of the faces before each of them and after the last; 0 beyond the border.
    errors: [u32; INLINE_CAPACITY - 1],
}

impl InlineReplacement {
    #[inline(always)]
    pub(crate) fn push(&mut self, successor: u32, error: u64) {
        self.successors[self.count % (INLINE_CAPACITY - 1)] = successor;
        self.end(error);
        self.count += 1;
    }

    /// Sets the error of the last face. One of more than 32 bits makes the count too large for an
    /// inline star, as too many new neighbours do.
    #[inline(always)]
    pub(crate) fn end(&mut self, error: u64) {
        self.errors[self.count % (INLINE_CAPACITY - 1)] = error as u32;
        self.count += if error > u32::MAX.into() { INLINE_CAPACITY } else { 0 };
    }
}

/// A star of any size.
///
/// Around an inner vertex the face after the last neighbour ends at the first one. On the border
/// the first and the last neighbour are those along the border, and there is no such face.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Star {
    pub(crate) neighbours: Vec<u32>,
    /// The error of the face between each neighbour and the next one; 0 where there is none.
    pub(crate) errors: Vec<u64>,
}

impl Star {
    /// The star after a neighbour is replaced by the neighbours `with`, `errors` being those of the
    /// faces before each of them and after the last; and the index of the replaced one.
    pub(crate) fn without(&self, removed: u32, with: &[u32], between: &[u64]) -> (Self, usize) {
        let Self { neighbours, errors } = self;
        // The vertex is a neighbour of each of its neighbours.
        let at = neighbours.iter().position(|&v| v == removed).unwrap_or_default();
        let errors = match at.checked_sub(1) {
            Some(before) => [&errors[..before], between, &errors[at + 1..]].concat(),
            // The face before the first neighbour is the last.
            None => [&between[1..], &errors[1..errors.len() - 1], &between[..1]].concat(),
        };
        let neighbours = [&neighbours[..at], with, &neighbours[at + 1..]].concat();
        (Self { neighbours, errors }, at)
    }

    /// The star as it is stored, with nothing cached; takes it where it does not fit a record.
    pub(crate) fn pack(&mut self) -> Packed {
        let degree = self.neighbours.len();
        let mut record = Record { degree: degree as u32, ..Record::REMOVED };
        if degree > INLINE_CAPACITY || self.errors.iter().any(|&error| error > u32::MAX.into()) {
            record.degree = SPILLED;
            return Packed { record, spilled: Some(Box::new(std::mem::take(self))) };
        }
        record.neighbours[..degree].copy_from_slice(&self.neighbours);
        for (kept, &error) in record.errors.iter_mut().zip(&self.errors) {
            *kept = error as u32;
        }
        Packed { record, spilled: None }
    }
}

pub(crate) struct Packed {
    pub(crate) record: Record,
    pub(crate) spilled: Option<Box<Star>>,
}

impl Packed {
    #[inline(always)]
    pub(crate) fn degree(&self) -> usize {
        self.spilled.as_ref().map_or(self.record.degree as usize, |star| star.neighbours.len())
    }

    #[inline(always)]
    pub(crate) fn error(&self) -> u64 {
        match &self.spilled {
            Some(star) => star.errors.iter().sum(),
            None => self.record.errors.iter().map(|&error| u64::from(error)).sum(),
        }
    }
}

/// The vertices, numbered along the `tile_order`, in tiles of `1 << digits`.
pub(crate) struct Vertices {
    pub(crate) points: Vec<Point>,
    /// The rank of each vertex among all, by row, then column.
    pub(crate) ranks: Vec<u32>,
    /// The binary digits of a vertex's index within its tile.
    pub(crate) digits: u32,
    pub(crate) right: i32,
    pub(crate) top: i32,
}

pub(crate) struct AllStars {
    pub(crate) vertices: Vertices,
    pub(crate) records: Vec<Record>,
    pub(crate) spilled: Vec<HashMap<u32, Star>>,
}

impl AllStars {
    /// The stars of each group of `tiles` consecutive tiles.
    pub(crate) fn groups(&mut self, tiles: usize) -> impl ExactSizeIterator<Item = Stars<'_>> {
        let Self { vertices, records, spilled } = self;
        let (vertices, size): (&Vertices, _) = (vertices, tiles << vertices.digits);
        let groups = records.chunks_mut(size).zip(spilled.chunks_mut(tiles)).enumerate();
        groups.map(move |(number, (records, spilled))| Stars {
            vertices,
            first: (number * size) as u32,
            records,
            spilled,
        })
    }

    pub(crate) fn whole(&mut self) -> Stars<'_> {
        let Self { vertices, records, spilled } = self;
        Stars { vertices, first: 0, records, spilled }
    }

    pub(crate) fn merge_tiles(&mut self) {
        let spilled = self.spilled.drain(..).flatten().collect();
        self.spilled.push(spilled);
        self.vertices.digits = ONE_TILE;
    }
}

pub(crate) struct Stars<'t> {
    pub(crate) vertices: &'t Vertices,
    first: u32,
    records: &'t mut [Record],
    spilled: &'t mut [HashMap<u32, Star>],
}

impl Stars<'_> {
    /// The index of a vertex's tile among these; for a vertex of another tile larger than all.
    #[inline(always)]
    pub(crate) fn tile_of(&self, vertex: u32) -> usize {
        (vertex.wrapping_sub(self.first) >> self.vertices.digits) as usize
    }

    pub(crate) fn numbers(&self, tile: usize) -> Range<u32> {
        let first = self.first + (tile << self.vertices.digits) as u32;
        let end = self.first + self.records.len() as u32;
        first..end.min(first + (1 << self.vertices.digits))
    }

    #[inline(always)]
    fn index(&self, vertex: u32) -> usize {
        vertex.wrapping_sub(self.first) as usize
    }

    #[inline(always)]
    pub(crate) fn point(&self, vertex: u32) -> Point {
        self.vertices.points[vertex as usize]
    }

    pub(crate) fn is_corner(&self, vertex: u32) -> bool {
        let (Point { x, y }, Vertices { right, top, .. }) = (self.point(vertex), self.vertices);
        (x == 0 || x == *right) && (y == 0 || y == *top)
    }

    pub(crate) fn is_on_border(&self, vertex: u32) -> bool {
        let (Point { x, y }, Vertices { right, top, .. }) = (self.point(vertex), self.vertices);
        x == 0 || x == *right || y == 0 || y == *top
    }

    #[inline(always)]
    pub(crate) fn record(&self, vertex: u32) -> &Record {
        &self.records[self.index(vertex)]
    }

    pub(crate) fn is_removed(&self, vertex: u32) -> bool {
        self.record(vertex).degree == 0
    }

    #[inline]
    pub(crate) fn neighbours(&self, vertex: u32) -> &[u32] {
        let record = self.record(vertex);
        match record.degree {
            SPILLED => &self.spilled[self.tile_of(vertex)][&vertex].neighbours,
            degree => &record.neighbours[..degree as usize],
        }
    }

    pub(crate) fn star(&self, vertex: u32) -> Cow<'_, Star> {
        let record = self.record(vertex);
        match record.degree {
            SPILLED => Cow::Borrowed(&self.spilled[self.tile_of(vertex)][&vertex]),
            degree => Cow::Owned(Star {
                neighbours: record.neighbours[..degree as usize].to_vec(),
                errors: record.errors[..degree as usize].iter().map(|&e| e.into()).collect(),
            }),
        }
    }

    pub(crate) fn packed(&self, vertex: u32) -> Packed {
        let spilled = self.spilled[self.tile_of(vertex)].get(&vertex);
        Packed { record: *self.record(vertex), spilled: spilled.cloned().map(Box::new) }
    }

    /// Reads the records of several vertices of the group at once, so that they come from memory
    /// together instead of one after the other as each is used.
    ///
    /// There is no prefetch instruction without `unsafe`. `black_box` promises nothing of the kind:
    /// where it does not keep the loads, this function does nothing.
    #[inline]
    pub(crate) fn prefetch(&self, vertices: &[u32]) {
        let lines = vertices.iter().map(|&v| {
            let record = self.records.get(self.index(v));
            record.map_or(0, |record| record.degree ^ record.errors[INLINE_CAPACITY - 1])
        });
        black_box(lines.fold(0, |all, line| all ^ line));
    }

    pub(crate) fn set_fill(&mut self, vertex: u32, fill: FillCache) {
        let index = self.index(vertex);
        self.records[index].fill = fill;
    }

    #[inline]
    pub(crate) fn write(&mut self, vertex: u32, Packed { record, spilled }: Packed) {
        let (index, tile) = (self.index(vertex), self.tile_of(vertex));
        let old = std::mem::replace(&mut self.records[index], record);
        if let Some(star) = spilled {
            self.spilled[tile].insert(vertex, *star);
        } else if old.degree == SPILLED {
            self.spilled[tile].remove(&vertex);
        }
    }

    pub(crate) fn remove(&mut self, vertex: u32) {
        self.write(vertex, Packed { record: Record::REMOVED, spilled: None });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_was_cached() {
        let mut cache = FillCache::EMPTY;
        assert_eq!(cache.error([0, 1, 2]), (false, 0));
        let fill = [([0, 2, 4], 5), ([2, 3, 4], 0), ([0, 1, 2], 7)];
        for (slot, (triangle, error)) in fill.into_iter().enumerate() {
            cache.set_triangle(slot, triangle);
            cache.set_error(slot, error.into());
        }
        assert_eq!(cache.error([0, 1, 2]), (true, 7));
        assert_eq!(cache.error([2, 3, 4]), (true, 0));
        assert_eq!(cache.error([1, 3, 4]), (false, 0));
        assert!(cache.all(3).unwrap().eq(fill));
        assert!(cache.all(4).is_none() && cache.all(7).is_none());
        // An error of 33 bits, and a slot that does not exist.
        cache.set_error(1, 1 << 32);
        assert!(!cache.error([2, 3, 4]).0 && cache.all(3).is_none());
        cache.set_triangle(CACHED_TRIANGLES, [6, 7, 8]);
        assert!(!cache.error([6, 7, 8]).0);
    }
}
