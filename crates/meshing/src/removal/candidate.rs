//! What the removal of a vertex would change, found without touching the mesh.
//!
//! A removal fills the vertex's hole, which gives every neighbour a new star and a new key; nothing
//! else changes.
//!
//! Nearly all stars are inline. Their holes are filled in arrays of fixed size, with few branches
//! that depend on the data: a misprediction costs about 40 instructions. The [`FillCache`] has the
//! errors of most triangles. The other new faces around a vertex are measured together.

use crate::control::{Cancelled, Poller};
use crate::face_error::{ErrorEvaluator, FaceErrors, FaceMeasure};
use crate::image::Point;
use crate::removal::star::{CACHED_TRIANGLES, FillCache, InlineReplacement, Packed, Stars};
use crate::triangulation::hole::{CAPACITY, HoleFiller, fill_small};

/// The most neighbours of a vertex whose whole fill is cached, a power of two.
const MOST_CACHED: usize = CACHED_TRIANGLES + 2;

pub(crate) struct Neighbour {
    pub(crate) vertex: u32,
    pub(crate) star: Packed,
    /// By how much its own removal would change the error; `None` for a corner of the image.
    pub(crate) change: Option<i64>,
}

pub(crate) struct Evaluator<'m> {
    errors: FaceErrors<'m>,
    pub(crate) poller: Poller<'m>,
    batch: Batch,
    filler: HoleFiller,
    /// The directed edges of a fill that is not cached as a whole, by indices of the boundary, in
    /// ascending order, with the third vertex and the error of the triangle to the left.
    edges: Vec<([usize; 2], (usize, u64))>,
    /// What replaces a vertex in a star that is not inline.
    successors: Vec<u32>,
    between: Vec<u64>,
}

impl<'m> Evaluator<'m> {
    pub(crate) fn new(measure: &'m ErrorEvaluator<'m>, poller: Poller<'m>) -> Self {
        Self {
            errors: FaceErrors::new(measure),
            poller,
            batch: Batch::default(),
            filler: HoleFiller::default(),
            edges: Vec::new(),
            successors: Vec::new(),
            between: Vec::new(),
        }
    }

    /// By how much the error changes when a vertex is removed, and the cache of its fill.
    pub(crate) fn evaluate(
        &mut self,
        vertex: u32,
        stars: &Stars<'_>,
    ) -> Result<(i64, FillCache), Cancelled> {
        let mut star = stars.packed(vertex);
        let cache = star.record.fill;
        self.batch.clear();
        self.batch.add(&mut star, &cache, Shift::NONE, stars, &mut self.filler);
        self.batch.measure(&mut self.errors, &mut self.poller)?;
        Ok((Batch::finish(&mut star, &mut self.batch.errors.iter()), star.record.fill))
    }

