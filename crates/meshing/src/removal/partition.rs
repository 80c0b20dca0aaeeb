//! Greedy removal tile by tile: nearly the same mesh, from caches and on all threads.
//!
//! In the exact order the next vertex lies anywhere in the image: memory is read again and again,
//! and any removal may decide which one follows. Here removal goes in rounds, each with an upper
//! limit for the keys. First every tile, by itself, removes in its own order the vertices whose
//! neighbours are all its own; then groups of 4 tiles, of 16 and so on do the same, until one group
//! of all tiles removes what is left below the limit. So the order differs from the exact one only
//! around the borders of tiles and within a round. The last removals are made in the exact order.
//!
//! Tiles and limits follow from the image and the parameters, not from the number of threads.

use crate::control::{Cancelled, Control, Poller, select};
use crate::face_error::ErrorEvaluator;
use crate::parallel::share_out;
use crate::removal::greedy::{Group, Progress, StopRule};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::Vertices;
use crate::removal::start::Start;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Vertices of a tile, as a power of two: their stars and pixels fit a second-level cache.
const USUAL_TILE: u32 = 13;
/// Vertices of the smallest tiles, as a power of two: of fewer, too many have neighbours in others.
const LEAST_TILE: u32 = 11;
/// Tiles are smaller than usual to make at least this many, so that threads do not wait.
const TILES_FOR_THREADS: usize = 16;
/// Fewer tiles than this are not worth another order.
const LEAST_TILES: usize = 2;
/// The most tiles; of more vertices, tiles are larger than usual.
const MOST_TILES: usize = 256;
/// Tiles that make a group of the next level.
const GROWTH: usize = 4;
/// One in this many of the remaining removals is below a round's limit as the round starts; about
/// as many more drop below it during the round.
const PART_OF_ROUND: usize = 3;
/// The quota of a tile in a round is twice its vertices below the limit, and this part of its size.
const PART_OF_TILE_AT_LEAST: usize = 512;
/// Rounds end when fewer removals remain than this part of all vertices, so that the quotas of a
/// round cannot exceed them. The rest is made in the exact order.
const LEAST_PART: usize = 128;

/// The binary digits of a vertex's number within its tile; `None` for too few vertices, or when the
/// number of removals is not known.
pub(crate) fn tile_digits(vertex_count: usize, rule: StopRule) -> Option<u32> {
    let least = vertex_count.div_ceil(MOST_TILES).next_power_of_two();
    let for_threads = (vertex_count / TILES_FOR_THREADS).checked_ilog2().unwrap_or(0);
    let digits = least.trailing_zeros().max(for_threads.clamp(LEAST_TILE, USUAL_TILE));
    let surplus = vertex_count.saturating_sub(rule.size);
    let is_large = vertex_count > LEAST_TILES << digits;
    (rule.bound.is_none() && is_large && surplus > vertex_count / LEAST_PART).then_some(digits)
}

pub(crate) fn remove_in_rounds(
    start: &mut Start,
    measure: &ErrorEvaluator<'_>,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let Start { stars, queues, progress } = start;
    let (count, size) = (queues.len(), 1 << stars.vertices.digits);
    // A limit needs a vertex below it.
    let least = (count * size / LEAST_PART).max(PART_OF_ROUND);
    while progress.surplus_left() >= least {
        let poller = &mut progress.poller(control);
        let poll = || progress.poller(control).poll();
        let limit = limit(queues, progress.surplus_left() / PART_OF_ROUND, &poll)?;
        let mut quotas = quotas(queues, limit, size, poller)?;
        let levels = std::iter::successors(Some(1), |tiles| Some(tiles * GROWTH));
        for tiles in levels.take_while(|&tiles| tiles < count).chain([count]) {
            let parts = queues.chunks_mut(tiles).zip(quotas.chunks_mut(tiles));
            let mut removed = vec![Vec::new(); count.div_ceil(tiles)];
            let groups = stars.groups(tiles).zip(parts).zip(&mut removed);
            share_out(groups, control, |((stars, (queues, quotas)), removed), control| {
                let mut group = Group::new(stars, queues, measure, progress.poller(control));
                *removed = remove_below(limit, &mut group, quotas)?;
                group.end_waiting();
                Ok(())
            })?;
            record_in_order(&removed, &stars.vertices, progress);
        }
    }
    Ok(())
}

