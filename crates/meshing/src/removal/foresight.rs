//! Removals prepared ahead of their turn, on several threads.
//!
//! What a removal changes depends on its neighbourhood alone. So the vertices that are next in the
//! queue are prepared side by side, and then take their turns one by one: one whose neighbourhood
//! has not changed in the meantime takes what was prepared for it, any other is prepared again.
//! The order, and with it the result, is that of one thread; among many vertices those that are
//! next lie far apart, and almost all that is prepared is used.

use crate::face_error::Measure;
use crate::parallel::share_out_all;
use crate::removal::candidate::{Neighbour, Net, Remover};
use crate::removal::queue::RemovalQueue;
use crate::removal::star::Stars;
use std::num::NonZeroUsize;

/// Fewer vertices than this are not worth the threads.
const LEAST_VERTICES: usize = 30_000;

/// Most removals prepared at once, and the part of all vertices that they are at most: the more,
/// the more of them meet.
const MOST_AT_ONCE: usize = 512;
const PART_AT_ONCE: usize = 64;

/// A removal in all its consequences.
pub(crate) struct Prepared {
    vertex: u32,
    /// The vertices around it, as they will be.
    pub(crate) neighbours: Vec<Neighbour>,
}

/// The removals prepared, in the order of their turns.
pub(crate) struct Foresight<'m> {
    /// One for each thread that there may be.
    removers: Vec<Remover<'m>>,
    /// How many vertices remain when it is asked for threads again, where there was one alone.
    rests_down_to: usize,
    prepared: Vec<Prepared>,
    /// The first one whose turn has not come.
    next: usize,
    /// For each vertex the round in which its star last changed.
    changed: Vec<u32>,
    round: u32,
}

impl<'m> Foresight<'m> {
    /// Foresight on at most so many threads; `None` on one, or for few vertices.
    pub(crate) fn new(
        measure: &'m Measure<'m>,
        vertex_count: usize,
        threads: NonZeroUsize,
    ) -> Option<Self> {
        (threads.get() > 1 && vertex_count >= LEAST_VERTICES).then(|| Self {
            removers: (0..threads.get()).map(|_| Remover::new(measure)).collect(),
            rests_down_to: usize::MAX,
            prepared: Vec::new(),
            next: 0,
            changed: vec![0; vertex_count],
            round: 0,
        })
    }

    /// Prepares the next removals when the turns of all those prepared are over, on the threads that
    /// there are at the moment; with one alone it rests for as many removals as it prepares at most.
    pub(crate) fn look_ahead(
        &mut self,
        net: &Net<'_, Stars>,
        queue: &RemovalQueue,
        remaining: usize,
        threads: impl Fn() -> NonZeroUsize,
    ) {
        self.skip_changed();
        let has_prepared = self.next < self.prepared.len();
        if has_prepared || remaining < LEAST_VERTICES || remaining > self.rests_down_to {
            return;
        }
        let threads = threads();
        if threads.get() == 1 {
            self.rests_down_to = remaining - MOST_AT_ONCE;
            return;
        }
        self.round += 1;
        self.next = 0;
        let next = queue.least(MOST_AT_ONCE.min(remaining / PART_AT_ONCE));
        self.prepared.truncate(next.len());
        for (i, entry) in next.iter().enumerate() {
            match self.prepared.get_mut(i) {
                Some(prepared) => prepared.vertex = entry.vertex,
                None => {
                    let neighbours = Vec::new();
                    self.prepared.push(Prepared { vertex: entry.vertex, neighbours });
                }
            }
        }
        let share_count = self.removers.len().min(threads.get());
        let share = self.prepared.len().div_ceil(share_count).max(1);
        let shares = self.prepared.chunks_mut(share).zip(&mut self.removers);
        let prepare = |(share, remover): (&mut [Prepared], &mut Remover<'m>)| {
            prepare_all(share, remover, net);
        };
        share_out_all(threads, shares, prepare);
    }

