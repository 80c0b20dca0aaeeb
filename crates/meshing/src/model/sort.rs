//! A sort that polls.

use crate::control::{Cancelled, POINTS_PER_POLL};

/// One element in this many is in the sample that a pivot comes from.
const SAMPLE_STEP: usize = 64;

/// Sorts distinct elements in place; polls at least once for every 65,536 elements moved.
///
/// # Errors
/// The first of `poll`.
pub(crate) fn sort<T: Ord + Copy>(
    elements: &mut [T],
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<(), Cancelled> {
    poll()?;
    if elements.len() <= POINTS_PER_POLL {
        elements.sort_unstable();
        return Ok(());
    }
    // The median of the sample leaves a 128th of the elements or more at each side.
    let mut sample: Vec<T> = elements.iter().step_by(SAMPLE_STEP).copied().collect();
    let middle = sample.len() / 2;
    let pivot = *sample.select_nth_unstable(middle).1;
    let mut below = 0;
    for i in 0..elements.len() {
        if i % POINTS_PER_POLL == 0 {
            poll()?;
        }
        let is_below = elements[i] < pivot;
        elements.swap(i, below);
        below += usize::from(is_below);
    }
    let (lower, upper) = elements.split_at_mut(below);
    sort(lower, poll)?;
    sort(upper, poll)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::control::Stage;
    use crate::control::tests::Recorder;

    #[test]
    fn sorts_in_parts() {
        for count in [1, 1 << 16, (1 << 16) + 1, 1 << 18] {
            let recorder = Recorder::default();
            let mut numbers: Vec<u32> =
                (0..count).map(|i: u32| i.wrapping_mul(0x9E37_79B1)).collect();
            sort(&mut numbers, &|| recorder.poll(Stage::Check, 0, 1)).unwrap();
            assert!(numbers.is_sorted(), "{count}");
            assert!(recorder.reports().len() >= (count as usize).div_ceil(1 << 16), "{count}");
        }
    }
}
