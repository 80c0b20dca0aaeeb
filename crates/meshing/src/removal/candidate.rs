//! What the removal of a vertex would change, found without touching the mesh.
//!
//! The hole is filled, which gives every neighbour a new star and a new key; nothing else changes.
//! Whether that comes true is for the caller to say, so that many removals can be prepared at once.

use crate::face_error::{FaceErrors, Measure};
use crate::image::Point;
use crate::removal::fill_cache::{HoleMemory, Shift};
use crate::removal::small_candidate::FewHoles;
use crate::removal::star::{Gap, Packed, Star};
use crate::removal::vertices::MeshView;
use crate::triangulation::hole::HoleFiller;

/// The state of a neighbour after a removal.
pub(crate) struct Neighbour {
    pub(crate) vertex: u32,
    pub(crate) star: Packed,
    /// By how much its own removal would change the error; `None` for a corner of the image, which
    /// stays.
    pub(crate) change: Option<i64>,
}

/// Prepares removals; keeps its memory from one to the next.
pub(crate) struct Remover<'m> {
    errors: FaceErrors<'m>,
    filler: HoleFiller,
    /// Does the removals of few neighbours.
    few: FewHoles,
    /// The star in work and the places of its neighbours.
    star: Star,
    boundary: Vec<Point>,
    /// The error of each triangle of the last fill.
    fill_errors: Vec<u64>,
    /// The triangles of the last fill that are not remembered, and their errors.
    unknown: Vec<usize>,
    faces: Vec<[Point; 3]>,
    face_errors: Vec<u64>,
    /// The star of the vertex that goes, and its fill as seen from each neighbour.
    hole: Star,
    wedges: Vec<Wedge>,
    successors: Vec<u32>,
    gap_errors: Vec<u64>,
}

/// A triangle of a fill, as seen from one of its vertices.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Wedge {
    /// The place of that vertex on the boundary.
    place: u32,
    /// How many places after it the next vertex comes: wedges of a vertex turn counter-clockwise.
    offset: u32,
    /// The place of the third vertex.
    end: u32,
    error: u64,
}

impl<'m> Remover<'m> {
    pub(crate) fn new(measure: &'m Measure<'m>) -> Self {
        Self {
            errors: FaceErrors::new(measure),
            filler: HoleFiller::default(),
            few: FewHoles::default(),
            star: Star::default(),
            boundary: Vec::new(),
            fill_errors: Vec::new(),
            unknown: Vec::new(),
            faces: Vec::new(),
            face_errors: Vec::new(),
            hole: Star::default(),
            wedges: Vec::new(),
            successors: Vec::new(),
            gap_errors: Vec::new(),
        }
    }

    /// By how much the error changes when a vertex goes, and what to remember of its hole.
    pub(crate) fn evaluate(&mut self, vertex: u32, net: &MeshView<'_>) -> (i64, HoleMemory) {
        let few = self.few.evaluate(vertex, net, &mut self.errors);
        few.unwrap_or_else(|| self.evaluate_any(vertex, net))
    }

    /// The same for a vertex of any number of neighbours and any errors.
    pub(crate) fn evaluate_any(&mut self, vertex: u32, net: &MeshView<'_>) -> (i64, HoleMemory) {
        net.stars(vertex).read(vertex, &mut self.star);
        let change = self.change(net, net.stars(vertex).memory(vertex), Shift::NONE);
        (change, self.memory())
    }

    /// The states of all neighbours after a vertex has gone.
    pub(crate) fn prepare(
        &mut self,
        vertex: u32,
        net: &MeshView<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) {
        let stars = net.stars(vertex);
        stars.prefetch(stars.neighbours(vertex));
        neighbours.clear();
        if self.few.prepare(vertex, net, &mut self.errors, neighbours).is_none() {
            self.prepare_any(vertex, net, neighbours);
        }
    }

