//! Greedy removal: the loop, when it ends, and what the removal of one vertex changes.
//!
//! The loop works on a group of consecutive tiles, each with a queue of its own. The exact order
//! has one tile of all vertices. `partition` runs several groups at a time; a vertex with a
//! neighbour outside its group then waits for a larger group.
//!
//! A removal fills the vertex's hole, which gives every neighbour a new star and a new key; nothing
//! else changes. An [`Evaluator`] finds this without touching the mesh, then [`Group`] writes it.
//!
//! Nearly all stars are inline. Their holes are filled in arrays of fixed size, with few branches
//! that depend on the data: a misprediction costs about 40 instructions. The [`FillCache`] has the
//! errors of most triangles. The other new faces around a vertex are measured together.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::bound::BROKEN;
use crate::face_error::{ErrorEvaluator, FaceErrors, FaceMeasure};
use crate::image::Point;
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{
    CACHED_TRIANGLES, FillCache, INLINE_CAPACITY, InlineReplacement, Packed, Stars,
};
use crate::triangulation::hole::{CAPACITY, HoleFiller, fill_small};

/// Stands for the change of a vertex that waits: for a larger group, or for the removal of a neighbour,
/// because its own would break a bound.
const WAITS: i64 = i64::MAX;

/// The most neighbours of a vertex whose whole fill is cached, a power of two.
const MOST_CACHED: usize = CACHED_TRIANGLES + 2;

/// When removal ends, and what it reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StopRule {
    pub(crate) size: usize,
    /// The largest sum of errors that a removal may leave, in the metric's whole numbers.
    pub(crate) bound: Option<u64>,
    /// Whether to go on below `size` while a removal lowers the error.
    pub(crate) bad_point_removal: bool,
    pub(crate) lists_removals: bool,
}

/// A vertex that greedy removal took out.
///
/// ```
/// use pixmesh_meshing::{Image, Method, Target, mesh_image};
/// let image = Image::from_top_down(16, 16, 8, vec![(0..=255).collect()])?;
/// let parameters = Method::Mgpr.parameters(Target::Size(40)).lists_removals(true);
/// let made = mesh_image(&image, &parameters, &())?;
/// let rise: i64 = made.removals.iter().map(|removal| removal.change).sum();
/// assert_eq!(rise as u64, made.fidelity.squared_error); // the mesh of all points has no error
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Removal {
    /// Its position.
    pub point: Point,
    /// By how much the sum of errors changed, in the metric's whole numbers.
    pub change: i64,
}

pub(crate) struct Progress {
    rule: StopRule,
    surplus: usize,
    remaining: usize,
    pub(crate) error: u64,
    pub(crate) removals: Vec<Removal>,
}

impl Progress {
    pub(crate) fn new(rule: StopRule, count: usize, error: u64) -> Self {
        let surplus = count.saturating_sub(rule.size);
        let removals = Vec::with_capacity(if rule.lists_removals { surplus } else { 0 });
        Self { rule, surplus, remaining: count, error, removals }
    }

    pub(crate) fn surplus_left(&self) -> usize {
        self.remaining.saturating_sub(self.rule.size)
    }

    fn done(&self) -> usize {
        self.surplus - self.surplus_left()
    }

    pub(crate) fn poller<'c>(&self, control: &'c dyn Control) -> Poller<'c> {
        Poller::new(control, Stage::Simplify, self.done(), self.surplus)
    }

    pub(crate) fn must_stop(&self, change: i64) -> bool {
        let rule = self.rule;
        if change == WAITS {
            return true;
        }
        if self.remaining <= rule.size {
            return !(rule.bad_point_removal && change < 0);
        }
        let error = self.error.wrapping_add_signed(change);
        rule.bound.is_some_and(|most| error > most)
    }

    pub(crate) fn record(&mut self, point: Point, removed: Entry) {
        if self.rule.lists_removals {
            self.removals.push(Removal { point, change: removed.change });
        }
        self.error = self.error.wrapping_add_signed(removed.change);
        self.remaining -= 1;
    }
}

pub(crate) fn remove_in_order(
    stars: Stars<'_>,
    queues: &mut [RemovalQueue],
    measure: &ErrorEvaluator<'_>,
    progress: &mut Progress,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let vertices = stars.vertices;
    let mut group = Group::new(stars, queues, measure, progress.poller(control));
    loop {
        group.evaluator.poller.done = progress.done();
        match group.remove_next(0, |first| !progress.must_stop(first.change))? {
            Some(removed) => progress.record(vertices.points[removed.vertex as usize], removed),
            None => return Ok(()),
        }
    }
}

pub(crate) struct Group<'t, 'm> {
    stars: Stars<'t>,
    queues: &'t mut [RemovalQueue],
    evaluator: Evaluator<'m>,
    neighbours: Vec<Neighbour>,
    /// The entries, as they were, of vertices that wait for a larger group.
    waiting: Vec<Entry>,
}

impl<'t, 'm> Group<'t, 'm> {
    pub(crate) fn new(
        stars: Stars<'t>,
        queues: &'t mut [RemovalQueue],
        measure: &'m ErrorEvaluator<'m>,
        poller: Poller<'m>,
    ) -> Self {
        let evaluator = Evaluator::new(measure, poller);
        Self { stars, queues, evaluator, neighbours: Vec::new(), waiting: Vec::new() }
    }

