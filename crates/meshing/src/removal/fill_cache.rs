//! The errors of the triangles that would fill the hole of a vertex, as last evaluated.
//!
//! When a neighbour goes, some triangles of a vertex's hole stay the same, two in five, and when
//! the vertex itself goes, all of them do: their errors need not be computed again. A triangle is
//! known by the places of its vertices among the neighbours, which shift when a neighbour goes.

use crate::triangulation::hole::HoleTriangle;

/// Triangles remembered for each vertex; a hole has four on average.
pub(crate) const SLOTS: usize = 6;

/// Stands in for the places of a triangle that is not remembered.
const NOTHING: u32 = u32::MAX;

/// Places from this one on are not remembered.
const PLACES: u32 = 255;

/// The triangles last evaluated for one vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HoleMemory {
    /// The places of the vertices of each, a byte each.
    triangles: [u32; SLOTS],
    /// Errors that do not fit are not remembered.
    errors: [u32; SLOTS],
}

impl HoleMemory {
    /// A memory of nothing.
    pub(crate) const NOTHING: Self = Self { triangles: [NOTHING; SLOTS], errors: [0; SLOTS] };

    /// The error of a triangle whose vertices had these places, ascending, when it was remembered.
    #[inline]
    pub(crate) fn error(&self, places: HoleTriangle) -> Option<u64> {
        let wanted = pack(places);
        // All slots are looked at, without a branch for each.
        let (mut found, mut error) = (false, 0);
        for (&triangle, &known) in self.triangles.iter().zip(&self.errors) {
            if triangle == wanted {
                (found, error) = (true, known);
            }
        }
        found.then_some(error.into())
    }

    /// Whether the error of a triangle is remembered, and the error, or 0.
    #[inline(always)]
    pub(crate) fn error_or_zero(&self, places: HoleTriangle) -> (bool, u32) {
        let wanted = pack(places);
        let (mut is_known, mut error) = (false, 0);
        for (&triangle, &known) in self.triangles.iter().zip(&self.errors) {
            is_known |= triangle == wanted;
            error |= if triangle == wanted { known } else { 0 };
        }
        (is_known, error)
    }

    /// Remembers a triangle, if there is a slot of this number.
    #[inline(always)]
    pub(crate) fn set_triangle(&mut self, slot: usize, places: HoleTriangle) {
        if let Some(triangle) = self.triangles.get_mut(slot) {
            *triangle = pack(places);
        }
    }

    /// Remembers the error of the triangle in a slot, if there is a slot of this number.
    #[inline(always)]
    pub(crate) fn set_error(&mut self, slot: usize, error: u32) {
        if let Some(known) = self.errors.get_mut(slot) {
            *known = error;
        }
    }

    /// What is remembered of a fill.
    #[inline]
    pub(crate) fn of(triangles: &[HoleTriangle], errors: &[u64]) -> Self {
        let mut memory = Self::NOTHING;
        for (i, (&triangle, &error)) in triangles.iter().zip(errors).take(SLOTS).enumerate() {
            // The last place is the largest.
            if triangle[2] < PLACES && error <= u32::MAX.into() {
                memory.triangles[i] = pack(triangle);
                memory.errors[i] = error as u32;
            }
        }
        memory
    }

    /// Hands out all triangles of a fill of `count`, with their errors; `None` when some of them
    /// are not remembered.
    #[inline(always)]
    pub(crate) fn recall(&self, count: usize) -> Option<impl Iterator<Item = (HoleTriangle, u64)>> {
        let known = self.triangles.get(..count)?;
        if known.contains(&NOTHING) {
            return None;
        }
        let errors = self.errors.iter().map(|&error| error.into());
        Some(known.iter().map(|&triangle| unpack(triangle)).zip(errors))
    }
}

/// Three places as three bytes.
#[inline(always)]
fn pack([a, b, c]: HoleTriangle) -> u32 {
    a | b << 8 | c << 16
}

/// The three places.
#[inline(always)]
fn unpack(triangle: u32) -> HoleTriangle {
    [triangle & 0xff, triangle >> 8 & 0xff, triangle >> 16]
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
        let memory = HoleMemory::of(&[[0, 1, 4], [1, 2, 4], [2, 3, 4]], &[7, 0, 1 << 31]);
        assert_eq!(memory.error([1, 2, 4]), Some(0));
        assert_eq!(memory.error([1, 3, 4]), None);
        // Neighbour 1 gives way to two others.
        let shift = Shift { place: 1, successors: 2 };
        assert_eq!(shift.before([3, 4, 5]), Some([2, 3, 4]));
        assert_eq!(memory.error([2, 3, 4]), Some(1 << 31));
        assert_eq!(shift.before([0, 2, 5]), None);
        // Neighbour 0 goes and leaves nothing.
        let shift = Shift { place: 0, successors: 0 };
        assert_eq!(shift.before([0, 1, 3]), Some([1, 2, 4]));
        assert_eq!(Shift::NONE.before([0, 1, 4]), Some([0, 1, 4]));
    }

    #[test]
    fn a_whole_fill_is_recalled_in_its_order() {
        let (triangles, errors) = ([[0, 2, 4], [2, 3, 4], [0, 1, 2]], [5, 6, 7]);
        let memory = HoleMemory::of(&triangles, &errors);
        assert!(memory.recall(3).unwrap().eq(triangles.into_iter().zip(errors)));
        assert!(memory.recall(4).is_none() && memory.recall(7).is_none());
        assert!(HoleMemory::of(&triangles, &[5, 1 << 32, 7]).recall(3).is_none());
    }

    #[test]
    fn what_does_not_fit_is_forgotten() {
        let memory = HoleMemory::of(&[[0, 1, 300], [1, 2, 3]], &[5, 1 << 32]);
        assert_eq!(memory.error([1, 2, 3]), None);
        assert_eq!(memory.error([0, 1, 44]), None);
        assert_eq!(Shift::NONE.before([0, 1, 300]), None);
        assert_eq!(HoleMemory::of(&[[1, 2, 3]; 8], &[9; 8]).error([1, 2, 3]), Some(9));
        assert_eq!(HoleMemory::NOTHING.error([0, 1, 2]), None);
    }
}
