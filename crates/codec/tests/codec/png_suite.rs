//! Willem van Schaik's PngSuite whole, where the folder of test images holds it, with the expected
//! outcome of each file; and files of the same kinds that are made here.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::{deflated, ihdr, png_file};
use pixmesh_codec::{DecodeError, Limits, decode, probe};
use pixmesh_meshing::Image;
use proptest::prelude::*;
use std::collections::BTreeMap;

/// Each file of the suite with its columns, rows, components and bits, and a checksum of its
/// samples; or `refused`: broken on purpose, or a single column.
const SUITE: &str = include_str!("../samples/png_suite.txt");

/// FNV-1a of all samples, component by component from the bottom row.
fn checksum(image: &Image) -> u64 {
    let bytes = image.components().iter().flatten().flat_map(|sample| sample.to_le_bytes());
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.fold(0xcbf2_9ce4_8422_2325, step)
}

/// What became of a file, in the words of the list.
fn outcome(bytes: &[u8]) -> String {
    match decode(bytes, &Limits::default()) {
        Ok(image) => {
            let header = probe(bytes, &Limits::default()).unwrap();
            assert_eq!((header.width, header.height), (image.width(), image.height()));
            let (count, bits) = (image.component_count(), image.precision());
            assert_eq!((header.component_count, header.precision), (count, bits));
            let (width, height) = (image.width(), image.height());
            format!("{width} {height} {count} {bits} {:016x}", checksum(&image))
        }
        Err(DecodeError::Malformed { .. } | DecodeError::Image(_) | DecodeError::UnknownFormat) => {
            "refused".to_owned()
        }
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn every_file_of_the_suite_has_its_expected_outcome() {
    let Some(folder) = crate::samples::test_images().map(|images| images.join("formats/pngsuite"))
    else {
        println!("skipped: there is no folder of test images, so the PngSuite is not read");
        return;
    };
    let expected: BTreeMap<&str, &str> =
        SUITE.lines().filter_map(|line| line.split_once(' ')).collect();
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "png") {
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            found.insert(name, outcome(&std::fs::read(&path).unwrap()));
        }
    }
    if std::env::var_os("PIXMESH_PRINT_PNG_SUITE").is_some() {
        found.iter().for_each(|(name, outcome)| println!("{name} {outcome}"));
    }
    let found: BTreeMap<&str, &str> =
        found.iter().map(|(name, outcome)| (name.as_str(), outcome.as_str())).collect();
    assert_eq!(found, expected);
}

/// The kinds of pixels that PNG has: number of the kind, bits, stored samples.
const KINDS: [(u8, u8, usize); 15] = [
    (0, 1, 1),
    (0, 2, 1),
    (0, 4, 1),
    (0, 8, 1),
    (0, 16, 1),
    (2, 8, 3),
    (2, 16, 3),
    (3, 1, 1),
    (3, 2, 1),
    (3, 4, 1),
    (3, 8, 1),
    (4, 8, 2),
    (4, 16, 2),
    (6, 8, 4),
    (6, 16, 4),
];

/// First column and row, and steps, of each pass of Adam7.
const PASSES: [[usize; 4]; 7] = [
    [0, 0, 8, 8],
    [4, 0, 8, 8],
    [0, 4, 4, 8],
    [2, 0, 4, 4],
    [0, 2, 2, 4],
    [1, 0, 2, 2],
    [0, 1, 1, 2],
];

/// A picture as it is stored: samples row by row from the top.
#[derive(Clone, Debug)]
struct Stored {
    width: usize,
    height: usize,
    kind: (u8, u8, usize),
    interlaced: bool,
    samples: Vec<u16>,
}

impl Stored {
    /// A row's bytes: samples packed, the first in the most significant bits.
    fn packed(&self, row: &[u16]) -> Vec<u8> {
        let depth = usize::from(self.kind.1);
        if depth == 16 {
            return row.iter().flat_map(|sample| sample.to_be_bytes()).collect();
        }
        let per_byte = 8 / depth;
        let byte = |samples: &[u16]| {
            let placed = samples.iter().enumerate();
            placed.fold(0, |byte, (i, &s)| byte | (s as u8) << (8 - depth * (i + 1)))
        };
        row.chunks(per_byte).map(byte).collect()
    }

    /// The rows in the order of the file, each with a filter of its own.
    fn filtered(&self) -> Vec<u8> {
        let count = self.kind.2;
        let pixel_bytes = (count * usize::from(self.kind.1)).div_ceil(8);
        let passes = if self.interlaced { &PASSES[..] } else { &[[0, 0, 1, 1]] };
        let mut bytes = Vec::new();
        for &[first_x, first_y, step_x, step_y] in passes {
            let mut above = Vec::new();
            if first_x >= self.width {
                continue;
            }
            for y in (first_y..self.height).step_by(step_y) {
                let pixel = |x: usize| &self.samples[(y * self.width + x) * count..][..count];
                let row: Vec<u16> =
                    (first_x..self.width).step_by(step_x).flat_map(pixel).copied().collect();
                let row = self.packed(&row);
                above.resize(row.len(), 0);
                let filter = (y % 5) as u8;
                bytes.push(filter);
                bytes.extend((0..row.len()).map(|i| {
                    let left = if i < pixel_bytes { 0 } else { row[i - pixel_bytes] };
                    let corner = if i < pixel_bytes { 0 } else { above[i - pixel_bytes] };
                    row[i].wrapping_sub(predicted(filter, left, above[i], corner))
                }));
                above = row;
            }
        }
        bytes
    }

