//! How values are written: a strict grammar, the same wherever they come from.
//!
//! A number is an optional minus, ASCII digits, and for decimals an optional fraction and exponent;
//! no spaces, no plus sign but an exponent's, no other digits, no units. Every number of JSON is a
//! decimal; a whole number is written without fraction and exponent there too, so that `10.0` and
//! `1e1` are refused where one is asked for. What reads as a number but has no finite value (`NaN`,
//! `inf`, `1e309`) is refused as such and not as malformed.

use crate::error::{Bound, InputError};

/// A decimal number between bounds.
pub(super) fn decimal(name: &str, text: &str, least: f64, most: f64) -> Result<f64, InputError> {
    if is_no_number_word(text) {
        return Err(not_finite(name));
    }
    if !is_decimal(text) {
        return Err(malformed(name, "a decimal number such as 2 or 0.5"));
    }
    let value: f64 = text.parse().map_err(|_| malformed(name, "a decimal number"))?;
    if !value.is_finite() {
        return Err(not_finite(name));
    }
    if value < least || value > most {
        return Err(out_of_range(name, text, Bound::Decimal(least), Bound::Decimal(most)));
    }
    Ok(value)
}

/// A whole number; `None` for one that 64 bits without a sign do not hold.
pub(super) fn whole(name: &str, text: &str) -> Result<Option<u64>, InputError> {
    if is_no_number_word(text) {
        return Err(not_finite(name));
    }
    let digits = text.strip_prefix('-').unwrap_or(text);
    if !all_digits(digits) {
        return Err(malformed(name, "a whole number such as 1000"));
    }
    let is_zero = digits.bytes().all(|digit| digit == b'0');
    Ok(if is_zero { Some(0) } else { text.parse().ok() })
}

/// A whole number between bounds, both allowed.
///
/// # Errors
/// When the text is no whole number or is out of the bounds.
pub fn whole_between(name: &str, text: &str, least: u64, most: u64) -> Result<u64, InputError> {
    let value = whole(name, text)?.filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| out_of_range(name, text, Bound::Whole(least), Bound::Whole(most)))
}

/// `true` or `false`.
pub(super) fn flag(name: &str, text: &str) -> Result<bool, InputError> {
    text.parse().map_err(|_| InputError::NotAFlag(name.to_owned()))
}

/// The refusal of a text that is no value at all.
pub(super) fn malformed(name: &str, expected: &'static str) -> InputError {
    InputError::Malformed { name: name.to_owned(), expected }
}

/// The refusal of a number out of bounds.
fn out_of_range(name: &str, text: &str, least: Bound, most: Bound) -> InputError {
    InputError::OutOfRange {
        name: name.to_owned(),
        text: text.chars().take(32).collect(),
        least,
        most,
    }
}

fn not_finite(name: &str) -> InputError {
    InputError::NotFinite(name.to_owned())
}

/// Whether the text is a word for what is no finite number, in any case, with or without a sign.
fn is_no_number_word(text: &str) -> bool {
    let word = text.strip_prefix(['+', '-']).unwrap_or(text);
    ["nan", "inf", "infinity"].iter().any(|known| word.eq_ignore_ascii_case(known))
}

/// `-? digits ( . digits )? ( [eE] [+-]? digits )?`
fn is_decimal(text: &str) -> bool {
    let unsigned = text.strip_prefix('-').unwrap_or(text);
    let (number, exponent) = unsigned.split_once(['e', 'E']).unwrap_or((unsigned, "0"));
    let (whole, fraction) = number.split_once('.').unwrap_or((number, "0"));
    let exponent = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
    [whole, fraction, exponent].into_iter().all(all_digits)
}

fn all_digits(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|letter| letter.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_malformed<T>(result: &Result<T, InputError>) -> bool {
        matches!(result, Err(InputError::Malformed { .. }))
    }

    #[test]
    fn decimals_follow_the_grammar_and_nothing_else() {
        for text in ["5", "0.5", "-0.5", "1e2", "1.5E-1", "1e+1", "007"] {
            assert!(decimal("density", text, -10.0, 100.0).is_ok(), "{text}");
        }
        for text in [
            "", " 5", "5 ", "5%", "5,0", "0x10", "٥", "1_000", "+5", ".5", "5.", "1e", "e5", "--1",
            "1e++2", "1e+", "+1e2",
        ] {
            assert!(is_malformed(&decimal("density", text, 0.0, 100.0)), "{text}");
        }
        for text in ["NaN", "nan", "inf", "-inf", "+Infinity", "1e309", "-1e309"] {
            let refused = Err(InputError::NotFinite("density".into()));
            assert_eq!(decimal("density", text, 0.0, 100.0), refused, "{text}");
        }
    }

    #[test]
    fn whole_numbers_have_no_fraction_and_tell_overflow_apart() {
        assert_eq!(whole("seed", "18446744073709551615"), Ok(Some(u64::MAX)));
        assert_eq!(whole("seed", "18446744073709551616"), Ok(None));
        assert_eq!(whole("seed", "-1"), Ok(None));
        assert_eq!(whole("seed", "-0"), Ok(Some(0)));
        for text in ["1e6", "3.5", "10.0", "", "+1", " 1", "-"] {
            assert!(is_malformed(&whole("seed", text)), "{text}");
        }
    }
}
