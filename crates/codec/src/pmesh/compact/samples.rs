//! Samples as whole numbers of steps.
//!
//! Red, green and blue become luma and two differences (Henrique S. Malvar and Gary J. Sullivan,
//! "YCoCg-R: A Color Space with RGB Reversibility and Low Dynamic Range", 2003). Each component is then
//! rounded to a multiple of its step; with steps of 1 nothing is lost.

/// The step that loses nothing: steps are in eighths of a sample's.
pub(super) const EXACT: i64 = 8;

/// The largest step of luma.
const MOST: f64 = 4096.0;

/// Step of the differences of colours to that of luma.
const COLOR_STEP: f64 = 1.6;

/// The steps of components: `step` of luma, alpha and others, a larger one of differences of colours.
/// A step of 1 loses nothing.
pub(in crate::pmesh) fn steps_of(step: f64, component_count: usize) -> Vec<i64> {
    let step = step.clamp(1.0, MOST);
    let in_eighths = |step: f64| (step * EXACT as f64).round() as i64;
    let mut steps = vec![in_eighths(step); component_count];
    if has_colors(component_count) && step > 1.0 {
        steps[1..3].fill(in_eighths(step * COLOR_STEP));
    }
    steps
}

/// Whether the first three components are red, green and blue.
fn has_colors(component_count: usize) -> bool {
    matches!(component_count, 3 | 4)
}

/// The numbers of steps nearest to sample vectors, one after the other.
pub(super) fn numbers_of(samples: &[u16], steps: &[i64]) -> Vec<i32> {
    let mut numbers: Vec<i32> = samples.iter().map(|&sample| sample.into()).collect();
    for vector in numbers.chunks_exact_mut(steps.len()) {
        if has_colors(steps.len()) {
            let [red, green, blue] = [vector[0], vector[1], vector[2]];
            let orange = red - blue;
            let middle = blue + (orange >> 1);
            let green = green - middle;
            vector[..3].copy_from_slice(&[middle + (green >> 1), orange, green]);
        }
        for (number, &step) in vector.iter_mut().zip(steps) {
            *number = (2 * EXACT * i64::from(*number) + step).div_euclid(2 * step) as i32;
        }
    }
    numbers
}

/// The samples of numbers of steps, 0 at least and `largest` at most.
pub(super) fn samples_of(numbers: &[i32], steps: &[i64], largest: u16) -> Vec<u16> {
    let mut samples = Vec::with_capacity(numbers.len());
    let mut vector = vec![0; steps.len()];
    for numbers in numbers.chunks_exact(steps.len()) {
        for ((value, number), step) in vector.iter_mut().zip(numbers).zip(steps) {
            *value = (i64::from(*number) * step + EXACT / 2).div_euclid(EXACT);
        }
        if has_colors(steps.len()) {
            let [luma, orange, green] = [vector[0], vector[1], vector[2]];
            let middle = luma - (green >> 1);
            let blue = middle - (orange >> 1);
            vector[..3].copy_from_slice(&[blue + orange, green + middle, blue]);
        }
        samples.extend(vector.iter().map(|&value| value.clamp(0, largest.into()) as u16));
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn steps_of_one_lose_nothing_and_larger_ones_half_a_step(
            components in 1usize..6,
            samples in prop::collection::vec(any::<u16>(), 60),
            step in 8i64..9000,
        ) {
            let samples = &samples[..60 / components * components];
            let back = |step: i64| {
                let steps = vec![step; components];
                samples_of(&numbers_of(samples, &steps), &steps, u16::MAX)
            };
            prop_assert_eq!(back(EXACT), samples);
            // Of luma and of both differences half a step each.
            for (&sample, back) in samples.iter().zip(back(step)) {
                prop_assert!(i64::from(sample.abs_diff(back)) <= 2 * step / EXACT + 3);
            }
        }
    }
}
