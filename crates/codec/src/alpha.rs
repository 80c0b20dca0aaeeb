//! What becomes of a picture's alpha: kept, cut, dropped, or composed over a colour.

use crate::header::Header;
use crate::rounding::rounded_quotient;
use crate::wanted::Wanted;
use pixmesh_meshing::alpha::{has_alpha, premultiply};
use pixmesh_meshing::{Cancelled, ParameterError};
use std::fmt;
use std::str::FromStr;

/// The least bits of a cut picture: the least alpha over 0 must not be seen.
const CUT_PRECISION: u8 = 8;

/// Samples between two polls of `wanted`.
const POLL_SAMPLES: usize = 1 << 16;

/// What becomes of alpha, the last component of a picture of two or four.
///
/// ```
/// use pixmesh_codec::Alpha;
///
/// assert_eq!("over:#ff8000".parse(), Ok(Alpha::Over([255, 128, 0])));
/// assert_eq!(Alpha::Over([255, 128, 0]).to_string(), "over:#ff8000");
/// assert_eq!("cut:8".parse(), Ok(Alpha::Cut(Alpha::CUT)));
/// assert!("over:red".parse::<Alpha>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Alpha {
    /// It is the last component, and the colours are [premultiplied](pixmesh_meshing::alpha).
    #[default]
    Keep,
    /// The same, but pixels of at most this alpha, of 255, become transparent; and what is written
    /// of a mesh leaves out the faces that show nothing.
    Cut(u8),
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
    pub const NAMES: &'static [&'static str] =
        &["keep", "cut", "cut:0 to 254", "drop", "over:#rrggbb"];
    /// The alpha of `cut` without a number.
    pub const CUT: u8 = 8;

    /// Whether faces that show nothing are left out.
    #[must_use]
    pub fn is_cut(self) -> bool {
        matches!(self, Self::Cut(_))
    }

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
        let precision = self.precision(header.component_count, header.precision);
        Header { component_count, precision, ..header }
    }

    /// The bits that samples of a picture of so many components and bits become.
    pub(crate) fn precision(self, component_count: usize, precision: u8) -> u8 {
        let needs_steps = self.is_cut() && has_alpha(component_count);
        if needs_steps { precision.max(CUT_PRECISION) } else { precision }
    }

    /// Applies the choice to planes of samples of `precision` bits, for as long as they are wanted.
    /// Their colours are straight, or premultiplied already.
    pub(crate) fn apply(
        self,
        planes: &mut Vec<Vec<u16>>,
        precision: u8,
        is_premultiplied: bool,
        wanted: &Wanted<'_>,
    ) -> Result<(), Cancelled> {
        if !has_alpha(planes.len()) {
            return Ok(());
        }
        let to = self.precision(planes.len(), precision);
        if to != precision {
            scale(planes, precision, to, wanted)?;
        }
        let largest = u16::MAX >> (16 - to);
        let mut alphas = planes.pop().unwrap_or_default();
        let colour = match self {
            Self::Drop => return Ok(()),
            Self::Keep | Self::Cut(_) => {
                if let Self::Cut(most) = self {
                    let most = u32::from(most) * u32::from(largest) / 255;
                    let hidden = alphas.iter_mut().filter(|alpha| u32::from(**alpha) <= most);
                    hidden.for_each(|alpha| *alpha = 0);
                }
                for plane in planes.iter_mut() {
                    let chunks = plane.chunks_mut(POLL_SAMPLES);
                    for (colors, alphas) in chunks.zip(alphas.chunks(POLL_SAMPLES)) {
                        wanted()?;
                        if is_premultiplied {
                            colors.iter_mut().zip(alphas).for_each(|(c, &a)| *c = (*c).min(a));
                        } else {
                            premultiply(colors, alphas, largest);
                        }
                    }
                }
                planes.push(alphas);
                return Ok(());
            }
            Self::Over(colour) => colour,
        };
        let [red, green, blue] = colour;
        if planes.len() == 1 && !(red == green && green == blue) {
            planes.resize_with(3, Vec::new);
            if let Some((gray, others)) = planes.split_first_mut() {
                others.iter_mut().for_each(|plane| plane.clone_from(gray));
            }
        }
        let largest = u64::from(largest);
        for (plane, backdrop) in planes.iter_mut().zip(colour) {
            let backdrop = rounded_quotient(u64::from(backdrop) * largest, 255);
            for (samples, alphas) in plane.chunks_mut(POLL_SAMPLES).zip(alphas.chunks(POLL_SAMPLES))
            {
                wanted()?;
                for (sample, &alpha) in samples.iter_mut().zip(alphas) {
                    let alpha = u64::from(alpha);
                    let factor = if is_premultiplied { largest } else { alpha };
                    let sum = u64::from(*sample) * factor + backdrop * (largest - alpha);
                    *sample = rounded_quotient(sum, largest).min(largest) as u16;
                }
            }
        }
        Ok(())
    }
}

