//! What is known of a picture before its pixels.

use crate::format::PictureFormat;
use crate::webp::CODE_BYTES;
use pixmesh_meshing::Shape;

/// Bytes that a decoder holds per column and per row, and for [`MORE_ROWS`] more of them: buffers of
/// single rows, tables of codes and of colours.
const ROW_BYTES: u64 = 256;
const MORE_ROWS: u64 = 1024;

/// Bytes of a sample of an image.
const SAMPLE_BYTES: u64 = 2;

/// What a picture's header says of the decoded image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The file's format, detected from its content.
    pub format: PictureFormat,
    /// Columns of the upright picture, that is after the orientation in its EXIF data; at least 2.
    pub width: usize,
    /// Rows of the upright picture, at least 2.
    pub height: usize,
    /// Components of the decoded image, alpha included: 1 to 4. Of an elevation model the alpha may be
    /// absent in the image, where no sample is missing.
    pub component_count: usize,
    /// Bits per sample of the decoded image, 1 to 16.
    pub precision: u8,
}

impl Header {
    /// The shape of the decoded image.
    #[must_use]
    pub fn shape(&self) -> Shape {
        let Self { width, height, component_count, precision, .. } = *self;
        Shape { width, height, component_count, precision }
    }

    /// The most bytes that decoding holds at once, copies of the file itself not counted: the samples
    /// of the image, those of alpha until it is dropped, and what the format's decoder holds beside
    /// them. Decoding under these [`DecodeOptions::max_bytes`](crate::DecodeOptions) succeeds.
    #[must_use]
    pub fn decode_bytes(&self) -> u64 {
        // One component more, for an alpha that is not in the image.
        self.image_bytes((self.component_count + 1).min(4)) + self.decoder_bytes()
    }

    /// Bytes of `component_count` planes of samples.
    pub(crate) fn image_bytes(&self, component_count: usize) -> u64 {
        SAMPLE_BYTES * component_count as u64 * self.width as u64 * self.height as u64
    }

    /// The most bytes that the format's decoder holds beside the image's samples.
    ///
    /// PNG and PNM are decoded row by row. All others are first decoded as their formats store them,
    /// a byte or two a sample, and keep what they need for that.
    pub(crate) fn decoder_bytes(&self) -> u64 {
        let (per_pixel, tables) = match self.format {
            PictureFormat::Png | PictureFormat::Pnm => (0, 0),
            // A byte a sample, and in progressive files two for each coefficient: one or up to four
            // a pixel are stored.
            PictureFormat::Jpeg if self.component_count == 1 => (1 + 2, 0),
            PictureFormat::Jpeg => (3 + 2 * 4, 0),
            // RGBA, and the planes of a lossy picture; or RGBA twice.
            PictureFormat::WebP => (4 + 4 + 4, 2 * CODE_BYTES as u64),
            PictureFormat::Gif => (1, 0),
            PictureFormat::Tiff => (5 * u64::from(self.precision).div_ceil(8), 0),
            PictureFormat::Bmp => (4, 0),
        };
        let (width, height) = (self.width as u64, self.height as u64);
        per_pixel * width * height + ROW_BYTES * (width + height + MORE_ROWS) + tables
    }
}
