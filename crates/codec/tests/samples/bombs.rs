//! Files that claim more than they hold, or hold more than they say.

use super::{gradient, ihdr, jpeg, png_file};

/// The name of a file, and its bytes.
type Named = (&'static str, Vec<u8>);

/// A header that claims too many pixels, in a file that holds hardly any.
pub(crate) fn huge_headers() -> Vec<Named> {
    let mut huge_jpeg = jpeg(&gradient(16, 16, 1), 90);
    let frame = huge_jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    huge_jpeg[frame + 5..frame + 9].copy_from_slice(&[0xFA, 0xFA, 0xFA, 0xFA]);
    let png = |width, height, interlaced| {
        let header = (b"IHDR", ihdr(width, height, 1, 0, interlaced));
        png_file(&[header, (b"IDAT", vec![0]), (b"IEND", Vec::new())])
    };
    vec![
        ("PNG 100000x100000", png(100_000, 100_000, false)),
        ("PNG 14000x14000 interlaced", png(14_000, 14_000, true)),
        ("PNG 2^31-1 square", png((1 << 31) - 1, (1 << 31) - 1, false)),
        ("PNG 1x2000000000", png(1, 2_000_000_000, false)),
        ("PGM 2^32-1 square", b"P5 4294967295 4294967295 255\n".to_vec()),
        ("PGM 10^40", format!("P5 1{:040} 3 255\n", 0).into_bytes()),
        ("PPM 100000x100000", b"P3 100000 100000 65535\n1 2 3".to_vec()),
        ("PAM 16385x2", b"P7 WIDTH 16385 HEIGHT 2 DEPTH 4 MAXVAL 1 ENDHDR\n".to_vec()),
        ("JPEG 64250x64250", huge_jpeg),
        ("GIF 65535x65535", b"GIF89a\xFF\xFF\xFF\xFF\x80\0\0\0\0\0\xFF\xFF\xFF".to_vec()),
        (
            "WebP canvas 16384x16384",
            webp(&[(b"VP8X", vp8x(16_384, 16_384)), (b"VP8L", tiny_webp())]),
        ),
        ("WebP lossless 16384x16384", webp(&[(b"VP8L", vec![0x2F, 0xFF, 0xFF, 0xFF, 0x0F, 0])])),
        ("TIFF 2^32-1 square", tiff(u32::MAX, u32::MAX, 1)),
        ("TIFF 100000x3", tiff(100_000, 3, 1)),
        ("BMP 30000x30000", bmp(30_000, 30_000)),
    ]
}

/// A WebP of chunks.
pub(crate) fn webp(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut body = b"WEBP".to_vec();
    for (kind, data) in chunks {
        body.extend_from_slice(*kind);
        body.extend((data.len() as u32).to_le_bytes());
        body.extend_from_slice(data);
        body.extend(std::iter::repeat_n(0, data.len() % 2));
    }
    [&b"RIFF"[..], &(body.len() as u32).to_le_bytes(), &body].concat()
}

/// The header of an extended WebP.
pub(crate) fn vp8x(width: u32, height: u32) -> Vec<u8> {
    let side = |side: u32| (side - 1).to_le_bytes()[..3].to_vec();
    [vec![0; 4], side(width), side(height)].concat()
}

/// The data of a lossless picture of 2x2 pixels.
pub(crate) fn tiny_webp() -> Vec<u8> {
    super::encoders::webp(&gradient(2, 2, 3))[20..].to_vec()
}

/// A TIFF of a strip that is not there, with so many values of its offset.
pub(crate) fn tiff(width: u32, height: u32, strips: u32) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0\x09\0".to_vec();
    for (tag, kind, count, value) in [
        (256_u16, 4_u16, 1_u32, width),
        (257, 4, 1, height),
        (258, 3, 1, 8),
        (259, 3, 1, 8),
        (262, 3, 1, 1),
        (273, 4, strips, 122),
        (277, 3, 1, 1),
        (278, 4, 1, height.div_ceil(strips)),
        (279, 4, strips, 122),
    ] {
        bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        bytes.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    bytes.extend([0; 8]);
    bytes
}

/// A BMP that ends after its header.
pub(crate) fn bmp(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = super::encoders::bmp(&gradient(2, 2, 3));
    bytes[18..22].copy_from_slice(&width.to_le_bytes());
    bytes[22..26].copy_from_slice(&height.to_le_bytes());
    bytes
}

/// Files that are within every limit by their headers, and would like to be more.
pub(crate) fn contradictions() -> Vec<Named> {
    let key_frame = vec![0, 0, 0, 0x9D, 1, 0x2A, 0xFF, 0x3F, 0xFF, 0x3F, 0, 0];
    let frame = [vec![0; 6], vec![1, 0, 0, 1, 0, 0], vec![0; 4]].concat();
    let inner = webp(&[(b"VP8 ", key_frame.clone())])[12..].to_vec();
    let mut animated = vp8x(2, 2);
    animated[0] = 2;
    let mut self_referring = tiff(64, 64, 1);
    self_referring[122 - 8..122 - 4].copy_from_slice(&8_u32.to_le_bytes());
    vec![
        (
            "WebP 2x2 with a key frame of 16383x16383",
            webp(&[(b"VP8X", vp8x(2, 2)), (b"VP8 ", key_frame)]),
        ),
        (
            "animated WebP with such a frame",
            webp(&[(b"VP8X", animated), (b"ANIM", vec![0; 6]), (b"ANMF", [frame, inner].concat())]),
        ),
        ("WebP of 200000 chunks", {
            let mut chunks: Vec<(&[u8; 4], Vec<u8>)> = vec![(b"VP8X", vp8x(2, 2))];
            chunks.extend((0..200_000).map(|_| (b"junk", vec![0; 2])));
            webp(&chunks)
        }),
        ("WebP of 65536 groups of codes", webp(&[(b"VP8L", many_codes(4, 4))])),
        ("still WebP with a frame of such codes", {
            let frame = [vec![0; 6], vec![11, 0, 0, 9, 0, 0], vec![0; 4]].concat();
            let inner = webp(&[(b"VP8L", many_codes(12, 10))])[12..].to_vec();
            let frame = (b"ANMF", [frame, inner].concat());
            webp(&[(b"VP8X", vp8x(12, 10)), frame, (b"VP8 ", lossy_webp())])
        }),
        ("WebP with alpha of such codes after its end", {
            let mut with_alpha = vp8x(12, 10);
            with_alpha[0] = 0x10;
            let file = webp(&[(b"VP8X", with_alpha), (b"VP8 ", lossy_webp())]);
            let alpha = [vec![1], many_codes(12, 10)[5..].to_vec()].concat();
            [file, webp(&[(b"ALPH", alpha)])[12..].to_vec()].concat()
        }),
        ("TIFF of 2^31 strips", tiff(64, 64, 1 << 31)),
        ("TIFF of a directory that refers to itself", self_referring),
        ("TIFF of 65535 fields", [&b"II*\0\x08\0\0\0\xFF\xFF"[..], &[0; 65_535 * 12]].concat()),
        ("GIF of 200000 comments", {
            let comments = b"!\xFE\x01c\0".repeat(200_000);
            [&b"GIF89a\x02\0\x02\0\x80\0\0\0\0\0\xFF\xFF\xFF"[..], &comments].concat()
        }),
        ("GIF of 16 MiB of metadata", {
            let blocks = [&[255], &[b'x'; 255][..]].concat().repeat(65_536);
            let start = b"GIF89a\x02\0\x02\0\x80\0\0\0\0\0\xFF\xFF\xFF!\xFF\x0BXMP DataXMP";
            [&start[..], &blocks, b"\0"].concat()
        }),
        ("BMP of 2x2 whose pixels lie beyond its end", {
            let mut bytes = bmp(2, 2);
            bytes[10..14].copy_from_slice(&u32::MAX.to_le_bytes());
            bytes
        }),
    ]
}

/// Bits, the least significant of each number first.
#[derive(Default)]
struct Bits(Vec<bool>);

impl Bits {
    fn put(&mut self, value: u32, count: usize) {
        self.0.extend((0..count).map(|i| value >> i & 1 == 1));
    }

    fn bytes(&self) -> Vec<u8> {
        let byte = |bits: &[bool]| bits.iter().rev().fold(0, |b, &bit| b << 1 | u8::from(bit));
        self.0.chunks(8).map(byte).collect()
    }
}

/// The data of a lossless picture that announces 65536 groups of codes, each of them with a table
/// of 1024 entries: 4 MB that would become 1.3 GB.
fn many_codes(width: u32, height: u32) -> Vec<u8> {
    let mut bits = Bits::default();
    bits.put(0x2F, 8);
    bits.put(width - 1, 14);
    bits.put(height - 1, 14);
    bits.put(0, 4);
    // No transform, no cache; groups of codes by the pixels of an image of one pixel, all ones.
    bits.put(0, 2);
    bits.put(1, 1);
    bits.put(0, 3);
    bits.put(0, 1);
    for symbol in [255, 255, 0, 0, 0] {
        bits.put(0b101, 3);
        bits.put(symbol, 8);
    }
    for _ in 0..65_536 * 5 {
        // The code of lengths: 1 to 6 have three bits, 7 to 10 four.
        bits.put(0, 1);
        bits.put(11, 4);
        for length in [0, 0, 0, 3, 3, 3, 3, 3, 0, 3, 4, 4, 4, 4, 0] {
            bits.put(length, 3);
        }
        // Eleven symbols of the lengths 1 to 9, 10 and 10.
        bits.put(1, 1);
        bits.put(1, 3);
        bits.put(9, 4);
        for length in (1..=10_u32).chain([10]) {
            let (code, count) = if length <= 6 { (length - 1, 3) } else { (12 + length - 7, 4) };
            let reversed = (0..count).fold(0, |r, i| r << 1 | (code >> i & 1));
            bits.put(reversed, count);
        }
    }
    bits.bytes()
}

/// The data of a lossy picture of 12x10 pixels.
fn lossy_webp() -> Vec<u8> {
    let file = include_bytes!("lossy_alpha.webp");
    let at = file.windows(4).position(|kind| kind == b"VP8 ").unwrap();
    file[at + 8..].to_vec()
}

/// A GIF of one small frame and 20000 more.
pub(crate) fn many_frames() -> Vec<u8> {
    let frame = super::encoders::GifFrame {
        width: 2,
        height: 2,
        indices: vec![1, 2, 3, 4],
        ..super::encoders::GifFrame::default()
    };
    super::encoders::gif(2, 2, &vec![frame; 20_000])
}
