//! Large pictures in small files, made in code, whose decoders work for long without reading.

use image_webp::{ColorType, WebPEncoder};

/// Makes the file of a picture of `width` by `height` pixels.
pub(crate) type Make = fn(u16, u16) -> Vec<u8>;

/// The formats by name.
pub(crate) const KINDS: [(&str, Make); 3] = [
    ("progressive JPEG", progressive_jpeg),
    ("lossless WebP", lossless_webp),
    ("lossy WebP", lossy_webp),
];

/// Numbers that look random, the same ones each time.
fn random_bytes() -> impl Iterator<Item = u8> {
    let mut state = 1_u32;
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    })
}

/// A progressive JPEG in colour: one scan of constant coefficients, and one of four others for each
/// component. Each coefficient is written as a zero, its code, and its sign.
fn progressive_jpeg(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = vec![0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0];
    bytes.extend([4; 64]);
    let ([h1, h0], [w1, w0]) = (height.to_be_bytes(), width.to_be_bytes());
    bytes.extend([0xFF, 0xC2, 0, 17, 8, h1, h0, w1, w0, 3]);
    bytes.extend([1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0]);
    for class in [0x00, 0x10] {
        // The one code, of one bit, says that a number of one bit follows.
        bytes.extend([0xFF, 0xC4, 0, 20, class, 1]);
        bytes.extend([0; 15]);
        bytes.push(1);
    }
    let blocks = usize::from(width).div_ceil(8) * usize::from(height).div_ceil(8);
    let coefficients = |count: usize| {
        let pairs = (2 * count).div_ceil(8);
        random_bytes().take(pairs).map(|byte| byte & 0x55).collect::<Vec<u8>>()
    };
    bytes.extend([0xFF, 0xDA, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 0, 0]);
    bytes.extend(coefficients(3 * blocks));
    for component in 1..=3 {
        bytes.extend([0xFF, 0xDA, 0, 8, 1, component, 0, 1, 4, 0]);
        bytes.extend(coefficients(4 * blocks));
    }
    bytes.extend([0xFF, 0xD9]);
    bytes
}

/// A WebP without loss, of sparse noise.
fn lossless_webp(width: u16, height: u16) -> Vec<u8> {
    let samples = 3 * usize::from(width) * usize::from(height);
    let pixels: Vec<u8> = random_bytes().map(|byte| byte / 0xE0).take(samples).collect();
    let mut bytes = Vec::new();
    let encoder = WebPEncoder::new(&mut bytes);
    encoder.encode(&pixels, width.into(), height.into(), ColorType::Rgb8).unwrap();
    bytes
}

/// A WebP with loss: a frame whose header and modes are all zeros, which is what the decoder reads them
/// as, and whose coefficients are noise in the upper rows.
fn lossy_webp(width: u16, height: u16) -> Vec<u8> {
    const MODES_BYTES: u32 = 500_000;
    let tag = MODES_BYTES << 5 | 1 << 4;
    let [t0, t1, t2, _] = tag.to_le_bytes();
    let ([w0, w1], [h0, h1]) = (width.to_le_bytes(), height.to_le_bytes());
    let mut frame = vec![t0, t1, t2, 0x9D, 0x01, 0x2A, w0, w1, h0, h1];
    frame.resize(frame.len() + MODES_BYTES as usize, 0);
    frame.extend(random_bytes().take(2 << 20));
    frame.resize(frame.len() + (1 << 20), 0);
    let length = frame.len() as u32;
    let mut bytes = b"RIFF".to_vec();
    bytes.extend((length + 12).to_le_bytes());
    bytes.extend(b"WEBPVP8 ");
    bytes.extend(length.to_le_bytes());
    bytes.extend(frame);
    bytes
}
