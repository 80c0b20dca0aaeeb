//! The vertices of a triangulation as their stars: of each one the neighbours, counter-clockwise,
//! and the errors of the faces between them.
//!
//! Greedy removal asks for the star of a vertex again and again; here it lies in one or two lines of
//! memory. A record has room for nine neighbours; the few vertices with more, or with a face whose
//! error needs more than 32 bits, have theirs in lists.

use crate::removal::fill_cache::{HoleMemory, Shift};
use crate::removal::small_candidate::FewGap;
use crate::triangulation::{NONE, Triangulation, next, previous};
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
    pub(crate) memory: HoleMemory,
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
        memory: HoleMemory::NOTHING,
        degree: 0,
        neighbours: [0; INLINE_CAPACITY],
        errors: [0; INLINE_CAPACITY],
    };

    /// Tells whether the star is in the record itself.
    #[inline(always)]
    pub(crate) fn is_within(&self) -> bool {
        self.degree != SPILLED
    }

    /// The neighbours of a star within.
    #[inline(always)]
    pub(crate) fn neighbours(&self) -> &[u32] {
        &self.neighbours[..INLINE_CAPACITY.min(self.degree as usize)]
    }

    /// The same with 0 for each that is missing.
    #[inline(always)]
    pub(crate) fn all_neighbours(&self) -> &[u32; INLINE_CAPACITY] {
        &self.neighbours
    }

    /// The sum of the errors of all faces of a star within.
    #[inline(always)]
    pub(crate) fn error(&self) -> u64 {
        self.errors.iter().map(|&error| u64::from(error)).sum()
    }

    /// The star, with nothing remembered, when a neighbour that is not at the border gives way to
    /// others, and the place of that neighbour; `None` when either star is not within.
    ///
    /// All parts are copied with room for the largest, the later ones over what is too much.
    #[inline]
    pub(crate) fn without(&self, gone: u32, gap: &FewGap) -> Option<(Self, usize)> {
        let degree = (self.degree as usize).wrapping_sub(1) + gap.count;
        if !self.is_within() || degree > INLINE_CAPACITY {
            return None;
        }
        let places = self.neighbours.iter().enumerate();
        let found = places.fold(0, |found, (i, &v)| found | u32::from(v == gone) << i);
        let place = (found.trailing_zeros() as usize).min(INLINE_CAPACITY - 1);
        let mut neighbours = [0; 4 * INLINE_CAPACITY];
        neighbours[..INLINE_CAPACITY].copy_from_slice(&self.neighbours);
        let mut after = [0; 2 * INLINE_CAPACITY];
        after[..INLINE_CAPACITY].copy_from_slice(&self.neighbours);
        neighbours[place..place + INLINE_CAPACITY - 1].copy_from_slice(&gap.successors);
        neighbours[place + gap.count..][..INLINE_CAPACITY]
            .copy_from_slice(&after[place + 1..][..INLINE_CAPACITY]);
        // The error before each neighbour; before the first one it is that after the last.
        let mut errors = [0; 4 * INLINE_CAPACITY];
        errors[1..=INLINE_CAPACITY].copy_from_slice(&self.errors);
        after[..INLINE_CAPACITY].copy_from_slice(&self.errors);
        errors[place..place + INLINE_CAPACITY - 1].copy_from_slice(&gap.errors);
        errors[place + gap.count + 1..][..INLINE_CAPACITY]
            .copy_from_slice(&after[place + 1..][..INLINE_CAPACITY]);
        errors[degree] = errors[if place == 0 { 0 } else { degree }];
        let mut record = Self { degree: degree as u32, ..Self::REMOVED };
        for i in 0..INLINE_CAPACITY {
            record.neighbours[i] = if i < degree { neighbours[i] } else { 0 };
            record.errors[i] = if i < degree { errors[i + 1] } else { 0 };
        }
        Some((record, place))
    }
}

impl Star {
    /// The sum of the errors of all faces.
    #[inline]
    pub(crate) fn error(&self) -> u64 {
        self.errors.iter().sum()
    }

    /// Becomes a copy of another star.
    fn copy<E: Copy + Into<u64>>(&mut self, neighbours: &[u32], errors: &[E]) {
        self.clear();
        self.neighbours.extend_from_slice(neighbours);
        self.errors.extend(errors.iter().map(|&error| error.into()));
    }