/// Scales samples from some bits to more, rounded to the nearest, halves up.
fn scale(planes: &mut [Vec<u16>], from: u8, to: u8, wanted: &Wanted<'_>) -> Result<(), Cancelled> {
    let [from, to] = [from, to].map(|bits| u64::from(u16::MAX >> (16 - bits)));
    for chunk in planes.iter_mut().flat_map(|plane| plane.chunks_mut(POLL_SAMPLES)) {
        wanted()?;
        for sample in chunk {
            *sample = rounded_quotient(u64::from(*sample) * to, from) as u16;
        }
    }
    Ok(())
}

impl fmt::Display for Alpha {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Keep => formatter.write_str("keep"),
            Self::Cut(Self::CUT) => formatter.write_str("cut"),
            Self::Cut(most) => write!(formatter, "cut:{most}"),
            Self::Drop => formatter.write_str("drop"),
            Self::Over([red, green, blue]) => {
                write!(formatter, "over:#{red:02x}{green:02x}{blue:02x}")
            }
        }
    }
}

impl FromStr for Alpha {
    type Err = ParameterError;

    /// Reads `keep`, `drop`, `cut`, `cut:` and a number of 0 to 254, or `over:` and a colour of six
    /// hexadecimal digits, with or without `#` (which in a query is written `%23`).
    fn from_str(text: &str) -> Result<Self, ParameterError> {
        let colour = || {
            let digits = text.strip_prefix("over:")?;
            let digits = digits.strip_prefix('#').unwrap_or(digits);
            let all_digits = digits.len() == 6 && digits.bytes().all(|d| d.is_ascii_hexdigit());
            let value = u32::from_str_radix(digits, 16).ok().filter(|_| all_digits)?;
            let [_, red, green, blue] = value.to_be_bytes();
            Some(Self::Over([red, green, blue]))
        };
        let cut = || {
            let digits = text.strip_prefix("cut:")?;
            let all_digits = digits.bytes().all(|digit| digit.is_ascii_digit());
            digits.parse().ok().filter(|&most| all_digits && most < u8::MAX).map(Self::Cut)
        };
        match text {
            "keep" => Ok(Self::Keep),
            "drop" => Ok(Self::Drop),
            "cut" => Ok(Self::Cut(Self::CUT)),
            _ => cut().or_else(colour).ok_or_else(|| ParameterError::UnknownValue {
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
        alpha.parse::<Alpha>().unwrap().apply(&mut planes, precision, false, &always).unwrap();
        planes.concat()
    }

    #[test]
    fn alpha_is_kept_dropped_or_composed() {
        assert_eq!(applied("keep", &[10, 200, 30, 51], 8), [2, 40, 6, 51]);
        assert_eq!(applied("cut", &[255, 9], 8), [9, 9]);
        assert_eq!(applied("cut", &[255, 8], 8), [0, 0]);
        assert_eq!(applied("cut:0", &[255, 1], 8), [1, 1]);
        assert_eq!(applied("cut:254", &[9, 255], 8), [9, 255]);
        assert_eq!(applied("cut:254", &[1, 1], 1), [255, 255], "1 bit becomes 8");
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
    fn premultiplied_colors_are_not_multiplied_again() {
        let applied = |alpha: Alpha| {
            let mut planes = vec![vec![40, 200], vec![51, 51]];
            alpha.apply(&mut planes, 8, true, &always).unwrap();
            planes
        };
        assert_eq!(applied(Alpha::Keep), [[40, 51], [51, 51]], "no colour exceeds its alpha");
        assert_eq!(applied(Alpha::Over([100; 3])), [[120, 255]]);
    }

    #[test]
    fn pictures_without_alpha_stay_what_they_are() {
        for alpha in ["keep", "cut", "drop", "over:#123456"] {
            assert_eq!(applied(alpha, &[1, 2, 3], 8), [1, 2, 3]);
            assert_eq!(applied(alpha, &[9], 8), [9]);
        }
    }

    #[test]
    fn what_is_no_value_is_refused() {
        for text in [
            "",
            "Keep",
            "cut:",
            "cut:255",
            "cut:+1",
            "cut:x",
            "over",
            "over:",
            "over:#12345",
            "over:#+12345",
            "over:#1234567",
        ] {
            assert!(text.parse::<Alpha>().is_err(), "{text}");
        }
    }
}
