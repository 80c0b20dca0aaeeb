//! Patches: parts of a triangulation that are changed apart from the rest, on threads of their own.
//!
//! The vertices are parted into blocks of the plane; a patch has the triangles whose vertices are all
//! of one part. What lies beyond its edge, the fence, is not known to it, so a change that a triangle
//! there might have a say in is not made. As the triangles at the fence never change then, a patch fits
//! into the rest afterwards whatever has happened in it, and in others, meanwhile.

use crate::dynamic_mesh::half_edges::{DynamicTriangulation, FENCE};
use crate::image::Point;
use crate::triangulation::NONE;

/// Which vertices and triangles make up each patch.
pub(crate) struct Partition {
    /// The vertices and the slots of each part.
    pub(crate) parts: Vec<Part>,
    /// The number of each vertex and slot in its part; [`NONE`] of those that are in none.
    vertex_numbers: Vec<u32>,
    slot_numbers: Vec<u32>,
    /// The part of each vertex and slot.
    part_of_vertex: Vec<u32>,
    part_of_slot: Vec<u32>,
}

/// The vertices and slots of a patch.
#[derive(Clone, Default)]
pub(crate) struct Part {
    pub(crate) vertices: Vec<u32>,
    pub(crate) slots: Vec<u32>,
}

/// Along which lines the plane is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cuts {
    /// Rows and columns.
    Straight,
    /// Diagonals, which have but few points in common with the straight cuts.
    Diagonal,
}

impl Cuts {
    /// Where a point lies across the cuts of the one direction and of the other.
    fn coordinates(self, p: Point) -> [i32; 2] {
        match self {
            Self::Straight => [p.x, p.y],
            Self::Diagonal => [p.x + p.y, p.x - p.y],
        }
    }
}

impl Partition {
    /// Parts a triangulation into two to the power of `halvings` parts of as many vertices each.
    pub(crate) fn new(triangulation: &DynamicTriangulation, cuts: Cuts, halvings: u32) -> Self {
        let outgoing = &triangulation.outgoing;
        let mut vertices: Vec<u32> = (0..outgoing.len() as u32).collect();
        vertices.retain(|&v| outgoing[v as usize] != NONE);
        let at = |v: u32| cuts.coordinates(triangulation.points[v as usize]);
        halve(&mut vertices, &at, halvings);
        let mut parts = vec![Part::default(); 1 << halvings];
        let (mut part_of_vertex, mut vertex_numbers) =
            (vec![NONE; outgoing.len()], vec![NONE; outgoing.len()]);
        let (count, mut rest) = (vertices.len(), &mut vertices[..]);
        for (p, part) in parts.iter_mut().enumerate() {
            let (own, others) = rest
                .split_at_mut(block_end(count, p + 1, halvings) - block_end(count, p, halvings));
            own.sort_unstable();
            for (number, &v) in (0..).zip(own.iter()) {
                (part_of_vertex[v as usize], vertex_numbers[v as usize]) = (p as u32, number);
            }
            part.vertices = own.to_vec();
            rest = others;
        }
        let mut partition = Self {
            parts,
            part_of_vertex,
            vertex_numbers,
            slot_numbers: vec![NONE; triangulation.slot_count()],
            part_of_slot: vec![NONE; triangulation.slot_count()],
        };
        partition.part_slots(triangulation);
        partition
    }

    /// The numbers that vertices have in their parts, in the order given here, for each part.
    pub(crate) fn in_parts(&self, order: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
        let mut orders = vec![Vec::new(); self.parts.len()];
        for v in order {
            let part = self.part_of_vertex[v as usize];
            if part != NONE {
                orders[part as usize].push(self.vertex_numbers[v as usize]);
            }
        }
        orders
    }

    /// Gives each slot whose vertices are all of one part to it.
    fn part_slots(&mut self, triangulation: &DynamicTriangulation) {
        let used =
            (0..triangulation.slot_count() as u32).filter(|&slot| triangulation.is_used(slot));
        for slot in used {
            let corners = triangulation.vertices_of(slot);
            let [a, b, c] = corners.map(|v| self.part_of_vertex[v as usize]);
            if a == b && b == c {
                let slots = &mut self.parts[a as usize].slots;
                self.slot_numbers[slot as usize] = slots.len() as u32;
                self.part_of_slot[slot as usize] = a;
                slots.push(slot);
            }
        }
    }
}

/// Where a block of so many vertices ends: after `halvings` all are as large as can be.
fn block_end(count: usize, block: usize, halvings: u32) -> usize {
    (count * block) >> halvings
}