    /// Becomes another star where a neighbour, at `place`, has given way.
    #[inline]
    fn copy_without<E: Copy + Into<u64>>(
        &mut self,
        (neighbours, errors): (&[u32], &[E]),
        place: usize,
        gap: Gap<'_>,
    ) {
        self.clear();
        self.neighbours.extend_from_slice(&neighbours[..place]);
        self.neighbours.extend_from_slice(gap.successors);
        self.neighbours.extend_from_slice(&neighbours[place + 1..]);
        match (place, gap.is_on_border()) {
            (0, true) => {
                self.errors.extend_from_slice(gap.errors);
                self.keep(&errors[1..]);
            }
            (_, true) => {
                self.keep(&errors[..place - 1]);
                self.errors.extend_from_slice(gap.errors);
                self.errors.push(0);
            }
            (0, false) => {
                // The face before the first neighbour comes last.
                self.errors.extend_from_slice(&gap.errors[1..]);
                self.keep(&errors[1..errors.len() - 1]);
                self.errors.push(gap.errors[0]);
            }
            (_, false) => {
                self.keep(&errors[..place - 1]);
                self.errors.extend_from_slice(gap.errors);
                self.keep(&errors[place + 1..]);
            }
        }
    }

    #[inline]
    fn keep<E: Copy + Into<u64>>(&mut self, errors: &[E]) {
        self.errors.extend(errors.iter().map(|&error| error.into()));
    }

    fn clear(&mut self) {
        self.neighbours.clear();
        self.errors.clear();
    }

    /// The star as it is kept.
    pub(crate) fn pack(&self, memory: HoleMemory) -> Packed {
        let degree = self.neighbours.len();
        let mut record = Record { memory, degree: degree as u32, ..Record::REMOVED };
        if degree > INLINE_CAPACITY || self.errors.iter().any(|&error| error > u32::MAX.into()) {
            record.degree = SPILLED;
            return Packed { record, spilled: Some(Box::new(self.clone())) };
        }
        record.neighbours[..degree].copy_from_slice(&self.neighbours);
        for (kept, &error) in record.errors.iter_mut().zip(&self.errors) {
            *kept = error as u32;
        }
        Packed { record, spilled: None }
    }
}

/// What stands in a star in the place of a neighbour that is gone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gap<'a> {
    /// The new neighbours, counter-clockwise.
    pub(crate) successors: &'a [u32],
    /// The errors of the faces between them and the neighbours before and after: one more than
    /// successors, but as many where a side of the gap lies on the border.
    pub(crate) errors: &'a [u64],
}

impl Gap<'_> {
    fn is_on_border(&self) -> bool {
        self.errors.len() == self.successors.len()
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
                block.push(star.pack(HoleMemory::NOTHING));
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

    /// What is remembered of the hole of a vertex.
    #[inline]
    pub(crate) fn memory(&self, vertex: u32) -> &HoleMemory {
        &self.record(vertex).memory
    }

    /// Remembers a hole.
    pub(crate) fn remember(&mut self, vertex: u32, memory: HoleMemory) {
        let index = self.index(vertex);
        self.records[index].memory = memory;
    }

    /// Copies the star of a vertex to `star`.
    pub(crate) fn read(&self, vertex: u32, star: &mut Star) {
        let record = self.record(vertex);
        match record.degree {
            SPILLED => star.clone_from(&self.spilled[&vertex]),
            degree => {
                let degree = degree as usize;
                star.copy(&record.neighbours[..degree], &record.errors[..degree]);
            }
        }
    }

    /// Copies to `star` the star that a vertex will have without one of its neighbours, and returns
    /// how the places of the others shift.
    #[inline]
    pub(crate) fn read_without(
        &self,
        vertex: u32,
        gone: u32,
        gap: Gap<'_>,
        star: &mut Star,
    ) -> Shift {
        let record = self.record(vertex);
        let place = |neighbours: &[u32]| {
            // Whoever has the vertex as a neighbour is one of its neighbours.
            neighbours.iter().position(|&v| v == gone).unwrap_or_default()
        };
        let place = match record.degree {
            SPILLED => {
                let Star { neighbours, errors } = &self.spilled[&vertex];
                let place = place(neighbours);
                star.copy_without((neighbours, errors), place, gap);
                place
            }
            degree => {
                let degree = degree as usize;
                let place = place(&record.neighbours[..degree]);
                let old = (&record.neighbours[..degree], &record.errors[..degree]);
                star.copy_without(old, place, gap);
                place
            }
        };
        Shift { place: place as u32, successors: gap.successors.len() as u32 }
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
