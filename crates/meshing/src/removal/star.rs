//! The vertices of a triangulation as their stars: of each one the neighbours, counter-clockwise,
//! and the errors of the faces between them.
//!
//! Greedy removal asks for the star of a vertex again and again; here it lies in one or two lines of
//! memory. A record has room for nine neighbours; the few vertices with more, or with a face whose
//! error needs more than 32 bits, have theirs in lists.

use crate::removal::fill_cache::FillCache;
use crate::triangulation::{NONE, Triangulation, next, previous};
use std::borrow::Cow;
use std::collections::HashMap;
use std::hint::black_box;
use std::ops::Range;

/// Neighbours that a record has room for; six in a thousand vertices have more.
pub(crate) const INLINE_CAPACITY: usize = 9;

/// Degree of a vertex whose star is in lists; the first neighbour is the number of these.
const SPILLED: u32 = u32::MAX;

/// The star of one vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub(crate) struct Record {
    pub(crate) fill: FillCache,
    /// Number of neighbours, 0 for a vertex that is gone.
    degree: u32,
    neighbours: [u32; INLINE_CAPACITY],
    /// The error of the face between each neighbour and the next one.
    errors: [u32; INLINE_CAPACITY],
}

/// A star of any size.
///
/// Around an inner vertex the face after the last neighbour ends at the first one. On the border
/// the first and the last neighbour are those along the border, and there is no such face.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Star {
    /// The neighbours, counter-clockwise.
    pub(crate) neighbours: Vec<u32>,
    /// The error of the face between each neighbour and the next one; 0 where there is none.
    pub(crate) errors: Vec<u64>,
}

/// A star with what is remembered of its hole, ready to be written.
pub(crate) struct Packed {
    pub(crate) record: Record,
    /// The star itself, where it does not fit.
    pub(crate) spilled: Option<Box<Star>>,
}

/// The stars of vertices whose numbers follow each other.
pub(crate) struct StarBlock {
    /// The number of the first of them.
    first: u32,
    records: Vec<Record>,
    /// The stars that do not fit their records.
    spilled: HashMap<u32, Star>,
}

impl Record {
    const REMOVED: Self = Self {
        fill: FillCache::EMPTY,
        degree: 0,
        neighbours: [0; INLINE_CAPACITY],
        errors: [0; INLINE_CAPACITY],
    };

    /// Whether the star is in the record itself.
    #[inline(always)]
    pub(crate) fn is_inline(&self) -> bool {
        self.degree != SPILLED
    }

    /// The neighbours of an inline star.
    #[inline(always)]
    pub(crate) fn neighbours(&self) -> &[u32] {
        &self.neighbours[..INLINE_CAPACITY.min(self.degree as usize)]
    }

    /// The same with 0 for each that is missing.
    #[inline(always)]
    pub(crate) fn all_neighbours(&self) -> &[u32; INLINE_CAPACITY] {
        &self.neighbours
    }

    /// The sum of the errors of all faces of an inline star.
    #[inline(always)]
    pub(crate) fn error(&self) -> u64 {
        self.errors.iter().map(|&error| u64::from(error)).sum()
    }

