//! What is known of a picture before its pixels.

use crate::format::PictureFormat;
use crate::webp::CODE_BYTES;
use pixmesh_meshing::Shape;

/// What a picture's header tells of the image that decoding will give.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The file's format, told by its content.
    pub format: PictureFormat,
    /// Columns of the upright picture, that is after the orientation in its EXIF data; at least 2.
    pub width: usize,
    /// Rows of the upright picture, at least 2.
    pub height: usize,
    /// Components of the decoded image, alpha included: 1 to 4.
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

    /// The most bytes that decoding holds at once, copies of the file itself not counted.
    ///
    /// The image's own samples take two bytes each, those of alpha too until it is dropped. PNG and
    /// PNM are decoded row by row. All others are first decoded as their formats store them, a byte
    /// or two a sample, and keep what they need for that: a JPEG two bytes for each coefficient, of
    /// which it stores one or up to four a pixel, a WebP the planes of its key frame or, where
    /// nothing is lost, four bytes a pixel twice and the tables of its codes.
    #[must_use]
    pub fn decode_bytes(&self) -> u64 {
        let pixels = self.width as u64 * self.height as u64;
        let components = self.component_count as u64;
        let rows = 256 * (self.width as u64 + self.height as u64 + 1024);
        // One component more, that of an alpha that does not come into the image.
        let samples = 2 * (components + 1).min(4);
        let stored = match self.format {
            PictureFormat::Png | PictureFormat::Pnm => 0,
            PictureFormat::Jpeg if components == 1 => 1 + 2,
            PictureFormat::Jpeg => 3 + 2 * 4,
            PictureFormat::WebP => 4 + 4 + 4,
            PictureFormat::Gif => 1,
            PictureFormat::Tiff => 5 * u64::from(self.precision).div_ceil(8),
            PictureFormat::Bmp => 4,
        };
        let codes = if self.format == PictureFormat::WebP { 2 * CODE_BYTES as u64 } else { 0 };
        (samples + stored) * pixels + rows + codes
    }
}