/// Orders vertices so that each half of each half, so often, is a block of the plane, cut across its
/// longer side, of equal ones across the first; `at` gives their places.
fn halve(vertices: &mut [u32], at: &impl Fn(u32) -> [i32; 2], halvings: u32) {
    halve_blocks(vertices, at, (0, vertices.len()), (0, 1 << halvings), halvings);
}

/// The same of the blocks from the first to before the end.
fn halve_blocks(
    vertices: &mut [u32],
    at: &impl Fn(u32) -> [i32; 2],
    (offset, count): (usize, usize),
    (first, end): (usize, usize),
    halvings: u32,
) {
    if end - first < 2 || vertices.is_empty() {
        return;
    }
    let extent = |axis: usize| {
        let places = || vertices.iter().map(|&v| at(v)[axis]);
        places().max().unwrap_or(0) - places().min().unwrap_or(0)
    };
    let middle = first.midpoint(end);
    let cut = block_end(count, middle, halvings) - offset;
    let across = usize::from(extent(1) > extent(0));
    let key = |v: &u32| (at(*v)[across], at(*v)[1 - across]);
    if cut < vertices.len() {
        vertices.select_nth_unstable_by_key(cut, key);
    }
    let (low, high) = vertices.split_at_mut(cut);
    halve_blocks(low, at, (offset, count), (first, middle), halvings);
    halve_blocks(high, at, (offset + cut, count), (middle, end), halvings);
}

impl DynamicTriangulation {
    /// The patch of one part, which numbers vertices and slots as that does, and for each vertex
    /// whether all of its triangles are in it.
    pub(crate) fn patch(&self, partition: &Partition, number: u32) -> (Self, Vec<bool>) {
        let Part { vertices, slots } = &partition.parts[number as usize];
        let half_edge = |h: u32| match partition.part_of_slot[h as usize / 3] {
            part if part == number => Some(3 * partition.slot_numbers[h as usize / 3] + h % 3),
            _ => None,
        };
        let sides = || slots.iter().flat_map(|&slot| 3 * slot..3 * slot + 3);
        let twin = |h: u32| match self.twins[h as usize] {
            NONE => NONE,
            twin => half_edge(twin).unwrap_or(FENCE),
        };
        let origin = |h: u32| partition.vertex_numbers[self.origins[h as usize] as usize];
        let way_out = |v: &u32| half_edge(self.outgoing[*v as usize]).unwrap_or(NONE);
        let patch = Self {
            points: vertices.iter().map(|&v| self.points[v as usize]).collect(),
            origins: sides().map(origin).collect(),
            twins: sides().map(twin).collect(),
            outgoing: vertices.iter().map(way_out).collect(),
            free: Vec::new(),
            right: self.right,
            top: self.top,
        };
        let mut is_inner: Vec<bool> = patch.outgoing.iter().map(|&h| h != NONE).collect();
        for (h, _) in (0..).zip(&patch.twins).filter(|(_, twin)| **twin == FENCE) {
            for end in [h, crate::triangulation::next(h)] {
                is_inner[patch.origins[end as usize] as usize] = false;
            }
        }
        (patch, is_inner)
    }

