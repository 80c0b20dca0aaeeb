//! The sizes that a picture may have, checked on its header.

use crate::error::DecodeError;
use pixmesh_meshing::{ImageError, MAX_SIDE};

/// The most pixels, columns and rows of a picture that is decoded or of a mesh that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The most pixels, columns times rows.
    pub max_pixels: u64,
    /// The most columns, and the most rows.
    pub max_side: usize,
}

impl Default for Limits {
    /// 40 million pixels and 16384 a side.
    fn default() -> Self {
        Self { max_pixels: 40_000_000, max_side: 16_384 }
    }
}

impl Limits {
    /// Checks the size that a header claims, and gives it back in the machine's integers.
    pub(crate) fn check(&self, width: u64, height: u64) -> Result<(usize, usize), DecodeError> {
        let pixels = width.saturating_mul(height);
        if pixels > self.max_pixels {
            let limit = self.max_pixels;
            return Err(DecodeError::TooManyPixels { width, height, pixels, limit });
        }
        let limit = self.max_side.min(MAX_SIDE);
        let side = |side: u64| usize::try_from(side).ok().filter(|&side| side <= limit);
        let (Some(columns), Some(rows)) = (side(width), side(height)) else {
            return Err(DecodeError::SideTooLong { width, height, limit });
        };
        if columns < 2 || rows < 2 {
            return Err(ImageError::TooSmall { width: columns, height: rows }.into());
        }
        Ok((columns, rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limits_themselves_are_allowed_and_one_more_is_not() {
        let limits = Limits { max_pixels: 100, max_side: 20 };
        assert_eq!(limits.check(10, 10), Ok((10, 10)));
        assert_eq!(limits.check(5, 20), Ok((5, 20)));
        let message = |width, height| limits.check(width, height).unwrap_err().to_string();
        assert_eq!(
            message(101, 1),
            "an image of 101x1 has 101 pixels, more than the limit of 100: scale it down first, \
             for example with `magick photo.png -resize '100@>' smaller.png`"
        );
        assert_eq!(
            message(21, 2),
            "an image of 21x2 has a side over the limit of 20 pixels: scale it down first, for \
             example with `magick photo.png -resize '20x20>' smaller.png`"
        );
        assert!(message(20, 1).contains("20x1"));
        assert!(message(0, 0).contains("0x0"));
    }

    #[test]
    fn products_beyond_64_bits_are_too_many_pixels() {
        let error = Limits::default().check(u64::MAX, 3).unwrap_err();
        assert!(matches!(error, DecodeError::TooManyPixels { pixels: u64::MAX, .. }), "{error}");
    }

    #[test]
    fn a_side_is_never_longer_than_the_kernels_allow() {
        let limits = Limits { max_pixels: u64::MAX, max_side: usize::MAX };
        let error = limits.check(MAX_SIDE as u64 + 1, 2).unwrap_err();
        assert!(matches!(error, DecodeError::SideTooLong { limit: MAX_SIDE, .. }), "{error}");
    }
}
