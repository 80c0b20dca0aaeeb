//! What the removal of a vertex would change, found without touching the mesh.
//!
//! A removal fills the vertex's hole, which gives every neighbour a new star and a new key; nothing
//! else changes.
//!
//! Nearly all stars are inline in their records. Their holes are filled in arrays of fixed size, with
//! few branches that depend on the data (a misprediction costs about 40 instructions), errors of
//! triangles are taken from the [`FillCache`], and the new faces around all neighbours of a vertex
//! are measured together. Spilled stars, and holes whose fill is not cached as a whole, take lists
//! and measure all their faces. The lists are the specification of the arrays: the test
//! `arrays_and_lists_agree` compares them.

use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::Point;
use crate::removal::fill_cache::{CACHED_TRIANGLES, FillCache};
use crate::removal::star::{InlineReplacement, Packed, Record, Replacement, Star};
use crate::removal::vertices::MeshView;
use crate::triangulation::hole::{CAPACITY, HoleFiller, MOST_TRIANGLES, fill_small};

/// The most neighbours of a vertex whose whole fill is cached.
const MOST_CACHED: usize = CACHED_TRIANGLES + 2;

/// The most triangles of the holes of that many neighbours.
const BATCH: usize = MOST_CACHED * MOST_TRIANGLES;

/// The state of a neighbour after a removal.
pub(crate) struct Neighbour {
    pub(crate) vertex: u32,
    pub(crate) star: Packed,
    /// By how much its own removal would change the error; `None` for a corner of the image, which
    /// is never removed.
    pub(crate) change: Option<i64>,
}

/// Evaluates removals; keeps its memory from one to the next.
pub(crate) struct Evaluator<'m> {
    errors: FaceErrors<'m>,
    batch: Batch,
    filler: HoleFiller,
    boundary: Vec<Point>,
    /// The triangles of the last fill that are not cached.
    unknown: Vec<usize>,
    faces: Vec<[Point; 3]>,
    face_errors: Vec<u64>,
    /// The error of each triangle of the last fill.
    errors_of_fill: Vec<u64>,
    /// The star of the vertex to remove, and its fill as seen from each neighbour.
    hole: Star,
    wedges: Vec<Wedge>,
    replacement: Replacement,
}

/// A triangle of a fill, as seen from one of its vertices; wedges sort counter-clockwise around the
/// first vertex of the boundary, then the second and so on.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Wedge {
    /// The index of that vertex on the boundary.
    at: usize,
    /// How many vertices of the boundary after it the next vertex of the triangle comes.
    offset: usize,
    /// The index of the third vertex.
    end: usize,
    error: u64,
}

impl<'m> Evaluator<'m> {
    pub(crate) fn new(measure: &'m ErrorEvaluator<'m>) -> Self {
        Self {
            errors: FaceErrors::new(measure),
            batch: Batch::default(),
            filler: HoleFiller::default(),
            boundary: Vec::new(),
            unknown: Vec::new(),
            faces: Vec::new(),
            face_errors: Vec::new(),
            errors_of_fill: Vec::new(),
            hole: Star::default(),
            wedges: Vec::new(),
            replacement: Replacement::default(),
        }
    }

    /// By how much the error changes when a vertex is removed, and the cache of its fill.
    pub(crate) fn evaluate(&mut self, vertex: u32, view: &MeshView<'_>) -> (i64, FillCache) {
        let stars = view.stars(vertex);
        let mut record = *stars.record(vertex);
        if record.is_inline() {
            let cache = record.fill;
            self.batch.face_count = 0;
            self.batch.add(0, &mut record, &cache, Former::SAME, view);
            self.batch.measure(&mut self.errors);
            (self.batch.finish(0, &mut record), record.fill)
        } else {
            self.fill_star(&stars.star(vertex), &record.fill, Former::SAME, view)
        }
    }

    /// The states of all neighbours after the removal of a vertex.
    pub(crate) fn prepare(
        &mut self,
        vertex: u32,
        view: &MeshView<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) {
        neighbours.clear();
        let stars = view.stars(vertex);
        stars.prefetch(stars.neighbours(vertex));
        match Fans::of_cached_fill(stars.record(vertex), view.is_on_border(vertex)) {
            Some(fans) => self.prepare_inline(vertex, &fans, view, neighbours),
            None => self.prepare_list(vertex, view, neighbours),
        }
    }

