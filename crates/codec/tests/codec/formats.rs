//! WebP, GIF, TIFF and BMP: there and back, their varieties, and what is refused of them.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::encoders::{GifFrame, bmp, gif, gray_gif, tiff, webp};
use crate::samples::{exif, scattered};
use pixmesh_codec::{Alpha, DecodeError, DecodeOptions, Limits, decode, probe};
use pixmesh_meshing::Image;
use proptest::prelude::*;
use tiff::encoder::{Compression, DeflateLevel, Predictor};

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

/// Images of 8 or 16 bits.
fn images(
    component_counts: &'static [usize],
    precisions: &'static [u8],
) -> impl Strategy<Value = Image> {
    let count = prop::sample::select(component_counts);
    let precision = prop::sample::select(precisions);
    (2..24_usize, 2..24_usize, count, precision).prop_flat_map(|(width, height, count, bits)| {
        let plane = prop::collection::vec(0..=u16::MAX >> (16 - bits), width * height);
        prop::collection::vec(plane, count)
            .prop_map(move |planes| Image::from_bottom_up(width, height, bits, planes).unwrap())
    })
}

/// The image with the gray component three times.
fn as_rgb(image: &Image) -> Image {
    let mut planes = image.components().to_vec();
    if planes.len() < 3 {
        planes = [vec![planes[0].clone(); 3], planes[1..].to_vec()].concat();
    }
    Image::from_bottom_up(image.width(), image.height(), image.precision(), planes).unwrap()
}

proptest! {
    #[test]
    fn lossless_webp_reads_back_as_the_same_image(image in images(&[1, 2, 3, 4], &[8])) {
        prop_assert_eq!(read(&webp(&image)).unwrap(), as_rgb(&image).premultiplied());
    }

    #[test]
    fn bitmaps_read_back_as_the_same_image(image in images(&[1, 3, 4], &[8])) {
        prop_assert_eq!(read(&bmp(&image)).unwrap(), as_rgb(&image).premultiplied());
    }

    #[test]
    fn gif_reads_back_as_the_same_image(image in images(&[1], &[8]), interlaced: bool) {
        let (width, height) = (image.width() as u16, image.height() as u16);
        let rows = (0..image.height()).rev().flat_map(|y| image.row(0, y).to_vec());
        let mut indices: Vec<u8> = rows.map(|sample| sample as u8).collect();
        if interlaced {
            let order = [(0, 8), (4, 8), (2, 4), (1, 2)];
            let rows = order.iter().flat_map(|&(first, step)| (first..image.height()).step_by(step));
            let stored = rows.flat_map(|y| indices[y * image.width()..][..image.width()].to_vec());
            indices = stored.collect();
        }
        let frame = GifFrame { width, height, interlaced, indices, ..GifFrame::default() };
        prop_assert_eq!(read(&gif(width, height, &[frame])).unwrap(), as_rgb(&image));
    }

    #[test]
    fn tiff_reads_back_as_the_same_image(
        image in images(&[1, 3, 4], &[8, 16]),
        method in 0..4_usize,
        horizontal: bool,
    ) {
        let deflate = Compression::Deflate(DeflateLevel::Fast);
        let methods = [Compression::Uncompressed, Compression::Lzw, deflate, Compression::Packbits];
        let predictor = if horizontal && matches!(method, 1 | 2) {
            Predictor::Horizontal
        } else {
            Predictor::None
        };
        let decoded = read(&tiff(&image, methods[method], predictor)).unwrap();
        prop_assert_eq!(decoded, image.premultiplied());
    }

    #[test]
    fn the_header_tells_the_shape_of_what_decoding_gives(image in images(&[4], &[8])) {
        let gray = Image::from_bottom_up(image.width(), image.height(), 8, image.components()[..1].to_vec());
        let plain = tiff(&image, Compression::Uncompressed, Predictor::None);
        for bytes in [webp(&image), bmp(&image), plain, gray_gif(&gray.unwrap())] {
            for alpha in [Alpha::Keep, Alpha::Drop, Alpha::Over([1, 2, 3])] {
                let options = DecodeOptions { alpha, ..DecodeOptions::default() };
                let header = options.probe(&bytes).unwrap();
                let decoded = options.decode(&bytes).unwrap();
                prop_assert_eq!((header.width, header.height), (decoded.width(), decoded.height()));
                prop_assert_eq!(header.component_count, decoded.component_count());
                prop_assert_eq!(header.precision, decoded.precision());
            }
        }
    }

    #[test]
    fn garbled_files_never_make_a_decoder_panic(
        kind in 0..FILE_COUNT,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = files().swap_remove(kind).1;
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let limits = Limits { max_pixels: 1 << 20, max_side: 4096 };
        let _ = probe(&bytes, &limits);
        let _ = decode(&bytes, &limits);
        let _ = DecodeOptions { limits, lenient: true, ..DecodeOptions::default() }.decode(&bytes);
    }

    #[test]
    fn garbage_after_any_signature_never_makes_a_decoder_panic(
        start in prop::sample::select(vec![
            &b"RIFF\xFF\0\0\0WEBPVP8L"[..], b"RIFF\xFF\0\0\0WEBPVP8 ", b"RIFF\xFF\0\0\0WEBPVP8X",
            b"GIF89a", b"GIF87a", b"II*\0\x08\0\0\0", b"MM\0*\0\0\0\x08", b"BM",
        ]),
        rest in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let bytes = [start, &rest].concat();
        let limits = Limits { max_pixels: 1 << 20, max_side: 4096 };
        let _ = probe(&bytes, &limits);
        let _ = decode(&bytes, &limits);
    }
}

