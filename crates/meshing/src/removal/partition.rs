//! Greedy point removal tile by tile: nearly the same mesh, from caches and on all threads.
//!
//! In the exact order the vertex that is next lies anywhere in the image: a large one is fetched from
//! memory again and again, and any removal may decide which one comes after it. Here the vertices,
//! numbered so that neighbours are together, are parted into tiles, and removal goes in rounds, each
//! with a limit for the keys of the vertices that go. First every tile, by itself, removes in its own
//! order those whose neighbours are all its own; then groups of four tiles, of sixteen and so on do
//! the same, until one group of all tiles removes what is left below the limit. So the order differs
//! from the exact one around the borders of tiles alone, and only within a round. The last vertices
//! leave in the exact order.
//!
//! Tiles and limits follow from the image and the parameters: the result does not depend on the number
//! of threads.

use crate::control::{Cancelled, Control};
use crate::face_error::Measure;
use crate::parallel::share_out;
use crate::removal::candidate::{Neighbour, Remover};
use crate::removal::queue::{Entry, RemovalQueue};
use crate::removal::star::{StarParts, StarSource, Stars};
use crate::removal::{Prepared, Simplified, StopRule, Tally, Vertices, touch_next};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Vertices of a tile, as a power of two, where there are many: what is known of them and their part of
/// a picture lie in a second-level cache.
const USUAL_TILE: u32 = 13;

/// There are at least so many tiles, so that threads need not wait for each other, unless they would be
/// smaller than the least tile.
const TILES_FOR_THREADS: usize = 16;

/// Vertices of the smallest tiles, as a power of two: of fewer too many have neighbours in others.
const LEAST_TILE: u32 = 11;

/// Fewer tiles than this are not worth another order.
const LEAST_TILES: usize = 2;

/// The most tiles; where vertices are more, tiles are larger.
const MOST_TILES: usize = 256;

/// Tiles that make a group of the next level.
const GROWTH: usize = 4;

/// A round's limit has one in so many of the vertices that must still go below it; about as many
/// follow them down.
const PART_OF_ROUND: usize = 3;

/// The last of so many parts of the vertices that must go leave in the exact order.
const PART_OF_LAST: usize = 128;

/// In a round a tile loses twice as many vertices as it has below the limit, and this part of its
/// size, at most.
const PART_OF_TILE_AT_LEAST: usize = 512;

/// No round begins with fewer vertices to go than this part of all: so the quotas of a round are less
/// than what must still go.
const LEAST_PART: usize = 128;

/// Stands for the change of a vertex that waits for a larger group.
const WAITS: i64 = i64::MAX;

/// The number of a vertex's tile is that of the vertex without so many of its last binary digits;
/// `None` where there are not vertices enough, or no number of them to remove is known.
pub(crate) fn tile_digits(vertex_count: usize, rule: StopRule) -> Option<u32> {
    let least = vertex_count.div_ceil(MOST_TILES).next_power_of_two();
    let for_threads = (vertex_count / TILES_FOR_THREADS).checked_ilog2().unwrap_or(0);
    let digits = least.trailing_zeros().max(for_threads.clamp(LEAST_TILE, USUAL_TILE));
    let surplus = vertex_count.saturating_sub(rule.size);
    let is_large = vertex_count > LEAST_TILES << digits;
    (rule.bound.is_none() && is_large && surplus > vertex_count / LEAST_PART).then_some(digits)
}

/// Removes vertices, prepared in tiles of `1 << digits`, until the rule says stop.
pub(crate) fn remove_by_tiles(
    prepared: Prepared<'_>,
    measure: &Measure<'_>,
    digits: u32,
    control: &dyn Control,
) -> Result<Simplified, Cancelled> {
    let Prepared { vertices, stars, entries, mut tally } = prepared;
    let frame = Frame { vertices: &vertices, measure, digits };
    let size = 1 << digits;
    let mut tiles = tiles(stars, entries);
    let count = tiles.len();
    let least = count * size / LEAST_PART;
    // A limit needs a vertex below it.
    let least = least.max(tally.surplus_left() / PART_OF_LAST).max(PART_OF_ROUND);
    while tally.surplus_left() >= least {
        let limit = set_quotas(&mut tiles, tally.surplus_left() / PART_OF_ROUND, size);
        let levels = std::iter::successors(Some(1), |tiles| Some(tiles * GROWTH));
        for tiles_of_group in levels.take_while(|&tiles| tiles < count).chain([count]) {
            let groups = frame.groups(&mut tiles, tiles_of_group);
            remove_in_groups(groups, limit, &mut tally, control)?;
        }
    }
    remove_in_order(frame.group(&mut tiles, 0), &mut tally, control)?;
    Ok(tally.finish(&vertices, &frame.stars(&tiles, 0)))
}