    /// The states of all neighbours of a vertex whose fill is cached.
    #[inline]
    fn prepare_inline(
        &mut self,
        vertex: u32,
        fans: &Fans<'_>,
        view: &MeshView<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) {
        self.batch.face_count = 0;
        for (i, &neighbour) in fans.hole.neighbours().iter().enumerate() {
            let replacement = fans.replacement(i);
            let old = view.stars(neighbour).record(neighbour);
            let (star, at) = match old.without(vertex, &replacement) {
                Some((record, at)) => (Packed { record, spilled: None }, at),
                None => {
                    self.replacement.copy_from(&replacement);
                    self.star_from_list(neighbour, vertex, view)
                }
            };
            let former = Former { at, count: replacement.count };
            neighbours.push(self.begin(i, neighbour, star, former, view));
        }
        self.batch.measure(&mut self.errors);
        for (i, neighbour) in neighbours.iter_mut().enumerate() {
            self.finish(i, neighbour);
        }
    }

    /// The states of all neighbours of any vertex.
    fn prepare_list(&mut self, vertex: u32, view: &MeshView<'_>, neighbours: &mut Vec<Neighbour>) {
        let star = view.stars(vertex).star(vertex);
        self.fill_star(&star, &view.stars(vertex).record(vertex).fill, Former::SAME, view);
        self.collect_wedges(star.neighbours.len());
        self.hole = star.into_owned();
        let is_open = view.is_on_border(vertex);
        let mut first = 0;
        for at in 0..self.hole.neighbours.len() {
            first = self.collect_replacement(at, first, is_open);
            let neighbour = self.hole.neighbours[at];
            let (star, at) = self.star_from_list(neighbour, vertex, view);
            let former = Former { at, count: self.replacement.successors.len() };
            self.batch.face_count = 0;
            let mut neighbour = self.begin(0, neighbour, star, former, view);
            self.batch.measure(&mut self.errors);
            self.finish(0, &mut neighbour);
            neighbours.push(neighbour);
        }
    }

    /// The star of a neighbour after the removal of `removed`, with the replacement collected, and
    /// the index of the removed vertex before.
    fn star_from_list(&self, vertex: u32, removed: u32, view: &MeshView<'_>) -> (Packed, usize) {
        let (mut star, at) = view.stars(vertex).star(vertex).without(removed, &self.replacement);
        (star.pack(), at)
    }

    /// The state of a neighbour with a new star: the hole of an inline star joins the batch under a
    /// number, and its change is not known yet.
    #[inline]
    fn begin(
        &mut self,
        number: usize,
        vertex: u32,
        mut star: Packed,
        former: Former,
        view: &MeshView<'_>,
    ) -> Neighbour {
        let cache = &view.stars(vertex).record(vertex).fill;
        let change = match &star.spilled {
            _ if view.is_corner(vertex) => None,
            Some(spilled) => {
                let (change, fill) = self.fill_star(spilled, cache, former, view);
                star.record.fill = fill;
                Some(change)
            }
            None => {
                self.batch.add(number, &mut star.record, cache, former, view);
                Some(0)
            }
        };
        Neighbour { vertex, star, change }
    }

    /// Finds the change of a neighbour whose hole has a number in the batch, which is measured.
    #[inline]
    fn finish(&self, number: usize, neighbour: &mut Neighbour) {
        if let (Some(change), None) = (&mut neighbour.change, &neighbour.star.spilled) {
            *change = self.batch.finish(number, &mut neighbour.star.record);
        }
    }

    /// The change of error of any star, and the cache of its fill, by the cache of the star before.
    /// Leaves the triangles in `filler` and their errors in `errors_of_fill`.
    fn fill_star(
        &mut self,
        star: &Star,
        cache: &FillCache,
        former: Former,
        view: &MeshView<'_>,
    ) -> (i64, FillCache) {
        self.boundary.clear();
        self.boundary.extend(star.neighbours.iter().map(|&v| view.point(v)));
        self.unknown.clear();
        self.faces.clear();
        self.errors_of_fill.clear();
        let (mut fill, mut sum) = (FillCache::EMPTY, 0);
        for (i, &triangle) in self.filler.fill(&self.boundary).iter().enumerate() {
            let (is_cached, error) = cache.error(triangle.map(|at| former.of(at as usize)));
            if !is_cached {
                self.unknown.push(i);
                self.faces.push(triangle.map(|at| self.boundary[at as usize]));
            }
            self.errors_of_fill.push(error.into());
        }
        self.errors.errors(&self.faces, &mut self.face_errors);
        for (&i, &error) in self.unknown.iter().zip(&self.face_errors) {
            self.errors_of_fill[i] = error;
        }
        for (i, (triangle, &error)) in
            self.filler.triangles().iter().zip(&self.errors_of_fill).enumerate()
        {
            let indices = triangle.map(|at| Former::SAME.of(at as usize));
            // The last index is the largest.
            if indices[2] != Former::NEW {
                fill.set_triangle(i, indices);
                fill.set_error(i, error);
            }
            sum += error;
        }
        (sum as i64 - star.error() as i64, fill)
    }