    /// Removes the first vertex of a tile's queue whose neighbours are all in the group, if it and
    /// all before it are accepted. Those before it move to the end of the queue and wait.
    #[inline]
    pub(crate) fn remove_next(
        &mut self,
        tile: usize,
        accepts: impl Fn(Entry) -> bool,
    ) -> Result<Option<Entry>, Cancelled> {
        self.evaluator.poller.poll()?;
        while let Some(first) = self.queues[tile].first()
            && accepts(first)
        {
            let (stars, tiles) = (&self.stars, self.queues.len());
            if stars.neighbours(first.vertex).iter().all(|&v| stars.tile_of(v) < tiles) {
                self.remove_first(tile, first.vertex)?;
                return Ok(Some(first));
            }
            self.queues[tile].change(first.vertex, WAITS);
            self.waiting.push(first);
        }
        Ok(None)
    }

    /// Removes the first vertex of a tile, fills its hole and gives its neighbours their new keys.
    #[inline]
    fn remove_first(&mut self, tile: usize, vertex: u32) -> Result<(), Cancelled> {
        self.queues[tile].remove_first();
        self.prefetch_next(tile);
        self.evaluator.prepare(vertex, &self.stars, &mut self.neighbours)?;
        for Neighbour { vertex, star, change } in self.neighbours.drain(..) {
            self.stars.write(vertex, star);
            if let Some(change) = change {
                self.queues[self.stars.tile_of(vertex)].change(vertex, change);
            }
        }
        self.stars.remove(vertex);
        Ok(())
    }

    /// Prefetches what the next removals of a tile probably need: the stars around the first vertex
    /// of the queue, and the star of the second.
    #[inline]
    fn prefetch_next(&self, tile: usize) {
        let (stars, queue) = (&self.stars, &self.queues[tile]);
        if let Some(next) = queue.first() {
            let around = stars.neighbours(next.vertex);
            stars.prefetch(&around[..around.len().min(INLINE_CAPACITY)]);
        }
        if let Some(second) = queue.second() {
            stars.prefetch(&[second.vertex]);
        }
    }

    /// Gives the vertices that wait their keys back, for the next group.
    pub(crate) fn end_waiting(self) {
        // The key of one that waited may have changed, and it may have waited again.
        for entry in self.waiting.into_iter().rev() {
            let queue = &mut self.queues[self.stars.tile_of(entry.vertex)];
            if queue.change_of(entry.vertex) == WAITS {
                queue.change(entry.vertex, entry.change);
            }
        }
    }
}

struct Neighbour {
    vertex: u32,
    star: Packed,
    /// By how much its own removal would change the error; `None` for a corner of the image.
    change: Option<i64>,
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

    fn prepare(
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

    /// Caches the errors of a star's hole; returns by how much filling it changes the error, or that
    /// the vertex waits.
    #[inline]
    fn finish<'e>(star: &mut Packed, errors: &mut impl Iterator<Item = &'e u64>) -> i64 {
        let mut sum = 0;
        for (i, &error) in errors.take(star.degree() - 2).enumerate() {
            star.record.fill.set_error(i, error);
            sum = (sum + error).min(BROKEN);
        }
        let change = sum as i64 - star.error() as i64;
        if sum == BROKEN { WAITS } else { change }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::removal::tests::down_to;

    /// Progress with an error of 50 and 10 vertices, of which 6 may stay.
    fn progress(bound: Option<u64>, bad_point_removal: bool) -> Progress {
        let rule = StopRule { size: 6, bound, bad_point_removal, ..down_to(6) };
        Progress::new(rule, 10, 50)
    }

    #[test]
    fn stops_at_the_size_unless_a_point_raises_the_error() {
        for bad_point_removal in [false, true] {
            let above = progress(None, bad_point_removal);
            assert!([-1, 0, 1, i64::MAX - 1].iter().all(|&change| !above.must_stop(change)));
            assert!(above.must_stop(WAITS));
            let at_size = Progress { remaining: 6, ..above };
            assert!(at_size.must_stop(0) && at_size.must_stop(1));
            assert_eq!(at_size.must_stop(-1), !bad_point_removal);
        }
    }

    #[test]
    fn stops_before_a_removal_that_breaks_the_bound() {
        let progress = progress(Some(60), false);
        assert!(!progress.must_stop(10) && progress.must_stop(11) && !progress.must_stop(-50));
    }

    #[test]
    fn reports_the_removals_made_up_to_the_surplus() {
        struct Expected(usize);
        impl Control for Expected {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                assert_eq!((stage, done, total), (Stage::Simplify, self.0, 4));
                Err(Cancelled)
            }
        }
        let mut progress = progress(None, true);
        for removed in 0..6 {
            let expected = Expected(removed.min(4));
            assert_eq!(progress.poller(&expected).poll(), Err(Cancelled));
            assert_eq!(progress.surplus_left(), 4_usize.saturating_sub(removed));
            progress.record(Point::new(1, 1), Entry { change: 0, rank: 0, vertex: 0 });
        }
    }
}
