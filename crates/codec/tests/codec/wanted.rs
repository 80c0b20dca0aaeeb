//! Decoding and encoding that stop when nobody wants their result any more.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::encoders::{bmp, gray_gif, tiff, webp};
use crate::samples::{gradient, jpeg, scattered};
use pixmesh_codec::{
    Alpha, DecodeError, DecodeOptions, EncodeError, Limits, ModelDefect, PmeshError,
    PngCompression, Texture, Wanted, WeightsError, read_model_while, read_progression_while,
    read_weights_while, write_model, write_pmesh_while, write_png, write_png_while, write_pnm,
    write_progression,
};
use pixmesh_meshing::{Cancelled, Image, Mesh, Method, Progression, Target, mesh_image};
use std::sync::atomic::{AtomicUsize, Ordering};
use tiff::encoder::{Compression, DeflateLevel, Predictor};

/// Rows of the pictures below.
const HEIGHT: usize = 150;

/// A picture of each kind, of so many rows and at least as many columns.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let image = |count, bits| scattered(200, HEIGHT, count, bits);
    let written = |write: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = Vec::new();
        write(&mut bytes);
        bytes
    };
    let deflate = Compression::Deflate(DeflateLevel::Fast);
    let tiff = |method, predictor| tiff(&image(3, 16), method, predictor);
    vec![
        ("PNG", written(&|out| write_png(&image(3, 8), out).unwrap())),
        ("PNG of 16 bits and alpha", written(&|out| write_png(&image(4, 16), out).unwrap())),
        ("PNM", written(&|out| write_pnm(&image(3, 16), out).unwrap())),
        ("JPEG", jpeg(&gradient(200, HEIGHT, 3), 95)),
        ("gray JPEG", jpeg(&gradient(200, HEIGHT, 1), 95)),
        ("WebP", webp(&image(4, 8))),
        ("GIF", gray_gif(&image(1, 8))),
        ("TIFF", tiff(Compression::Uncompressed, Predictor::None)),
        ("TIFF by LZW", tiff(Compression::Lzw, Predictor::Horizontal)),
        ("TIFF by Deflate", tiff(deflate, Predictor::None)),
        ("TIFF by PackBits", tiff(Compression::Packbits, Predictor::None)),
        ("BMP", bmp(&image(3, 8))),
        ("progressive JPEG", include_bytes!("../samples/progressive.jpg").to_vec()),
        ("lossy WebP", include_bytes!("../samples/lossy.webp").to_vec()),
        ("lossy WebP with alpha", include_bytes!("../samples/lossy_alpha.webp").to_vec()),
        ("interlaced GIF", include_bytes!("../samples/interlaced.gif").to_vec()),
        ("TIFF for fax", include_bytes!("../samples/fax4.tif").to_vec()),
        ("BMP of two colours", include_bytes!("../samples/bilevel.bmp").to_vec()),
    ]
}

/// The kinds that are smaller.
const SMALL: usize = 6;