const FILE_COUNT: usize = 17;

/// One file of each kind, with the bytes at its end that may be missing.
fn files() -> Vec<(usize, Vec<u8>)> {
    let image = |count, bits| scattered(61, 47, count, bits);
    let deflate = Compression::Deflate(DeflateLevel::Fast);
    vec![
        (0, webp(&image(3, 8))),
        (0, webp(&image(4, 8))),
        (0, include_bytes!("../samples/lossy.webp").to_vec()),
        (0, include_bytes!("../samples/lossy_alpha.webp").to_vec()),
        (0, include_bytes!("../samples/animated.webp").to_vec()),
        // The reader stops after the last pixel: the end of the frame and of the file follow.
        (4, gray_gif(&image(1, 8))),
        (4, include_bytes!("../samples/interlaced.gif").to_vec()),
        (0, tiff(&image(1, 16), Compression::Uncompressed, Predictor::None)),
        (0, tiff(&image(3, 8), Compression::Lzw, Predictor::Horizontal)),
        (0, tiff(&image(4, 8), deflate, Predictor::None)),
        (0, include_bytes!("../samples/fax4.tif").to_vec()),
        (0, include_bytes!("../samples/palette.tif").to_vec()),
        (0, include_bytes!("../samples/cmyk.tif").to_vec()),
        (0, bmp(&image(3, 8))),
        (0, bmp(&image(4, 8))),
        (0, include_bytes!("../samples/palette.bmp").to_vec()),
        (0, include_bytes!("../samples/bilevel.bmp").to_vec()),
    ]
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    let files = files();
    assert_eq!(files.len(), FILE_COUNT);
    for (index, (optional, bytes)) in files.into_iter().enumerate() {
        assert!(read(&bytes).is_ok(), "{index}: {:?}", read(&bytes));
        let ends = (0..bytes.len() - optional).step_by(37);
        for end in ends.chain([bytes.len() - optional - 1]) {
            let result = read(&bytes[..end]);
            match result {
                Ok(_) => panic!("file {index} of {} cut at {end} is accepted", bytes.len()),
                Err(DecodeError::Empty) => assert_eq!(end, 0),
                Err(DecodeError::Malformed { reason, .. }) => assert!(!reason.is_empty()),
                Err(other) => panic!("file {index} of {} cut at {end}: {other}", bytes.len()),
            }
        }
    }
}

#[test]
fn bytes_after_the_picture_are_ignored() {
    for (_, mut bytes) in files() {
        let image = read(&bytes).unwrap();
        bytes.extend(b" PK\x03\x04 trailing bytes");
        assert_eq!(read(&bytes).as_ref(), Ok(&image));
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

/// The greatest difference of two images' first three components, in 8 bits.
fn greatest_difference(a: &Image, b: &Image) -> u16 {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()));
    let planes = |image: &Image| {
        let shift = image.precision() - 8;
        image.components()[..3].concat().into_iter().map(move |sample| sample >> shift)
    };
    planes(a).zip(planes(b)).map(|(a, b)| a.abs_diff(b)).max().unwrap()
}

