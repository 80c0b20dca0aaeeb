//! Pictures to send, made in code.

use pixmesh_meshing::Image;

/// A disc on a gradient, 8 bits, as PNG.
pub(crate) fn disc(width: usize, height: usize, components: usize) -> Vec<u8> {
    png(&disc_image(width, height, components))
}

pub(crate) fn disc_image(width: usize, height: usize, components: usize) -> Image {
    let (radius, x0, y0) = (width.min(height) / 3, width / 2, height / 2);
    let sample = |c: usize, x: usize, y: usize| {
        let inside = x.abs_diff(x0).pow(2) + y.abs_diff(y0).pow(2) < radius.pow(2);
        let gradient = [x * 100 / width, y * 100 / height, (x + y) * 50 / (width + height)][c % 3];
        if inside { 250 - gradient as u16 } else { gradient as u16 }
    };
    image(width, height, components, sample)
}

/// A square with a hard edge in the middle of transparent pixels.
pub(crate) fn sprite(side: usize) -> Vec<u8> {
    let is_inside = |at: usize| (side / 4..3 * side / 4).contains(&at);
    let plane = |sample: u16| {
        let pixels = (0..side * side).map(|i| is_inside(i % side) && is_inside(i / side));
        pixels.map(|inside| if inside { sample } else { 0 }).collect()
    };
    png(&Image::from_top_down(side, side, 8, [200, 90, 30, 255].map(plane).to_vec()).unwrap())
}

/// Noise, 8 bits gray, as PGM: nothing simplifies quickly in it.
pub(crate) fn noise(side: usize) -> Vec<u8> {
    let mut state = 1_u32;
    let mut bytes = format!("P5\n{side} {side}\n255\n").into_bytes();
    bytes.extend((0..side * side).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    }));
    bytes
}

/// Noise, 8 bits, three components, as PNG: it takes long to decode.
pub(crate) fn colour_noise(width: usize, height: usize) -> Vec<u8> {
    let mut state = 1_u32;
    let sample = |_, _, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        // Of four bits, so that there is something to inflate.
        (state >> 24 & 0xF0) as u16
    };
    png(&image(width, height, 3, sample))
}

/// A picture of one colour, 8 bits, three components, as PPM: quick to mesh whatever its size.
pub(crate) fn flat(width: usize, height: usize) -> Vec<u8> {
    let mut bytes = format!("P6\n{width} {height}\n255\n").into_bytes();
    bytes.resize(bytes.len() + 3 * width * height, 7);
    bytes
}

pub(crate) fn png(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    pixmesh_codec::write_png(image, &mut bytes).unwrap();
    bytes
}

/// A PNG of nothing but a signature, a header that claims a size, and a little data.
pub(crate) fn png_claiming(width: u32, height: u32) -> Vec<u8> {
    let mut header = b"IHDR".to_vec();
    header.extend_from_slice(&width.to_be_bytes());
    header.extend_from_slice(&height.to_be_bytes());
    header.extend_from_slice(&[8, 0, 0, 0, 0]);
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    for chunk in [header, b"IDAT\x78".to_vec(), b"IEND".to_vec()] {
        bytes.extend_from_slice(&(chunk.len() as u32 - 4).to_be_bytes());
        bytes.extend_from_slice(&chunk);
        bytes.extend_from_slice(&crc32(&chunk).to_be_bytes());
    }
    bytes
}

fn image(
    width: usize,
    height: usize,
    components: usize,
    mut sample: impl FnMut(usize, usize, usize) -> u16,
) -> Image {
    let mut plane =
        |c: usize| (0..width * height).map(|i| sample(c, i % width, i / width)).collect();
    Image::from_top_down(width, height, 8, (0..components).map(&mut plane).collect()).unwrap()
}

/// The checksum of a PNG's chunk.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}
