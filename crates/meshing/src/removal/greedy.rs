//! The removal loop, when it ends, and how far it has come.
//!
//! The loop works on a group of consecutive tiles, each with a queue of its own. The exact order
//! has one tile of all vertices. `partition` runs several groups at a time; a vertex with a
//! neighbour outside its group then waits for a larger group.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::ErrorEvaluator;
use crate::image::Point;
use crate::removal::candidate::{Evaluator, Neighbour};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{INLINE_CAPACITY, Stars};

/// Stands for the change of a vertex that waits for a larger group.
const WAITS: i64 = i64::MAX;

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
            assert!([-1, 0, 1, i64::MAX].iter().all(|&change| !above.must_stop(change)));
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