/// Some vertices whose numbers follow each other.
struct Tile {
    stars: Stars,
    queue: RemovalQueue,
    /// How many may still go in the round.
    quota: usize,
}

/// The tiles of vertices with an entry for each that may leave, by number.
fn tiles(stars: StarParts, entries: Vec<Entry>) -> Vec<Tile> {
    let mut entries = entries.into_iter().peekable();
    let tile = |stars: Stars| {
        let Range { start, end } = stars.numbers();
        let own = std::iter::from_fn(|| entries.next_if(|entry| entry.vertex < end)).collect();
        let queue = RemovalQueue::of_vertices_from(start, (end - start) as usize, own);
        Tile { stars, queue, quota: 0 }
    };
    stars.parts.into_iter().map(tile).collect()
}

/// Sets the quotas of a round whose limit has so many vertices below it, for tiles of this size, and
/// returns the limit.
fn set_quotas(tiles: &mut [Tile], count: usize, size: usize) -> Entry {
    let mut entries = Vec::with_capacity(tiles.iter().map(|tile| tile.queue.len()).sum());
    entries.extend(tiles.iter().flat_map(|tile| tile.queue.entries()));
    let limit = *entries.select_nth_unstable(count).1;
    for tile in tiles {
        let below = tile.queue.entries().filter(|&entry| entry < limit).count();
        tile.quota = 2 * below + size / PART_OF_TILE_AT_LEAST;
    }
    limit
}

/// Lets each group remove what is its own, on all threads.
fn remove_in_groups(
    mut groups: Vec<Group<'_, '_>>,
    limit: Entry,
    tally: &mut Tally<'_>,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let before: &Tally<'_> = tally;
    share_out(groups.iter_mut(), control, |group, control| {
        group.remove_own(limit, &|| before.poll(control))
    })?;
    note_gone(&groups, tally);
    Ok(())
}

/// Tells the tally what has gone from all groups, in the order of the whole.
fn note_gone(groups: &[Group<'_, '_>], tally: &mut Tally<'_>) {
    let at = |group: usize, place: usize| {
        let entry = groups[group].gone.get(place)?;
        Some(Reverse((*entry, group, place)))
    };
    let mut next: BinaryHeap<_> = (0..groups.len()).filter_map(|group| at(group, 0)).collect();
    while let Some(Reverse((entry, group, place))) = next.pop() {
        tally.note(groups[group].frame.vertices, entry);
        next.extend(at(group, place + 1));
    }
}

/// Removes the last vertices in the order of the whole.
fn remove_in_order(
    mut all: Group<'_, '_>,
    tally: &mut Tally<'_>,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let mut firsts: Vec<Option<Entry>> = all.tiles.iter().map(|tile| tile.queue.first()).collect();
    while let Some((tile, first)) = least(&firsts) {
        tally.poll(control)?;
        if tally.must_stop(first.change) {
            break;
        }
        all.remove_first_of(tile, |changed, queue| firsts[changed] = queue.first());
        tally.note(all.frame.vertices, first);
    }
    Ok(())
}

/// The least entry and its place.
fn least(entries: &[Option<Entry>]) -> Option<(usize, Entry)> {
    let entries = entries.iter().enumerate().filter_map(|(i, &entry)| Some((i, entry?)));
    entries.min_by_key(|&(_, entry)| entry)
}

/// What all groups have in common.
#[derive(Clone, Copy)]
struct Frame<'a> {
    vertices: &'a Vertices,
    measure: &'a Measure<'a>,
    /// Binary digits of a vertex's number that do not count in that of its tile.
    digits: u32,
}

impl<'a> Frame<'a> {
    /// The groups of so many tiles each, but for the last.
    fn groups<'t>(self, tiles: &'t mut [Tile], size: usize) -> Vec<Group<'t, 'a>> {
        let groups = tiles.chunks_mut(size).enumerate();
        groups.map(|(i, tiles)| self.group(tiles, i * size)).collect()
    }

    /// The group of these tiles, the first of which has this number.
    fn group<'t>(self, tiles: &'t mut [Tile], first: usize) -> Group<'t, 'a> {
        let (remover, neighbours) = (Remover::new(self.measure), Vec::new());
        Group { frame: self, tiles, first, remover, neighbours, gone: Vec::new() }
    }

    /// The stars of these tiles, the first of which has this number.
    fn stars(self, tiles: &[Tile], first: usize) -> TileStars<'_> {
        TileStars { tiles, first, digits: self.digits }
    }
}

/// The stars of some tiles.
struct TileStars<'t> {
    tiles: &'t [Tile],
    first: usize,
    digits: u32,
}

impl StarSource for TileStars<'_> {
    #[inline]
    fn stars_of(&self, vertex: u32) -> &Stars {
        &self.tiles[(vertex >> self.digits) as usize - self.first].stars
    }
}

