//! Sizes and periods, as settings write them: `32MiB`, `30s`. None of them may be zero.

use serde::{Serialize, Serializer};
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

/// A number of bytes, over 0: digits, then nothing, `KiB`, `MiB` or `GiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ByteSize(pub u64);

/// A period of time, over 0: digits, then `ms`, `s`, `m` or `h`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Period(pub Duration);

const SIZE_UNITS: [(&str, u64); 4] =
    [("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10), ("", 1)];
const PERIOD_UNITS_MS: [(&str, u64); 4] =
    [("ms", 1), ("s", 1_000), ("m", 60_000), ("h", 3_600_000)];

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        quantity(text, &SIZE_UNITS).map(Self).ok_or_else(|| {
            format!("'{text}' is no size over 0: write 1048576, 1024KiB, 1MiB or 1GiB")
        })
    }
}

impl FromStr for Period {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        quantity(text, &PERIOD_UNITS_MS)
            .map(|period_ms| Self(Duration::from_millis(period_ms)))
            .ok_or_else(|| format!("'{text}' is no period over 0: write 500ms, 30s, 10m or 24h"))
    }
}

impl fmt::Display for ByteSize {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fits = |unit: &&(&str, u64)| self.0.is_multiple_of(unit.1);
        let (unit, bytes) = SIZE_UNITS.iter().find(fits).copied().unwrap_or(("", 1));
        write!(formatter, "{}{unit}", self.0 / bytes)
    }
}

impl fmt::Display for Period {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let period_ms = self.0.as_millis();
        if period_ms.is_multiple_of(1000) {
            write!(formatter, "{}s", period_ms / 1000)
        } else {
            write!(formatter, "{period_ms}ms")
        }
    }
}

impl Serialize for ByteSize {
    /// As it is written.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl Serialize for Period {
    /// As it is written.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Seconds as a decimal number over 0.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds > 0.0 => Ok(seconds),
        _ => Err(format!("'{text}' is no number of seconds over 0")),
    }
}

/// Digits and a unit, multiplied; `None` for zero, for anything else, and for what is too large.
fn quantity(text: &str, units: &[(&str, u64)]) -> Option<u64> {
    let digits = text.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let (_, scale) = units.iter().find(|(name, _)| *name == unit)?;
    number.parse::<u64>().ok()?.checked_mul(*scale).filter(|&value| value > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_periods_read_back_as_they_are_written() {
        for text in ["1GiB", "32MiB", "3KiB", "1025"] {
            assert_eq!(text.parse::<ByteSize>().unwrap().to_string(), text);
        }
        for text in ["500ms", "30s"] {
            assert_eq!(text.parse::<Period>().unwrap().to_string(), text);
        }
        assert_eq!("10m".parse(), Ok(Period(Duration::from_secs(600))));
    }

    #[test]
    fn zero_never_means_unlimited() {
        assert!("0".parse::<ByteSize>().is_err() && "0MiB".parse::<ByteSize>().is_err());
        assert!("0s".parse::<Period>().is_err() && seconds("0").is_err());
    }

    #[test]
    fn what_is_no_quantity_is_refused() {
        for text in
            ["", "MiB", "-1", "1 MiB", "1mb", "1e3", "99999999999GiB", "18446744073709551616"]
        {
            assert!(text.parse::<ByteSize>().is_err(), "{text}");
        }
        assert!("30".parse::<Period>().is_err(), "a period needs its unit");
    }
}
