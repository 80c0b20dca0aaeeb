//! What PNG files may hold beside plain pixels.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use crate::samples::{deflated, exif, ihdr, png_file, scattered};
use pixmesh_codec::{DecodeError, Limits, decode, probe, write_png};
use pixmesh_meshing::Image;

type Chunk = (&'static [u8; 4], Vec<u8>);

fn read(chunks: &[Chunk]) -> Result<Image, DecodeError> {
    decode(&png_file(chunks), &Limits::default())
}

/// A file of two rows without filters, with some chunks between header and pixels.
fn two_rows(depth: u8, kind: u8, width: u32, extra: &[Chunk], rows: [&[u8]; 2]) -> Vec<Chunk> {
    let raw = [&[0], rows[0], &[0], rows[1]].concat();
    let mut chunks = vec![(b"IHDR", ihdr(width, 2, depth, kind, false))];
    chunks.extend_from_slice(extra);
    chunks.extend([(b"IDAT", deflated(&raw)), (b"IEND", Vec::new())]);
    chunks
}

/// A gray picture of 2x2 pixels of 8 bits.
fn gray(extra: &[Chunk]) -> Vec<Chunk> {
    two_rows(8, 0, 2, extra, [&[1, 2], &[3, 4]])
}

/// The image's components from the top row.
fn planes(image: &Image) -> Vec<Vec<u16>> {
    let rows = |c: usize| (0..image.height()).rev().flat_map(move |y| image.row(c, y).to_vec());
    (0..image.component_count()).map(|c| rows(c).collect()).collect()
}

#[test]
fn gray_of_few_bits_keeps_its_precision() {
    let image = read(&two_rows(2, 0, 3, &[], [&[0b0001_1011], &[0b1110_0100]])).unwrap();
    assert_eq!(image.precision(), 2);
    assert_eq!(planes(&image), [[0, 1, 2, 3, 2, 1]]);
    let image = read(&two_rows(16, 0, 2, &[], [&[1, 2, 3, 4], &[5, 6, 7, 8]])).unwrap();
    assert_eq!(planes(&image), [[0x0102, 0x0304, 0x0506, 0x0708]]);
}

#[test]
fn a_transparent_colour_becomes_an_alpha_component_of_the_same_precision() {
    let key = (b"tRNS", vec![0, 2]);
    let image = read(&two_rows(2, 0, 2, &[key], [&[0b0010_0000], &[0b1011_0000]])).unwrap();
    assert_eq!((image.precision(), planes(&image)), (2, vec![vec![0, 0, 0, 3], vec![3, 0, 0, 3]]));

    let key = (b"tRNS", vec![0, 1, 0, 2, 0, 3]);
    let image = read(&two_rows(8, 2, 2, &[key], [&[1, 2, 3, 1, 2, 4], &[0; 6]])).unwrap();
    assert_eq!(planes(&image)[3], [0, 255, 255, 255]);

    let key = (b"tRNS", vec![1, 2]);
    let image = read(&two_rows(16, 0, 2, &[key], [&[1, 2, 1, 3], &[2, 2, 1, 2]])).unwrap();
    assert_eq!(planes(&image)[1], [0, 65535, 65535, 0]);
}

#[test]
fn a_palette_becomes_rgb_and_its_transparency_alpha() {
    let palette = (b"PLTE", vec![10, 11, 12, 20, 21, 22, 30, 31, 32]);
    let rows: [&[u8]; 2] = [&[0b0001_0000], &[0b1000_0000]];
    let image = read(&two_rows(2, 3, 2, std::slice::from_ref(&palette), rows)).unwrap();
    assert_eq!(image.precision(), 8);
    assert_eq!(planes(&image), [[10, 20, 30, 10], [11, 21, 31, 11], [12, 22, 32, 12]]);

    let image = read(&two_rows(2, 3, 2, &[palette, (b"tRNS", vec![0, 128])], rows)).unwrap();
    assert_eq!(planes(&image)[3], [0, 128, 255, 0]);
}

#[test]
fn palettes_that_are_missing_or_too_short_are_errors() {
    let message = |extra: &[Chunk]| {
        read(&two_rows(8, 3, 2, extra, [&[0, 1], &[1, 2]])).unwrap_err().to_string()
    };
    assert!(message(&[]).contains("no palette"), "{}", message(&[]));
    let two_colours = message(&[(b"PLTE", vec![0; 6])]);
    assert!(two_colours.contains("colour 2 of a palette of 2"), "{two_colours}");
}

#[test]
fn interlaced_pixels_land_where_the_others_do() {
    for (width, height) in [(2, 2), (3, 7), (9, 10)] {
        let plain = scattered(width, height, 3, 8);
        let mut raw = Vec::new();
        for [first, first_y, step, step_y] in [
            [0, 0, 8, 8],
            [4, 0, 8, 8],
            [0, 4, 4, 8],
            [2, 0, 4, 4],
            [0, 2, 2, 4],
            [1, 0, 2, 2],
            [0, 1, 1, 2],
        ] {
            for y in (first_y..height).step_by(step_y).filter(|_| first < width) {
                raw.push(0);
                for x in (first..width).step_by(step) {
                    raw.extend((0..3).map(|c| plain.sample(c, x, height - 1 - y) as u8));
                }
            }
        }
        let header = (b"IHDR", ihdr(width as u32, height as u32, 8, 2, true));
        let chunks = [header, (b"IDAT", deflated(&raw)), (b"IEND", Vec::new())];
        assert_eq!(read(&chunks), Ok(plain), "{width}x{height}");
    }
}

#[test]
fn the_orientation_of_an_exif_chunk_makes_the_picture_upright() {
    let chunks = two_rows(8, 0, 3, &[(b"eXIf", exif(6))], [&[1, 2, 3], &[4, 5, 6]]);
    let header = probe(&png_file(&chunks), &Limits::default()).unwrap();
    assert_eq!((header.width, header.height), (2, 3));
    let image = read(&chunks).unwrap();
    assert_eq!((image.width(), planes(&image)), (2, vec![vec![4, 1, 5, 2, 6, 3]]));
    let broken = two_rows(8, 0, 3, &[(b"eXIf", b"II*\0\xFF".to_vec())], [&[1; 3], &[4; 3]]);
    assert_eq!(read(&broken).unwrap().width(), 3);
}

#[test]
fn gamma_text_and_unknown_chunks_change_nothing() {
    let plain = read(&gray(&[])).unwrap();
    let extra: [Chunk; 6] = [
        (b"gAMA", 100_000_u32.to_be_bytes().to_vec()),
        (b"sRGB", vec![0]),
        (b"sBIT", vec![5]),
        (b"tEXt", b"Comment\0text".to_vec()),
        (b"zTXt", [b"Comment\0\0".to_vec(), deflated(&[b'x'; 1000])].concat()),
        (b"abCd", vec![1, 2, 3]),
    ];
    assert_eq!(read(&gray(&extra)), Ok(plain));
}

#[test]
fn of_an_animation_the_default_image_is_decoded() {
    let frame = |sequence: u32| {
        let words = [sequence, 2, 2, 0, 0].map(u32::to_be_bytes).concat();
        [words, vec![0, 1, 0, 10, 0, 0]].concat()
    };
    let animation = (b"acTL", [2_u32, 0].map(u32::to_be_bytes).concat());
    let mut chunks = gray(&[animation, (b"fcTL", frame(0))]);
    let second = [2_u32.to_be_bytes().to_vec(), deflated(&[0, 9, 9, 0, 9, 9])].concat();
    let end = chunks.len() - 1;
    chunks.splice(end..end, [(b"fcTL", frame(1)), (b"fdAT", second)]);
    assert_eq!(read(&chunks), read(&gray(&[])));
}

#[test]
fn broken_structure_is_malformed_and_says_why() {
    let header = || (b"IHDR", ihdr(2, 2, 8, 0, false));
    let end = || (b"IEND", Vec::new());
    let pixels = |raw: &[u8]| (b"IDAT", deflated(raw));
    let cases: [&[Chunk]; 8] = [
        &[header(), end()],
        &[pixels(&[0, 1, 2, 0, 3, 4]), end()],
        &[header(), header(), pixels(&[0, 1, 2, 0, 3, 4]), end()],
        &[header(), pixels(&[0, 1, 2]), end()],
        &[header(), pixels(&[7, 1, 2, 0, 3, 4]), end()],
        &[header(), (b"IDAT", b"not deflated".to_vec()), end()],
        &[(b"IHDR", ihdr(0, 2, 8, 0, false)), pixels(&[0, 0]), end()],
        &[(b"IHDR", ihdr(2, 2, 3, 0, false)), pixels(&[0, 0]), end()],
    ];
    for chunks in cases {
        let error = read(chunks).unwrap_err();
        assert!(matches!(&error, DecodeError::Malformed { .. }), "{error}");
    }
    let mut flipped = png_file(&gray(&[]));
    let at = flipped.len() - 25;
    flipped[at] ^= 4;
    assert!(decode(&flipped, &Limits::default()).is_err());
}

#[test]
fn a_raised_precision_is_told_by_an_sbit_chunk() {
    let written = |precision| {
        let mut bytes = Vec::new();
        write_png(&scattered(4, 4, 3, precision), &mut bytes).unwrap();
        bytes
    };
    let has = |bytes: &[u8], chunk: &[u8]| bytes.windows(chunk.len()).any(|at| at == chunk);
    assert!(has(&written(12), b"\0\0\0\x03sBIT\x0C\x0C\x0C"));
    assert!(has(&written(3), b"\0\0\0\x03sBIT\x03\x03\x03"));
    assert!(!has(&written(8), b"sBIT"));
    assert!(!has(&written(16), b"sBIT"));
}
