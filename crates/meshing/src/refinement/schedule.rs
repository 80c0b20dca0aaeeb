//! The steps of refinement in order, and how many of them each effort takes.

use crate::refinement::relocation::Look;

/// A step of refinement. None raises the error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// One look at each vertex whose surroundings have changed.
    Relocate(Look),
    /// One look at each vertex.
    RelocateAll(Look),
    /// Swaps with openings in a quarter of the faces, the worst.
    Swap,
    /// So many percent of the vertices more for a while, which find their places with foresight.
    GrowQuickly(usize),
    /// The same by a little more where a decibel is far.
    GrowForDecibel,
    /// Where not a little more than a decibel has been gained yet, what that is foreseen to take: one
    /// more look, or growth.
    ReachDecibel,
    /// So many percent of the vertices more for a while.
    Grow(usize),
    /// The same again and again while it pays.
    GrowWhileItPays(usize),
}

/// All steps, each with the effort from which on it is taken.
///
/// The steps of an effort are the first of those of the next one, so that more effort is never
/// worse.
///
/// Efforts 1 to 3 look with foresight, which finds nearly as much as trying all places in less than
/// half the time; from 4 on every place is tried, which finds what derivatives do not foresee.
/// Growth, though quick, finds more than swaps do in the same time. Effort 1 is to gain 1 dB over MGPRFS
/// in no more time than MGPRFS takes; what was tried for that is in `PERFORMANCE.md`.
const STEPS: &[(u8, Step)] = {
    use Look::{Foresighted, Thorough};
    use Step::{
        Grow, GrowForDecibel, GrowQuickly, GrowWhileItPays, ReachDecibel, Relocate, RelocateAll,
        Swap,
    };
    &[
        (1, Relocate(Foresighted)),
        (1, GrowForDecibel),
        (1, ReachDecibel),
        (1, ReachDecibel),
        (1, ReachDecibel),
        (2, GrowQuickly(20)),
        (3, GrowQuickly(20)),
        (4, RelocateAll(Thorough)),
        (4, Relocate(Thorough)),
        (5, Swap),
        (5, Relocate(Thorough)),
        (5, Relocate(Thorough)),
        (6, Grow(20)),
        (7, Grow(20)),
        (7, Grow(10)),
        (8, Grow(20)),
        (8, Grow(20)),
        (8, Grow(10)),
        (9, GrowWhileItPays(20)),
        (9, GrowWhileItPays(10)),
        (9, GrowWhileItPays(5)),
    ]
};

/// The steps that an effort of 0 to [`MAX_EFFORT`] takes.
pub(crate) fn steps(effort: u8) -> impl Iterator<Item = Step> {
    STEPS.iter().take_while(move |(from, _)| *from <= effort).map(|(_, step)| *step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::MAX_EFFORT;

    #[test]
    fn each_effort_does_all_that_the_one_before_does_and_more() {
        assert_eq!(steps(0).count(), 0);
        for effort in 1..=MAX_EFFORT {
            let (fewer, more) = (steps(effort - 1).count(), steps(effort).count());
            assert!(fewer < more, "effort {effort}");
        }
        assert_eq!(steps(MAX_EFFORT).count(), STEPS.len());
    }
}
