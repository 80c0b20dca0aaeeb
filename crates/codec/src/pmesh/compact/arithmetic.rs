//! Binary arithmetic coding: decisions with probabilities of 12 bits, an interval with bounds of 32.

use crate::wanted::Wanted;
use pixmesh_meshing::Cancelled;

/// Decisions between two polls.
const DECISIONS_PER_POLL: u32 = 1 << 16;

/// Bytes that a reader looks ahead.
const AHEAD: usize = 4;

/// Why coding ends early.
pub(in crate::pmesh) enum Stop {
    /// The bytes are no stream of these decisions.
    Damaged,
    /// The result is no longer wanted.
    Cancelled(Cancelled),
}

/// Codes one decision after another: a writer takes them, a reader tells them.
pub(super) trait Coder {
    /// Whether decisions are told, and those given to [`Self::code`] mean nothing.
    const READS: bool;

    /// Codes a decision that is true with a probability of `chance` / 4096, 1 to 4095.
    fn code(&mut self, decision: bool, chance: u32) -> Result<bool, Stop>;
}

/// The last number of the lower part of an interval, which stands for true.
fn split(low: u32, high: u32, chance: u32) -> u32 {
    let range = high - low;
    low + (range >> 12) * chance + (((range & 0xfff) * chance) >> 12)
}

/// Polls from time to time.
struct Poller<'a> {
    wanted: &'a Wanted<'a>,
    decisions: u32,
}

impl Poller<'_> {
    fn step(&mut self) -> Result<(), Stop> {
        self.decisions += 1;
        if self.decisions == DECISIONS_PER_POLL {
            self.decisions = 0;
            (self.wanted)().map_err(Stop::Cancelled)?;
        }
        Ok(())
    }
}

/// Writes decisions.
pub(super) struct Writer<'a> {
    low: u32,
    high: u32,
    bytes: Vec<u8>,
    poller: Poller<'a>,
}

impl<'a> Writer<'a> {
    pub(super) fn new(wanted: &'a Wanted<'a>) -> Self {
        let poller = Poller { wanted, decisions: 0 };
        Self { low: 0, high: u32::MAX, bytes: Vec::new(), poller }
    }

    /// The bytes of all decisions: at the end those of the number in the interval that needs the
    /// fewest before its zeros, which a reader adds.
    pub(super) fn finish(mut self) -> Vec<u8> {
        let candidate = |kept: usize| {
            let zeros = u32::MAX.checked_shr(8 * kept as u32).unwrap_or(0);
            let number = self.low.checked_add(zeros)? & !zeros;
            (number <= self.high).then(|| number.to_be_bytes()[..kept].to_vec())
        };
        let last = (0..AHEAD).find_map(candidate).unwrap_or(self.low.to_be_bytes().to_vec());
        self.bytes.extend(last);
        self.bytes
    }
}

impl Coder for Writer<'_> {
    const READS: bool = false;

    fn code(&mut self, decision: bool, chance: u32) -> Result<bool, Stop> {
        self.poller.step()?;
        let middle = split(self.low, self.high, chance);
        if decision {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.bytes.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
        }
        Ok(decision)
    }
}

/// Reads decisions.
pub(super) struct Reader<'a> {
    low: u32,
    high: u32,
    number: u32,
    rest: &'a [u8],
    /// Zeros added at the end.
    added: usize,
    poller: Poller<'a>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8], wanted: &'a Wanted<'a>) -> Self {
        let poller = Poller { wanted, decisions: 0 };
        let mut reader = Self { low: 0, high: u32::MAX, number: 0, rest: bytes, added: 0, poller };
        for _ in 0..AHEAD {
            reader.shift();
        }
        reader
    }

    fn shift(&mut self) {
        let byte = match self.rest.split_first() {
            Some((&byte, rest)) => {
                self.rest = rest;
                byte
            }
            None => {
                self.added += 1;
                0
            }
        };
        self.number = self.number << 8 | u32::from(byte);
    }

    /// Fails when bytes are left that no decision needed.
    pub(super) fn finish(self) -> Result<(), Stop> {
        if self.rest.is_empty() { Ok(()) } else { Err(Stop::Damaged) }
    }
}

impl Coder for Reader<'_> {
    const READS: bool = true;

    fn code(&mut self, _: bool, chance: u32) -> Result<bool, Stop> {
        self.poller.step()?;
        let middle = split(self.low, self.high, chance);
        let decision = self.number <= middle;
        if decision {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
            self.shift();
        }
        // A writer's last number has at most as many zeros as a reader looks ahead.
        if self.added > AHEAD { Err(Stop::Damaged) } else { Ok(decision) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wanted::always;
    use proptest::prelude::*;

    fn decoded(bytes: &[u8], chances: &[(u32, bool)]) -> Option<Vec<bool>> {
        let mut reader = Reader::new(bytes, &always);
        let decisions = chances.iter().map(|&(chance, _)| reader.code(false, chance).ok());
        let decisions = decisions.collect::<Option<_>>()?;
        reader.finish().ok().map(|()| decisions)
    }

    proptest! {
        #[test]
        fn decisions_read_back_as_they_were(
            decisions in prop::collection::vec((1u32..4096, any::<bool>()), 0..300)
        ) {
            let mut writer = Writer::new(&always);
            for &(chance, decision) in &decisions {
                prop_assert!(writer.code(decision, chance).is_ok());
            }
            let mut bytes = writer.finish();
            let expected: Vec<_> = decisions.iter().map(|&(_, decision)| decision).collect();
            prop_assert_eq!(decoded(&bytes, &decisions), Some(expected));
            bytes.extend([7; AHEAD + 1]);
            prop_assert_eq!(decoded(&bytes, &decisions), None);
        }
    }

    #[test]
    fn a_decision_costs_what_its_probability_says() {
        let mut writer = Writer::new(&always);
        for i in 0..8000 {
            assert!(writer.code(i % 4 != 0, 3072).is_ok());
        }
        // 0.8113 bits each.
        assert!((811..=813).contains(&writer.finish().len()));
    }

    #[test]
    fn a_stream_that_ends_early_is_damaged() {
        let mut reader = Reader::new(&[0x80], &always);
        let failed = (0..100).position(|_| matches!(reader.code(false, 2048), Err(Stop::Damaged)));
        assert_eq!(failed, Some(15));
    }
}
