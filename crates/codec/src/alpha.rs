//! What becomes of a picture's alpha: kept as a component, dropped, or composed over a colour.

use crate::header::Header;
use crate::rounding::rounded_quotient;
use crate::wanted::Wanted;
use pixmesh_meshing::{Cancelled, ParameterError};
use std::fmt;
use std::str::FromStr;

/// Samples between two polls of `wanted`.
const POLL_SAMPLES: usize = 1 << 16;

/// What becomes of alpha, the last component of a picture of two or four.
///
/// ```
/// use pixmesh_codec::Alpha;
///
/// assert_eq!("over:#ff8000".parse(), Ok(Alpha::Over([255, 128, 0])));
/// assert_eq!(Alpha::Over([255, 128, 0]).to_string(), "over:#ff8000");
/// assert!("over:red".parse::<Alpha>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Alpha {
    /// It is a component like any other.
    #[default]
    Keep,
    /// It is left out; the other components stay as they are stored.
    Drop,
    /// The picture is composed over a colour, red, green and blue of 8 bits, and has no alpha then.
    /// A gray picture stays gray over a gray and becomes RGB over any other colour.
    Over([u8; 3]),
}

impl Alpha {
    /// Name of the parameter that takes these values.
    pub const PARAMETER: &'static str = "alpha";
    /// How the values are written.
    pub const NAMES: &'static [&'static str] = &["keep", "drop", "over:#rrggbb"];

    /// What a header becomes.
    pub(crate) fn of_header(self, header: Header) -> Header {
        let component_count = match (self, header.component_count) {
            (Self::Drop, count @ (2 | 4)) => count - 1,
            (Self::Over([red, green, blue]), 2) => {
                if red == green && green == blue {
                    1
                } else {
                    3
                }
            }
            (Self::Over(_), 4) => 3,
            (_, count) => count,
        };
        Header { component_count, ..header }
    }

    /// Applies the choice to planes of samples of `precision` bits, for as long as they are wanted.
    pub(crate) fn apply(
        self,
        planes: &mut Vec<Vec<u16>>,
        precision: u8,
        wanted: &Wanted<'_>,
    ) -> Result<(), Cancelled> {
        if !matches!(planes.len(), 2 | 4) || self == Self::Keep {
            return Ok(());
        }
        let alphas = planes.pop().unwrap_or_default();
        let Self::Over(colour) = self else { return Ok(()) };
        let [red, green, blue] = colour;
        if planes.len() == 1 && !(red == green && green == blue) {
            planes.resize_with(3, Vec::new);
            if let Some((gray, others)) = planes.split_first_mut() {
                others.iter_mut().for_each(|plane| plane.clone_from(gray));
            }
        }
        let largest = u64::from(u16::MAX >> (16 - precision));
        for (plane, backdrop) in planes.iter_mut().zip(colour) {
            let backdrop = rounded_quotient(u64::from(backdrop) * largest, 255);
            for (samples, alphas) in plane.chunks_mut(POLL_SAMPLES).zip(alphas.chunks(POLL_SAMPLES))
            {
                wanted()?;
                for (sample, &alpha) in samples.iter_mut().zip(alphas) {
                    let alpha = u64::from(alpha);
                    let sum = u64::from(*sample) * alpha + backdrop * (largest - alpha);
                    *sample = rounded_quotient(sum, largest) as u16;
                }
            }
        }
        Ok(())
    }
}

impl fmt::Display for Alpha {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Keep => formatter.write_str("keep"),
            Self::Drop => formatter.write_str("drop"),
            Self::Over([red, green, blue]) => {
                write!(formatter, "over:#{red:02x}{green:02x}{blue:02x}")
            }
        }
    }
}

impl FromStr for Alpha {
    type Err = ParameterError;

    /// Reads `keep`, `drop`, or `over:` and a colour of six hexadecimal digits, with or without `#`
    /// (which in a query is written `%23`).
    fn from_str(text: &str) -> Result<Self, ParameterError> {
        let colour = || {
            let digits = text.strip_prefix("over:")?;
            let digits = digits.strip_prefix('#').unwrap_or(digits);
            let all_digits = digits.len() == 6 && digits.bytes().all(|d| d.is_ascii_hexdigit());
            let value = u32::from_str_radix(digits, 16).ok().filter(|_| all_digits)?;
            let [_, red, green, blue] = value.to_be_bytes();
            Some(Self::Over([red, green, blue]))
        };
        match text {
            "keep" => Ok(Self::Keep),
            "drop" => Ok(Self::Drop),
            _ => colour().ok_or_else(|| ParameterError::UnknownValue {
                parameter: Self::PARAMETER,
                value: text.to_owned(),
                allowed: Self::NAMES,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wanted::always;

    fn applied(alpha: &str, planes: &[u16], precision: u8) -> Vec<u16> {
        let mut planes: Vec<Vec<u16>> = planes.iter().map(|&sample| vec![sample]).collect();
        alpha.parse::<Alpha>().unwrap().apply(&mut planes, precision, &always).unwrap();
        planes.concat()
    }

    #[test]
    fn alpha_is_kept_dropped_or_composed() {
        assert_eq!(applied("keep", &[10, 20, 30, 40], 8), [10, 20, 30, 40]);
        assert_eq!(applied("drop", &[10, 20, 30, 40], 8), [10, 20, 30]);
        assert_eq!(applied("drop", &[10, 40], 8), [10]);
        assert_eq!(applied("over:#ffffff", &[10, 20, 30, 0], 8), [255, 255, 255]);
        assert_eq!(applied("over:ffffff", &[10, 20, 30, 255], 8), [10, 20, 30]);
        assert_eq!(applied("over:#000000", &[255, 100, 0, 128], 8), [128, 50, 0]);
        assert_eq!(applied("over:#808080", &[0, 0], 8), [128]);
        assert_eq!(applied("over:#ff0000", &[7, 0], 8), [255, 0, 0]);
        assert_eq!(applied("over:#ffffff", &[0, 0], 16), [65535]);
        assert_eq!(applied("over:#ffffff", &[0, 0], 1), [1]);
    }

    #[test]
    fn pictures_without_alpha_stay_what_they_are() {
        for alpha in ["keep", "drop", "over:#123456"] {
            assert_eq!(applied(alpha, &[1, 2, 3], 8), [1, 2, 3]);
            assert_eq!(applied(alpha, &[9], 8), [9]);
        }
    }

    #[test]
    fn what_is_no_value_is_refused() {
        for text in ["", "Keep", "over", "over:", "over:#12345", "over:#+12345", "over:#1234567"] {
            assert!(text.parse::<Alpha>().is_err(), "{text}");
        }
    }
}
