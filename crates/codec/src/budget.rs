//! The memory that decoding reserves before it takes it.

use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::webp::CODE_BYTES;

/// Bytes that a decoder holds for each column and each row, and for so many more: buffers of single
/// rows, tables of codes and of colours.
const ROW_BYTES: u64 = 256;
const MORE_ROWS: u64 = 1024;

/// Bytes of a sample of an image.
const SAMPLE_BYTES: u64 = 2;

/// Bytes of the samples of an image, `component_count` planes of them.
pub(crate) fn image_bytes(header: &Header, component_count: usize) -> u64 {
    SAMPLE_BYTES * component_count as u64 * header.width as u64 * header.height as u64
}

/// The most bytes that the decoder of a format holds beside the image's samples.
///
/// PNG and PNM are decoded row by row. All others are first decoded as their formats store them, a
/// byte or two a sample, and keep what they need for that.
pub(crate) fn decoder_bytes(header: &Header) -> u64 {
    let per_pixel = match header.format {
        PictureFormat::Png | PictureFormat::Pnm => 0,
        // A byte a sample, and of progressive files two for each coefficient: one or up to four a
        // pixel are stored.
        PictureFormat::Jpeg if header.component_count == 1 => 1 + 2,
        PictureFormat::Jpeg => 3 + 2 * 4,
        // RGBA, and the planes of a lossy picture; or RGBA twice.
        PictureFormat::WebP => 4 + 4 + 4,
        PictureFormat::Gif => 1,
        PictureFormat::Tiff => 5 * u64::from(header.precision).div_ceil(8),
        PictureFormat::Bmp => 4,
    };
    let codes = if header.format == PictureFormat::WebP { 2 * CODE_BYTES as u64 } else { 0 };
    let (width, height) = (header.width as u64, header.height as u64);
    per_pixel * width * height + ROW_BYTES * (width + height + MORE_ROWS) + codes
}

/// Bytes that decoding has reserved, of those that it may take.
pub(crate) struct Budget {
    reserved: u64,
    allowed: u64,
}

impl Budget {
    /// Reserves what decoding takes beside the planes that the file stores: what the decoder holds,
    /// and planes that gray gets which is composed over a colour.
    ///
    /// # Errors
    /// As [`Self::reserve`].
    pub(crate) fn of_decoder(
        header: &Header,
        options: &DecodeOptions,
    ) -> Result<Self, DecodeError> {
        let mut budget = Self { reserved: 0, allowed: options.max_bytes.unwrap_or(u64::MAX) };
        let (stored, made) = (header.component_count, options.alpha.of_header(*header));
        let added =
            if made.component_count > stored { made.component_count + 1 - stored } else { 0 };
        budget.reserve(decoder_bytes(header) + image_bytes(header, added))?;
        Ok(budget)
    }

    /// Reserves bytes that are about to be taken.
    ///
    /// # Errors
    /// When all that is reserved would be more than is allowed.
    pub(crate) fn reserve(&mut self, bytes: u64) -> Result<(), DecodeError> {
        let (needed, allowed) = (self.reserved.saturating_add(bytes), self.allowed);
        if needed > allowed {
            return Err(DecodeError::TooMuchMemory { needed, allowed });
        }
        self.reserved = needed;
        Ok(())
    }
}
