//! The errors of the triangles that would fill the hole of a vertex, as last evaluated.
//!
//! When a neighbour goes, some triangles of a vertex's hole stay the same, two in five, and when
//! the vertex itself goes, all of them do: their errors need not be computed again. A triangle is
//! known by the places of its vertices among the neighbours, which shift when a neighbour goes.

use crate::hole::HoleTriangle;

/// Triangles remembered for each vertex; a hole has four on average.
const SLOTS: usize = 6;

/// Bits of a slot that hold the error; three bytes above them hold the places.
const ERROR_BITS: u32 = 40;

/// Stands in for a triangle that is not remembered: no error has all bits set.
const NOTHING: u64 = u64::MAX;

/// Places from this one on are not remembered.
const PLACES: u32 = 255;

/// The triangles last evaluated for one vertex.
#[derive(Clone, Copy)]
pub(crate) struct HoleMemory([u64; SLOTS]);

impl HoleMemory {
    /// A memory of nothing.
    pub(crate) const NOTHING: Self = Self([NOTHING; SLOTS]);

    /// The error of a triangle whose vertices had these places, ascending, when it was remembered.
    #[inline]
    pub(crate) fn error(&self, places: HoleTriangle) -> Option<u64> {
        let places = pack(places);
        let known = self.0.iter().find(|&&slot| slot >> ERROR_BITS == places && slot != NOTHING);
        known.map(|slot| slot & ((1 << ERROR_BITS) - 1))
    }

    /// What is remembered of a fill.
    #[inline]
    pub(crate) fn of(triangles: &[HoleTriangle], errors: &[u64]) -> Self {
        let mut memory = Self::NOTHING;
        for (slot, (&triangle, &error)) in memory.0.iter_mut().zip(triangles.iter().zip(errors)) {
            // The last place is the largest.
            if triangle[2] < PLACES && error < (1 << ERROR_BITS) - 1 {
                *slot = pack(triangle) << ERROR_BITS | error;
            }
        }
        memory
    }
}

/// Three places as three bytes.
#[inline]
fn pack([a, b, c]: HoleTriangle) -> u64 {
    u64::from(a | b << 8 | c << 16)
}

/// How the places of a vertex's neighbours have shifted since its hole was last evaluated.
#[derive(Clone, Copy)]
pub(crate) struct Shift {
    /// The place of the neighbour that went.
    pub(crate) place: u32,
    /// How many neighbours stand there now.
    pub(crate) successors: u32,
}

impl Shift {
    /// No neighbour went.
    pub(crate) const NONE: Self = Self { place: u32::MAX, successors: 0 };

    /// The places that three neighbours had; `None` when one of them is new or they were out of
    /// reach of the memory.
    #[inline]
    pub(crate) fn before(self, triangle: HoleTriangle) -> Option<HoleTriangle> {
        let mut before = triangle;
        for place in &mut before {
            if *place >= self.place {
                if *place - self.place < self.successors {
                    return None;
                }
                *place = *place - self.successors + 1;
            }
        }
        (before[2] < PLACES).then_some(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_remembered_is_found_where_its_neighbours_stand_now() {
        let memory = HoleMemory::of(&[[0, 1, 4], [1, 2, 4], [2, 3, 4]], &[7, 0, 1 << 39]);
        assert_eq!(memory.error([1, 2, 4]), Some(0));
        assert_eq!(memory.error([1, 3, 4]), None);
        // Neighbour 1 gives way to two others.
        let shift = Shift { place: 1, successors: 2 };
        assert_eq!(shift.before([3, 4, 5]), Some([2, 3, 4]));
        assert_eq!(memory.error([2, 3, 4]), Some(1 << 39));
        assert_eq!(shift.before([0, 2, 5]), None);
        // Neighbour 0 goes and leaves nothing.
        let shift = Shift { place: 0, successors: 0 };
        assert_eq!(shift.before([0, 1, 3]), Some([1, 2, 4]));
        assert_eq!(Shift::NONE.before([0, 1, 4]), Some([0, 1, 4]));
    }

    #[test]
    fn what_does_not_fit_is_forgotten() {
        let memory = HoleMemory::of(&[[0, 1, 300], [1, 2, 3]], &[5, 1 << 40]);
        assert_eq!(memory.error([1, 2, 3]), None);
        assert_eq!(memory.error([0, 1, 44]), None);
        assert_eq!(Shift::NONE.before([0, 1, 300]), None);
        assert_eq!(HoleMemory::of(&[[1, 2, 3]; 8], &[9; 8]).error([1, 2, 3]), Some(9));
        assert_eq!(HoleMemory::NOTHING.error([0, 1, 2]), None);
    }
}