    /// The last fill, of a hole of `degree` vertices, as seen from each of them.
    fn collect_wedges(&mut self, degree: usize) {
        self.wedges.clear();
        for (triangle, &error) in self.filler.triangles().iter().zip(&self.errors_of_fill) {
            let [a, b, c] = triangle.map(|at| at as usize);
            for (at, next, end) in [(a, b, c), (b, c, a), (c, a, b)] {
                let offset = if next > at { next - at } else { next + degree - at };
                self.wedges.push(Wedge { at, offset, end, error });
            }
        }
        self.wedges.sort_unstable();
    }

    /// Collects what replaces the vertex in the star of its neighbour at an index: the ends of that
    /// one's wedges, which begin at `first`, but the last; along the border that one too, or the
    /// start of the first. Returns where the wedges of the next neighbour begin.
    fn collect_replacement(&mut self, at: usize, first: usize, is_open: bool) -> usize {
        let Replacement { successors, errors } = &mut self.replacement;
        successors.clear();
        errors.clear();
        if is_open && at + 1 == self.hole.neighbours.len() {
            successors.push(self.hole.neighbours[0]);
            errors.push(0);
        }
        let own = self.wedges[first..].iter().take_while(|wedge| wedge.at == at);
        let mut count = 0;
        for wedge in own {
            successors.push(self.hole.neighbours[wedge.end]);
            errors.push(wedge.error);
            count += 1;
        }
        if is_open && at == 0 {
            errors.push(0);
        } else {
            successors.pop();
        }
        first + count
    }
}

/// How the indices of a star's neighbours have shifted since its hole was last evaluated: the
/// neighbour at `at` was replaced by `count` others.
#[derive(Clone, Copy)]
struct Former {
    at: usize,
    count: usize,
}

impl Former {
    /// Stands for an index that the cache does not hold, as that of a new neighbour.
    const NEW: u8 = u8::MAX;

    /// No neighbour was replaced.
    const SAME: Self = Self { at: usize::MAX, count: 1 };

    /// The index that a neighbour had.
    #[inline]
    fn of(self, index: usize) -> u8 {
        let moved = index.wrapping_sub(self.count).wrapping_add(1);
        let is_new = index.wrapping_sub(self.at) < self.count;
        let former = if index < self.at { index } else { moved };
        if is_new { Self::NEW } else { former.min(Self::NEW.into()) as u8 }
    }

    /// The same for the first indices, in bytes, so that one vector holds all.
    #[inline]
    fn table(self) -> [u8; CAPACITY] {
        let (at, after) = (self.at as u8, self.at.wrapping_add(self.count) as u8);
        std::array::from_fn(|index| {
            let index = index as u8;
            let moved = index.wrapping_sub(self.count as u8).wrapping_add(1);
            let beyond = if index < after { Self::NEW } else { moved };
            if index < at { index } else { beyond }
        })
    }
}

/// Holes of inline stars whose faces are measured together.
struct Batch {
    /// The faces whose errors are not cached, and of which triangle of which hole each is.
    faces: [[Point; 3]; BATCH],
    triangles: [u8; BATCH],
    face_count: usize,
    /// The error of each triangle of each hole.
    errors: [u64; BATCH],
    face_errors: Vec<u64>,
}

impl Default for Batch {
    fn default() -> Self {
        Self {
            faces: [[Point::new(0, 0); 3]; BATCH],
            triangles: [0; BATCH],
            face_count: 0,
            errors: [0; BATCH],
            face_errors: Vec::with_capacity(BATCH),
        }
    }
}

