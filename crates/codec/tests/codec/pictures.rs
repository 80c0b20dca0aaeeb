//! Pictures there and back, cut short, and garbled.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::{gradient, images, scattered};
use pixmesh_codec::{
    DecodeError, EncodeError, Limits, PictureFormat, decode, probe, write_png, write_pnm,
};
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::{Image, ImageError};
use proptest::prelude::*;

fn png(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_png(image, &mut bytes).unwrap();
    bytes
}

fn pnm(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_pnm(image, &mut bytes).unwrap();
    bytes
}

fn jpeg(image: &Image) -> Vec<u8> {
    crate::samples::jpeg(image, 90)
}

fn read(bytes: &[u8]) -> Result<Image, DecodeError> {
    decode(bytes, &Limits::default())
}

/// The image with its samples at `to` bits, rounded to the nearest.
fn rescaled(image: &Image, to: u8) -> Image {
    let (from_max, to_max) = (f64::from(image.max_sample()), f64::from(u16::MAX >> (16 - to)));
    let scale = |&sample: &u16| (f64::from(sample) * to_max / from_max).round() as u16;
    let planes = image.components().iter().map(|plane| plane.iter().map(scale).collect());
    Image::from_bottom_up(image.width(), image.height(), to, planes.collect()).unwrap()
}

proptest! {
    #[test]
    fn anymaps_read_back_as_the_same_image(image in images()) {
        prop_assert_eq!(read(&pnm(&image)).unwrap(), image);
    }

    #[test]
    fn png_reads_back_as_the_same_image_or_as_its_exact_enlargement(image in images()) {
        let depths: &[u8] = if image.component_count() == 1 { &[1, 2, 4, 8, 16] } else { &[8, 16] };
        let depth = *depths.iter().find(|&&depth| depth >= image.precision()).unwrap();
        let decoded = read(&png(&image)).unwrap();
        if has_alpha(image.component_count()) && depth != image.precision() {
            // A rounded straight colour premultiplies to one beside it.
            let again = rescaled(&decoded, image.precision()).components().concat();
            let pairs = again.into_iter().zip(image.components().concat());
            prop_assert!(pairs.into_iter().all(|(a, b)| a.abs_diff(b) <= 1));
            return Ok(());
        }
        prop_assert_eq!(&decoded, &rescaled(&image, depth));
        prop_assert_eq!(rescaled(&decoded, image.precision()), image);
    }

    #[test]
    fn the_header_tells_the_shape_of_what_decoding_gives(image in images()) {
        for bytes in [png(&image), pnm(&image)] {
            let header = probe(&bytes, &Limits::default()).unwrap();
            let decoded = read(&bytes).unwrap();
            prop_assert_eq!((header.width, header.height), (decoded.width(), decoded.height()));
            prop_assert_eq!(header.component_count, decoded.component_count());
            prop_assert_eq!(header.precision, decoded.precision());
        }
    }

    #[test]
    fn garbled_files_never_make_a_decoder_panic(
        kind in 0..6_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = files().swap_remove(kind).1;
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let _ = probe(&bytes, &Limits::default());
        let _ = read(&bytes);
    }

    #[test]
    fn garbage_after_any_signature_never_makes_a_decoder_panic(
        start in prop::sample::select(vec![
            &b"\x89PNG\r\n\x1a\n"[..], b"\xFF\xD8\xFF", b"P1 ", b"P2 ", b"P3 ", b"P4 ", b"P5 ",
            b"P6 ", b"P7\n",
        ]),
        rest in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let bytes = [start, &rest].concat();
        let _ = probe(&bytes, &Limits::default());
        let _ = read(&bytes);
    }
}

/// One file of each kind, with the bytes at its end that may be missing.
fn files() -> Vec<(usize, Vec<u8>)> {
    let plain = b"P3 4 3 255\n".to_vec();
    let plain = [plain, "128 ".repeat(36).into_bytes()].concat();
    vec![
        (0, png(&scattered(61, 47, 3, 8))),
        (0, jpeg(&gradient(61, 47, 3))),
        (0, include_bytes!("../samples/progressive.jpg").to_vec()),
        (0, pnm(&scattered(61, 47, 3, 16))),
        (0, pnm(&scattered(61, 47, 4, 8))),
        // The last white space, and digits of the last number.
        (3, plain),
    ]
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    for (optional, bytes) in files() {
        assert!(read(&bytes).is_ok());
        let ends = (0..bytes.len() - optional).step_by(37);
        for end in ends.chain([bytes.len() - optional - 1]) {
            let error = read(&bytes[..end]).expect_err(&format!("cut at {end}"));
            match error {
                DecodeError::Empty => assert_eq!(end, 0),
                DecodeError::Malformed { reason, .. } => assert!(!reason.is_empty()),
                other => panic!("cut at {end} of {}: {other}", bytes.len()),
            }
        }
    }
}

