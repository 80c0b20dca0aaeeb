//! The luma of a colour picture, as a picture of one component.

use crate::image::Image;

/// The luma `floor(0.299 R + 0.587 G + 0.114 B)` of an image's first three components, with the
/// image's precision; a copy of the first component when there are fewer than three.
///
/// The sum is one of 64-bit floating point, from left to right, which now and then falls just
/// short of a whole number (three equal components of 128 have the luma 127): so it was in the
/// thesis's published results, and with exact fractions they are not reproduced.
pub(crate) fn luma(image: &Image) -> Image {
    let samples = match image.components() {
        [red, green, blue, ..] => {
            let colours = red.iter().zip(green).zip(blue);
            colours.map(|((&red, &green), &blue)| luma_of([red, green, blue])).collect()
        }
        components => components[0].clone(),
    };
    image.with_components(vec![samples])
}

/// The luma of one colour.
#[inline]
pub(crate) fn luma_of([red, green, blue]: [u16; 3]) -> u16 {
    let sum = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    sum.floor() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_components_are_their_own_luma_or_one_less() {
        let off: Vec<u16> = (0..=255).filter(|&v| luma_of([v, v, v]) != v).collect();
        assert!(off.iter().all(|&v| luma_of([v, v, v]) == v - 1), "{off:?}");
        assert!(off.contains(&128) && off.len() == 65, "{off:?}");
    }

    #[test]
    fn luma_is_rounded_down() {
        let components = vec![vec![1, 0, 0, 255], vec![1, 1, 0, 0], vec![0, 0, 9, 0]];
        let image = Image::from_bottom_up(2, 2, 8, components).unwrap();
        assert_eq!(luma(&image).components()[0], [0, 0, 1, 76]);
    }
}
