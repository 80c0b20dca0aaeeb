//! The removal of a vertex with few neighbours, all of which have few: nearly all removals.
//!
//! What [`removal`](crate::removal::candidate) does for any vertex is done here in arrays of fixed size: stars
//! as they lie in their records, the fans of the hole's vertices read from a table of its directed
//! edges, and the new faces of all neighbours measured in one go. Steps whose number nobody can
//! guess are few, because each costs as much as some forty others.

use crate::face_error::FaceErrors;
use crate::image::Point;
use crate::removal::candidate::Neighbour;
use crate::removal::fill_cache::{HoleMemory, SLOTS};
use crate::removal::star::{Packed, Record};
use crate::removal::vertices::MeshView;
use crate::triangulation::small_hole::{PLACES, TRIANGLES, fill_few};

/// The most neighbours of a vertex that goes: all triangles of its fill are remembered.
const MOST_NEIGHBOURS: usize = SLOTS + 2;

/// Room for those of all holes around a vertex.
const ALL_TRIANGLES: usize = MOST_NEIGHBOURS * TRIANGLES;

/// Holes of few vertices whose faces are measured together.
pub(crate) struct FewHoles {
    /// The faces whose errors are not remembered, and of which triangle of which hole each is.
    faces: [[Point; 3]; ALL_TRIANGLES],
    triangles: [u8; ALL_TRIANGLES],
    face_count: usize,
    /// The error of each triangle of each hole.
    errors: [u64; ALL_TRIANGLES],
    face_errors: Vec<u64>,
}

impl Default for FewHoles {
    fn default() -> Self {
        Self {
            faces: [[Point::new(0, 0); 3]; ALL_TRIANGLES],
            triangles: [0; ALL_TRIANGLES],
            face_count: 0,
            errors: [0; ALL_TRIANGLES],
            face_errors: Vec::with_capacity(ALL_TRIANGLES),
        }
    }
}

/// The places that the neighbours in a star had before one of them gave way to others.
struct FormerPlaces([u8; PLACES]);

impl FormerPlaces {
    /// Stands for a neighbour that was not there. No triangle with it is remembered.
    const NONE: u8 = 0xff;

    /// The places when none gave way.
    #[inline]
    fn same() -> Self {
        Self(std::array::from_fn(|place| place as u8))
    }

    /// The places when the neighbour at `place` gave way to so many.
    #[inline]
    fn without(place: usize, successors: usize) -> Self {
        let (place, after) = (place as u8, (place + successors) as u8);
        let mut places = Self::same().0;
        for former in &mut places {
            let moved = (*former).wrapping_sub(successors as u8).wrapping_add(1);
            let beyond = if *former < after { Self::NONE } else { moved };
            *former = if *former < place { *former } else { beyond };
        }
        Self(places)
    }
}

impl FewHoles {
    /// By how much the error changes when a vertex goes, and what to remember of its hole; `None`
    /// when it has many neighbours or large errors.
    pub(crate) fn evaluate(
        &mut self,
        vertex: u32,
        net: &MeshView<'_>,
        errors: &mut FaceErrors<'_>,
    ) -> Option<(i64, HoleMemory)> {
        let record = net.stars(vertex).record(vertex);
        if !net.is_narrow() || !record.is_within() {
            return None;
        }
        let (mut record, memory) = (*record, record.memory);
        self.face_count = 0;
        self.begin(0, &mut record, &memory, &FormerPlaces::same(), net);
        self.measure(errors);
        let change = self.finish(0, &mut record)?;
        Some((change, record.memory))
    }

    /// The states of all neighbours after a vertex has gone; `None` when there are many neighbours or large errors, or when the vertex is on the border.
    pub(crate) fn prepare(
        &mut self,
        vertex: u32,
        net: &MeshView<'_>,
        errors: &mut FaceErrors<'_>,
        neighbours: &mut Vec<Neighbour>,
    ) -> Option<()> {
        let hole = net.stars(vertex).record(vertex);
        if !net.is_narrow() || !hole.is_within() || net.is_on_border(vertex) {
            return None;
        }
        let fans = Fans::new(hole)?;
        self.face_count = 0;
        for (place, &neighbour) in hole.neighbours().iter().enumerate() {
            let gap = fans.gap(place);
            let old = net.stars(neighbour).record(neighbour);
            let (mut record, at) = old.without(vertex, &gap)?;
            let mut change = None;
            if !net.is_corner(neighbour) {
                let former = FormerPlaces::without(at, gap.count);
                self.begin(place, &mut record, &old.memory, &former, net);
                change = Some(0);
            }
            let star = Packed { record, spilled: None };
            neighbours.push(Neighbour { vertex: neighbour, star, change });
        }
        self.measure(errors);
        for (place, neighbour) in neighbours.iter_mut().enumerate() {
            if let Some(change) = &mut neighbour.change {
                *change = self.finish(place, &mut neighbour.star.record)?;
            }
        }
        Some(())
    }