    /// The star, with nothing cached, after a neighbour is replaced, and the index of that
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
        if !self.is_inline() || degree > INLINE_CAPACITY {
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

/// What replaces a removed vertex in the star of a neighbour.
#[derive(Default)]
pub(crate) struct Replacement {
    /// The new neighbours, counter-clockwise.
    pub(crate) successors: Vec<u32>,
    /// The errors of the faces before each of them and after the last; 0 beyond the border.
    pub(crate) errors: Vec<u64>,
}

/// The same in arrays, for a vertex of at most eight neighbours.
#[derive(Default)]
pub(crate) struct InlineReplacement {
    successors: [u32; INLINE_CAPACITY - 1],
    pub(crate) count: usize,
    errors: [u32; INLINE_CAPACITY - 1],
}

impl InlineReplacement {
    /// Adds a new neighbour and the error of the face before it.
    #[inline(always)]
    pub(crate) fn push(&mut self, successor: u32, error: u32) {
        self.successors[self.count % (INLINE_CAPACITY - 1)] = successor;
        self.end(error);
        self.count += 1;
    }

    /// Sets the error of the last face.
    #[inline(always)]
    pub(crate) fn end(&mut self, error: u32) {
        debug_assert!(self.count < INLINE_CAPACITY - 1);
        self.errors[self.count % (INLINE_CAPACITY - 1)] = error;
    }
}

impl Replacement {
    /// Becomes a copy.
    pub(crate) fn copy_from(&mut self, inline: &InlineReplacement) {
        self.successors.clear();
        self.successors.extend_from_slice(&inline.successors[..inline.count]);
        self.errors.clear();
        self.errors.extend(inline.errors[..=inline.count].iter().map(|&error| u64::from(error)));
    }
}

impl Star {
    /// The sum of the errors of all faces.
    #[inline]
    pub(crate) fn error(&self) -> u64 {
        self.errors.iter().sum()
    }

    /// The star after a neighbour is replaced, and the index of that neighbour.
    pub(crate) fn without(&self, removed: u32, replacement: &Replacement) -> (Self, usize) {
        let Replacement { successors, errors: between } = replacement;
        let Self { neighbours, errors } = self;
        // The vertex is a neighbour of each of its neighbours.
        let at = neighbours.iter().position(|&v| v == removed).unwrap_or_default();
        let errors = match at.checked_sub(1) {
            Some(before) => [&errors[..before], between, &errors[at + 1..]].concat(),
            // The face before the first neighbour is the last.
            None => [&between[1..], &errors[1..errors.len() - 1], &between[..1]].concat(),
        };
        let neighbours = [&neighbours[..at], successors, &neighbours[at + 1..]].concat();
        (Self { neighbours, errors }, at)
    }

    fn clear(&mut self) {
        self.neighbours.clear();
        self.errors.clear();
    }

    /// The star as it is kept, with nothing cached; may take it.
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

impl StarBlock {
    /// An empty block with space for the stars of this many vertices from the first one on.
    pub(crate) fn with_capacity(first: u32, count: usize) -> Self {
        Self { first, records: Vec::with_capacity(count), spilled: HashMap::new() }
    }

    /// The stars of a triangulation's vertices, in blocks of `1 << digits`, with the errors of its
    /// triangles; vertex `v` here is the triangulation's vertex `ranks[v]`.
    pub(crate) fn of_triangulation(
        triangulation: &Triangulation,
        ranks: &[u32],
        errors: &[u64],
        digits: u32,
    ) -> Vec<Self> {
        let Triangulation { origins, twins, .. } = triangulation;
        let mut numbers = vec![0; ranks.len()];
        for (number, &rank) in (0..).zip(ranks) {
            numbers[rank as usize] = number;
        }
        let outgoing = outgoing_half_edges(triangulation);
        let mut blocks = Vec::new();
        let mut star = Star::default();
        for ranks in ranks.chunks(1 << digits) {
            let mut block = Self::with_capacity((blocks.len() << digits) as u32, ranks.len());
            for &rank in ranks {
                star.clear();
                let first = outgoing[rank as usize];
                let mut spoke = first;
                loop {
                    star.neighbours.push(numbers[origins[next(spoke) as usize] as usize]);
                    star.errors.push(errors[spoke as usize / 3]);
                    let incoming = previous(spoke);
                    spoke = twins[incoming as usize];
                    if spoke == NONE {
                        star.neighbours.push(numbers[origins[incoming as usize] as usize]);
                        star.errors.push(0);
                    }
                    if spoke == NONE || spoke == first {
                        break;
                    }
                }
                block.push(star.pack());
            }
            blocks.push(block);
        }
        blocks
    }

    /// Adds the star of the next vertex.
    fn push(&mut self, Packed { record, spilled }: Packed) {
        let vertex = self.numbers().end;
        self.spilled.extend(spilled.map(|star| (vertex, *star)));
        self.records.push(record);
    }

    /// Adds the stars of a block whose vertices follow.
    pub(crate) fn append(&mut self, mut other: Self) {
        self.records.append(&mut other.records);
        self.spilled.extend(other.spilled);
    }

    /// The numbers of the vertices.
    pub(crate) fn numbers(&self) -> Range<u32> {
        self.first..self.first + self.records.len() as u32
    }

    /// The index of a vertex's record.
    #[inline(always)]
    fn index(&self, vertex: u32) -> usize {
        vertex.wrapping_sub(self.first) as usize
    }

    /// Reads the records of several vertices at once, so that they come from memory together instead
    /// of one after the other as each is used; leaves out vertices of other blocks.
    ///
    /// There is no prefetch instruction without `unsafe`. `black_box` does not promise to keep a
    /// load; where it does not, this function does nothing.
    #[inline]
    pub(crate) fn prefetch(&self, vertices: &[u32]) {
        let lines = vertices.iter().map(|&v| {
            let record = self.records.get(self.index(v));
            record.map_or(0, |record| record.degree ^ record.errors[INLINE_CAPACITY - 1])
        });
        black_box(lines.fold(0, |all, line| all ^ line));
    }

    /// The record of a vertex.
    #[inline(always)]
    pub(crate) fn record(&self, vertex: u32) -> &Record {
        &self.records[self.index(vertex)]
    }

    /// Whether a vertex is removed.
    pub(crate) fn is_removed(&self, vertex: u32) -> bool {
        self.record(vertex).degree == 0
    }

    /// The neighbours of a vertex, counter-clockwise.
    #[inline]
    pub(crate) fn neighbours(&self, vertex: u32) -> &[u32] {
        let record = self.record(vertex);
        match record.degree {
            SPILLED => &self.spilled[&vertex].neighbours,
            degree => &record.neighbours[..degree as usize],
        }
    }

    /// Replaces what is cached of the hole of a vertex.
    pub(crate) fn set_fill(&mut self, vertex: u32, fill: FillCache) {
        let index = self.index(vertex);
        self.records[index].fill = fill;
    }

    /// The star of a vertex, in lists.
    pub(crate) fn star(&self, vertex: u32) -> Cow<'_, Star> {
        let record = self.record(vertex);
        match record.degree {
            SPILLED => Cow::Borrowed(&self.spilled[&vertex]),
            degree => Cow::Owned(Star {
                neighbours: record.neighbours().to_vec(),
                errors: record.errors[..degree as usize].iter().map(|&e| e.into()).collect(),
            }),
        }
    }

    /// Replaces the star of a vertex.
    #[inline]
    pub(crate) fn write(&mut self, vertex: u32, Packed { record, spilled }: Packed) {
        let index = self.index(vertex);
        let old = std::mem::replace(&mut self.records[index], record);
        if let Some(star) = spilled {
            self.spilled.insert(vertex, *star);
        } else if old.degree == SPILLED {
            self.spilled.remove(&vertex);
        }
    }

    /// Forgets a vertex that is removed.
    pub(crate) fn remove(&mut self, vertex: u32) {
        self.write(vertex, Packed { record: Record::REMOVED, spilled: None });
    }
}

/// A half-edge that begins at each vertex; on the border the one with no twin, from which turning
/// counter-clockwise meets every triangle.
fn outgoing_half_edges(triangulation: &Triangulation) -> Vec<u32> {
    let mut outgoing = vec![NONE; triangulation.points.len()];
    let half_edges = triangulation.origins.iter().zip(&triangulation.twins);
    for (h, (&origin, &twin)) in half_edges.enumerate() {
        let out = &mut outgoing[origin as usize];
        if *out == NONE || twin == NONE {
            *out = h as u32;
        }
    }
    outgoing
}