    pub(crate) fn prepare(
        &mut self,
        vertex: u32,
        stars: &Stars<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) -> Result<(), Cancelled> {
        let hole = stars.neighbours(vertex);
        stars.prefetch(hole);
        self.batch.clear();
        neighbours.clear();
        let triangle_count = hole.len() - 2;
        if let Some(fill) = stars.record(vertex).fill.all(triangle_count) {
            let mut thirds = [(0, 0); MOST_CACHED * MOST_CACHED];
            for ([a, b, c], error) in fill {
                for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
                    let edge = usize::from(from) * MOST_CACHED + usize::from(to);
                    thirds[edge % (MOST_CACHED * MOST_CACHED)] = (usize::from(third), error);
                }
            }
            let third = |from: usize, to: usize| {
                let (third, error) = thirds[(from * MOST_CACHED + to) % thirds.len()];
                (third, error.into())
            };
            self.replace(vertex, hole, third, stars, neighbours);
        } else {
            self.list_edges(vertex, stars)?;
            let edges = std::mem::take(&mut self.edges);
            let third = |from: usize, to: usize| {
                edges[edges.partition_point(|(ends, _)| *ends < [from, to])].1
            };
            self.replace(vertex, hole, third, stars, neighbours);
            self.edges = edges;
        }
        self.batch.measure(&mut self.errors, &mut self.poller)?;
        let mut errors = self.batch.errors.iter();
        for Neighbour { star, change, .. } in neighbours {
            if let Some(change) = change {
                *change = Batch::finish(star, &mut errors);
            }
        }
        Ok(())
    }

    /// Gives all neighbours of a vertex, the boundary of its hole, their new stars; `third` returns
    /// the triangle to the left of an edge of the fill. Holes of the neighbours join the batch.
    #[inline]
    fn replace(
        &mut self,
        vertex: u32,
        hole: &[u32],
        third: impl Fn(usize, usize) -> (usize, u64),
        stars: &Stars<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) {
        let is_open = stars.is_on_border(vertex);
        for (i, &neighbour) in hole.iter().enumerate() {
            let mut replacement = InlineReplacement::default();
            let add = |third: usize, error| replacement.push(hole[third], error);
            let last = walk_fan(i, hole.len(), is_open, &third, add);
            replacement.end(last);
            let old = stars.record(neighbour);
            let (mut star, shift) = match old.without(vertex, &replacement) {
                Some((record, at)) => {
                    (Packed { record, spilled: None }, Shift::new(at, replacement.count))
                }
                None => {
                    let Self { successors, between, .. } = self;
                    successors.clear();
                    between.clear();
                    let last = walk_fan(i, hole.len(), is_open, &third, |third, error| {
                        successors.push(hole[third]);
                        between.push(error);
                    });
                    between.push(last);
                    let (mut star, at) = stars.star(neighbour).without(vertex, successors, between);
                    (star.pack(), Shift::new(at, successors.len()))
                }
            };
            let is_removable = !stars.is_corner(neighbour);
            if is_removable {
                self.batch.add(&mut star, &old.fill, shift, stars, &mut self.filler);
            }
            let change = is_removable.then_some(0);
            neighbours.push(Neighbour { vertex: neighbour, star, change });
        }
    }

    fn list_edges(&mut self, vertex: u32, stars: &Stars<'_>) -> Result<(), Cancelled> {
        let boundary: Vec<Point> =
            stars.neighbours(vertex).iter().map(|&v| stars.point(v)).collect();
        let cache = &stars.record(vertex).fill;
        self.edges.clear();
        for triangle in self.filler.fill(&boundary) {
            let corners = triangle.map(|at| at as usize);
            let (is_cached, error) = cached_error(cache, Shift::NONE, corners);
            let error = match is_cached {
                true => error.into(),
                false => self.errors.error(corners.map(|at| boundary[at]), &mut self.poller)?,
            };
            let [a, b, c] = corners;
            let sides = [([a, b], c), ([b, c], a), ([c, a], b)];
            self.edges.extend(sides.map(|(ends, third)| (ends, (third, error))));
        }
        self.edges.sort_unstable();
        Ok(())
    }
}

/// Walks through the triangles of a fill at one vertex of the boundary, counter-clockwise from the
/// next vertex to the one before. Calls `add` with each new neighbour and the error of the face
/// before it; returns that of the face after the last. An open hole is on the border of the image:
/// its first and last vertex become neighbours, and 0 stands for the face beyond their edge.
#[inline(always)]
fn walk_fan(
    at: usize,
    boundary_len: usize,
    is_open: bool,
    third: impl Fn(usize, usize) -> (usize, u64),
    mut add: impl FnMut(usize, u64),
) -> u64 {
    let last = boundary_len - 1;
    let end = if at == 0 { last } else { at - 1 };
    let mut next = if at == last { 0 } else { at + 1 };
    if is_open && at == last {
        add(0, 0);
    }
    loop {
        let (third, error) = third(at, next);
        next = third;
        if next == end && !(is_open && at == 0) {
            return error;
        }
        add(next, error);
        if next == end {
            return 0;
        }
    }
}

/// How the indices of a star's neighbours have shifted since its hole was last evaluated: the
/// neighbour at `at` was replaced by those before `end`. Only the first 255 indices are followed.
#[derive(Clone, Copy)]
struct Shift {
    at: u8,
    end: u8,
    /// How many more indices there are.
    growth: u8,
}

impl Shift {
    /// Stands for an index that the cache does not hold, as that of a new neighbour.
    const NEW: u8 = u8::MAX;

    const NONE: Self = Self { at: Self::NEW, end: Self::NEW, growth: 0 };