    /// The same for a vertex of any number of neighbours and any errors.
    pub(crate) fn prepare_any(
        &mut self,
        vertex: u32,
        net: &MeshView<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) {
        neighbours.clear();
        net.stars(vertex).read(vertex, &mut self.star);
        let memory = net.stars(vertex).memory(vertex);
        if !self.recall(memory) {
            self.change(net, memory, Shift::NONE);
        }
        self.collect_wedges();
        std::mem::swap(&mut self.hole, &mut self.star);
        let is_open = net.is_on_border(vertex);
        let mut first = 0;
        for place in 0..self.hole.neighbours.len() {
            let others = &self.wedges[first..];
            let count = others.iter().take_while(|wedge| wedge.place == place as u32).count();
            self.close_gap(place, first..first + count, is_open);
            first += count;
            neighbours.push(self.neighbour(self.hole.neighbours[place], vertex, net));
        }
    }

    /// Takes the fill of the star in work from memory, if all of it is remembered.
    fn recall(&mut self, memory: &HoleMemory) -> bool {
        let Some(fill) = memory.recall(self.star.neighbours.len() - 2) else { return false };
        self.fill_errors.clear();
        self.filler.take(fill.map(|(triangle, error)| {
            self.fill_errors.push(error);
            triangle
        }));
        true
    }

    /// The change of error of the star in work, and its fill.
    #[inline]
    fn change(&mut self, net: &MeshView<'_>, memory: &HoleMemory, shift: Shift) -> i64 {
        self.boundary.clear();
        self.boundary.extend(self.star.neighbours.iter().map(|&v| net.point(v)));
        self.fill_errors.clear();
        self.unknown.clear();
        self.faces.clear();
        let mut sum = 0;
        for (i, &triangle) in self.filler.fill(&self.boundary).iter().enumerate() {
            let known = shift.before(triangle).and_then(|before| memory.error(before));
            if known.is_none() {
                self.unknown.push(i);
                self.faces.push(triangle.map(|place| self.boundary[place as usize]));
            }
            let known = known.unwrap_or_default();
            self.fill_errors.push(known);
            sum += known;
        }
        self.errors.errors(&self.faces, &mut self.face_errors);
        for (&i, &error) in self.unknown.iter().zip(&self.face_errors) {
            self.fill_errors[i] = error;
            sum += error;
        }
        sum as i64 - self.star.error() as i64
    }

    /// What to remember of the last fill.
    fn memory(&self) -> HoleMemory {
        HoleMemory::of(self.filler.triangles(), &self.fill_errors)
    }

    /// The last fill as seen from each vertex of the boundary, in their order.
    fn collect_wedges(&mut self) {
        let degree = self.star.neighbours.len() as u32;
        self.wedges.clear();
        for (&[a, b, c], &error) in self.filler.triangles().iter().zip(&self.fill_errors) {
            for (place, next, end) in [(a, b, c), (b, c, a), (c, a, b)] {
                let offset = if next > place { next - place } else { next + degree - place };
                self.wedges.push(Wedge { place, offset, end, error });
            }
        }
        self.wedges.sort_unstable_by_key(|wedge| (wedge.place, wedge.offset));
    }

    /// What stands in the star of the neighbour at `place` where the vertex was: the ends of all
    /// its wedges but the last; along the border that last one too, or the start of the first.
    fn close_gap(&mut self, place: usize, wedges: std::ops::Range<usize>, is_open: bool) {
        let last = self.hole.neighbours.len() - 1;
        self.successors.clear();
        self.gap_errors.clear();
        if is_open && place == last {
            self.successors.push(self.hole.neighbours[0]);
        }
        for wedge in &self.wedges[wedges] {
            self.successors.push(self.hole.neighbours[wedge.end as usize]);
            self.gap_errors.push(wedge.error);
        }
        if !(is_open && place == 0) {
            self.successors.pop();
        }
    }

    /// The state of a neighbour after `gone` has gone, with the gap closed as found.
    fn neighbour(&mut self, vertex: u32, gone: u32, net: &MeshView<'_>) -> Neighbour {
        let gap = Gap { successors: &self.successors, errors: &self.gap_errors };
        let shift = net.stars(vertex).read_without(vertex, gone, gap, &mut self.star);
        if net.is_corner(vertex) {
            return Neighbour { vertex, star: self.star.pack(HoleMemory::NOTHING), change: None };
        }
        let change = self.change(net, net.stars(vertex).memory(vertex), shift);
        Neighbour { vertex, star: self.star.pack(self.memory()), change: Some(change) }
    }
}