impl Batch {
    /// Fills the hole number `number` of the batch, that of an inline star, and looks its triangles
    /// up in the cache of the star before.
    #[inline]
    fn add(
        &mut self,
        number: usize,
        record: &mut Record,
        cache: &FillCache,
        former: Former,
        view: &MeshView<'_>,
    ) {
        let mut points = [Point::new(0, 0); CAPACITY];
        for (point, &vertex) in points.iter_mut().zip(record.all_neighbours()) {
            *point = view.point(vertex);
        }
        let indices = former.table();
        let count = record.neighbours().len();
        let triangles = fill_small(&points, count);
        record.fill = FillCache::EMPTY;
        for (i, triangle) in triangles[..count - 2].iter().enumerate() {
            let corners = triangle.map(|at| usize::from(at) % CAPACITY);
            record.fill.set_triangle(i, *triangle);
            let (is_cached, error) = cache.error(corners.map(|at| indices[at]));
            let triangle = number * MOST_TRIANGLES + i;
            debug_assert!(triangle < BATCH && self.face_count < BATCH);
            self.errors[triangle % BATCH] = error.into();
            // Written in any case, kept if it is to be measured.
            let face = self.face_count % BATCH;
            self.faces[face] = corners.map(|at| points[at]);
            self.triangles[face] = triangle as u8;
            self.face_count += usize::from(!is_cached);
        }
    }

    /// Measures the faces that are not cached.
    fn measure(&mut self, errors: &mut FaceErrors<'_>) {
        errors.errors(&self.faces[..self.face_count], &mut self.face_errors);
        for (&triangle, &error) in self.triangles.iter().zip(&self.face_errors) {
            self.errors[usize::from(triangle) % BATCH] = error;
        }
    }

    /// Caches the errors of a hole, and returns by how much filling it changes the error.
    #[inline]
    fn finish(&self, number: usize, record: &mut Record) -> i64 {
        let errors = &self.errors[number * MOST_TRIANGLES..][..record.neighbours().len() - 2];
        let mut sum = 0;
        for (i, &error) in errors.iter().enumerate() {
            record.fill.set_error(i, error);
            sum += error;
        }
        sum as i64 - record.error() as i64
    }
}

/// The triangles that fill a hole by their directed edges.
struct Fans<'a> {
    hole: &'a Record,
    /// Whether the vertex of the hole lies on the border of the image.
    is_open: bool,
    /// For each two indices the one that makes a triangle with them, and that triangle's number.
    thirds: [(u8, u8); MOST_CACHED * MOST_CACHED],
    errors: [u32; CACHED_TRIANGLES],
}

impl<'a> Fans<'a> {
    /// The fans of a hole whose whole fill is cached.
    #[inline]
    fn of_cached_fill(hole: &'a Record, is_open: bool) -> Option<Self> {
        let degree = hole.neighbours().len();
        if !hole.is_inline() || degree > MOST_CACHED {
            return None;
        }
        let (triangles, errors) = hole.fill.all(degree - 2)?;
        let thirds = [(0, 0); MOST_CACHED * MOST_CACHED];
        let mut fans = Self { hole, is_open, thirds, errors };
        for (i, [a, b, c]) in triangles.enumerate() {
            for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
                let edge = usize::from(from) * MOST_CACHED + usize::from(to);
                debug_assert!(edge < fans.thirds.len());
                fans.thirds[edge % fans.thirds.len()] = (third, i as u8);
            }
        }
        Some(fans)
    }

    /// What replaces the vertex in the star of its neighbour at an index: all that it sees of the
    /// fill between the neighbours after and before; along the border one of these too.
    #[inline]
    fn replacement(&self, at: usize) -> InlineReplacement {
        let neighbours = self.hole.neighbours();
        let last = neighbours.len() - 1;
        let end = if at == 0 { last } else { at - 1 };
        let mut next = if at == last { 0 } else { at + 1 };
        let mut found = InlineReplacement::default();
        if self.is_open && at == last {
            found.push(neighbours[0], 0);
        }
        loop {
            let edge = at * MOST_CACHED + next;
            let (third, triangle) = self.thirds[edge % self.thirds.len()];
            let error = self.errors[usize::from(triangle) % CACHED_TRIANGLES];
            next = usize::from(third);
            if next == end && !(self.is_open && at == 0) {
                found.end(error);
                return found;
            }
            found.push(self.hole.all_neighbours()[next % MOST_CACHED], error);
            if next == end {
                found.end(0);
                return found;
            }
        }
    }
}

#[cfg(test)]
mod tests;