#[test]
fn files_made_elsewhere_show_the_picture_they_were_made_of() {
    let files: [(&[u8], u16); 8] = [
        (include_bytes!("../samples/lossy.webp"), 40),
        (include_bytes!("../samples/lossy_alpha.webp"), 40),
        (include_bytes!("../samples/animated.webp"), 40),
        (include_bytes!("../samples/planar_lzw.tif"), 0),
        (include_bytes!("../samples/palette.tif"), 60),
        (include_bytes!("../samples/cmyk.tif"), 1),
        (include_bytes!("../samples/palette.bmp"), 60),
        (include_bytes!("../samples/interlaced.gif"), 60),
    ];
    for (index, (bytes, tolerance)) in files.into_iter().enumerate() {
        let straight = DecodeOptions { alpha: Alpha::Drop, ..DecodeOptions::default() };
        let difference = greatest_difference(&made_elsewhere(), &straight.decode(bytes).unwrap());
        assert!(difference <= tolerance, "{index}: {difference}");
    }
}

#[test]
fn lossy_webp_keeps_its_alpha() {
    let image = read(include_bytes!("../samples/lossy_alpha.webp")).unwrap();
    let expected: Vec<u16> = (0..120).map(|i| if i % 12 < 6 { 255 } else { 51 }).collect();
    assert_eq!(image.components()[3], expected);
}

#[test]
fn bilevel_fax_and_bitmap_show_the_same_pattern() {
    let fax = read(include_bytes!("../samples/fax4.tif")).unwrap();
    let bitmap = read(include_bytes!("../samples/bilevel.bmp")).unwrap();
    assert_eq!((fax.component_count(), fax.precision()), (1, 1));
    assert_eq!((bitmap.component_count(), bitmap.precision()), (3, 8));
    let bright: Vec<u16> = fax.components()[0].iter().map(|&bit| 255 * bit).collect();
    assert_eq!(bitmap.components()[0], bright);
    let expected: Vec<u16> =
        (0..800).map(|i| u16::from((i % 40 / 5 + i / 40 / 3) % 2 == 1)).collect();
    let expected = Image::from_top_down(40, 20, 1, vec![expected]).unwrap();
    assert_eq!(fax, expected);
}

#[test]
fn the_first_frame_of_a_gif_lies_on_a_transparent_screen() {
    let first = GifFrame {
        left: 1,
        top: 1,
        width: 2,
        height: 1,
        transparent: Some(9),
        indices: vec![7, 9],
        ..GifFrame::default()
    };
    let second = GifFrame { width: 4, height: 3, indices: vec![200; 12], ..GifFrame::default() };
    let image = read(&gif(4, 3, &[first, second])).unwrap();
    assert_eq!(image.component_count(), 4);
    assert_eq!(image.components()[3], [0, 0, 0, 0, 0, 255, 0, 0, 0, 0, 0, 0]);
    assert_eq!(image.sample(0, 1, 1), 7);
}

#[test]
fn a_gif_frame_beyond_its_screen_and_one_without_frames_are_refused() {
    let frame =
        GifFrame { left: 3, width: 3, height: 2, indices: vec![0; 6], ..GifFrame::default() };
    assert!(!reason(&gif(4, 3, &[frame])).is_empty());
    assert!(!reason(&gif(4, 3, &[])).is_empty());
}