    /// Puts a patch back; `hear` hears of each of its slots and the one that it has here.
    pub(crate) fn put_in(&mut self, part: &Part, patch: &Self, mut hear: impl FnMut(u32, u32)) {
        let mut slots = part.slots.clone();
        while slots.len() < patch.slot_count() {
            slots.push(self.free_slot());
        }
        let half_edge = |h: u32| 3 * slots[h as usize / 3] + h % 3;
        for (number, &slot) in (0..).zip(&slots) {
            hear(number, slot);
            if !patch.is_used(number) {
                self.origins[3 * slot as usize..][..3].fill(NONE);
                self.free.push(slot);
                continue;
            }
            for (from, to) in (3 * number as usize..).zip(3 * slot as usize..).take(3) {
                self.origins[to] = part.vertices[patch.origins[from] as usize];
                match patch.twins[from] {
                    FENCE => {}
                    NONE => self.twins[to] = NONE,
                    twin => self.twins[to] = half_edge(twin),
                }
            }
        }
        for ((&v, &point), &h) in part.vertices.iter().zip(&patch.points).zip(&patch.outgoing) {
            self.points[v as usize] = point;
            if h != NONE {
                self.outgoing[v as usize] = half_edge(h);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::corner_points;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn parts_are_blocks_of_as_many_vertices_and_patches_hold_the_triangles_within_them(
            (width, height) in (2i32..20, 2i32..20),
            seeds in prop::collection::vec((0i32..20, 0i32..20), 0..60),
            halvings in 0u32..4,
            cuts in prop::sample::select(&[Cuts::Straight, Cuts::Diagonal][..]),
        ) {
            let seeds = seeds.iter().map(|&(x, y)| Point::new(x % width, y % height));
            let points: BTreeSet<Point> =
                seeds.chain(corner_points(width as usize, height as usize)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let faces = triangulate(&points);
            let (width, height) = (width as usize, height as usize);
            let mut whole = DynamicTriangulation::new(points.clone(), &faces, width, height);
            let partition = Partition::new(&whole, cuts, halvings);
            prop_assert_eq!(partition.parts.len(), 1 << halvings);
            let mut part_of = vec![usize::MAX; points.len()];
            for (p, part) in partition.parts.iter().enumerate() {
                let fair = points.len() >> halvings;
                prop_assert!((fair..=fair + 1).contains(&part.vertices.len()));
                for &v in &part.vertices {
                    prop_assert_eq!(std::mem::replace(&mut part_of[v as usize], p), usize::MAX);
                }
            }
            for p in 0..partition.parts.len() {
                let part = &partition.parts[p];
                let within = |face: &[u32; 3]| face.iter().all(|&v| part_of[v as usize] == p);
                let expected = faces.iter().filter(|face| within(face)).count();
                let (patch, is_inner) = whole.patch(&partition, p as u32);
                prop_assert_eq!(patch.slot_count(), expected);
                for slot in 0..expected as u32 {
                    let there = part.slots[slot as usize];
                    prop_assert_eq!(patch.corners(slot), whole.corners(there));
                }
                for (number, &v) in part.vertices.iter().enumerate() {
                    let mut around = faces.iter().filter(|face| face.contains(&v));
                    prop_assert_eq!(is_inner[number], around.all(within));
                }
                whole.put_in(part, &patch, |from, to| {
                    assert_eq!(part.slots[from as usize], to);
                });
            }
            let places = |part: &Part| {
                let across = |v: &u32| {
                    let Point { x, y } = points[*v as usize];
                    match cuts {
                        Cuts::Straight => Point::new(x, y),
                        Cuts::Diagonal => Point::new(x + y, x - y),
                    }
                };
                part.vertices.iter().map(across).collect()
            };
            let blocks: Vec<Vec<Point>> = partition.parts.iter().map(places).collect();
            if halvings > 0 {
                assert_cut_across_the_longer_side(&blocks);
            }
            prop_assert_eq!(whole.mesh().1, faces);
        }

        #[test]
        fn a_few_vertices_are_parted_into_more_parts_than_there_are_of_them(
            seeds in prop::collection::vec((0i32..20, 0i32..20), 0..12),
        ) {
            let seeds = seeds.iter().map(|&(x, y)| Point::new(x, y));
            let points: BTreeSet<Point> = seeds.chain(corner_points(20, 20)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let whole = DynamicTriangulation::new(points.clone(), &triangulate(&points), 20, 20);
            let parts = Partition::new(&whole, Cuts::Straight, 4).parts;
            prop_assert_eq!(parts.len(), 16);
            prop_assert_eq!(parts.iter().map(|part| part.vertices.len()).sum::<usize>(), points.len());
            prop_assert!(parts.iter().all(|part| part.vertices.len() <= 1));
        }
    }

    /// Of each two halves one is at the left of the other, or below it where together they are higher
    /// than wide.
    fn assert_cut_across_the_longer_side(blocks: &[Vec<Point>]) {
        let [low, high] = [0, 1].map(|half| {
            let half_count = blocks.len() / 2;
            &blocks[half * half_count..][..half_count]
        });
        let side = |of: fn(&Point) -> i32| {
            let all = || blocks.iter().flatten().map(of);
            all().max().zip(all().min()).map_or(0, |(most, least)| most - least)
        };
        let is_wide = side(|p| p.x) >= side(|p| p.y);
        let key = |p: &Point| if is_wide { (p.x, p.y) } else { (p.y, p.x) };
        let last = low.iter().flatten().map(key).max();
        let first = high.iter().flatten().map(key).min();
        assert!(last.zip(first).is_none_or(|(last, first)| last < first), "{blocks:?}");
        for half in [low, high].into_iter().filter(|half| half.len() > 1) {
            assert_cut_across_the_longer_side(half);
        }
    }
}