/// Tiles that follow each other.
struct Group<'t, 'a> {
    frame: Frame<'a>,
    tiles: &'t mut [Tile],
    /// The number of the first tile.
    first: usize,
    remover: Remover<'a>,
    /// The neighbours of the last vertex that went.
    neighbours: Vec<Neighbour>,
    /// The vertices that have gone, in order.
    gone: Vec<Entry>,
}

impl Group<'_, '_> {
    /// Removes, tile after tile, the vertices below the limit whose neighbours are all in the group.
    fn remove_own(
        &mut self,
        limit: Entry,
        poll: &dyn Fn() -> Result<(), Cancelled>,
    ) -> Result<(), Cancelled> {
        let mut waiting = Vec::new();
        let mut gone_before = usize::MAX;
        // A removal may bring a neighbour in another tile below the limit.
        while self.gone.len() != gone_before {
            gone_before = self.gone.len();
            for tile in 0..self.tiles.len() {
                poll()?;
                self.remove_of_tile(tile, limit, &mut waiting);
            }
        }
        // The key of one that waited may have changed, and it may have waited again.
        for entry in waiting.into_iter().rev() {
            let queue = &mut self.tiles[self.tile_of(entry.vertex)].queue;
            if queue.change_of(entry.vertex) == WAITS {
                queue.change(entry.vertex, entry.change);
            }
        }
        Ok(())
    }

    /// Removes the vertices of one tile; those that have to wait are added to the others.
    fn remove_of_tile(&mut self, tile: usize, limit: Entry, waiting: &mut Vec<Entry>) {
        while let Some(first) = self.tiles[tile].queue.first().filter(|&first| first < limit)
            && self.tiles[tile].quota > 0
        {
            if self.holds_all(self.tiles[tile].stars.neighbours(first.vertex)) {
                self.tiles[tile].quota -= 1;
                self.remove_first_of(tile, |_, _| ());
                self.gone.push(first);
            } else {
                self.tiles[tile].queue.change(first.vertex, WAITS);
                waiting.push(first);
            }
        }
    }

    /// The place of a vertex's tile in the group.
    fn tile_of(&self, vertex: u32) -> usize {
        (vertex >> self.frame.digits) as usize - self.first
    }

    /// Tells whether all of some vertices are in the group.
    #[inline]
    fn holds_all(&self, vertices: &[u32]) -> bool {
        let place = |v: u32| ((v >> self.frame.digits) as usize).wrapping_sub(self.first);
        vertices.iter().fold(true, |all, &v| all & (place(v) < self.tiles.len()))
    }

