//! Whole numbers at the nodes of a graph, predicted from those of neighbours that are known already.
//!
//! The prediction is the mean of the neighbours, each by its squared distance: two vertices close to
//! each other lie on both sides of an edge of the picture, so that the far ones tell more.

use super::arithmetic::{Coder, Stop};
use super::mixing::Mixture;

/// The largest magnitude of a number.
pub(super) const MOST: i64 = 1 << 18;

/// The largest distance of a neighbour, squared.
const MOST_DISTANCE: i64 = u16::MAX as i64;

/// Components with contexts of their own; those after them share the last one's.
const KINDS: usize = 4;

/// Differences are whether they are 0, their sign, then what their magnitude is above 1: so many
/// decisions whether it is more, and for what is left the number of bits and the bits.
const UNARY: usize = 18;
const BITS: usize = 18;
const SIZE_AT: usize = 2 + UNARY;
const BITS_AT: usize = SIZE_AT + BITS;
const DECISIONS: usize = BITS_AT + BITS;

/// Classes of numbers of either sign, of those without one, of squared distances and of predictions.
const SIGNED: usize = 13;
const UNSIGNED: usize = 11;
const DISTANCES: usize = 8;
const PREDICTIONS: i64 = 64;

const INPUT_SIZES: [usize; 7] = [
    UNSIGNED * UNSIGNED * DECISIONS,
    DISTANCES * UNSIGNED * DECISIONS,
    SIGNED * SIGNED * DECISIONS,
    SIGNED * SIGNED * DECISIONS,
    DECISIONS,
    UNSIGNED * UNSIGNED * DECISIONS,
    PREDICTIONS as usize * SIGNED * DECISIONS,
];

/// A known neighbour: its squared distance and its node.
pub(super) type Neighbour = (i64, usize);

/// Numbers of nodes, node by node, `components` of each, and how they differ from the predicted ones.
pub(super) struct Values {
    components: usize,
    pub(super) numbers: Vec<i32>,
    differences: Vec<i32>,
}

impl Values {
    pub(super) fn new(components: usize) -> Self {
        Self { components, numbers: Vec::new(), differences: Vec::new() }
    }

    /// Codes the numbers of the next `count` nodes, `numbers` of a writer. `neighbours` tells those of
    /// a node that come before it, once or more.
    pub(super) fn code<C: Coder>(
        &mut self,
        count: usize,
        numbers: &[i32],
        mut neighbours: impl FnMut(usize, &mut Vec<Neighbour>),
        coder: &mut C,
    ) -> Result<(), Stop> {
        let kinds = self.components.min(KINDS);
        let mut mixtures: Vec<_> =
            (0..kinds).map(|_| Mixture::new(INPUT_SIZES, DECISIONS)).collect();
        let mut numbers = numbers.iter();
        let mut near = Vec::new();
        let first = self.numbers.len() / self.components;
        for node in first..first + count {
            near.clear();
            neighbours(node, &mut near);
            near.sort_unstable();
            near.dedup();
            for component in 0..self.components {
                let context = Surroundings::new(self, &near, component);
                let difference =
                    numbers.next().map_or(0, |&number| i64::from(number) - context.predicted);
                let mixture = &mut mixtures[component.min(KINDS - 1)];
                let bases = context.bases();
                let decide = |at: usize, decision: bool| {
                    mixture.code(coder, bases.map(|base| base * DECISIONS + at), at, decision)
                };
                let difference = code_difference(difference, decide)?;
                let number = context.predicted + difference;
                if number.abs() > MOST {
                    return Err(Stop::Damaged);
                }
                self.numbers.push(number as i32);
                // Less than twice the largest number.
                self.differences.push(difference as i32);
            }
        }
        Ok(())
    }
}

/// What is known of a component of a node before it is coded.
struct Surroundings {
    predicted: i64,
    least: i64,
    most: i64,
    neighbours: i64,
    /// How the numbers of the nearest two neighbours differ from the prediction.
    nearest: [i64; 2],
    nearest_distance: i64,
    /// How the nearest neighbour differed from its own prediction, and twice the mean magnitude of all.
    nearest_difference: i64,
    activity: i64,
    /// How the first two components of the node differed from their predictions; 0 where they come
    /// later.
    before: [i64; 2],
    is_first: bool,
}

