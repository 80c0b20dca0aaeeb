//! The portable anymaps by the letter of their manual pages.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use pixmesh_codec::{DecodeError, Limits, decode, probe, write_pnm};
use pixmesh_meshing::Image;

fn read(bytes: impl AsRef<[u8]>) -> Result<Image, DecodeError> {
    decode(bytes.as_ref(), &Limits::default())
}

/// The reason why a file is refused.
fn reason(bytes: impl AsRef<[u8]>) -> String {
    match read(bytes).unwrap_err() {
        DecodeError::Malformed { reason, .. } | DecodeError::Unsupported { reason, .. } => reason,
        other => panic!("{other}"),
    }
}

/// Precision, and the components from the top row.
fn content(image: &Image) -> (u8, Vec<Vec<u16>>) {
    let rows = |c: usize| (0..image.height()).rev().flat_map(move |y| image.row(c, y).to_vec());
    (image.precision(), (0..image.component_count()).map(|c| rows(c).collect()).collect())
}

#[test]
fn all_six_magic_numbers_are_read() {
    let bits = (1, vec![vec![0, 1, 1, 1, 0, 0]]);
    let gray = (8, vec![vec![1, 2, 3, 4, 5, 255]]);
    let color = (8, vec![vec![1, 4, 7, 1], vec![2, 5, 8, 2], vec![3, 6, 9, 3]]);
    assert_eq!(content(&read("P1 3 2\n100\n011").unwrap()), bits);
    assert_eq!(content(&read("P1 3 2 1 0 0 0 1 1").unwrap()), bits);
    assert_eq!(content(&read(b"P4 3 2\n\x80\x60").unwrap()), bits);
    assert_eq!(content(&read("P2 3 2 255 1 2 3 4 5 255").unwrap()), gray);
    assert_eq!(content(&read(b"P5 3 2 255\n\x01\x02\x03\x04\x05\xFF").unwrap()), gray);
    assert_eq!(content(&read("P3 2 2 255 1 2 3 4 5 6 7 8 9 1 2 3").unwrap()), color);
    assert_eq!(
        content(&read(b"P6 2 2 255\n\x01\x02\x03\x04\x05\x06\x07\x08\x09\x01\x02\x03").unwrap()),
        color
    );
}

#[test]
fn the_precision_is_the_number_of_bits_of_maxval() {
    for (maxval, precision) in
        [(1, 1), (2, 2), (3, 2), (15, 4), (100, 7), (255, 8), (256, 9), (65535, 16)]
    {
        let image = read(format!("P2 2 2 {maxval} 0 1 1 {maxval}")).unwrap();
        assert_eq!(content(&image), (precision, vec![vec![0, 1, 1, maxval]]));
    }
}

#[test]
fn maxval_over_255_takes_two_bytes_a_sample() {
    let image = read(b"P5 2 2 256\n\0\x01\x01\0\0\0\0\xFF").unwrap();
    assert_eq!(content(&image), (9, vec![vec![1, 256, 0, 255]]));
}

#[test]
fn comments_may_stand_anywhere_in_the_header_and_in_plain_rasters() {
    let expected = read(b"P5 2 2 255\nabcd").unwrap();
    for text in [
        &b"P5# one\n2# two\r# three\n2\t# four\n255\nabcd"[..],
        b"P5\n\n 2 \r\n 2 # 9 9\n255# ends the header\nabcd",
        b"P2 2 2 255 97 # 5\n98 99#\n100#",
    ] {
        assert_eq!(read(text), Ok(expected.clone()));
    }
}

#[test]
fn only_one_white_space_ends_the_header_of_a_raw_file() {
    let image = read(b"P5 2 2 255\r\n234").unwrap();
    assert_eq!(content(&image).1, [[10, 50, 51, 52]]);
    assert!(
        reason(b"P5 2 2 255abcd").contains("white space after the header is expected at byte 10")
    );
}

#[test]
fn samples_above_maxval_are_refused() {
    assert!(reason("P2 2 2 100 1 2 3 101").contains("row 1 from the top has the sample 101"));
    assert!(reason("P2 2 2 100 1 2 3 99999999999999999999").contains("more than 100"));
    assert!(reason(b"P5 2 2 100\n\xFF\0\0\0").contains("row 0 from the top has the sample 255"));
    assert!(reason("P1 2 2 1 0 2 0").contains("a bit is expected at byte 11, not '2'"));
}

#[test]
fn broken_headers_say_where() {
    assert!(reason("P5 x").contains("the width is expected at byte 3, not 'x'"));
    assert!(reason("P5 -2 2").contains("not '-'"));
    assert!(reason("P5 2").contains("ends early: the height is expected at byte 4"));
    assert!(reason("P5 2 2 0\n1234").contains("maxval 0"));
    assert!(reason("P5 2 2 65536\n12341234").contains("maxval 65536"));
    assert!(reason("P2 2 2 9 1 2 3 \x07").contains("not '\\x07'"));
    assert!(reason("P2 2 2 9 1 2.5 3 4").contains("a sample is expected at byte 12, not '.'"));
}

#[test]
fn memory_is_taken_only_for_pixels_that_the_file_can_hold() {
    for magic in 1..=6 {
        let header = format!("P{magic} 6000 6000 {}\n0 0", if magic % 3 == 1 { "" } else { "255" });
        assert!(probe(header.as_bytes(), &Limits::default()).is_ok());
        assert!(reason(&header).contains("6000x6000 pixels need"), "{}", reason(&header));
    }
}

#[test]
fn pam_is_read_and_written_where_there_is_alpha() {
    let header = "WIDTH 2\nHEIGHT 2\nDEPTH 2\nMAXVAL 255\nTUPLTYPE GRAYSCALE_ALPHA\nENDHDR\n";
    let pixels = [97, 255, 5, 51, 0, 0, 103, 255];
    let text = [format!("P7\n# a comment\n{header}").as_bytes(), &pixels].concat();
    let image = read(&text).unwrap();
    assert_eq!(content(&image), (8, vec![vec![97, 1, 0, 103], vec![255, 51, 0, 255]]));
    let mut written = Vec::new();
    write_pnm(&image, &mut written).unwrap();
    assert_eq!(written, [format!("P7\n{header}").as_bytes(), &pixels].concat());
    assert!(reason("P7\nWIDTH 2\nENDHDR\n").contains("lacks"));
    assert!(reason("P7\nWIDHT 2\nENDHDR\n").contains("unknown 'WIDHT'"));
    assert!(reason("P7\nWIDTH 2\nHEIGHT 2\nDEPTH 5\nMAXVAL 1\nENDHDR\n").contains("5 components"));
    assert!(reason("P7\nWIDTH 2\n").contains("ENDHDR is expected at byte 11"));
}