    /// Takes the first vertex of a tile out of the mesh, fills its hole and gives its neighbours their
    /// new keys; `hear` hears of each queue that changes.
    #[inline]
    fn remove_first_of(&mut self, tile: usize, mut hear: impl FnMut(usize, &RemovalQueue)) {
        let Some(gone) = self.tiles[tile].queue.first() else { return };
        self.tiles[tile].queue.remove_first();
        touch_next(&self.tiles[tile].stars, &self.tiles[tile].queue);
        let stars = self.frame.stars(self.tiles, self.first);
        let net = self.frame.vertices.net(&stars);
        self.remover.prepare(gone.vertex, &net, &mut self.neighbours);
        for Neighbour { vertex, star, change } in self.neighbours.drain(..) {
            let place = (vertex >> self.frame.digits) as usize - self.first;
            let Tile { stars, queue, .. } = &mut self.tiles[place];
            stars.write(vertex, star);
            if let Some(change) = change {
                queue.change(vertex, change);
                hear(place, queue);
            }
        }
        self.tiles[tile].stars.remove(gone.vertex);
        hear(tile, &self.tiles[tile].queue);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::dynamic_mesh::MeasuredMesh;
    use crate::face_error::FaceErrors;
    use crate::image::{Image, Point};
    use crate::parameters::choices::{ErrorMetric, Parallel};
    use crate::removal::{prepare, simplify};
    use crate::triangulation::{Triangulation, triangulate};
    use proptest::prelude::*;
    use std::num::NonZeroUsize;

    fn all_points(width: usize, height: usize) -> Vec<Point> {
        (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y))).collect()
    }

    /// What is left of all points of a picture, by tiles of `1 << digits` vertices.
    fn remove(image: &Image, size: usize, digits: u32, threads: usize) -> Simplified {
        let rule = rule(size);
        let points = all_points(image.width(), image.height());
        let triangulation = Triangulation::new(points, &()).unwrap();
        let measure = Measure::new(image, rule.metric);
        let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
        let prepared = prepare(image, triangulation, rule, &measure, digits, &control).unwrap();
        remove_by_tiles(prepared, &measure, digits, &control).unwrap()
    }

    fn rule(size: usize) -> StopRule {
        let metric = ErrorMetric::MeanCompSe;
        StopRule { size, bound: None, metric, bad_point_removal: false }
    }

    /// Each removal, made in its turn on a mesh of all points, changes the error as it says.
    fn assert_removals_can_be_made_in_their_order(image: &Image, made: &Simplified) {
        let (width, height) = (image.width(), image.height());
        let points = all_points(width, height);
        let measure = Measure::new(image, ErrorMetric::MeanCompSe);
        let faces = triangulate(&points);
        let errors = FaceErrors::new(&measure);
        let mut mesh = MeasuredMesh::new(points, &faces, (width, height), errors);
        for removal in &made.removals {
            let number = removal.point.y as usize * width + removal.point.x as usize;
            assert_eq!(mesh.remove(number as u32).0, removal.change);
        }
        assert_eq!(mesh.total_error(), made.error);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn what_is_left_is_the_triangulation_of_points_that_others_were_removed_from_one_by_one(
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
            assert_removals_can_be_made_in_their_order(&image, &made);
            for threads in [2, 5] {
                let again = remove(&image, size, digits, threads);
                prop_assert_eq!(&again.points, &made.points);
                prop_assert_eq!(again.removals, made.removals.clone());
            }
        }
    }

    #[test]
    fn a_single_tile_is_simplified_in_the_exact_order() {
        let plane = (0..900).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(30, 30, 4, vec![plane]).unwrap();
        let triangulation = Triangulation::new(all_points(30, 30), &()).unwrap();
        let exact = simplify(&image, triangulation, rule(100), Parallel::Exact, &()).unwrap();
        assert_eq!(remove(&image, 100, 10, 2).removals, exact.removals);
        // In several tiles the order is another one, or the test would be of nothing.
        assert_ne!(remove(&image, 100, 5, 2).removals, exact.removals);
    }

    #[test]
    fn several_tiles_are_made_only_where_they_are_asked_for() {
        let (width, height) = (200, 170);
        let plane = (0..width * height).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(width, height, 4, vec![plane]).unwrap();
        let size = width * height - 1000;
        let removals = |parallel| {
            let triangulation = Triangulation::new(all_points(width, height), &()).unwrap();
            simplify(&image, triangulation, rule(size), parallel, &()).unwrap().removals
        };
        let by_tiles_of = |digits| remove(&image, size, digits, 1).removals;
        assert!(removals(Parallel::Tiles) == by_tiles_of(LEAST_TILE));
        assert!(removals(Parallel::Exact) == by_tiles_of(16), "all in one tile");
        assert!(removals(Parallel::Tiles) != removals(Parallel::Exact));
    }

    #[test]
    fn tiles_have_2048_to_8192_vertices_or_more_where_there_were_too_many_of_them() {
        let digits = |count, size| tile_digits(count, rule(size));
        assert_eq!([4096, 4097, 65_535].map(|count| digits(count, 4)), [None, Some(11), Some(11)]);
        assert_eq!([65_536, 131_071].map(|count| digits(count, 4)), [Some(12); 2]);
        let most = 256 * 8192;
        assert_eq!([131_072, most].map(|count| digits(count, 4)), [Some(13); 2]);
        assert_eq!([most + 1, 5 * most].map(|count| digits(count, 4)), [Some(14), Some(16)]);
        // Few of them go.
        let (count, part) = (most, most / LEAST_PART);
        assert_eq!(digits(count, count - part), None);
        assert_eq!(digits(count, count - part - 1), Some(13));
        let bound = Some(crate::parameters::ErrorBound::PsnrDb(30.0));
        assert_eq!(tile_digits(count, StopRule { bound, ..rule(4) }), None);
    }

    #[test]
    fn a_limit_has_as_many_below_it_as_asked_for_and_quotas_are_twice_these() {
        let plane = (0..900).map(|i| (i * i / 7 % 16) as u16).collect();
        let image = Image::from_bottom_up(30, 30, 4, vec![plane]).unwrap();
        let triangulation = Triangulation::new(all_points(30, 30), &()).unwrap();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe);
        let Prepared { stars, entries, .. } =
            prepare(&image, triangulation, rule(4), &measure, 6, &()).unwrap();
        let mut tiles = tiles(stars, entries.clone());
        assert_eq!(tiles.len(), 900_usize.div_ceil(64));
        for (count, size, least) in [(0, 64, 0), (100, 64, 0), (300, 1024, 2)] {
            let limit = set_quotas(&mut tiles, count, size);
            let is_below = |entry: &&Entry| **entry < limit;
            assert_eq!(entries.iter().filter(is_below).count(), count);
            for (number, tile) in tiles.iter().enumerate() {
                let own = |entry: &&Entry| entry.vertex as usize / 64 == number;
                let below = entries.iter().filter(is_below).filter(own).count();
                assert_eq!(tile.quota, 2 * below + least);
            }
        }
    }
}