/// A WebP file of chunks.
fn riff(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
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
fn vp8x(flags: u8, width: u32, height: u32) -> Vec<u8> {
    let side = |side: u32| (side - 1).to_le_bytes()[..3].to_vec();
    [vec![flags, 0, 0, 0], side(width), side(height)].concat()
}

#[test]
fn the_orientation_of_a_webp_is_applied() {
    let image = scattered(5, 3, 3, 8);
    let plain = webp(&image);
    let picture = &plain[20..];
    for orientation in 1..=8 {
        let exif = exif(orientation);
        let bytes = riff(&[(b"VP8X", &vp8x(0x08, 5, 3)), (b"VP8L", picture), (b"EXIF", &exif)]);
        let turned = read(&bytes).unwrap();
        let header = probe(&bytes, &Limits::default()).unwrap();
        let expected = if orientation < 5 { (5, 3) } else { (3, 5) };
        assert_eq!((turned.width(), turned.height()), expected, "{orientation}");
        assert_eq!((header.width, header.height), expected, "{orientation}");
        // The corner that the file stores first.
        let (x, y) = [(0, 2), (4, 2), (4, 0), (0, 0), (0, 4), (2, 4), (2, 0), (0, 0)]
            [usize::from(orientation) - 1];
        assert_eq!(turned.sample(0, x, y), image.sample(0, 0, 2), "{orientation}");
    }
}

#[test]
fn a_webp_whose_sizes_contradict_each_other_is_refused_before_it_is_decoded() {
    let picture = &webp(&scattered(5, 3, 3, 8))[20..];
    let reason_of = |chunks: &[(&[u8; 4], &[u8])]| reason(&riff(chunks));
    let canvas = vp8x(0, 6, 3);
    let reason = reason_of(&[(b"VP8X", &canvas), (b"VP8L", picture)]);
    assert!(reason.contains("Inconsistent image sizes"), "{reason}");
    let huge = [0, 0, 0, 0x9D, 1, 0x2A, 0xFF, 0x3F, 0xFF, 0x3F, 0, 0];
    let reason = reason_of(&[(b"VP8X", &canvas), (b"VP8 ", &huge)]);
    assert_eq!(reason, "a picture of 16383x16383 lies on a canvas of 6x3");
    assert!(!reason_of(&[(b"VP8X", &canvas)]).is_empty());
    assert!(!reason_of(&[(b"ABCD", &[0; 10])]).is_empty());
}

/// A TIFF of fields, `MM` or `II`; each has a tag, a type, a count and a value or offset.
fn tiff_of(little_endian: bool, fields: &[(u16, u16, u32, u32)], data: &[u8]) -> Vec<u8> {
    let short = |v: u16| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
    let long = |v: u32| if little_endian { v.to_le_bytes() } else { v.to_be_bytes() };
    let mut bytes = if little_endian { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
    bytes.extend(long(8 + data.len() as u32));
    bytes.extend_from_slice(data);
    bytes.extend(short(fields.len() as u16));
    for &(tag, kind, count, value) in fields {
        bytes.extend([short(tag), short(kind)].concat());
        bytes.extend(long(count));
        if kind == 3 && count == 1 {
            bytes.extend([short(value as u16), short(0)].concat());
        } else {
            bytes.extend(long(value));
        }
    }
    bytes.extend([0; 4]);
    bytes
}

/// The fields of an uncompressed gray picture in one strip at byte 8.
fn gray_fields(width: u32, height: u32, depth: u32, length: u32) -> Vec<(u16, u16, u32, u32)> {
    vec![
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 1, depth),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (277, 3, 1, 1),
        (278, 4, 1, height),
        (279, 4, 1, length),
    ]
}

/// Sets a field, or adds it in its place.
fn with_field(
    mut fields: Vec<(u16, u16, u32, u32)>,
    field: (u16, u16, u32, u32),
) -> Vec<(u16, u16, u32, u32)> {
    fields.retain(|known| known.0 != field.0);
    fields.push(field);
    fields.sort_unstable();
    fields
}

#[test]
fn tiff_of_few_bits_and_of_both_byte_orders_keeps_its_bits() {
    for little_endian in [false, true] {
        let image =
            read(&tiff_of(little_endian, &gray_fields(3, 2, 4, 4), &[0x12, 0x30, 0x45, 0x60]));
        let image = image.unwrap();
        assert_eq!(image.precision(), 4);
        assert_eq!(image.components(), [[4, 5, 6, 1, 2, 3]]);
        let white = with_field(gray_fields(3, 2, 1, 2), (262, 3, 1, 0));
        let image = read(&tiff_of(little_endian, &white, &[0b0100_0000, 0b1010_0000])).unwrap();
        assert_eq!(image.components(), [[0, 1, 0, 1, 0, 1]]);
    }
    let words = [1, 2, 3, 4, 5, 6, 7, 8];
    let image = read(&tiff_of(false, &gray_fields(2, 2, 16, 8), &words)).unwrap();
    assert_eq!(image.components(), [[0x0506, 0x0708, 0x0102, 0x0304]]);
}

#[test]
fn the_orientation_of_a_tiff_is_applied() {
    let fields = with_field(gray_fields(3, 2, 8, 6), (274, 3, 1, 6));
    let image = read(&tiff_of(true, &fields, &[1, 2, 3, 4, 5, 6])).unwrap();
    assert_eq!((image.width(), image.height()), (2, 3));
    assert_eq!(image.components(), [[6, 3, 5, 2, 4, 1]]);
}

#[test]
fn components_of_a_tiff_may_lie_one_after_the_other() {
    let data: Vec<u8> = (1..=12).collect();
    // Offsets and lengths of the three strips follow the samples.
    let mut data = data;
    for number in [8_u32, 12, 16, 4, 4, 4] {
        data.extend(number.to_le_bytes());
    }
    let mut fields = gray_fields(2, 2, 8, 0);
    for field in [(262, 3, 1, 2), (277, 3, 1, 3), (284, 3, 1, 2)] {
        fields = with_field(fields, field);
    }
    let fields = with_field(with_field(fields, (273, 4, 3, 20)), (279, 4, 3, 32));
    let image = read(&tiff_of(true, &fields, &data)).unwrap();
    assert_eq!(image.components(), [[3, 4, 1, 2], [7, 8, 5, 6], [11, 12, 9, 10]]);
}

#[test]
fn what_is_not_read_of_tiff_is_named() {
    let refused =
        |field| reason(&tiff_of(true, &with_field(gray_fields(2, 2, 8, 4), field), &[0; 4]));
    // A floating-point number of 8 bits, and complex whole numbers.
    assert!(!refused((339, 3, 1, 3)).is_empty() && !refused((339, 3, 1, 5)).is_empty());
    assert!(refused((258, 3, 1, 12)).contains("samples of 12 bits"));
    assert!(refused((259, 3, 1, 7)).contains("compression"), "{}", refused((259, 3, 1, 7)));
    assert!(refused((262, 3, 1, 6)).contains("interpretation 6"));
    assert!(refused((277, 3, 1, 9)).contains("9 samples"));
    assert!(refused((262, 3, 1, 3)).contains("no palette"));
    assert!(!reason(b"II+\0\x08\0\0\0\0\0\0\0\0\0\0\0").is_empty());
    let tile = [(322, 4, 1, 1 << 31), (323, 4, 1, 16), (324, 4, 1, 8), (325, 4, 1, 4)];
    let fields = tile.into_iter().fold(gray_fields(2, 2, 8, 4), with_field);
    let fields: Vec<_> = fields.into_iter().filter(|f| !matches!(f.0, 273 | 278 | 279)).collect();
    assert!(reason(&tiff_of(true, &fields, &[0; 4])).contains("a side of 2147483648"));
}

#[test]
fn bitmaps_of_one_row_or_without_pixels_are_refused() {
    let mut bytes = bmp(&scattered(4, 4, 3, 8));
    bytes[22..26].copy_from_slice(&1_u32.to_le_bytes());
    assert!(matches!(read(&bytes), Err(DecodeError::Image(_))));
    bytes[22..26].copy_from_slice(&0_u32.to_le_bytes());
    assert!(read(&bytes).is_err());
    // Rows from the top.
    let image = scattered(4, 4, 3, 8);
    let mut bytes = bmp(&image);
    bytes[22..26].copy_from_slice(&(-4_i32).to_le_bytes());
    let flipped = read(&bytes).unwrap();
    assert_eq!(flipped.row(0, 0), image.row(0, 3));
}

#[test]
fn a_file_that_ends_early_is_read_as_far_as_it_goes_when_asked_to() {
    let image = scattered(61, 47, 1, 8);
    let options = DecodeOptions { lenient: true, ..DecodeOptions::default() };
    let mut png = Vec::new();
    pixmesh_codec::write_png(&image, &mut png).unwrap();
    let mut pgm = Vec::new();
    pixmesh_codec::write_pnm(&image, &mut pgm).unwrap();
    let plain: Vec<String> = image.components()[0].iter().map(ToString::to_string).collect();
    let plain = format!("P2 61 47 255 {}", plain.join(" ")).into_bytes();
    let jpeg = crate::samples::jpeg(&crate::samples::gradient(61, 47, 3), 90);
    let progressive = include_bytes!("../samples/progressive.jpg").to_vec();
    for whole in [png, pgm, plain, jpeg, progressive, gray_gif(&image)] {
        let complete = read(&whole).unwrap();
        assert_eq!(options.decode(&whole).as_ref(), Ok(&complete));
        for part in [2, 3, 4] {
            let cut = &whole[..whole.len() - whole.len() / part / 8];
            assert!(matches!(read(cut), Err(DecodeError::Malformed { .. })));
            let partial = options.decode(cut).unwrap();
            assert_eq!((partial.width(), partial.height()), (complete.width(), complete.height()));
            let top = complete.height() - 1;
            let close = |(a, b): (&u16, &u16)| a.abs_diff(*b) < 60;
            assert!(partial.row(0, top).iter().zip(complete.row(0, top)).all(close));
        }
        assert!(options.decode(&whole[..4]).is_err());
    }
}
