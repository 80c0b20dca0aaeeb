//! A partition of a triangulation into patches of equally many vertices.
//!
//! The plane is cut into blocks, each across its longer side. A patch has the triangles whose
//! vertices are all in one block. The other triangles belong to no patch and do not change while
//! patches do, so a patch fits into the rest afterwards, whatever changed in it and in others.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, poll_at};
use crate::image::Point;
use crate::triangulation::NONE;

/// Which vertices and triangles make up each patch.
pub(crate) struct Partition {
    pub(crate) patches: Vec<PatchIndices>,
    /// The patch of each vertex and slot, and its index there; [`NONE`] where it is in none.
    pub(super) vertices: Vec<Location>,
    pub(super) slots: Vec<Location>,
}

/// The vertices and slots of a patch, by their indices in the whole triangulation.
#[derive(Clone, Default)]
pub(crate) struct PatchIndices {
    pub(crate) vertices: Vec<u32>,
    pub(crate) slots: Vec<u32>,
}

/// Where in a partition a vertex or a slot is.
#[derive(Clone, Copy)]
pub(super) struct Location {
    pub(super) patch: u32,
    pub(super) index: u32,
}

const NOWHERE: Location = Location { patch: NONE, index: NONE };

/// The direction of the cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cuts {
    /// Along rows and columns.
    Straight,
    /// Along diagonals, which share few points with the straight cuts.
    Diagonal,
}

impl Cuts {
    /// The coordinates of a point across the cuts of both directions.
    fn coordinates(self, p: Point) -> [i32; 2] {
        match self {
            Self::Straight => [p.x, p.y],
            Self::Diagonal => [p.x + p.y, p.x - p.y],
        }
    }
}

impl Partition {
    /// Halves a triangulation `halvings` times.
    ///
    /// # Errors
    /// When the control cancels.
    pub(crate) fn new(
        triangulation: &DynamicTriangulation,
        cuts: Cuts,
        halvings: u32,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let outgoing = &triangulation.outgoing;
        let mut order: Vec<u32> = (0..outgoing.len() as u32).collect();
        order.retain(|&v| outgoing[v as usize] != NONE);
        let coordinates = |v: u32| cuts.coordinates(triangulation.points[v as usize]);
        let mut blocks = Vec::new();
        halve(&mut order, &coordinates, halvings, &mut blocks, control)?;
        let mut partition = Self {
            patches: Vec::new(),
            vertices: vec![NOWHERE; outgoing.len()],
            slots: vec![NOWHERE; triangulation.slot_count()],
        };
        for (patch, mut vertices) in (0..).zip(blocks) {
            vertices.sort_unstable();
            for (index, &v) in (0..).zip(&vertices) {
                partition.vertices[v as usize] = Location { patch, index };
            }
            partition.patches.push(PatchIndices { vertices, slots: Vec::new() });
        }
        partition.assign_slots(triangulation, control)?;
        Ok(partition)
    }

    /// For each patch the indices there of those of some vertices that are in it, in their order.
    pub(crate) fn by_patch(&self, order: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
        let mut orders = vec![Vec::new(); self.patches.len()];
        for v in order {
            let Location { patch, index } = self.vertices[v as usize];
            if patch != NONE {
                orders[patch as usize].push(index);
            }
        }
        orders
    }

    /// Assigns each slot whose vertices are all in one patch to it.
    fn assign_slots(
        &mut self,
        triangulation: &DynamicTriangulation,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        for slot in 0..triangulation.slot_count() as u32 {
            poll_at(slot as usize, control)?;
            if !triangulation.is_used(slot) {
                continue;
            }
            let corners = triangulation.vertices_of(slot);
            let [patch, b, c] = corners.map(|v| self.vertices[v as usize].patch);
            if patch == b && b == c {
                let slots = &mut self.patches[patch as usize].slots;
                self.slots[slot as usize] = Location { patch, index: slots.len() as u32 };
                slots.push(slot);
            }
        }
        Ok(())
    }
}

/// Halves vertices `halvings` times, each time across the longer side of their bounding box, and
/// pushes the blocks. Of equally long sides the first is cut.
fn halve(
    vertices: &mut [u32],
    coordinates: &impl Fn(u32) -> [i32; 2],
    halvings: u32,
    blocks: &mut Vec<Vec<u32>>,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    control.poll(Stage::Refine, 0, 1)?;
    if halvings == 0 {
        blocks.push(vertices.to_vec());
        return Ok(());
    }
    let extent = |axis: usize| {
        let values = || vertices.iter().map(|&v| coordinates(v)[axis]);
        values().max().unwrap_or(0) - values().min().unwrap_or(0)
    };
    let across = usize::from(extent(1) > extent(0));
    let key = |v: &u32| (coordinates(*v)[across], coordinates(*v)[1 - across]);
    let middle = vertices.len() / 2;
    if middle > 0 {
        vertices.select_nth_unstable_by_key(middle, key);
    }
    let (low, high) = vertices.split_at_mut(middle);
    halve(low, coordinates, halvings - 1, blocks, control)?;
    halve(high, coordinates, halvings - 1, blocks, control)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::corner_points;
    use crate::triangulation::{Triangulation, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn patches_are_equal_blocks_with_their_triangles(
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
            let triangulation = Triangulation::new(points.clone(), &()).unwrap();
            let mut whole = DynamicTriangulation::new(triangulation, width, height, &()).unwrap();
            let partition = Partition::new(&whole, cuts, halvings, &()).unwrap();
            prop_assert_eq!(partition.patches.len(), 1 << halvings);
            let mut part_of = vec![usize::MAX; points.len()];
            for (p, part) in partition.patches.iter().enumerate() {
                let fair = points.len() >> halvings;
                prop_assert!((fair..=fair + 1).contains(&part.vertices.len()));
                for &v in &part.vertices {
                    prop_assert_eq!(std::mem::replace(&mut part_of[v as usize], p), usize::MAX);
                }
            }
            for p in 0..partition.patches.len() {
                let part = &partition.patches[p];
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
                prop_assert_eq!(&whole.put_patch(part, &patch), &part.slots);
            }
            let positions = |part: &PatchIndices| {
                let across = |v: &u32| {
                    let Point { x, y } = points[*v as usize];
                    match cuts {
                        Cuts::Straight => Point::new(x, y),
                        Cuts::Diagonal => Point::new(x + y, x - y),
                    }
                };
                part.vertices.iter().map(across).collect()
            };
            let blocks: Vec<Vec<Point>> = partition.patches.iter().map(positions).collect();
            if halvings > 0 {
                assert_cut_across_the_longer_side(&blocks);
            }
            prop_assert_eq!(whole.mesh().1, faces);
        }

        #[test]
        fn more_patches_than_vertices(
            seeds in prop::collection::vec((0i32..20, 0i32..20), 0..12),
        ) {
            let seeds = seeds.iter().map(|&(x, y)| Point::new(x, y));
            let points: BTreeSet<Point> = seeds.chain(corner_points(20, 20)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let triangulation = Triangulation::new(points.clone(), &()).unwrap();
            let whole = DynamicTriangulation::new(triangulation, 20, 20, &()).unwrap();
            let parts = Partition::new(&whole, Cuts::Straight, 4, &()).unwrap().patches;
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
