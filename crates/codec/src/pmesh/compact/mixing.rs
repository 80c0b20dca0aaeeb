//! Probabilities of decisions: those of several contexts, mixed in the logistic domain.
//!
//! Each context keeps a probability that follows the decisions made in it. The mixture adds their
//! logarithmic odds, each by its weight and by how often its context was met; weights follow the
//! gradient of the code's length (Matthew V. Mahoney, "Adaptive weighing of context models for
//! lossless data compression", 2005). All numbers are whole, so that every reader agrees.

use super::arithmetic::{Coder, Stop};

/// 4096 / (1 + exp(-x / 256)) at x = -2048, -1920, ..., 2048, rounded, 1 at least and 4095 at most.
const LOGISTIC: [i32; 33] = [
    1, 2, 4, 6, 10, 17, 27, 45, 74, 120, 194, 311, 488, 747, 1102, 1546, 2048, 2550, 2994, 3349,
    3608, 3785, 3902, 3976, 4022, 4051, 4069, 4079, 4086, 4090, 4092, 4094, 4095,
];

/// The largest logarithmic odds, in 256ths.
const MOST_ODDS: i32 = 2047;

/// 0.21 of 65536: a little more than the inverse of the number of inputs.
const FIRST_WEIGHT: i32 = 14_000;
const MOST_WEIGHT: i32 = 1 << 20;

/// How fast weights follow.
const LEARNING: i32 = 10;

/// Decisions after which a context's probability follows at a constant speed.
const MOST_MET: u16 = 255;

/// How far a context's odds are trusted, of 65536, by the decisions that it met.
const TRUST: [i32; MOST_MET as usize + 1] = by_met(true);

/// How fast a context's probability follows, of 65536, by the decisions that it met.
const RATE: [i32; MOST_MET as usize + 1] = by_met(false);

/// 65536 times `met / (met + 2)` or `1 / (met + 2)`, rounded down.
const fn by_met(times_met: bool) -> [i32; MOST_MET as usize + 1] {
    let mut table = [0; MOST_MET as usize + 1];
    let mut met = 0;
    while met < table.len() {
        table[met] = ((if times_met { met } else { 1 }) * 65536 / (met + 2)) as i32;
        met += 1;
    }
    table
}

/// The probability, of 4096, of logarithmic odds in 256ths.
fn probability(odds: i32) -> i32 {
    let odds = odds.clamp(-MOST_ODDS, MOST_ODDS) + 2048;
    let (at, part) = ((odds >> 7) as usize, odds & 127);
    (LOGISTIC[at] * (128 - part) + LOGISTIC[at + 1] * part + 64) >> 7
}

/// For each probability of 4096 the least odds that have it or a larger one.
fn odds_table() -> Vec<i32> {
    let mut odds = -MOST_ODDS;
    let least = |chance| {
        while odds < MOST_ODDS && probability(odds) < chance {
            odds += 1;
        }
        odds
    };
    (0..4096).map(least).collect()
}

/// What a context knows.
#[derive(Clone, Copy)]
struct Context {
    /// The probability of true, of 65536.
    chance: u16,
    /// Decisions met, up to [`MOST_MET`].
    met: u16,
}

/// The contexts of decisions of one kind, of `N` inputs, and the weights of their mixtures.
pub(super) struct Mixture<const N: usize> {
    inputs: [Vec<Context>; N],
    weights: Vec<[i32; N]>,
    odds: Vec<i32>,
}

impl<const N: usize> Mixture<N> {
    /// `sizes` are the numbers of contexts of each input, `sets` is that of sets of weights.
    pub(super) fn new(sizes: [usize; N], sets: usize) -> Self {
        let inputs = sizes.map(|size| vec![Context { chance: 1 << 15, met: 0 }; size]);
        Self { inputs, weights: vec![[FIRST_WEIGHT; N]; sets], odds: odds_table() }
    }

    /// Codes a decision in one context of each input, with a set of weights.
    pub(super) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: [usize; N],
        set: usize,
        decision: bool,
    ) -> Result<bool, Stop> {
        let weights = &mut self.weights[set];
        let mut odds = [0; N];
        let mut sum = 0i64;
        for (i, context) in contexts.into_iter().enumerate() {
            let Context { chance, met } = self.inputs[i][context];
            odds[i] = (self.odds[usize::from(chance >> 4)] * TRUST[usize::from(met)]) >> 16;
            sum += i64::from(odds[i]) * i64::from(weights[i]);
        }
        let most = i64::from(MOST_ODDS);
        let chance = probability((sum >> 16).clamp(-most, most) as i32);
        let decision = coder.code(decision, chance as u32)?;
        let error = ((i32::from(decision) << 12) - chance) * LEARNING;
        for (i, context) in contexts.into_iter().enumerate() {
            let change = (odds[i] * error + (1 << 13)) >> 14;
            weights[i] = (weights[i] + change).clamp(-MOST_WEIGHT, MOST_WEIGHT);
            let Context { chance, met } = &mut self.inputs[i][context];
            let target = if decision { i32::from(u16::MAX) } else { 0 };
            let step = ((target - i32::from(*chance)) * RATE[usize::from(*met)]) >> 16;
            *chance = (i32::from(*chance) + step) as u16;
            *met = (*met + 1).min(MOST_MET);
        }
        Ok(decision)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pmesh::compact::arithmetic::Writer;
    use crate::wanted::always;

    #[test]
    fn the_table_holds_rounded_logistic_values() {
        for (at, &value) in (0..).zip(&LOGISTIC) {
            let x = f64::from(at * 128 - 2048) / 256.0;
            let exact = (4096.0 / (1.0 + (-x).exp())).round() as i32;
            assert_eq!(value, exact.clamp(1, 4095), "{at}");
        }
        assert!((-MOST_ODDS..=MOST_ODDS).all(|odds| (1..=4095).contains(&probability(odds))));
    }

    #[test]
    fn an_input_that_knows_is_learnt_to_be_trusted() {
        let mut writer = Writer::new(&always);
        let mut mixture = Mixture::new([2, 2], 1);
        let mut hash = 1u32;
        for _ in 0..8000 {
            hash = hash.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (decision, noise) = (hash >> 31 == 1, (hash >> 20 & 1) as usize);
            assert!(mixture.code(&mut writer, [usize::from(decision), noise], 0, decision).is_ok());
        }
        assert!(writer.finish().len() < 40);
    }
}
