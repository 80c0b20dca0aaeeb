//! The picture that is meshed where no file is given, and pictures as the kernels take them.

use image::RgbImage;
use pixmesh_meshing::{Image, ImageError};

/// Discs of many sizes and colours one over the other, shaded and with a little noise, in a square
/// of this side.
pub(crate) fn made_up(side: u32) -> RgbImage {
    let mut state = 1u64;
    let mut random = |bound: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (state >> 33) as u32 % bound
    };
    let mut pixels = RgbImage::from_fn(side, side, |x, y| {
        image::Rgb([
            (x * 512 / side / 3) as u8,
            (y * 128 / side) as u8,
            ((x + y) * 64 / side) as u8,
        ])
    });
    for _ in 0..120 {
        let (x, y, radius) = (random(side), random(side), 4 + random(side * 15 / 128));
        let colour = [random(200), random(200), random(200)];
        let beside = |at: u32| at.saturating_sub(radius)..side.min(at + radius);
        for (py, px) in beside(y).flat_map(|py| beside(x).map(move |px| (py, px))) {
            if px.abs_diff(x).pow(2) + py.abs_diff(y).pow(2) < radius * radius {
                let shade = (px + radius - x) * 40 / (2 * radius);
                pixels.get_pixel_mut(px, py).0 = colour.map(|c| (c + shade) as u8);
            }
        }
    }
    for pixel in pixels.pixels_mut() {
        pixel.0 = pixel.0.map(|sample| sample.saturating_add(random(7) as u8));
    }
    pixels
}

/// The three components of a picture.
pub(crate) fn colour(pixels: &RgbImage) -> Result<Image, ImageError> {
    let component = |c: usize| pixels.pixels().map(|pixel| pixel.0[c].into()).collect();
    image_of(pixels, (0..3).map(component).collect())
}

/// The luma of a picture.
pub(crate) fn gray(pixels: &RgbImage) -> Result<Image, ImageError> {
    let luma = |[red, green, blue]: [u8; 3]| {
        (0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)) as u16
    };
    image_of(pixels, vec![pixels.pixels().map(|pixel| luma(pixel.0)).collect()])
}

fn image_of(pixels: &RgbImage, components: Vec<Vec<u16>>) -> Result<Image, ImageError> {
    Image::from_top_down(pixels.width() as usize, pixels.height() as usize, 8, components)
}
