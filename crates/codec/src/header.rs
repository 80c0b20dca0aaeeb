//! What is known of a picture before its pixels.

use crate::budget::{decoder_bytes, image_bytes};
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

    /// The most bytes that decoding holds at once, copies of the file itself not counted: the samples
    /// of the image, those of alpha too until it is dropped, and what the format's decoder holds
    /// beside them. Decoding under these [`DecodeOptions::max_bytes`](crate::DecodeOptions) succeeds.
    #[must_use]
    pub fn decode_bytes(&self) -> u64 {
        // One component more, that of an alpha that does not come into the image.
        image_bytes(self, (self.component_count + 1).min(4)) + decoder_bytes(self)
    }
}
