//! The picture that is meshed: a file, or one made up.

use image::{ExtendedColorType, ImageEncoder, RgbImage};
use pixmesh_meshing::Image;
use std::error::Error;

const SIDE: u32 = 512;

/// A picture as a PNG file, and its samples.
pub(crate) struct Picture {
    pub(crate) name: String,
    pub(crate) png: Vec<u8>,
    pub(crate) colour: Image,
    /// The luma.
    pub(crate) gray: Image,
}

impl Picture {
    /// The picture of a PNG file, or one made up.
    pub(crate) fn new(path: Option<&str>) -> Result<Self, Box<dyn Error>> {
        let png = match path {
            Some(path) => std::fs::read(path)?,
            None => made_up_png()?,
        };
        let pixels = image::load_from_memory(&png)?.to_rgb8();
        let (width, height) = (pixels.width() as usize, pixels.height() as usize);
        let component = |c: usize| pixels.pixels().map(|pixel| pixel.0[c].into()).collect();
        let colour = Image::from_top_down(width, height, 8, (0..3).map(component).collect())?;
        let luma = |[red, green, blue]: [u8; 3]| {
            (0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)) as u16
        };
        let gray = pixels.pixels().map(|pixel| luma(pixel.0)).collect();
        let gray = Image::from_top_down(width, height, 8, vec![gray])?;
        let name = path.unwrap_or("a picture made up").to_owned();
        Ok(Self { name, png, colour, gray })
    }
}

/// Discs of many sizes and colours one over the other, shaded and with a little noise.
fn made_up_png() -> Result<Vec<u8>, Box<dyn Error>> {
    let mut state = 1u64;
    let mut random = |bound: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (state >> 33) as u32 % bound
    };
    let mut pixels = RgbImage::from_fn(SIDE, SIDE, |x, y| {
        image::Rgb([(x / 3) as u8, (y / 4) as u8, ((x + y) / 8) as u8])
    });
    for _ in 0..120 {
        let (x, y, radius) = (random(SIDE) as i64, random(SIDE) as i64, 4 + random(60) as i64);
        let colour = [random(200), random(200), random(200)];
        for (px, py, pixel) in pixels.enumerate_pixels_mut() {
            let (dx, dy) = (i64::from(px) - x, i64::from(py) - y);
            if dx * dx + dy * dy < radius * radius {
                let shade = ((dx + radius) * 40 / (2 * radius)) as u32;
                pixel.0 = colour.map(|c| (c + shade) as u8);
            }
        }
    }
    for pixel in pixels.pixels_mut() {
        pixel.0 = pixel.0.map(|sample| sample.saturating_add(random(7) as u8));
    }
    let mut png = Vec::new();
    image::codecs::png::PngEncoder::new(&mut png).write_image(
        &pixels,
        SIDE,
        SIDE,
        ExtendedColorType::Rgb8,
    )?;
    Ok(png)
}