    /// Fills the hole of a vertex, of which `number` holes there are before, and looks up what is
    /// known of its triangles.
    #[inline]
    fn begin(
        &mut self,
        number: usize,
        record: &mut Record,
        memory: &HoleMemory,
        former: &FormerPlaces,
        net: &MeshView<'_>,
    ) {
        let mut points = [Point::new(0, 0); PLACES];
        for (point, &vertex) in points.iter_mut().zip(record.all_neighbours()) {
            *point = net.point(vertex);
        }
        let count = record.neighbours().len();
        let triangles = fill_few(&points, count);
        record.memory = HoleMemory::NOTHING;
        for (i, &[a, b, c]) in triangles[..count - 2].iter().enumerate() {
            let corners = [a, b, c].map(|place| usize::from(place) % PLACES);
            record.memory.set_triangle(i, corners.map(|place| place as u32));
            let known = memory.error_or_zero(corners.map(|place| former.0[place].into()));
            let triangle = number * TRIANGLES + i;
            self.errors[triangle % ALL_TRIANGLES] = known.1.into();
            // Written in any case, kept if it is to be measured.
            let face = self.face_count % ALL_TRIANGLES;
            self.faces[face] = corners.map(|place| points[place]);
            self.triangles[face] = triangle as u8;
            self.face_count += usize::from(!known.0);
        }
    }

    /// Measures the faces that are not remembered.
    fn measure(&mut self, errors: &mut FaceErrors<'_>) {
        errors.errors(&self.faces[..self.face_count], &mut self.face_errors);
        for (&triangle, &error) in self.triangles.iter().zip(&self.face_errors) {
            self.errors[usize::from(triangle) % ALL_TRIANGLES] = error;
        }
    }

    /// Remembers the errors of a hole, and returns by how much filling it changes the error; `None`
    /// when they are too large to be remembered.
    #[inline]
    fn finish(&self, number: usize, record: &mut Record) -> Option<i64> {
        let errors = &self.errors[number * TRIANGLES..][..record.neighbours().len() - 2];
        for (i, &error) in errors.iter().enumerate() {
            record.memory.set_error(i, error as u32);
        }
        let (sum, all) =
            errors.iter().fold((0, 0), |(sum, all), &error| (sum + error, all | error));
        (all <= u32::MAX.into()).then(|| sum as i64 - record.error() as i64)
    }
}

/// What stands in the star of a neighbour in the place of a vertex that goes.
pub(crate) struct FewGap {
    pub(crate) successors: [u32; MOST_NEIGHBOURS],
    /// How many successors there are.
    pub(crate) count: usize,
    /// The errors of the faces before each of them and after the last.
    pub(crate) errors: [u32; MOST_NEIGHBOURS],
}

/// The triangles that fill a hole by their directed edges.
struct Fans<'a> {
    hole: &'a Record,
    /// For each two places the one that makes a triangle with them, and that triangle's number.
    thirds: [(u8, u8); MOST_NEIGHBOURS * MOST_NEIGHBOURS],
    errors: [u32; SLOTS],
}

impl<'a> Fans<'a> {
    /// The fans of a hole whose fill is remembered.
    #[inline]
    fn new(hole: &'a Record) -> Option<Self> {
        let degree = hole.neighbours().len();
        if degree > MOST_NEIGHBOURS {
            return None;
        }
        let mut fans =
            Self { hole, thirds: [(0, 0); MOST_NEIGHBOURS * MOST_NEIGHBOURS], errors: [0; SLOTS] };
        let fill = hole.memory.recall(degree - 2)?;
        for (i, ([a, b, c], error)) in fill.enumerate() {
            for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
                let edge = from as usize * MOST_NEIGHBOURS + to as usize;
                fans.thirds[edge % fans.thirds.len()] = (third as u8, i as u8);
            }
            fans.errors[i % SLOTS] = error as u32;
        }
        Some(fans)
    }

    /// What stands in the star of the neighbour at `place`.
    #[inline]
    fn gap(&self, place: usize) -> FewGap {
        let neighbours = self.hole.neighbours();
        let last = if place == 0 { neighbours.len() - 1 } else { place - 1 };
        let mut next = if place + 1 == neighbours.len() { 0 } else { place + 1 };
        let mut gap =
            FewGap { successors: [0; MOST_NEIGHBOURS], count: 0, errors: [0; MOST_NEIGHBOURS] };
        for i in 0..MOST_NEIGHBOURS {
            let edge = place * MOST_NEIGHBOURS + next;
            let (third, triangle) = self.thirds[edge % self.thirds.len()];
            next = usize::from(third);
            gap.errors[i] = self.errors[usize::from(triangle) % SLOTS];
            if next == last {
                break;
            }
            gap.successors[i] = self.hole.all_neighbours()[next % MOST_NEIGHBOURS];
            gap.count = i + 1;
        }
        gap
    }
}

#[cfg(test)]
mod tests;
