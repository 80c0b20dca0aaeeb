//! What JPEG files may hold, and what they may only claim.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::{exif, gradient, jpeg};
use pixmesh_codec::{DecodeError, Limits, decode, probe};
use pixmesh_meshing::Image;

fn read(bytes: &[u8]) -> Result<Image, DecodeError> {
    decode(bytes, &Limits::default())
}

/// The reason why a file is refused, be it broken or not supported.
fn reason(bytes: &[u8]) -> String {
    match read(bytes).unwrap_err() {
        DecodeError::Malformed { reason, .. } | DecodeError::Unsupported { reason, .. } => reason,
        other => panic!("{other}"),
    }
}

/// A segment with its marker and length.
fn segment(marker: u8, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u16 + 2).to_be_bytes();
    [&[0xFF, marker], &length[..], payload].concat()
}

/// The file with a segment right after its start.
fn with_segment(bytes: &[u8], marker: u8, payload: &[u8]) -> Vec<u8> {
    [&bytes[..2], &segment(marker, payload), &bytes[2..]].concat()
}

fn with_exif(bytes: &[u8], orientation: u16) -> Vec<u8> {
    with_segment(bytes, 0xE1, &[b"Exif\0\0".to_vec(), exif(orientation)].concat())
}

/// Offset of the first marker of that kind, found by walking through the segments.
fn find(bytes: &[u8], marker: u8) -> usize {
    let mut at = 2;
    while bytes[at + 1] != marker {
        at += 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
    }
    at
}

/// The greatest difference of two images' samples.
fn greatest_difference(a: &Image, b: &Image) -> u16 {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()));
    let pairs = a.components().concat().into_iter().zip(b.components().concat());
    pairs.map(|(a, b)| a.abs_diff(b)).max().unwrap()
}

#[test]
fn gray_and_colour_decode_to_nearly_what_was_encoded() {
    for component_count in [1, 3] {
        let original = gradient(67, 45, component_count);
        let image = read(&jpeg(&original, 95)).unwrap();
        assert_eq!((image.component_count(), image.precision()), (component_count, 8));
        assert!(greatest_difference(&original, &image) < 24);
    }
}

/// Twelve by ten pixels: red rises with x, green from the top, blue falls with x.
fn made_elsewhere() -> Image {
    let plane = |sample: fn(u16, u16) -> u16| -> Vec<u16> {
        (0..120).map(|i| sample(i % 12, i / 12)).collect()
    };
    let planes = vec![plane(|x, _| 20 * x), plane(|_, y| 25 * y), plane(|x, _| 255 - 20 * x)];
    Image::from_top_down(12, 10, 8, planes).unwrap()
}

#[test]
fn progressive_files_with_sampled_chroma_decode() {
    let image = read(include_bytes!("../samples/progressive.jpg")).unwrap();
    assert!(greatest_difference(&made_elsewhere(), &image) < 60);
}

#[test]
fn adobe_s_inverted_cmyk_becomes_rgb() {
    let bytes = include_bytes!("../samples/cmyk.jpg");
    assert_eq!(probe(bytes, &Limits::default()).unwrap().component_count, 3);
    assert!(greatest_difference(&made_elsewhere(), &read(bytes).unwrap()) < 60);
}