#[test]
fn bytes_after_the_picture_are_ignored() {
    for (_, mut bytes) in files() {
        let image = read(&bytes).unwrap();
        bytes.extend(b" PK\x03\x04 trailing \xFF\xD9 bytes");
        assert_eq!(read(&bytes).as_ref(), Ok(&image));
    }
}

#[test]
fn the_first_row_of_a_file_is_the_top_row_of_the_image() {
    let image = read(b"P2 2 2 255 1 2 3 4").unwrap();
    assert_eq!((image.row(0, 1), image.row(0, 0)), (&[1, 2][..], &[3, 4][..]));
    assert_eq!(pnm(&image), b"P5\n2 2\n255\n\x01\x02\x03\x04");
    assert_eq!(read(&png(&image)), Ok(image));
}

#[test]
fn one_row_or_one_column_is_refused_by_its_header() {
    for (width, height) in [(1, 1), (1, 5000), (5000, 1)] {
        let bytes = format!("P5 {width} {height} 255\n").into_bytes();
        let expected = DecodeError::Image(ImageError::TooSmall { width, height });
        assert_eq!(probe(&bytes, &Limits::default()), Err(expected.clone()));
        assert_eq!(read(&bytes), Err(expected));
    }
}

#[test]
fn no_bytes_and_other_formats_have_errors_of_their_own() {
    assert_eq!(read(b""), Err(DecodeError::Empty));
    for other in [&b"GIF90a"[..], b"hello", b"\x89"] {
        assert_eq!(read(other), Err(DecodeError::UnknownFormat));
    }
    for signature in [&b"\x89PNG\r\n\x1a\n"[..], b"\xFF\xD8\xFF", b"\xFF\xD8<html>", b"P6\n"] {
        assert!(matches!(read(signature), Err(DecodeError::Malformed { .. })));
    }
}

#[test]
fn a_picture_at_each_limit_is_decoded_and_one_pixel_more_is_not() {
    let limits = Limits { max_pixels: 12, max_side: 6 };
    assert!(decode(&pnm(&scattered(6, 2, 1, 8)), &limits).is_ok());
    assert!(decode(&pnm(&scattered(4, 3, 1, 8)), &limits).is_ok());
    let error = decode(&pnm(&scattered(7, 2, 1, 8)), &limits).unwrap_err();
    assert!(matches!(error, DecodeError::TooManyPixels { pixels: 14, limit: 12, .. }));
    let limits = Limits { max_pixels: 14, max_side: 6 };
    let error = decode(&pnm(&scattered(7, 2, 1, 8)), &limits).unwrap_err();
    assert_eq!(error, DecodeError::SideTooLong { width: 7, height: 2, limit: 6 });
}

#[test]
fn five_components_are_written_as_no_picture() {
    let image = scattered(3, 3, 5, 8);
    for result in [write_png(&image, &mut Vec::new()), write_pnm(&image, &mut Vec::new())] {
        assert!(matches!(result, Err(EncodeError::ComponentCount { actual: 5, maximum: 4, .. })));
    }
}

#[test]
fn failures_of_the_sink_are_passed_on() {
    let image = scattered(300, 300, 3, 8);
    for room in [0, 3, 20, 60, 1000, 100_000] {
        let mut sink = vec![0; room];
        assert!(matches!(write_png(&image, &mut sink.as_mut_slice()), Err(EncodeError::Io(_))));
        assert!(matches!(write_pnm(&image, &mut sink.as_mut_slice()), Err(EncodeError::Io(_))));
    }
}

#[test]
fn formats_have_names() {
    let names: Vec<String> = PictureFormat::ALL.iter().map(ToString::to_string).collect();
    assert_eq!(names, ["PNG", "JPEG", "PNM", "WebP", "GIF", "TIFF", "BMP"]);
}