/// The entry with `count` others below it in all queues.
fn limit(
    queues: &[RemovalQueue],
    count: usize,
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<Entry, Cancelled> {
    let mut entries = Vec::with_capacity(queues.iter().map(RemovalQueue::len).sum());
    for queue in queues {
        poll()?;
        entries.extend(queue.entries());
    }
    select(&mut entries, count, poll)
}

/// How many vertices each tile of this size may lose in a round.
fn quotas(
    queues: &[RemovalQueue],
    limit: Entry,
    size: usize,
    poller: &mut Poller<'_>,
) -> Result<Vec<usize>, Cancelled> {
    let quota = |queue: &RemovalQueue| {
        poller.step(queue.len())?;
        let below = queue.entries().filter(|&entry| entry < limit).count();
        Ok(2 * below + size / PART_OF_TILE_AT_LEAST)
    };
    queues.iter().map(quota).collect()
}

/// Records what all groups have removed, in the order of the whole.
fn record_in_order(removed: &[Vec<Entry>], vertices: &Vertices, progress: &mut Progress) {
    let at = |group: usize, i: usize| Some(Reverse((*removed[group].get(i)?, group, i)));
    let mut next: BinaryHeap<_> = (0..removed.len()).filter_map(|group| at(group, 0)).collect();
    while let Some(Reverse((entry, group, i))) = next.pop() {
        progress.record(vertices.points[entry.vertex as usize], entry);
        next.extend(at(group, i + 1));
    }
}

/// Removes, tile after tile, vertices below the limit with all neighbours in the group, in order.
fn remove_below(
    limit: Entry,
    group: &mut Group<'_, '_>,
    quotas: &mut [usize],
) -> Result<Vec<Entry>, Cancelled> {
    let (mut removed, mut removed_before) = (Vec::new(), usize::MAX);
    // A removal may bring a neighbour in another tile below the limit.
    while removed.len() != removed_before {
        removed_before = removed.len();
        for (tile, quota) in quotas.iter_mut().enumerate() {
            while *quota > 0
                && let Some(entry) = group.remove_next(tile, |first| first < limit)?
            {
                *quota -= 1;
                removed.push(entry);
            }
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::control::{OnThreads, Stage};
    use crate::dynamic_mesh::MeasuredMesh;
    use crate::face_error::FaceErrors;
    use crate::face_error::tests::evaluator_of;
    use crate::image::Image;
    use crate::parameters::choices::Parallel;
    use crate::removal::tests::{down_to, lattice, simplify, start};
    use crate::removal::{Simplified, finish};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::num::NonZeroUsize;

    /// What is left of all points of a picture, by tiles of `1 << digits` vertices.
    fn remove(image: &Image, size: usize, digits: u32, threads: usize) -> Simplified {
        let measure = evaluator_of(image);
        let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
        let mut start = start(image, &measure, down_to(size), digits, &control);
        remove_in_rounds(&mut start, &measure, &control).unwrap();
        start.merge_tiles(&control).unwrap();
        finish(start, &measure, &control).unwrap()
    }

    /// Each removal, made in its turn on a mesh of all points, changes the error as it says.
    fn assert_removals_can_be_replayed(image: &Image, made: &Simplified) {
        let (width, height) = (image.width(), image.height());
        let points = lattice(width, height);
        let measure = evaluator_of(image);
        let (size, errors) = ((width, height), FaceErrors::new(&measure));
        let mut mesh = MeasuredMesh::new(points, size, errors, Stage::Measure, &()).unwrap();
        for removal in &made.removals {
            let number = removal.point.y as usize * width + removal.point.x as usize;
            assert_eq!(mesh.remove(number as u32, &mut poller()), Ok(removal.change));
        }
        assert_eq!(mesh.triangulation.total_error, made.error);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn leaves_the_triangulation_of_what_remains(
            (width, height) in (2usize..50, 2usize..50),
            digits in 1u32..9,
            part in 0usize..100,
            samples in prop::collection::vec(0u16..64, 60),
        ) {
            let sample = |i: usize| samples[i % 60] / 8 + samples[i / 60 % 60] % 8;
            let plane = (0..width * height).map(sample).collect();
            let image = Image::from_bottom_up(width, height, 4, vec![plane]).unwrap();
            let size = 4 + (width * height - 4) * part / 100;
            let made = remove(&image, size, digits, 1);
            prop_assert_eq!(made.points.len(), size);
            prop_assert!(made.points.is_sorted());
            prop_assert_eq!(&made.faces, &triangulate(&made.points));
            assert_removals_can_be_replayed(&image, &made);
            for threads in [2, 5] {
                let again = remove(&image, size, digits, threads);
                prop_assert_eq!(&again.points, &made.points);
                prop_assert_eq!(again.removals, made.removals.clone());
            }
        }
    }

    #[test]
    fn one_tile_gives_the_exact_order() {
        let plane = (0..900).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(30, 30, 4, vec![plane]).unwrap();
        let exact = simplify(&image, 100, Parallel::Exact);
        assert_eq!(remove(&image, 100, 10, 2).removals, exact.removals);
        // Several tiles give another order.
        assert_ne!(remove(&image, 100, 5, 2).removals, exact.removals);
    }

    #[test]
    fn partitions_only_on_request() {
        let (width, height) = (200, 170);
        let plane = (0..width * height).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(width, height, 4, vec![plane]).unwrap();
        let size = width * height - 1000;
        let removals = |parallel| simplify(&image, size, parallel).removals;
        let by_tiles_of = |digits| remove(&image, size, digits, 1).removals;
        assert!(removals(Parallel::Tiles) == by_tiles_of(LEAST_TILE));
        assert!(removals(Parallel::Exact) == by_tiles_of(16), "all in one tile");
        assert!(removals(Parallel::Tiles) != removals(Parallel::Exact));
    }

    #[test]
    fn chooses_the_size_of_tiles() {
        let digits = |count, size| tile_digits(count, down_to(size));
        assert_eq!([4096, 4097, 65_535].map(|count| digits(count, 4)), [None, Some(11), Some(11)]);
        assert_eq!([65_536, 131_071].map(|count| digits(count, 4)), [Some(12); 2]);
        let most = 256 * 8192;
        assert_eq!([131_072, most].map(|count| digits(count, 4)), [Some(13); 2]);
        assert_eq!([most + 1, 5 * most].map(|count| digits(count, 4)), [Some(14), Some(16)]);
        // Too few removals.
        let (count, part) = (most, most / LEAST_PART);
        assert_eq!(digits(count, count - part), None);
        assert_eq!(digits(count, count - part - 1), Some(13));
        let bound = Some(30);
        assert_eq!(tile_digits(count, StopRule { bound, ..down_to(4) }), None);
    }

    #[test]
    fn limit_is_a_quantile_and_quotas_follow_from_it() {
        let plane = (0..900).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(30, 30, 4, vec![plane]).unwrap();
        let measure = evaluator_of(&image);
        let Start { queues, progress, .. } = start(&image, &measure, down_to(4), 6, &());
        assert_eq!(queues.len(), 900_usize.div_ceil(64));
        for (count, size, least) in [(0, 64, 0), (100, 64, 0), (300, 1024, 2), (895, 64, 0)] {
            let poller = &mut progress.poller(&());
            let limit = limit(&queues, count, &|| Ok(())).unwrap();
            let below = |queue: &RemovalQueue| queue.entries().filter(|e| *e < limit).count();
            assert_eq!(queues.iter().map(below).sum::<usize>(), count);
            let quotas = quotas(&queues, limit, size, poller).unwrap();
            assert!(quotas.iter().zip(&queues).all(|(&q, queue)| q == 2 * below(queue) + least));
        }
    }
}
