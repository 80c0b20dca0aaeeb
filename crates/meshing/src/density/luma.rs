//! Gray pictures of a colour image: the luma, and the gray pictures of the thesis.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage};
use crate::image::Image;
use crate::parallel::in_row_bands;
use crate::parameters::choices::Guide;

/// The gray picture whose error guides the mesh, of an image's first three components; `None`
/// where the components themselves guide it.
pub(crate) fn guide_picture(
    image: &Image,
    guide: Guide,
    control: &dyn Control,
) -> Result<Option<Image>, Cancelled> {
    match guide {
        Guide::Components => Ok(None),
        Guide::Luma => gray_picture(image, luma_of, control).map(Some),
        Guide::Gray => gray_picture(image, gray_of, control).map(Some),
    }
}

/// The gray value of each colour, as an image of one component: a copy of the first component where
/// there are fewer than three.
fn gray_picture(
    image: &Image,
    gray_of: fn([u16; 3]) -> u16,
    control: &dyn Control,
) -> Result<Image, Cancelled> {
    let [red, green, blue, ..] = image.components() else {
        return Ok(image.with_components(vec![image.components()[0].clone()]));
    };
    let (mut samples, width) = (vec![0; image.pixel_count()], image.width());
    in_row_bands(&mut samples, width, control, |first_row, band, control| {
        for (i, chunk) in band.chunks_mut(POINTS_PER_POLL).enumerate() {
            control.poll(Stage::Density, 0, 1)?;
            let start = first_row * width + i * POINTS_PER_POLL;
            let colours = red[start..].iter().zip(&green[start..]).zip(&blue[start..]);
            for (sample, ((&red, &green), &blue)) in chunk.iter_mut().zip(colours) {
                *sample = gray_of([red, green, blue]);
            }
        }
        Ok(())
    })?;
    Ok(image.with_components(vec![samples]))
}

/// The luma of one colour, `floor(0.299 R + 0.587 G + 0.114 B)`.
///
/// The sum is one of 64-bit floating point, from left to right, and falls now and then just short
/// of a whole number: three equal components of 128 have the luma 127. The thesis's published
/// results are made so; exact fractions do not reproduce them.
#[inline]
pub(crate) fn luma_of([red, green, blue]: [u16; 3]) -> u16 {
    let sum = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    sum.floor() as u16
}

/// The gray value of one colour in the thesis's gray test images.
fn gray_of(colour: [u16; 3]) -> u16 {
    let [red, green, blue] = colour.map(u32::from);
    ((77 * red + 150 * green + 29 * blue + 128) >> 8) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luma_of_equal_components_is_exact_or_one_less() {
        let off: Vec<u16> = (0..=255).filter(|&v| luma_of([v, v, v]) != v).collect();
        assert!(off.iter().all(|&v| luma_of([v, v, v]) == v - 1), "{off:?}");
        assert!(off.contains(&128) && off.len() == 65, "{off:?}");
    }

    #[test]
    fn guides_have_known_values() {
        let components = vec![vec![1, 0, 0, 255], vec![1, 1, 0, 0], vec![0, 0, 9, 0]];
        let image = Image::from_bottom_up(2, 2, 8, components).unwrap();
        let guide = |guide| guide_picture(&image, guide, &()).unwrap();
        assert_eq!(guide(Guide::Components), None);
        assert_eq!(guide(Guide::Luma).unwrap().components()[0], [0, 0, 1, 76]);
        assert_eq!(guide(Guide::Gray).unwrap().components()[0], [1, 1, 1, 77]);
    }

    #[test]
    fn gray_keeps_equal_components() {
        for value in [0, 1, 127, 128, 255, 4095, u16::MAX] {
            assert_eq!(gray_of([value; 3]), value);
        }
        assert_eq!([gray_of([0, 0, 255]), gray_of([0, 255, 0])], [29, 149]);
    }
}
