//! Decoding and encoding under a budget of memory.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

mod samples;

use pixmesh_codec::{Alpha, DecodeError, DecodeOptions, write_png, write_pnm};
use pixmesh_meshing::Image;
use samples::encoders::{bmp, gray_gif, tiff, webp};
use samples::memory::rise_kib;
use samples::{gradient, jpeg, scattered};
use std::process::Command;
use tiff::encoder::{Compression, Predictor};

fn png(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_png(image, &mut bytes).unwrap();
    bytes
}

/// A file of each format and kind, of so many columns and rows.
fn files(width: usize, height: usize) -> Vec<(&'static str, Vec<u8>)> {
    let image = |count, bits| scattered(width, height, count, bits);
    let mut pnm = Vec::new();
    write_pnm(&image(3, 16), &mut pnm).unwrap();
    let uncompressed =
        |count, bits| tiff(&image(count, bits), Compression::Uncompressed, Predictor::None);
    vec![
        ("PNG", png(&image(3, 8))),
        ("PNG of gray and alpha", png(&image(2, 8))),
        ("PNG of 16 bits", png(&image(4, 16))),
        ("PNM", pnm),
        ("JPEG", jpeg(&gradient(width, height, 3), 90)),
        ("gray JPEG", jpeg(&gradient(width, height, 1), 90)),
        ("WebP", webp(&image(3, 8))),
        ("WebP with alpha", webp(&image(4, 8))),
        ("GIF", gray_gif(&image(1, 8))),
        ("gray TIFF", uncompressed(1, 8)),
        ("TIFF of 16 bits", uncompressed(4, 16)),
        ("TIFF by LZW", tiff(&image(3, 8), Compression::Lzw, Predictor::Horizontal)),
        ("BMP", bmp(&image(3, 8))),
        ("BMP with alpha", bmp(&image(4, 8))),
    ]
}

/// Small files of kinds that no encoder here makes.
fn kept_files() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("progressive JPEG", include_bytes!("samples/progressive.jpg").to_vec()),
        ("lossy WebP", include_bytes!("samples/lossy.webp").to_vec()),
        ("lossy WebP with alpha", include_bytes!("samples/lossy_alpha.webp").to_vec()),
        ("animated WebP", include_bytes!("samples/animated.webp").to_vec()),
        ("interlaced GIF", include_bytes!("samples/interlaced.gif").to_vec()),
        ("TIFF for fax", include_bytes!("samples/fax4.tif").to_vec()),
        ("TIFF with a palette", include_bytes!("samples/palette.tif").to_vec()),
        ("TIFF of inks", include_bytes!("samples/cmyk.tif").to_vec()),
        ("BMP with a palette", include_bytes!("samples/palette.bmp").to_vec()),
    ]
}

#[test]
fn what_the_header_says_is_enough_for_decoding() {
    for (kind, bytes) in files(61, 47).into_iter().chain(kept_files()) {
        for alpha in [Alpha::Keep, Alpha::Drop, Alpha::Over([0; 3]), Alpha::Over([1, 2, 3])] {
            let free = DecodeOptions { alpha, ..DecodeOptions::default() };
            let allowed = free.probe(&bytes).unwrap().decode_bytes();
            let bound = DecodeOptions { max_bytes: Some(allowed), ..free };
            assert_eq!(bound.decode(&bytes), free.decode(&bytes), "{kind}");
        }
    }
}

#[test]
fn decoding_that_needs_more_than_allowed_is_refused() {
    for (kind, bytes) in files(61, 47).into_iter().chain(kept_files()) {
        let free = DecodeOptions::default();
        let enough = free.probe(&bytes).unwrap().decode_bytes();
        for allowed in [0, 1, enough / 4, enough / 2] {
            let bound = DecodeOptions { max_bytes: Some(allowed), ..free };
            assert_eq!(bound.probe(&bytes), free.probe(&bytes), "{kind}");
            match bound.decode(&bytes).unwrap_err() {
                DecodeError::TooMuchMemory { needed, allowed: told } => {
                    assert_eq!(told, allowed, "{kind}");
                    assert!((allowed + 1..=enough).contains(&needed), "{kind}: {needed}");
                }
                other => panic!("{kind}: {other}"),
            }
        }
    }
}

/// Names the file that the process decodes instead of running the test.
const FILE_VARIABLE: &str = "PIXMESH_TEST_BUDGET_FILE";

#[test]
fn decoders_take_no_more_memory_than_told() {
    if let Some(file) = std::env::var_os(FILE_VARIABLE) {
        return decode_within_budget(&std::fs::read(file).unwrap());
    }
    let path = std::env::temp_dir().join(format!("pixmesh-budget-{}", std::process::id()));
    for (kind, bytes) in files(1600, 1200) {
        std::fs::write(&path, bytes).unwrap();
        // In a process of its own: this one has memory that it used before.
        let test = std::env::current_exe().unwrap();
        let child = Command::new(test)
            .args(["--exact", "decoders_take_no_more_memory_than_told", "--nocapture"])
            .env(FILE_VARIABLE, &path)
            .output()
            .unwrap();
        println!("{kind}: {}", String::from_utf8_lossy(&child.stdout));
        assert!(child.status.success(), "{kind}: {}", String::from_utf8_lossy(&child.stderr));
    }
    std::fs::remove_file(&path).unwrap();
}

fn decode_within_budget(bytes: &[u8]) {
    let options = DecodeOptions::default();
    let allowed_kib = options.probe(bytes).unwrap().decode_bytes() >> 10;
    // A JPEG is decoded from a copy.
    let copy_kib = bytes.len() as u64 >> 10;
    let (image, rise) = rise_kib(|| options.decode(bytes).unwrap());
    let samples = image.pixel_count() * image.component_count();
    println!("{rise} KiB of {allowed_kib} KiB and {copy_kib} KiB");
    assert!(rise <= allowed_kib + copy_kib, "{rise} KiB");
    assert!(rise >= samples as u64 >> 9, "{rise} KiB are too few to be true");
}
