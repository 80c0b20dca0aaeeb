//! What is known of a picture before its pixels.

use crate::format::PictureFormat;
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
    /// The image's own samples take two bytes each. PNG and PNM are decoded row by row. A JPEG is
    /// first decoded to one byte a sample; before that it may keep two bytes for each coefficient,
    /// of which it stores one or up to four a pixel; and the file is copied once.
    #[must_use]
    pub fn decode_bytes(&self) -> u64 {
        let pixels = self.width as u64 * self.height as u64;
        let components = self.component_count as u64;
        let rows = 256 * (self.width as u64 + self.height as u64 + 1024);
        match self.format {
            PictureFormat::Png | PictureFormat::Pnm => 2 * components * pixels + rows,
            PictureFormat::Jpeg => {
                let coefficients = if components == 1 { 1 } else { 4 };
                (components + 2 * coefficients) * pixels + rows
            }
        }
    }
}