impl Surroundings {
    fn new(known: &Values, near: &[Neighbour], component: usize) -> Self {
        let number_of = |node: usize| i64::from(known.numbers[node * known.components + component]);
        let difference = |at: usize| i64::from(known.differences[at]);
        let difference_of = |node: usize| difference(node * known.components + component);
        let (mut sum, mut weights, mut activity) = (0, 0, 0);
        let (mut least, mut most) = (i64::MAX, i64::MIN);
        for &(distance, node) in near {
            let (number, weight) = (number_of(node), distance.min(MOST_DISTANCE));
            sum += weight * number;
            weights += weight;
            least = least.min(number);
            most = most.max(number);
            activity += difference_of(node).abs();
        }
        let neighbours = near.len() as i64;
        let predicted =
            if near.is_empty() { 0 } else { (2 * sum + weights).div_euclid(2 * weights) };
        let nearest =
            [0, 1].map(|i: usize| near.get(i).map_or(0, |&(_, node)| number_of(node) - predicted));
        let before = [0, 1].map(|i: usize| {
            let place = known.differences.len() + i;
            if i < component { difference(place - component) } else { 0 }
        });
        Self {
            predicted,
            least: if near.is_empty() { 0 } else { least },
            most: if near.is_empty() { 0 } else { most },
            neighbours,
            nearest,
            nearest_distance: near.first().map_or(MOST_DISTANCE, |&(distance, _)| distance),
            nearest_difference: near.first().map_or(0, |&(_, node)| difference_of(node)),
            activity: if near.is_empty() {
                0
            } else {
                (2 * activity + neighbours - 1) / neighbours
            },
            before,
            is_first: component == 0,
        }
    }

    /// The contexts of the inputs, without the decision.
    fn bases(&self) -> [usize; INPUT_SIZES.len()] {
        let [before, second] = self.before;
        let spread = if self.neighbours > 1 { self.most - self.least } else { 2 };
        let beside = if self.is_first { self.nearest_difference } else { second };
        let prediction =
            self.predicted.clamp(-PREDICTIONS / 2, PREDICTIONS / 2 - 1) + PREDICTIONS / 2;
        [
            class(self.activity) * UNSIGNED + class(before),
            bits(self.nearest_distance).min(DISTANCES - 1) * UNSIGNED
                + class(if self.is_first { spread } else { before }),
            signed_class(self.nearest[0]) * SIGNED + signed_class(self.nearest[1]),
            signed_class(before) * SIGNED + signed_class(beside),
            0,
            class((self.most - self.predicted).max(0)) * UNSIGNED
                + class((self.predicted - self.least).max(0)),
            prediction as usize * SIGNED + signed_class(before),
        ]
    }
}

/// Codes a difference of at most `MOST` and a prediction's magnitude.
fn code_difference(
    difference: i64,
    mut decide: impl FnMut(usize, bool) -> Result<bool, Stop>,
) -> Result<i64, Stop> {
    if decide(0, difference == 0)? {
        return Ok(0);
    }
    let is_negative = decide(1, difference < 0)?;
    let above = difference.unsigned_abs().saturating_sub(1);
    let mut size = 0;
    while size < UNARY && decide(2 + size, above > size as u64)? {
        size += 1;
    }
    let mut magnitude = 1 + size as u64;
    if size == UNARY {
        let left = above.saturating_sub(UNARY as u64) + 1;
        let mut bits = 0;
        while bits < BITS && decide(SIZE_AT + bits, left >> (bits + 1) > 0)? {
            bits += 1;
        }
        let mut number = 1;
        for bit in (0..bits).rev() {
            number = number << 1 | u64::from(decide(BITS_AT + bit, left >> bit & 1 == 1)?);
        }
        magnitude += number - 1;
    }
    Ok(if is_negative { -(magnitude as i64) } else { magnitude as i64 })
}

/// The number of bits of a magnitude.
fn bits(number: i64) -> usize {
    (u64::BITS - number.unsigned_abs().leading_zeros()) as usize
}

/// The magnitudes 0, 1, 2 to 3, 4 to 7, up to 31, and more, with their sign: 0 to 12.
fn signed_class(number: i64) -> usize {
    let class = bits(number).min(SIGNED / 2);
    if number < 0 { SIGNED / 2 - class } else { SIGNED / 2 + class }
}

/// The magnitudes 0, 1, 2, 3 to 4, 5 to 7, 8 to 11, and so on, as 0 to 10.
fn class(number: i64) -> usize {
    let least = [1, 2, 3, 5, 8, 12, 18, 28, 44, 71];
    least.into_iter().filter(|&least| number.abs() >= least).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pmesh::compact::arithmetic::{Reader, Writer};
    use crate::wanted::always;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_read_back_as_they_were(
            components in 1usize..6,
            numbers in prop::collection::vec(-MOST..=MOST, 60),
            shift in 0u32..18,
        ) {
            let numbers: Vec<i32> = numbers.iter().map(|number| (number >> shift) as i32).collect();
            let count = numbers.len() / components;
            let numbers = &numbers[..count * components];
            let neighbours = |node: usize, near: &mut Vec<Neighbour>| {
                near.extend((node.saturating_sub(3)..node).map(|other| (((node - other) * 9) as i64, other)));
            };
            let mut writer = Writer::new(&always);
            prop_assert!(Values::new(components).code(count, numbers, neighbours, &mut writer).is_ok());
            let bytes = writer.finish();
            let (mut read, mut reader) = (Values::new(components), Reader::new(&bytes, &always));
            prop_assert!(read.code(count, &[], neighbours, &mut reader).is_ok());
            prop_assert_eq!(read.numbers, numbers);
        }
    }
}
