//! Patches: parts of a mesh that threads change on their own.
//!
//! The plane is cut into blocks, each across its longer side. A patch has the triangles whose
//! vertices are all in one block. The other triangles belong to no patch and stay as they are while
//! patches change, so a changed patch fits into the rest. A move that would replace a triangle at
//! the boundary of a patch is not made: a patch has the triangles that the whole mesh would have.

use crate::control::{Cancelled, Control, Poller, Stage, select};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::half_edges::{DynamicTriangulation, PATCH_BOUNDARY};
use crate::face_error::FaceMeasure;
use crate::image::Point;
use crate::triangulation::{NONE, next};

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

#[derive(Clone, Copy)]
pub(super) struct Location {
    pub(super) patch: u32,
    pub(super) index: u32,
}

const NOWHERE: Location = Location { patch: NONE, index: NONE };

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cuts {
    Straight,
    /// Along diagonals, which share few points with the straight cuts.
    Diagonal,
}

impl Cuts {
    pub(crate) const BOTH: [Self; 2] = [Self::Straight, Self::Diagonal];

    /// The coordinates of a point across the cuts of both directions.
    fn coordinates(self, p: Point) -> [i32; 2] {
        match self {
            Self::Straight => [p.x, p.y],
            Self::Diagonal => [p.x + p.y, p.x - p.y],
        }
    }
}

impl Partition {
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
        let mut partition = Self {
            patches: Vec::new(),
            vertices: vec![NOWHERE; outgoing.len()],
            slots: vec![NOWHERE; triangulation.slot_count()],
        };
        for (patch, mut vertices) in (0..).zip(halve(order, coordinates, halvings, control)?) {
            vertices.sort_unstable();
            for (index, &v) in (0..).zip(&vertices) {
                partition.vertices[v as usize] = Location { patch, index };
            }
            partition.patches.push(PatchIndices { vertices, slots: Vec::new() });
        }
        let mut poller = Poller::new(control, Stage::Refine, 0, 1);
        for slot in 0..triangulation.slot_count() as u32 {
            poller.step(1)?;
            if !triangulation.is_used(slot) {
                continue;
            }
            let corners = triangulation.vertices_of(slot);
            let [patch, b, c] = corners.map(|v| partition.vertices[v as usize].patch);
            if patch == b && b == c {
                let slots = &mut partition.patches[patch as usize].slots;
                partition.slots[slot as usize] = Location { patch, index: slots.len() as u32 };
                slots.push(slot);
            }
        }
        Ok(partition)
    }

    /// Divides vertices by their patches, in their order: for each patch their indices there.
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
}

/// Halves vertices `halvings` times, each time across the longer side of each block's bounding box;
/// of equally long sides the first is cut.
fn halve(
    vertices: Vec<u32>,
    coordinates: impl Fn(u32) -> [i32; 2],
    halvings: u32,
    control: &dyn Control,
) -> Result<Vec<Vec<u32>>, Cancelled> {
    let mut blocks = vec![vertices];
    for _ in 0..halvings {
        let mut halves = Vec::with_capacity(2 * blocks.len());
        for block in blocks {
            control.poll(Stage::Refine, 0, 1)?;
            let extent = |axis: usize| {
                let values = || block.iter().map(|&v| coordinates(v)[axis]);
                values().max().unwrap_or(0) - values().min().unwrap_or(0)
            };
            let across = usize::from(extent(1) > extent(0));
            let key = |&v: &u32| (coordinates(v)[across], coordinates(v)[1 - across], v);
            let mut keys: Vec<_> = block.iter().map(key).collect();
            let middle = keys.len() / 2;
            if middle > 0 {
                select(&mut keys, middle, &|| control.poll(Stage::Refine, 0, 1))?;
            }
            let (low, high) = keys.split_at(middle);
            halves.extend([low, high].map(|half| half.iter().map(|&(.., v)| v).collect()));
        }
        blocks = halves;
    }
    Ok(blocks)
}

impl<M: FaceMeasure> MeasuredMesh<M> {
    /// A copy of a patch. Only vertices with all their triangles in it are in its mesh.
    pub(crate) fn patch(&self, partition: &Partition, number: usize) -> Self {
        let triangulation = self.triangulation.patch(partition, number);
        Self::of_parts(triangulation, self.evaluator.measure.clone())
    }
}

impl DynamicTriangulation {
    fn patch(&self, partition: &Partition, number: usize) -> Self {
        let PatchIndices { vertices, slots } = &partition.patches[number];
        let half_edge = |h: u32| {
            let location = partition.slots[h as usize / 3];
            (location.patch == number as u32).then(|| 3 * location.index + h % 3)
        };
        let sides = || slots.iter().flat_map(|&slot| 3 * slot..3 * slot + 3);
        let twin = |h: u32| match self.twins[h as usize] {
            NONE => NONE,
            twin => half_edge(twin).unwrap_or(PATCH_BOUNDARY),
        };
        let origin = |h: u32| partition.vertices[self.origins[h as usize] as usize].index;
        let outgoing = |v: &u32| half_edge(self.outgoing[*v as usize]).unwrap_or(NONE);
        let mut patch = Self {
            points: vertices.iter().map(|&v| self.points[v as usize]).collect(),
            origins: sides().map(origin).collect(),
            twins: sides().map(twin).collect(),
            outgoing: vertices.iter().map(outgoing).collect(),
            free: Vec::new(),
            face_errors: slots.iter().map(|&slot| self.face_error(slot)).collect(),
            ..*self
        };
        let sides = (0..).zip(&patch.twins).filter(|(_, twin)| **twin == PATCH_BOUNDARY);
        for end in sides.flat_map(|(h, _)| [h, next(h)]) {
            patch.outgoing[patch.origins[end as usize] as usize] = NONE;
        }
        patch
    }