    /// The file, its compressed pixels in chunks of a few bytes.
    fn file(&self, palette: &[u8], extra: &[(&'static [u8; 4], Vec<u8>)]) -> Vec<u8> {
        let (kind, depth, _) = self.kind;
        let header = ihdr(self.width as u32, self.height as u32, depth, kind, self.interlaced);
        let mut chunks = vec![(b"IHDR", header)];
        chunks.extend_from_slice(extra);
        if kind == 3 {
            chunks.push((b"PLTE", palette.to_vec()));
        }
        let compressed = deflated(&self.filtered());
        chunks.extend(compressed.chunks(7).map(|part| (b"IDAT", part.to_vec())));
        chunks.push((b"IEND", Vec::new()));
        png_file(&chunks)
    }

    /// What decoding is to give.
    fn expected(&self, palette: &[u8]) -> Image {
        let (kind, depth, count) = self.kind;
        let planes: Vec<Vec<u16>> = if kind == 3 {
            let colour = |c: usize| {
                let sample = move |&index: &u16| palette[3 * usize::from(index) + c].into();
                self.samples.iter().map(sample).collect()
            };
            (0..3).map(colour).collect()
        } else {
            let plane = |c| self.samples.iter().skip(c).step_by(count).copied().collect();
            (0..count).map(plane).collect()
        };
        let precision = if kind == 3 { 8 } else { depth };
        Image::from_top_down(self.width, self.height, precision, planes).unwrap().premultiplied()
    }
}

/// The prediction of a filter: none, left, above, their mean, or Paeth's.
fn predicted(filter: u8, left: u8, above: u8, corner: u8) -> u8 {
    let [a, b, c] = [left, above, corner].map(i32::from);
    match filter {
        1 => left,
        2 => above,
        3 => i32::midpoint(a, b) as u8,
        4 => {
            let estimate = a + b - c;
            let nearest = [(a, left), (b, above), (c, corner)];
            nearest.into_iter().min_by_key(|(value, _)| (estimate - value).abs()).unwrap().1
        }
        _ => 0,
    }
}

/// Chunks that change nothing: gamma, chromaticities, background, sizes, times, texts, histograms.
fn ancillary() -> Vec<(&'static [u8; 4], Vec<u8>)> {
    vec![
        (b"gAMA", 35_000_u32.to_be_bytes().to_vec()),
        (b"cHRM", [31270_u32; 8].iter().flat_map(|n| n.to_be_bytes()).collect()),
        (b"sRGB", vec![0]),
        (b"pHYs", vec![0, 0, 0, 1, 0, 0, 0, 4, 1]),
        (b"tIME", vec![7, 230, 1, 1, 0, 0, 0]),
        (b"tEXt", b"Title\0PngSuite".to_vec()),
        (b"zTXt", b"Title\0\0garbage".to_vec()),
        (b"vpAg", vec![0; 9]),
    ]
}

fn stored() -> impl Strategy<Value = Stored> {
    let kind = prop::sample::select(&KINDS[..]);
    (2..40_usize, 2..40_usize, kind, any::<bool>()).prop_flat_map(
        |(width, height, kind, interlaced)| {
            let samples = 0..=u16::MAX >> (16 - kind.1);
            prop::collection::vec(samples, width * height * kind.2)
                .prop_map(move |samples| Stored { width, height, kind, interlaced, samples })
        },
    )
}

proptest! {
    #[test]
    fn every_kind_depth_filter_and_order_of_rows_is_read(
        stored in stored(),
        palette in prop::collection::vec(any::<u8>(), 3 * 256),
    ) {
        let palette = &palette[..3 << stored.kind.1.min(8)];
        let expected = stored.expected(palette);
        for extra in [Vec::new(), ancillary()] {
            let decoded = decode(&stored.file(palette, &extra), &Limits::default());
            prop_assert_eq!(decoded.unwrap(), expected.clone());
        }
    }

    #[test]
    fn a_changed_byte_is_an_error_or_changes_no_pixel(
        stored in stored(),
        place in any::<prop::sample::Index>(),
        change in 1..=255_u8,
    ) {
        let palette = vec![9; 3 << stored.kind.1.min(8)];
        let mut bytes = stored.file(&palette, &[]);
        let place = place.index(bytes.len());
        bytes[place] ^= change;
        if let Ok(image) = decode(&bytes, &Limits::default()) {
            prop_assert_eq!(image, stored.expected(&palette));
        }
    }
}

#[test]
fn headers_that_the_standard_does_not_allow_are_refused() {
    let picture =
        Stored { width: 4, height: 4, kind: (0, 8, 1), interlaced: false, samples: vec![7; 16] };
    let file = picture.file(&[], &[]);
    assert!(decode(&file, &Limits::default()).is_ok());
    // Signature as mangled by text transfers; colour type 1 and 9; depth 3 and 99; no pixels.
    for (place, value) in [(0, 0x09), (4, 0x0A), (25, 1), (25, 9), (24, 3), (24, 99)] {
        let mut broken = file.clone();
        broken[place] = value;
        let mut checksum = flate2::Crc::new();
        checksum.update(&broken[12..29]);
        broken[29..33].copy_from_slice(&checksum.sum().to_be_bytes());
        assert!(decode(&broken, &Limits::default()).is_err(), "{place} {value}");
    }
    let empty = png_file(&[(b"IHDR", ihdr(4, 4, 8, 0, false)), (b"IEND", Vec::new())]);
    assert!(decode(&empty, &Limits::default()).is_err());
}
