//! The steps of each effort. `NOTES.md` has the gains and times.

use crate::refinement::relocation::Search;

/// A step of refinement. None raises the error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// One pass over the vertices whose surroundings have changed.
    Relocate(Search),
    RelocateAll(Search),
    /// Growth by this percentage of the vertices, and removal of as many.
    Grow(Search, usize),
}

/// Each step with the lowest effort that includes it. An effort takes the steps of lower efforts
/// first, so that more effort is never worse.
const STEPS: &[(u8, Step)] = {
    use Search::{Exhaustive, Predicted};
    use Step::{Grow, Relocate, RelocateAll};
    &[
        (1, Relocate(Predicted)),
        (1, Grow(Predicted, 20)),
        (1, Relocate(Predicted)),
        (2, Grow(Predicted, 20)),
        (3, Grow(Predicted, 20)),
        (4, RelocateAll(Exhaustive)),
        (4, Relocate(Exhaustive)),
        (5, Grow(Exhaustive, 20)),
        (6, Grow(Exhaustive, 20)),
        (7, Grow(Exhaustive, 20)),
        (7, Grow(Exhaustive, 10)),
        (8, Grow(Exhaustive, 20)),
        (8, Grow(Exhaustive, 10)),
        (9, Grow(Exhaustive, 20)),
        (9, Grow(Exhaustive, 20)),
        (9, Grow(Exhaustive, 10)),
        (9, Grow(Exhaustive, 10)),
        (9, Grow(Exhaustive, 5)),
    ]
};

pub(crate) fn steps(effort: u8) -> impl Iterator<Item = Step> {
    STEPS.iter().take_while(move |(least, _)| *least <= effort).map(|(_, step)| *step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::MAX_EFFORT;

    #[test]
    fn each_effort_adds_steps() {
        assert_eq!(steps(0).count(), 0);
        for effort in 1..=MAX_EFFORT {
            let (fewer, more) = (steps(effort - 1).count(), steps(effort).count());
            assert!(fewer < more, "effort {effort}");
        }
        assert_eq!(steps(MAX_EFFORT).count(), STEPS.len());
    }
}