    #[inline]
    fn new(at: usize, count: usize) -> Self {
        let byte = |index: usize| index.min(Self::NEW.into()) as u8;
        Self { at: byte(at), end: byte(at + count), growth: (count as u8).wrapping_sub(1) }
    }

    #[inline(always)]
    fn former(self, index: u8) -> u8 {
        let moved = index.wrapping_sub(self.growth);
        let after = if index < self.end { Self::NEW } else { moved };
        if index < self.at { index } else { after }
    }

    /// The same for the first indices, so that one vector holds all.
    #[inline]
    fn table(self) -> [u8; CAPACITY] {
        std::array::from_fn(|index| self.former(index as u8))
    }
}

/// Whether the error of a triangle of a fill of any size is cached, and the error, or 0.
fn cached_error(cache: &FillCache, shift: Shift, triangle: [usize; 3]) -> (bool, u32) {
    // The last index is the largest.
    let is_followed = triangle[2] < Shift::NEW.into();
    if is_followed { cache.error(triangle.map(|at| shift.former(at as u8))) } else { (false, 0) }
}

#[derive(Default)]
struct Batch {
    /// The error of each triangle, hole after hole; 0 until it is measured.
    errors: Vec<u64>,
    /// The triangles whose errors are not cached, and the index of each one's error.
    faces: Vec<[Point; 3]>,
    indices: Vec<u32>,
    face_errors: Vec<u64>,
}

impl Batch {
    fn clear(&mut self) {
        self.errors.clear();
        self.faces.clear();
        self.indices.clear();
    }

    /// Fills the hole of a star, by the cache and the indices of the star before.
    #[inline]
    fn add(
        &mut self,
        star: &mut Packed,
        cache: &FillCache,
        shift: Shift,
        stars: &Stars<'_>,
        filler: &mut HoleFiller,
    ) {
        let count = star.degree() - 2;
        let mut fill = FillCache::EMPTY;
        if let Some(spilled) = &star.spilled {
            let boundary: Vec<Point> = spilled.neighbours.iter().map(|&v| stars.point(v)).collect();
            for (i, triangle) in filler.fill(&boundary).iter().enumerate() {
                let corners = triangle.map(|at| at as usize);
                if corners[2] < Shift::NEW.into() {
                    fill.set_triangle(i, corners.map(|at| at as u8));
                }
                let cached = cached_error(cache, shift, corners);
                self.push(corners.map(|at| boundary[at]), cached);
            }
        } else {
            let mut boundary = [Point::new(0, 0); CAPACITY];
            for (point, &vertex) in boundary.iter_mut().zip(&star.record.neighbours) {
                *point = stars.point(vertex);
            }
            let former = shift.table();
            for (i, triangle) in fill_small(&boundary, count + 2)[..count].iter().enumerate() {
                fill.set_triangle(i, *triangle);
                let corners = triangle.map(|at| usize::from(at) % CAPACITY);
                let cached = cache.error(corners.map(|at| former[at]));
                self.push(corners.map(|at| boundary[at]), cached);
            }
        }
        star.record.fill = fill;
    }

    #[inline(always)]
    fn push(&mut self, face: [Point; 3], (is_cached, error): (bool, u32)) {
        // Written in any case, kept if it is to be measured: without a branch.
        let count = self.faces.len();
        self.faces.push(face);
        self.indices.push(self.errors.len() as u32);
        self.faces.truncate(count + usize::from(!is_cached));
        self.indices.truncate(count + usize::from(!is_cached));
        self.errors.push(error.into());
    }

    fn measure(
        &mut self,
        errors: &mut FaceErrors<'_>,
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        errors.errors_below(&self.faces, u64::MAX, &mut self.face_errors, poller)?;
        for (&index, &error) in self.indices.iter().zip(&self.face_errors) {
            self.errors[index as usize] = error;
        }
        Ok(())
    }

    /// Caches the errors of a star's hole; returns by how much filling it changes the error.
    #[inline]
    fn finish<'e>(star: &mut Packed, errors: &mut impl Iterator<Item = &'e u64>) -> i64 {
        let mut sum = 0;
        for (i, &error) in errors.take(star.degree() - 2).enumerate() {
            star.record.fill.set_error(i, error);
            sum += error;
        }
        sum as i64 - star.error() as i64
    }
}
