//! Pictures in the formats that are only read, by the encoders of others.

use pixmesh_meshing::Image;
use std::io::Cursor;
use tiff::encoder::colortype::{Gray8, Gray16, RGB8, RGB16, RGBA8, RGBA16};
use tiff::encoder::{Compression, Predictor, TiffEncoder};

/// The samples row by row from the top, those of a pixel side by side.
fn interleaved(image: &Image) -> Vec<u16> {
    let rows = (0..image.height()).rev();
    rows.flat_map(|y| {
        (0..image.width())
            .flat_map(move |x| (0..image.component_count()).map(move |c| image.sample(c, x, y)))
    })
    .collect()
}

fn interleaved_bytes(image: &Image) -> Vec<u8> {
    interleaved(image).iter().map(|&sample| sample as u8).collect()
}

fn size(image: &Image) -> (u32, u32) {
    (image.width() as u32, image.height() as u32)
}

/// An image of 8 bits as lossless WebP.
pub(crate) fn webp(image: &Image) -> Vec<u8> {
    let color = match image.component_count() {
        1 => image_webp::ColorType::L8,
        2 => image_webp::ColorType::La8,
        3 => image_webp::ColorType::Rgb8,
        _ => image_webp::ColorType::Rgba8,
    };
    let (width, height) = size(image);
    let mut bytes = Vec::new();
    let encoder = image_webp::WebPEncoder::new(&mut bytes);
    encoder.encode(&interleaved_bytes(image), width, height, color).unwrap();
    bytes
}

/// An image of 1, 3 or 4 components of 8 bits as BMP.
pub(crate) fn bmp(image: &Image) -> Vec<u8> {
    let color = match image.component_count() {
        1 => image::ExtendedColorType::L8,
        3 => image::ExtendedColorType::Rgb8,
        _ => image::ExtendedColorType::Rgba8,
    };
    let (width, height) = size(image);
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::bmp::BmpEncoder::new(&mut bytes);
    encoder.encode(&interleaved_bytes(image), width, height, color).unwrap();
    bytes
}

/// An image of 1, 3 or 4 components of 8 or 16 bits as TIFF.
pub(crate) fn tiff(image: &Image, compression: Compression, predictor: Predictor) -> Vec<u8> {
    let (width, height) = size(image);
    let mut bytes = Cursor::new(Vec::new());
    let encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut encoder = encoder.with_compression(compression).with_predictor(predictor);
    let (words, octets) = (interleaved(image), interleaved_bytes(image));
    match (image.component_count(), image.precision()) {
        (1, 16) => encoder.write_image::<Gray16>(width, height, &words),
        (3, 16) => encoder.write_image::<RGB16>(width, height, &words),
        (_, 16) => encoder.write_image::<RGBA16>(width, height, &words),
        (1, _) => encoder.write_image::<Gray8>(width, height, &octets),
        (3, _) => encoder.write_image::<RGB8>(width, height, &octets),
        (..) => encoder.write_image::<RGBA8>(width, height, &octets),
    }
    .unwrap();
    bytes.into_inner()
}

/// A frame of a GIF: indices of a palette of 256 grays.
#[derive(Clone, Debug, Default)]
pub(crate) struct GifFrame {
    pub(crate) left: u16,
    pub(crate) top: u16,
    pub(crate) width: u16,
    pub(crate) height: u16,
    pub(crate) transparent: Option<u8>,
    pub(crate) interlaced: bool,
    pub(crate) indices: Vec<u8>,
}

/// A GIF of frames on a screen, whose palette is that of 256 grays.
pub(crate) fn gif(width: u16, height: u16, frames: &[GifFrame]) -> Vec<u8> {
    let palette: Vec<u8> = (0..=255).flat_map(|gray| [gray; 3]).collect();
    let mut bytes = Vec::new();
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &palette).unwrap();
    for frame in frames {
        let GifFrame { left, top, width, height, transparent, interlaced, .. } = *frame;
        let buffer = frame.indices.clone().into();
        let frame = gif::Frame {
            left,
            top,
            width,
            height,
            transparent,
            interlaced,
            buffer,
            ..gif::Frame::default()
        };
        encoder.write_frame(&frame).unwrap();
    }
    drop(encoder);
    bytes
}

/// A gray image of 8 bits as GIF.
pub(crate) fn gray_gif(image: &Image) -> Vec<u8> {
    let (width, height) = (image.width() as u16, image.height() as u16);
    let indices = interleaved_bytes(image);
    gif(width, height, &[GifFrame { width, height, indices, ..GifFrame::default() }])
}