#[test]
fn every_orientation_is_applied_and_others_mean_upright() {
    let original = gradient(40, 24, 3);
    let bytes = jpeg(&original, 95);
    let plain = read(&bytes).unwrap();
    for orientation in [0, 1, 9, 65535] {
        assert_eq!(read(&with_exif(&bytes, orientation)).unwrap(), plain);
    }
    // What a viewer sees at (x, y) from the top left, in the stored picture.
    type Place = fn(usize, usize) -> (usize, usize);
    let places: [(u16, Place); 7] = [
        (2, |x, y| (39 - x, y)),
        (3, |x, y| (39 - x, 23 - y)),
        (4, |x, y| (x, 23 - y)),
        (5, |x, y| (y, x)),
        (6, |x, y| (y, 23 - x)),
        (7, |x, y| (39 - y, 23 - x)),
        (8, |x, y| (39 - y, x)),
    ];
    for (orientation, place) in places {
        let turned = with_exif(&bytes, orientation);
        let header = probe(&turned, &Limits::default()).unwrap();
        let image = read(&turned).unwrap();
        let expected = if orientation < 5 { (40, 24) } else { (24, 40) };
        assert_eq!((image.width(), image.height()), expected);
        assert_eq!((header.width, header.height), expected);
        let from_top =
            |image: &Image, c, (x, y): (usize, usize)| image.sample(c, x, image.height() - 1 - y);
        for (x, y) in [(0, 0), (5, 3), (23, 23), (7, 20)] {
            for c in 0..3 {
                let stored = from_top(&plain, c, place(x, y));
                assert_eq!(from_top(&image, c, (x, y)), stored, "{orientation}");
            }
        }
    }
}

#[test]
fn the_first_exif_segment_counts_and_other_metadata_does_not() {
    let bytes = jpeg(&gradient(40, 24, 1), 90);
    let plain = read(&bytes).unwrap();
    let both = with_exif(&with_exif(&bytes, 6), 1);
    assert_eq!(read(&both), Ok(plain.clone()));
    let xmp = with_segment(&bytes, 0xE1, b"http://ns.adobe.com/xap/1.0/\0<x/>");
    assert_eq!(read(&with_segment(&xmp, 0xFE, b"a comment")), Ok(plain.clone()));
    let profile = with_segment(&bytes, 0xE2, b"ICC_PROFILE\0\x01\x01profile");
    assert_eq!(read(&profile), Ok(plain));
}

#[test]
fn a_thumbnail_within_the_metadata_is_no_end() {
    let thumbnail = jpeg(&gradient(8, 8, 1), 50);
    let bytes = jpeg(&gradient(40, 24, 1), 90);
    let payload = [b"Exif\0\0".to_vec(), exif(1), thumbnail].concat();
    assert_eq!(read(&with_segment(&bytes, 0xE1, &payload)), read(&bytes));
}

#[test]
fn scans_too_short_for_the_claimed_size_are_refused() {
    let mut bytes = jpeg(&gradient(16, 16, 1), 90);
    let frame = find(&bytes, 0xC0);
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x0F, 0xA0, 0x0F, 0xA0]);
    assert!(probe(&bytes, &Limits::default()).is_ok());
    let reason = reason(&bytes);
    assert!(reason.contains("too few for 250000 blocks of 4000x4000"), "{reason}");
    assert!(bytes.ends_with(&[0xFF, 0xD9]));
}

#[test]
fn the_flattest_picture_is_not_taken_for_a_truncated_one() {
    for component_count in [1, 3] {
        let plane = vec![128; 640 * 480];
        let image = Image::from_bottom_up(640, 480, 8, vec![plane; component_count]).unwrap();
        assert_eq!(read(&jpeg(&image, 1)), Ok(image));
    }
}

#[test]
fn a_file_without_its_end_marker_is_refused() {
    let mut bytes = jpeg(&gradient(40, 24, 3), 90);
    bytes.truncate(bytes.len() - 2);
    assert!(reason(&bytes).contains("it ends early, at byte"));
}

#[test]
fn codings_that_are_not_read_are_named() {
    let frame = |marker: u8, change: fn(&mut [u8])| {
        let mut bytes = jpeg(&gradient(16, 16, 3), 90);
        let at = find(&bytes, 0xC0);
        bytes[at + 1] = marker;
        change(&mut bytes[at..]);
        (read(&bytes).unwrap_err(), reason(&bytes))
    };
    for (marker, change, expected) in [
        (0xC3, (|_| {}) as fn(&mut [u8]), "lossless coding is not supported"),
        (0xC5, |_| {}, "hierarchical coding is not supported"),
        (0xC9, |_| {}, "arithmetic coding is not supported"),
        (0xC1, |frame| frame[4] = 12, "12 bits per sample are not supported, only 8 are"),
        (0xC0, |frame| frame[9] = 2, "2 components are not supported, only 1, 3 and 4 are"),
        (0xC0, |frame| frame[5..7].fill(0), "its height follows its pixels"),
    ] {
        let (error, reason) = frame(marker, change);
        assert!(matches!(error, DecodeError::Unsupported { .. }), "{error}");
        assert_eq!(reason, expected);
    }
}