    pub(crate) fn put_patch(&mut self, indices: &PatchIndices, patch: &Self) {
        let mut slots = indices.slots.clone();
        while slots.len() < patch.slot_count() {
            slots.push(self.free_slot());
        }
        let half_edge = |h: u32| 3 * slots[h as usize / 3] + h % 3;
        for (index, &slot) in (0..).zip(&slots) {
            if !patch.is_used(index) {
                self.free(slot);
                continue;
            }
            self.set_face_error(slot, patch.face_error(index));
            for (from, to) in (3 * index as usize..).zip(3 * slot as usize..).take(3) {
                self.origins[to] = indices.vertices[patch.origins[from] as usize];
                match patch.twins[from] {
                    PATCH_BOUNDARY => {}
                    NONE => self.twins[to] = NONE,
                    twin => self.twins[to] = half_edge(twin),
                }
            }
        }
        for ((&v, &point), &h) in indices.vertices.iter().zip(&patch.points).zip(&patch.outgoing) {
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
    use crate::triangulation::{Triangulation, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn patches_are_equal_blocks_with_their_faces(
            (width, height) in (2usize..20, 2usize..20),
            seeds in prop::collection::vec((0usize..20, 0usize..20), 0..60),
            halvings in 0u32..5,
            cuts in prop::sample::select(&Cuts::BOTH[..]),
        ) {
            let seeds = seeds
                .iter()
                .map(|&(x, y)| Point::new((x % width) as i32, (y % height) as i32));
            let points: BTreeSet<Point> = seeds.chain(corner_points(width, height)).collect();
            let points: Vec<Point> = points.into_iter().collect();
            let faces = triangulate(&points);
            let triangulation = Triangulation::new(points.clone(), &()).unwrap();
            let mut whole =
                DynamicTriangulation::new(triangulation, (width, height), &()).unwrap();
            let partition = Partition::new(&whole, cuts, halvings, &()).unwrap();
            prop_assert_eq!(partition.patches.len(), 1 << halvings);
            let mut patch_of = vec![usize::MAX; points.len()];
            for (number, indices) in partition.patches.iter().enumerate() {
                let fair = points.len() >> halvings;
                prop_assert!((fair..=fair + 1).contains(&indices.vertices.len()));
                for &v in &indices.vertices {
                    let before = std::mem::replace(&mut patch_of[v as usize], number);
                    prop_assert_eq!(before, usize::MAX);
                }
            }
            for (number, indices) in partition.patches.iter().enumerate() {
                let is_inside =
                    |face: &[u32; 3]| face.iter().all(|&v| patch_of[v as usize] == number);
                let patch = whole.patch(&partition, number);
                let count = faces.iter().filter(|face| is_inside(face)).count();
                prop_assert_eq!(patch.slot_count(), count);
                for (slot, &there) in (0..).zip(&indices.slots) {
                    prop_assert_eq!(patch.corners(slot), whole.corners(there));
                }
                for (&outgoing, v) in patch.outgoing.iter().zip(&indices.vertices) {
                    let mut around = faces.iter().filter(|face| face.contains(v));
                    prop_assert_eq!(outgoing != NONE, around.all(is_inside));
                }
                whole.put_patch(indices, &patch);
            }
            let position = |&v: &u32| {
                let [x, y] = cuts.coordinates(points[v as usize]);
                Point::new(x, y)
            };
            let block = |indices: &PatchIndices| indices.vertices.iter().map(position).collect();
            assert_cut_across_the_longer_side(
                &partition.patches.iter().map(block).collect::<Vec<_>>(),
            );
            prop_assert_eq!(whole.sorted(&()).unwrap().faces, faces);
        }
    }

    /// Of each two halves one is left of the other, or below it where together they are higher than
    /// wide.
    fn assert_cut_across_the_longer_side(blocks: &[Vec<Point>]) {
        if blocks.len() < 2 {
            return;
        }
        let (low, high) = blocks.split_at(blocks.len() / 2);
        let side = |of: fn(&Point) -> i32| {
            let all = || blocks.iter().flatten().map(of);
            all().max().zip(all().min()).map_or(0, |(most, least)| most - least)
        };
        let is_wide = side(|p| p.x) >= side(|p| p.y);
        let key = |p: &Point| if is_wide { (p.x, p.y) } else { (p.y, p.x) };
        let last = low.iter().flatten().map(key).max();
        let first = high.iter().flatten().map(key).min();
        assert!(last.zip(first).is_none_or(|(last, first)| last < first), "{blocks:?}");
        assert_cut_across_the_longer_side(low);
        assert_cut_across_the_longer_side(high);
    }
}
