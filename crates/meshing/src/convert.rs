//! Conversions from and to the types of the crate `image`.

use crate::alpha::straighten_vectors;
use crate::image::{Image, ImageError};
use image::{DynamicImage, ImageBuffer, Luma, LumaA, Rgb, Rgba};

impl TryFrom<&DynamicImage> for Image {
    type Error = ImageError;

    /// Takes the channels, alpha too, as components of 8 or 16 bits; floats become 16 bits. Colours
    /// are [premultiplied](crate::alpha).
    ///
    /// ```
    /// let decoded = image::DynamicImage::new_rgb8(3, 2);
    /// let image = pixmesh_meshing::Image::try_from(&decoded)?;
    /// assert_eq!((image.width(), image.component_count()), (3, 3));
    /// # Ok::<(), pixmesh_meshing::ImageError>(())
    /// ```
    fn try_from(picture: &DynamicImage) -> Result<Self, ImageError> {
        let channels = usize::from(picture.color().channel_count());
        let size = (picture.width() as usize, picture.height() as usize);
        if let Some(pixels) = picture.as_flat_samples_u8() {
            of_channels(size, 8, pixels.samples, channels)
        } else if let Some(pixels) = picture.as_flat_samples_u16() {
            of_channels(size, 16, pixels.samples, channels)
        } else if channels == 3 {
            of_channels(size, 16, &picture.to_rgb16(), channels)
        } else {
            of_channels(size, 16, &picture.to_rgba16(), 4)
        }
    }
}

impl From<&Image> for DynamicImage {
    /// Makes a picture of 8 bits, or of 16 where there are more than 8. One component is gray, two
    /// are gray and alpha, three RGB, four RGBA; of more than four the first three are taken.
    fn from(image: &Image) -> Self {
        let (width, height) = (image.width() as u32, image.height() as u32);
        macro_rules! picture {
            ($pixel:ident) => {
                if image.precision() <= 8 {
                    let pixel = |x, y| $pixel(samples(image, x, y, u8::MAX));
                    ImageBuffer::from_fn(width, height, pixel).into()
                } else {
                    let pixel = |x, y| $pixel(samples(image, x, y, u16::MAX));
                    ImageBuffer::from_fn(width, height, pixel).into()
                }
            };
        }
        match image.component_count() {
            1 => picture!(Luma),
            2 => picture!(LumaA),
            4 => picture!(Rgba),
            _ => picture!(Rgb),
        }
    }
}

fn of_channels<T: Copy + Into<u16>>(
    (width, height): (usize, usize),
    precision: u8,
    pixels: &[T],
    count: usize,
) -> Result<Image, ImageError> {
    let channel = |c| pixels.iter().skip(c).step_by(count).map(|&sample| sample.into()).collect();
    let channels = (0..count).map(channel).collect();
    Ok(Image::from_top_down(width, height, precision, channels)?.premultiplied())
}

/// The first samples of a pixel whose row counts from the top, scaled to 0 to `largest`.
fn samples<T, const N: usize>(image: &Image, x: u32, y: u32, largest: T) -> [T; N]
where
    T: Copy + Into<u64> + TryFrom<u64>,
{
    let (row, of) = (image.height() - 1 - y as usize, u64::from(image.max_sample()));
    let mut samples = std::array::from_fn::<u16, N, _>(|c| image.sample(c, x as usize, row));
    straighten_vectors(&mut samples, N, image.max_sample());
    samples.map(|sample| {
        T::try_from((u64::from(sample) * largest.into() + of / 2) / of).unwrap_or(largest)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_survive_both_conversions() {
        for (count, precision) in
            [(1, 8), (2, 8), (3, 8), (4, 8), (1, 16), (2, 16), (3, 16), (4, 16)]
        {
            let plane = |c: usize| (0..6).map(|i| (i * 40 + c) as u16).collect();
            let components = (0..count).map(plane).collect();
            let image = Image::from_top_down(3, 2, precision, components).unwrap();
            assert_eq!(Image::try_from(&DynamicImage::from(&image)), Ok(image));
        }
    }

    #[test]
    fn other_precisions_are_scaled() {
        let image = Image::from_top_down(2, 2, 4, vec![vec![0, 15, 7, 1]]).unwrap();
        let picture = DynamicImage::from(&image).into_luma8();
        assert_eq!(picture.as_raw(), &[0, 255, 119, 17]);
        let five = Image::from_top_down(2, 2, 12, vec![vec![4095; 4]; 5]).unwrap();
        assert_eq!(DynamicImage::from(&five).into_rgb16().as_raw(), &[u16::MAX; 12]);
        let float = Image::try_from(&DynamicImage::new_rgb32f(2, 2)).unwrap();
        assert_eq!((float.component_count(), float.precision()), (3, 16));
    }
}
