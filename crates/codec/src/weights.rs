//! Weights: a picture that says how much each point of another picture matters.
//!
//! White is the largest weight, black is 0. A picture in colour gives its luma, because painting
//! programs and browsers write gray drawings as RGB. Alpha is ignored.

use crate::alpha::Alpha;
use crate::color::{LUMA_SUM, luma};
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::header::Header;
use crate::limits::Limits;
use crate::rounding::rounded_quotient;
use crate::wanted::{Wanted, always};
use pixmesh_meshing::parameters::Weights;
use pixmesh_meshing::{Cancelled, Image};
use thiserror::Error;

/// Why a picture gives no weights.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WeightsError {
    /// It cannot be decoded.
    #[error("the weights: {0}")]
    Picture(#[from] DecodeError),
    /// It is of another size than the picture whose points it weighs.
    #[error(
        "the weights are a picture of {}x{}, but that of the picture to weigh is {}x{}",
        actual.0, actual.1, expected.0, expected.1
    )]
    Size {
        /// Its columns and rows.
        actual: (usize, usize),
        /// Those of the other.
        expected: (usize, usize),
    },
    /// Its components are neither gray nor RGB.
    #[error("the weights are a picture of {0} components, but must have 1 (gray) or 3 (colour)")]
    ComponentCount(usize),
}

/// Reads the header of the weights of a picture whose columns and rows are `expected`.
///
/// # Errors
/// As [`read_weights_while`], but for broken pixels.
pub fn probe_weights(
    bytes: &[u8],
    expected: (usize, usize),
    limits: &Limits,
) -> Result<Header, WeightsError> {
    let options = DecodeOptions { limits: *limits, ..DecodeOptions::default() };
    let header = without_alpha(&options).probe(bytes)?;
    check((header.width, header.height), header.component_count, expected)?;
    Ok(header)
}

/// Reads the weights, 0 to 255, of a picture whose columns and rows are `expected`, as
/// [`Parameters::weights`](pixmesh_meshing::Parameters::weights) takes them, for as long as they are
/// wanted. Of the options, the limits and the memory count: a file that ends early is refused.
///
/// # Errors
/// When the bytes are not a picture, or one of another size or of neither 1 nor 3 components;
/// [`DecodeError::Cancelled`] when the weights are no longer wanted.
pub fn read_weights_while(
    bytes: &[u8],
    expected: (usize, usize),
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Weights, WeightsError> {
    let picture = without_alpha(options).decode_while(bytes, wanted)?;
    let size = (picture.width(), picture.height());
    check(size, picture.component_count(), expected)?;
    let weights = lumas(&picture, wanted).map_err(DecodeError::from)?;
    Ok(Weights::from_bottom_up(size.0, size.1, weights).map_err(DecodeError::from)?)
}

/// Reads weights as [`read_weights_while`] does, to the end.
///
/// # Errors
/// As [`read_weights_while`].
pub fn read_weights(
    bytes: &[u8],
    expected: (usize, usize),
    limits: &Limits,
) -> Result<Weights, WeightsError> {
    let options = DecodeOptions { limits: *limits, ..DecodeOptions::default() };
    read_weights_while(bytes, expected, &options, &always)
}

/// The options for a picture of weights.
fn without_alpha(options: &DecodeOptions) -> DecodeOptions {
    DecodeOptions { alpha: Alpha::Drop, lenient: false, ..*options }
}

fn check(
    actual: (usize, usize),
    component_count: usize,
    expected: (usize, usize),
) -> Result<(), WeightsError> {
    if actual != expected {
        return Err(WeightsError::Size { actual, expected });
    }
    match component_count {
        1 | 3 => Ok(()),
        other => Err(WeightsError::ComponentCount(other)),
    }
}

/// The luma of each point as 8 bits, rounded to the nearest.
fn lumas(picture: &Image, wanted: &Wanted<'_>) -> Result<Vec<u8>, Cancelled> {
    let most = u64::from(LUMA_SUM) * u64::from(picture.max_sample());
    let scaled = |samples: &[u16]| rounded_quotient(255 * u64::from(luma(samples)), most) as u8;
    let mut weights = Vec::with_capacity(picture.pixel_count());
    for y in 0..picture.height() {
        wanted()?;
        let first = picture.row(0, y);
        if picture.component_count() == 3 {
            let colours = first.iter().zip(picture.row(1, y)).zip(picture.row(2, y));
            weights.extend(colours.map(|((&r, &g), &b)| scaled(&[r, g, b])));
        } else {
            weights.extend(first.iter().map(|&gray| scaled(&[gray])));
        }
    }
    Ok(weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8], expected: (usize, usize)) -> Result<Vec<u8>, WeightsError> {
        let limits = Limits::default();
        assert_eq!(
            probe_weights(text, expected, &limits).is_ok(),
            read_weights(text, expected, &limits).is_ok()
        );
        read_weights(text, expected, &limits).map(|weights| weights.values().to_vec())
    }

    #[test]
    fn gray_of_any_depth_and_colours_without_alpha_become_weights_of_8_bits() {
        assert_eq!(
            read(b"P2\n3 2\n15\n0 7 15 1 2 3\n", (3, 2)).unwrap(),
            [17, 34, 51, 0, 119, 255]
        );
        assert_eq!(read(b"P1\n2 2\n0 1 1 0\n", (2, 2)).unwrap(), [0, 255, 255, 0]);
        let colour = b"P3\n2 2\n255\n255 255 255 255 0 0 0 255 0 0 0 255\n";
        assert_eq!(read(colour, (2, 2)).unwrap(), [150, 29, 255, 76]);
        let alpha = b"P7\nWIDTH 2\nHEIGHT 2\nDEPTH 2\nMAXVAL 255\nTUPLTYPE GRAYSCALE_ALPHA\nENDHDR\nabcdefgh";
        assert_eq!(read(alpha, (2, 2)).unwrap(), *b"egac");
    }

    #[test]
    fn other_pictures_are_refused_and_told_why() {
        let of = |text: &[u8], expected| read(text, expected).unwrap_err().to_string();
        assert!(of(b"P2\n3 2\n15\n0 7 15 1 2 3\n", (2, 3)).contains("3x2"));
        assert!(of(b"nothing", (2, 3)).starts_with("the weights: "));
        let many = b"P7\nWIDTH 2\nHEIGHT 2\nDEPTH 5\nMAXVAL 255\nENDHDR\nabcdefghijklmnopqrst";
        assert!(of(many, (2, 2)).contains("components"));
    }
}