/// Runs `work`, which is wanted up to its question `last`; gives back its result and the questions
/// that it asked.
fn ask<T>(last: usize, work: impl FnOnce(&Wanted<'_>) -> T) -> (T, usize) {
    let asked = AtomicUsize::new(0);
    let result = work(&|| {
        let before = asked.fetch_add(1, Ordering::Relaxed);
        if before >= last { Err(Cancelled) } else { Ok(()) }
    });
    (result, asked.into_inner())
}

fn decode_until(
    bytes: &[u8],
    options: &DecodeOptions,
    last: usize,
) -> (Result<Image, DecodeError>, usize) {
    ask(last, |wanted| options.decode_while(bytes, wanted))
}

#[test]
fn a_picture_that_nobody_wants_is_not_decoded() {
    for (kind, bytes) in files() {
        let (result, asked) = decode_until(&bytes, &DecodeOptions::default(), 0);
        assert_eq!((result, asked), (Err(DecodeError::Cancelled(Cancelled)), 1), "{kind}");
    }
}

#[test]
fn a_picture_that_is_wanted_to_its_end_is_the_same_and_asked_for_at_each_row() {
    let files = files();
    let small = files.len() - SMALL;
    for (place, (kind, bytes)) in files.into_iter().enumerate() {
        let options = DecodeOptions::default();
        let (image, asked) = decode_until(&bytes, &options, usize::MAX);
        assert_eq!(image, options.decode(&bytes), "{kind}");
        let height = image.unwrap().height();
        assert_eq!(height == HEIGHT, place < small, "{kind}");
        assert!(asked > height, "{kind}: asked {asked} times for {height} rows");
    }
}

#[test]
fn decoding_ends_at_whichever_question_is_answered_with_no() {
    for (kind, bytes) in files() {
        for lenient in [false, true] {
            let alpha = Alpha::Over([1, 2, 3]);
            let options = DecodeOptions { lenient, alpha, ..DecodeOptions::default() };
            let (_, questions) = decode_until(&bytes, &options, usize::MAX);
            for last in (0..questions).step_by(questions / 40 + 1).chain([questions - 1]) {
                let (result, asked) = decode_until(&bytes, &options, last);
                let told = format!("{kind}, question {last} of {questions}");
                assert_eq!(result, Err(DecodeError::Cancelled(Cancelled)), "{told}");
                assert_eq!(asked, last + 1, "{told}");
            }
        }
    }
}

#[test]
fn decoders_that_read_are_stopped_before_they_have_all_pixels() {
    // One question for each row is asked by what puts the pixels into planes, after the decoder.
    for (kind, bytes) in files() {
        let reads_at_length = bytes.len() > 20_000 && !kind.contains("PNM");
        let (_, asked) = decode_until(&bytes, &DecodeOptions::default(), usize::MAX);
        let while_reading = asked.saturating_sub(HEIGHT + 2);
        assert!(!reads_at_length || while_reading >= bytes.len() / 8192, "{kind}: {while_reading}");
    }
}

#[test]
fn weights_textures_and_pictures_are_made_as_long_as_they_are_wanted() {
    let image = scattered(40, 30, 3, 16);
    let mut png = Vec::new();
    write_png(&image, &mut png).unwrap();

    let weights = |last| {
        ask(last, |wanted| read_weights_while(&png, (40, 30), &DecodeOptions::default(), wanted))
    };
    let (made, questions) = weights(usize::MAX);
    assert_eq!(made.unwrap().values().len(), 40 * 30);
    for last in 0..questions {
        let refused = weights(last).0.unwrap_err();
        assert!(matches!(refused, WeightsError::Picture(DecodeError::Cancelled(_))), "{last}");
    }

    let texture = |last| ask(last, |wanted| Texture::of_file_while(&png, &image, wanted));
    let (made, questions) = texture(usize::MAX);
    assert_eq!(made.unwrap(), Texture::of_file_while(&png, &image, &|| Ok(())).unwrap());
    for last in 0..questions {
        assert!(matches!(texture(last).0, Err(EncodeError::Cancelled(_))), "{last}");
    }

    let picture = |last| {
        let mut out = Vec::new();
        let compression = PngCompression::Fast;
        let (result, asked) =
            ask(last, |wanted| write_png_while(&image, compression, &mut out, wanted));
        (result.map(|()| out), asked)
    };
    let (made, questions) = picture(usize::MAX);
    assert_eq!((made.unwrap(), questions), (png, 30));
    for last in 0..questions {
        assert!(matches!(picture(last).0, Err(EncodeError::Cancelled(_))), "{last}");
    }
}

/// A mesh of some ten thousand vertices.
fn large_mesh() -> (Image, Mesh) {
    let image = scattered(200, HEIGHT, 3, 8);
    let parameters = Method::Med.parameters(Target::Percent(60.0));
    let mesh = mesh_image(&image, &parameters, &()).unwrap().mesh;
    (image, mesh)
}

#[test]
fn a_model_is_read_as_long_as_it_is_wanted() {
    let (_, mesh) = large_mesh();
    let mut bytes = Vec::new();
    write_model(&mesh, &mut bytes).unwrap();
    let read = |last| ask(last, |wanted| read_model_while(&bytes, &Limits::default(), wanted));
    let (whole, questions) = read(usize::MAX);
    assert_eq!(whole.unwrap(), mesh);
    // So often while it is read, and a few times while it is checked.
    let reading = bytes.len() / (1 << 15);
    assert!((reading + 4..3 * reading + 40).contains(&questions), "{questions} of {reading}");
    for last in 0..questions {
        let (refused, asked) = read(last);
        assert_eq!(refused.unwrap_err().defect, ModelDefect::Cancelled(Cancelled), "{last}");
        assert_eq!(asked, last + 1);
    }
}

#[test]
fn a_pmesh_is_read_as_long_as_it_is_wanted() {
    let (image, mesh) = large_mesh();
    let parameters = Method::Mgpr.parameters(Target::Size(mesh.points().len()));
    let progression = Progression::new(&image, &mesh, &parameters, &()).unwrap();
    let mut bytes = Vec::new();
    write_progression(&progression, None, &mut bytes).unwrap();
    let read =
        |last| ask(last, |wanted| read_progression_while(&bytes, &Limits::default(), wanted));
    let (whole, questions) = read(usize::MAX);
    assert_eq!(whole.unwrap(), progression);
    let vertices = mesh.points().len();
    assert!(questions >= 2 * vertices / 4096 + bytes.len() / (1 << 15), "{questions}");
    for last in 0..questions {
        let (refused, asked) = read(last);
        assert!(matches!(refused.unwrap_err(), PmeshError::Cancelled(_)), "{last}");
        // Where the stream's reader was told, the one who reads it asks once more.
        assert!((last + 1..=last + 2).contains(&asked), "{last}: {asked}");
    }
}

#[test]
fn a_pmesh_is_checked_as_long_as_it_is_wanted() {
    let (_, mesh) = large_mesh();
    let write = |last| ask(last, |wanted| write_pmesh_while(&mesh, None, &mut Vec::new(), wanted));
    let (whole, questions) = write(usize::MAX);
    whole.unwrap();
    assert!(questions >= 4 * mesh.faces().len() / (1 << 14), "{questions}");
    for last in 0..questions {
        let (refused, asked) = write(last);
        assert!(matches!(refused, Err(EncodeError::Cancelled(_))), "{last}");
        assert_eq!(asked, last + 1);
    }
}
