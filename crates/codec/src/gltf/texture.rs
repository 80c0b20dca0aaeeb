//! The picture that a mesh shows instead of its vertices' colours.

use crate::choices::PngCompression;
use crate::error::EncodeError;
use crate::jpeg;
use crate::png::{Samples, write_rows};
use crate::wanted::{Wanted, always};
use pixmesh_meshing::{Image, Shape};

/// A picture that a glTF file carries: a PNG of 8 bits, or the JPEG that it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    pub(crate) bytes: Vec<u8>,
    pub(super) media_type: &'static str,
}

impl Texture {
    /// The picture of a file and the image that was decoded from it, for as long as it is wanted.
    ///
    /// An upright JPEG in gray or YCbCr is carried as it is, without its metadata; everything else
    /// becomes PNG.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] when it is no longer wanted.
    pub fn of_file_while(
        bytes: &[u8],
        image: &Image,
        wanted: &Wanted<'_>,
    ) -> Result<Self, EncodeError> {
        match jpeg::plain_copy(bytes) {
            Some(bytes) => Ok(Self { bytes, media_type: "image/jpeg" }),
            None => Self::of_image_while(image, wanted),
        }
    }

    /// An image as PNG of 8 bits; of five and more components the first three.
    ///
    /// # Errors
    /// Never in practice: the file is made in memory.
    pub fn of_image(image: &Image) -> Result<Self, EncodeError> {
        Self::of_image_while(image, &always)
    }

    fn of_image_while(image: &Image, wanted: &Wanted<'_>) -> Result<Self, EncodeError> {
        let mut bytes = Vec::new();
        let component_count = if image.component_count() > 4 { 3 } else { image.component_count() };
        let samples = Samples { component_count, depth: png::BitDepth::Eight, significant: None };
        write_rows(image, &samples, PngCompression::Small, &mut bytes, wanted)?;
        Ok(Self { bytes, media_type: "image/png" })
    }

    /// The texture whose bytes were [kept](Self::into_bytes).
    #[must_use]
    pub fn of_stored(bytes: Vec<u8>) -> Self {
        let is_png = bytes.starts_with(b"\x89PNG");
        Self { bytes, media_type: if is_png { "image/png" } else { "image/jpeg" } }
    }

    /// The file of the picture.
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// The most bytes that making the texture of an image of this shape holds: its file, in a buffer
    /// that doubles when it is full.
    #[must_use]
    pub fn held_bytes(shape: Shape) -> u64 {
        4 * shape.width as u64 * shape.height as u64 * shape.component_count as u64
    }
}