    /// What was prepared for the vertex whose turn it is, if that still holds.
    pub(crate) fn take(&mut self, vertex: u32, net: &Net<'_, Stars>) -> Option<&mut Prepared> {
        self.skip_changed();
        let prepared = self.prepared.get_mut(self.next)?;
        if prepared.vertex != vertex {
            return None;
        }
        self.next += 1;
        let is_current = |v: &u32| self.changed[*v as usize] != self.round;
        net.stars.neighbours(vertex).iter().all(is_current).then_some(prepared)
    }

    /// Hears that the star of a vertex has changed.
    pub(crate) fn note_change(&mut self, vertex: u32) {
        self.changed[vertex as usize] = self.round;
    }

    /// Leaves out the vertices that have another turn now.
    fn skip_changed(&mut self) {
        let is_changed = |prepared: &Prepared| self.changed[prepared.vertex as usize] == self.round;
        while self.prepared.get(self.next).is_some_and(is_changed) {
            self.next += 1;
        }
    }
}

/// Prepares some removals.
fn prepare_all(share: &mut [Prepared], remover: &mut Remover<'_>, net: &Net<'_, Stars>) {
    for Prepared { vertex, neighbours } in share {
        remover.prepare(*vertex, net, neighbours);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Image, Point};
    use crate::parameters::choices::ErrorMetric;
    use crate::removal::{Prepared as Begun, StopRule, prepare};
    use crate::triangulation::Triangulation;
    use std::cell::Cell;
    use std::collections::HashSet;

    const SIDE: usize = 40;

    fn two() -> NonZeroUsize {
        NonZeroUsize::new(2).unwrap()
    }

    fn picture() -> Image {
        let samples = (0..SIDE * SIDE).map(|i| (i * i / 7 % 31 + i / SIDE) as u16).collect();
        Image::from_bottom_up(SIDE, SIDE, 8, vec![samples]).unwrap()
    }

    /// Removal from all lattice points of an image.
    fn begun<'a>(image: &'a Image, measure: &Measure<'_>) -> Begun<'a> {
        let lattice =
            (0..SIDE as i32).flat_map(|y| (0..SIDE as i32).map(move |x| Point::new(x, y)));
        let triangulation = Triangulation::new(lattice.collect(), &()).unwrap();
        let metric = ErrorMetric::MeanCompSe;
        let rule = StopRule { size: 4, bound: None, metric, bad_point_removal: false };
        prepare(image, triangulation, rule, measure, u32::BITS, &()).unwrap()
    }

    fn assert_same(foreseen: &[Neighbour], fresh: &[Neighbour]) {
        assert_eq!(foreseen.len(), fresh.len());
        for (foreseen, fresh) in foreseen.iter().zip(fresh) {
            assert_eq!((foreseen.vertex, foreseen.change), (fresh.vertex, fresh.change));
            assert_eq!(foreseen.star.record, fresh.star.record);
            assert_eq!(foreseen.star.listed, fresh.star.listed);
        }
    }

    #[test]
    fn threads_are_used_where_there_are_several_and_enough_vertices() {
        let image = picture();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
        let has_foresight = |vertex_count, threads| {
            Foresight::new(&measure, vertex_count, NonZeroUsize::new(threads).unwrap()).is_some()
        };
        assert!(has_foresight(LEAST_VERTICES, 2) && has_foresight(LEAST_VERTICES + 1, 8));
        assert!(!has_foresight(LEAST_VERTICES, 1) && !has_foresight(LEAST_VERTICES - 1, 2));
    }

    #[test]
    fn as_many_are_prepared_as_a_part_of_those_that_remain() {
        let image = picture();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
        let Begun { vertices, stars, entries, .. } = begun(&image, &measure);
        let stars = stars.into_one();
        let queue = RemovalQueue::new(entries, SIDE * SIDE);
        let (net, some) = (vertices.net(&stars), LEAST_VERTICES);
        for (remaining, count) in [(some - 1, 0), (some, some / 64), (some + 640, some / 64 + 10)] {
            let mut foresight = Foresight::new(&measure, LEAST_VERTICES, two()).unwrap();
            foresight.look_ahead(&net, &queue, remaining, two);
            assert_eq!(foresight.prepared.len(), count, "of {remaining}");
            // Nothing is prepared anew before all of it had its turn.
            foresight.next = 1;
            foresight.look_ahead(&net, &queue, remaining, two);
            assert_eq!(foresight.next, 1);
        }
    }

    #[test]
    fn with_one_thread_nothing_is_prepared_until_there_may_be_more() {
        let image = picture();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
        let Begun { vertices, stars, entries, .. } = begun(&image, &measure);
        let stars = stars.into_one();
        let queue = RemovalQueue::new(entries, SIDE * SIDE);
        let (net, many) = (vertices.net(&stars), 2 * LEAST_VERTICES);
        let mut foresight = Foresight::new(&measure, LEAST_VERTICES, two()).unwrap();
        let asked = Cell::new(0);
        let mut look = |remaining, threads| {
            let threads = || {
                asked.set(asked.get() + 1);
                NonZeroUsize::new(threads).unwrap()
            };
            foresight.look_ahead(&net, &queue, remaining, threads);
            (foresight.prepared.len(), asked.get())
        };
        assert_eq!(look(many, 1), (0, 1));
        assert_eq!(look(many - MOST_AT_ONCE + 1, 2), (0, 1));
        assert_eq!(look(many - MOST_AT_ONCE, 1), (0, 2));
        // More than it has removers for.
        assert_eq!(look(many - 2 * MOST_AT_ONCE, 3), (MOST_AT_ONCE, 3));
    }

    #[test]
    fn what_is_foreseen_is_what_is_found_and_holds_wherever_nothing_near_it_changed() {
        let image = picture();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
        let Begun { vertices, stars, entries, .. } = begun(&image, &measure);
        let mut stars = stars.into_one();
        let mut queue = RemovalQueue::new(entries, SIDE * SIDE);
        let mut remover = Remover::new(&measure);
        let mut foresight = Foresight::new(&measure, LEAST_VERTICES, two()).unwrap();
        // The vertices that were prepared, and those whose stars have changed since.
        let (mut prepared, mut changed) = (HashSet::new(), HashSet::new());
        let (mut held, mut rounds) = (0, 0);
        while let Some(first) = queue.first() {
            let net = vertices.net(&stars);
            let round = foresight.round;
            foresight.look_ahead(&net, &queue, LEAST_VERTICES, two);
            if foresight.round != round {
                rounds += 1;
                prepared = queue.least(LEAST_VERTICES / 64).iter().map(|e| e.vertex).collect();
                changed.clear();
            }
            queue.remove_first();
            let mut fresh = Vec::new();
            remover.prepare(first.vertex, &net, &mut fresh);
            let around: HashSet<u32> = net.stars.neighbours(first.vertex).iter().copied().collect();
            let is_current = prepared.contains(&first.vertex)
                && !changed.contains(&first.vertex)
                && changed.is_disjoint(&around);
            let foreseen = foresight.take(first.vertex, &net);
            assert_eq!(foreseen.is_some(), is_current, "{}", first.vertex);
            if let Some(foreseen) = foreseen {
                assert_same(&foreseen.neighbours, &fresh);
                held += 1;
            }
            for Neighbour { vertex, star, change } in fresh {
                stars.write(vertex, star);
                foresight.note_change(vertex);
                changed.insert(vertex);
                if let Some(change) = change {
                    queue.change(vertex, change);
                }
            }
            stars.remove(first.vertex);
        }
        assert!(held > SIDE && rounds > 2, "{held} held in {rounds} rounds");
    }
}
