//! A set of columns that finds the nearest member at or before a column.
//!
//! A tree of 64-bit words, each bit of which tells whether the word below it has any: one word is
//! read where the nearest member is near, four levels hold the widest image. The idea, with other
//! widths, is Peter van Emde Boas, "Preserving order in a forest in less than logarithmic time",
//! 1975.

/// Bits of a word.
const WORD: usize = 64;

/// A set of numbers below a bound.
#[derive(Debug)]
pub(super) struct ColumnSet {
    /// Words of members, then words that tell which of the words of the level before are not 0.
    levels: Vec<Vec<u64>>,
}

impl ColumnSet {
    /// The empty set of columns below `count`.
    pub(super) fn new(count: usize) -> Self {
        let mut levels = Vec::new();
        let mut words = count;
        while words > 1 || levels.is_empty() {
            words = words.div_ceil(WORD);
            levels.push(vec![0; words]);
        }
        Self { levels }
    }

    /// Adds a column.
    #[inline]
    pub(super) fn insert(&mut self, column: usize) {
        let mut at = column;
        for level in &mut self.levels {
            let word = &mut level[at / WORD];
            let known_above = *word != 0;
            *word |= 1 << (at % WORD);
            if known_above {
                return;
            }
            at /= WORD;
        }
    }

    /// Takes a column out.
    #[inline]
    pub(super) fn remove(&mut self, column: usize) {
        let mut at = column;
        for level in &mut self.levels {
            let word = &mut level[at / WORD];
            *word &= !(1 << (at % WORD));
            if *word != 0 {
                return;
            }
            at /= WORD;
        }
    }

    /// The last member that is not after `column`.
    #[inline]
    pub(super) fn at_or_before(&self, column: usize) -> Option<usize> {
        let word = self.levels[0][column / WORD] & (u64::MAX >> (WORD - 1 - column % WORD));
        if word == 0 {
            self.before_word(column / WORD)
        } else {
            Some(last_bit(column / WORD, word))
        }
    }

    /// The last member in the words before one.
    fn before_word(&self, word: usize) -> Option<usize> {
        let mut at = word;
        for (height, level) in self.levels.iter().enumerate().skip(1) {
            let before = level[at / WORD] & ((1 << (at % WORD)) - 1);
            if before != 0 {
                let top = last_bit(at / WORD, before);
                let below = self.levels[..height].iter().rev();
                return Some(below.fold(top, |at, level| last_bit(at, level[at])));
            }
            at /= WORD;
        }
        None
    }
}

/// The number of the last bit of a word that is set, counted from the first word's first.
#[inline]
fn last_bit(index: usize, word: u64) -> usize {
    index * WORD + word.ilog2() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn the_nearest_member_is_that_of_an_ordered_set(
            count in prop::sample::select(vec![1usize, 2, 64, 65, 4096, 4097, 300_000]),
            changes in prop::collection::vec((any::<bool>(), any::<prop::sample::Index>()), 0..60),
            asked in prop::collection::vec(any::<prop::sample::Index>(), 20),
        ) {
            let (mut set, mut expected) = (ColumnSet::new(count), BTreeSet::new());
            for (is_new, column) in changes {
                // Some of them again and again.
                let column = column.index(count) / 7 * 7;
                if is_new {
                    set.insert(column);
                    expected.insert(column);
                } else {
                    set.remove(column);
                    expected.remove(&column);
                }
            }
            for column in asked.iter().map(|column| column.index(count)) {
                prop_assert_eq!(set.at_or_before(column), expected.range(..=column).next_back().copied());
            }
        }
    }
}
