//! The folder of test images, where it is at hand: `PIXMESH_TEST_IMAGES` names it.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use pixmesh_codec::{Alpha, DecodeError, DecodeOptions, Limits, decode, probe};
use pixmesh_meshing::{Image, ImageError};
use std::path::{Path, PathBuf};

/// The files of a folder of test images with one of the extensions, sorted; none when absent.
fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let Some(images) = crate::samples::test_images() else {
        println!("skipped: there is no folder of test images, so {folder} is not read");
        return Vec::new();
    };
    let wanted = |path: &PathBuf| {
        path.extension().is_some_and(|found| extensions.iter().any(|&wanted| found == wanted))
    };
    let entries = std::fs::read_dir(images.join(folder)).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).filter(wanted).collect();
    files.sort();
    assert!(!files.is_empty());
    files
}

fn read(path: &Path) -> Result<Image, DecodeError> {
    decode(&std::fs::read(path).unwrap(), &Limits::default())
}

fn name(path: &Path) -> &str {
    path.file_name().unwrap().to_str().unwrap()
}

/// The mean difference of two images of the same shape, in samples.
fn mean_difference(a: &Image, b: &Image) -> f64 {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()));
    assert_eq!(a.component_count(), b.component_count());
    let pairs = a.components().concat().into_iter().zip(b.components().concat());
    let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(b))).sum();
    sum as f64 / (a.pixel_count() * a.component_count()) as f64
}

#[test]
fn the_png_suite_decodes_but_for_its_corrupt_files_and_its_single_pixels() {
    for path in files("formats/pngsuite", &["png"]) {
        let result = read(&path);
        let refused = name(&path).starts_with('x') || name(&path).starts_with("s01");
        assert_eq!(result.is_err(), refused, "{path:?}: {result:?}");
        if let Ok(image) = result {
            let header = probe(&std::fs::read(&path).unwrap(), &Limits::default()).unwrap();
            assert_eq!(header.shape().component_count, image.component_count(), "{path:?}");
            assert_eq!(header.precision, image.precision(), "{path:?}");
        }
    }
}

#[test]
fn interlaced_files_of_the_png_suite_equal_the_others() {
    for path in files("formats/pngsuite", &["png"]) {
        if name(&path).starts_with("basi") {
            let plain = path.with_file_name(name(&path).replacen("basi", "basn", 1));
            assert_eq!(read(&path).unwrap(), read(&plain).unwrap(), "{path:?}");
        }
    }
}

#[test]
fn depth_and_components_of_the_png_suite_are_kept() {
    for path in files("formats/pngsuite", &["png"]) {
        let kind = name(&path);
        if !kind.starts_with("basn") {
            continue;
        }
        let image = read(&path).unwrap();
        let depth: u8 = kind[6..8].parse().unwrap();
        let (component_count, precision) = match kind.as_bytes()[4] {
            b'0' => (1, depth),
            b'2' => (3, depth),
            b'3' => (3, 8),
            b'4' => (2, depth),
            _ => (4, depth),
        };
        assert_eq!(image.component_count(), component_count, "{kind}");
        assert_eq!(image.precision(), precision, "{kind}");
    }
}

#[test]
fn every_exif_orientation_gives_the_same_upright_picture() {
    let files: Vec<PathBuf> = files("formats", &["jpg"])
        .into_iter()
        .filter(|path| name(path).starts_with("derived_coffee_exif_orientation"))
        .collect();
    let Some(first) = files.first().map(|path| read(path).unwrap()) else { return };
    assert_eq!(files.len(), 8);
    for path in files {
        let difference = mean_difference(&first, &read(&path).unwrap());
        assert!(difference < 3.0, "{path:?}: {difference}");
    }
}

#[test]
fn jpeg_files_decode_but_for_broken_truncated_and_huge_ones() {
    for path in files("formats", &["jpg"]) {
        let result = read(&path);
        match name(&path) {
            "thumbor_BlueSquare_truncated.jpg" => {
                assert!(matches!(result, Err(DecodeError::Malformed { .. })), "{result:?}");
            }
            "thumbor_9643x10328.jpg" => {
                assert!(matches!(result, Err(DecodeError::TooManyPixels { .. })), "{result:?}");
            }
            "thumbor_broken-exif-tag.jpg" => {
                let reason = ImageError::TooSmall { width: 1, height: 1 };
                assert_eq!(result, Err(reason.into()));
            }
            _ => assert!(result.is_ok(), "{path:?}: {result:?}"),
        }
    }
}

#[test]
fn other_encodings_of_the_same_picture_look_the_same() {
    let Some(original) = files("formats", &["ppm"]).first().map(|path| read(path).unwrap()) else {
        return;
    };
    let close = |file: &str, tolerance: f64| {
        let path = files("formats", &["jpg", "png"]).into_iter().find(|path| name(path) == file);
        // Of pictures with alpha the straight colours.
        let options = DecodeOptions { alpha: Alpha::Drop, ..DecodeOptions::default() };
        let image = options.decode(&std::fs::read(path.unwrap()).unwrap()).unwrap();
        let rgb = Image::from_bottom_up(
            image.width(),
            image.height(),
            image.precision(),
            image.components()[..3].to_vec(),
        );
        let difference = mean_difference(&original, &rgb.unwrap());
        assert!(difference < tolerance, "{file}: {difference}");
    };
    close("derived_coffee_progressive_444.jpg", 3.0);
    close("derived_coffee_cmyk.jpg", 8.0);
    close("derived_coffee_rgba.png", 0.01);
    close("derived_coffee_indexed.png", 8.0);
}

#[test]
fn gray_pictures_of_16_bits_keep_their_bits() {
    for path in files("formats", &["png"]) {
        if name(&path).ends_with("gray16.png") {
            let image = read(&path).unwrap();
            assert_eq!((image.component_count(), image.precision()), (1, 16), "{path:?}");
        }
    }
}

#[test]
fn photographs_and_the_thesis_s_pictures_decode() {
    for folder in ["photos", "thesis"] {
        for path in files(folder, &["png", "jpg"]) {
            let header = probe(&std::fs::read(&path).unwrap(), &Limits::default()).unwrap();
            let image = read(&path).unwrap();
            assert_eq!((image.width(), image.height()), (header.width, header.height), "{path:?}");
        }
    }
}

#[test]
fn a_small_file_of_a_huge_picture_is_refused() {
    for path in files("formats", &["png"]) {
        if name(&path) == "thumbor_16384x16384.png" {
            assert!(matches!(read(&path), Err(DecodeError::TooManyPixels { .. })));
        }
    }
}