#[test]
fn samplings_that_would_decode_wrongly_are_refused() {
    let bytes = jpeg(&gradient(16, 16, 3), 90);
    let (frame, scan) = (find(&bytes, 0xC0), find(&bytes, 0xDA));
    let sampled = |samplings: [u8; 3]| {
        let mut bytes = bytes.clone();
        for (i, sampling) in samplings.into_iter().enumerate() {
            bytes[frame + 11 + 3 * i] = sampling;
        }
        bytes
    };
    for (samplings, expected) in [
        ([0x11, 0x22, 0x11], "the samplings 1x1, 2x2, 1x1 are not supported"),
        ([0x44, 0x11, 0x11], "the samplings 4x4, 1x1, 1x1 are not supported"),
        ([0x22, 0x22, 0x22], "the samplings 2x2, 2x2, 2x2 are not supported"),
    ] {
        assert_eq!(reason(&sampled(samplings)), expected);
    }
    let after_scan = scan + 2 + usize::from(bytes[scan + 3]);
    for (selectors, samplings) in
        [(&[1, 0, 0][..], [0x22, 0x11, 0x11]), (&[2, 0, 0, 1, 1], [0x21, 0x11, 0x11])]
    {
        let mut selectors = selectors.to_vec();
        for (i, id) in selectors.iter_mut().skip(1).step_by(2).enumerate() {
            *id = bytes[frame + 10 + 3 * i];
        }
        let header = segment(0xDA, &[&selectors[..], &[0, 63, 0]].concat());
        let whole = sampled(samplings);
        let scans = [&whole[..scan], &header, &whole[after_scan..]].concat();
        assert!(reason(&scans).starts_with("several scans of sampled components"));
    }
}

#[test]
fn contradictions_are_malformed() {
    let bytes = jpeg(&gradient(16, 16, 3), 90);
    let (frame, scan) = (find(&bytes, 0xC0), find(&bytes, 0xDA));
    let changed = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        reason(&bytes)
    };
    assert_eq!(changed(frame + 8, 0), "its width is 0");
    assert!(changed(frame + 11, 0x50).contains("sampling 5x0"));
    assert!(!changed(scan + 4, 9).is_empty());
    assert!(!changed(scan + 5, 99).is_empty());
    let twice = [&bytes[..scan], &bytes[frame..frame + 19], &bytes[scan..]].concat();
    assert!(reason(&twice).contains("second frame"));
    let without_frame = [&bytes[..frame], &bytes[frame + 19..]].concat();
    assert!(reason(&without_frame).contains("before its frame"));
    assert!(reason(&with_segment(&bytes, 0xE5, &[])[..4]).contains("ends early"));
    assert!(reason(b"\xFF\xD8\xFF\xE5\0\x01").contains("the length 1"));
    assert!(reason(b"\xFF\xD8\xFF\xD9").contains("without a scan"));
}

#[test]
fn a_component_without_a_scan_is_missed() {
    let bytes = jpeg(&gradient(16, 16, 1), 90);
    let (frame, scan) = (find(&bytes, 0xC0), find(&bytes, 0xDA));
    let header = segment(0xC0, &[8, 0, 16, 0, 16, 3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0]);
    let three = [&bytes[..frame], &header, &bytes[frame + 13..]].concat();
    assert_eq!(scan - frame, find(&three, 0xDA) - find(&three, 0xC0) - 6);
    assert!(reason(&three).contains("only 1 of 3 components have a scan"), "{}", reason(&three));
}
