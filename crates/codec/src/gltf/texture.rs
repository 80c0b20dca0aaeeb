//! The picture that a mesh shows instead of its vertices' colours.

use crate::choices::PngCompression;
use crate::error::EncodeError;
use crate::jpeg;
use crate::png::write_png_while;
use crate::wanted::{Wanted, always};
use pixmesh_meshing::{Image, Shape};

/// A picture that a glTF file carries: a PNG of 8 bits, or the JPEG that it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    bytes: Vec<u8>,
    media_type: &'static str,
}

impl Texture {
    /// The picture of a file and the image that was decoded from it.
    ///
    /// A JPEG that is upright and not in inks is carried as it is, its metadata left out; everything
    /// else becomes PNG.
    ///
    /// # Errors
    /// As [`Self::of_image`].
    pub fn of_file(bytes: &[u8], image: &Image) -> Result<Self, EncodeError> {
        Self::of_file_while(bytes, image, &always)
    }

    /// As [`Self::of_file`], for as long as the picture is wanted.
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
        let image = of_8_bits(image, wanted)?;
        write_png_while(&image, PngCompression::Small, &mut bytes, wanted)?;
        Ok(Self { bytes, media_type: "image/png" })
    }

    /// The most bytes that making the texture of an image of this shape holds: a copy of 8 bits a
    /// sample, and its file.
    #[must_use]
    pub fn held_bytes(shape: Shape) -> u64 {
        4 * shape.width as u64 * shape.height as u64 * shape.component_count as u64
    }

    /// The file.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// `image/png` or `image/jpeg`.
    #[must_use]
    pub fn media_type(&self) -> &'static str {
        self.media_type
    }
}

/// The image with samples of 8 bits, rounded to the nearest, and at most four components.
fn of_8_bits(image: &Image, wanted: &Wanted<'_>) -> Result<Image, EncodeError> {
    let largest = u32::from(image.max_sample());
    let table: Vec<u16> =
        (0..=largest).map(|sample| ((510 * sample + largest) / (2 * largest)) as u16).collect();
    let scaled = |&sample: &u16| table.get(usize::from(sample)).copied().unwrap_or(255);
    let count = if image.component_count() > 4 { 3 } else { image.component_count() };
    let (width, height) = (image.width(), image.height());
    let mut planes = Vec::with_capacity(count);
    for component in 0..count {
        let mut plane = Vec::with_capacity(width * height);
        for y in 0..height {
            wanted()?;
            plane.extend(image.row(component, y).iter().map(scaled));
        }
        planes.push(plane);
    }
    Ok(Image::from_bottom_up(width, height, 8, planes).map_err(std::io::Error::other)?)
}
