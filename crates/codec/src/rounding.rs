//! Integer division, rounded to the nearest.

/// `dividend / divisor`, halves up.
pub(crate) fn rounded_quotient(dividend: u64, divisor: u64) -> u64 {
    (2 * dividend + divisor) / (2 * divisor)
}
