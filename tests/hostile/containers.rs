//! 6.2: broken containers, and files that are not what they are called.

use crate::client::{Answer, field, form};
use crate::pictures::disc;
use crate::samples::encoders::{bmp, gray_gif, tiff, webp};
use crate::samples::{deflated, gradient, ihdr, jpeg, png_file};
use crate::table::{Expected, Request, Row, check, mesh, post};
use std::time::Duration;
use tiff::encoder::{Compression, Predictor};

const BROKEN: Expected = Expected::Refused(422, "image-decode-failed");
const UNKNOWN: Expected = Expected::Refused(415, "unsupported-image");
/// How far apart the places are at which files are cut.
const STEP: usize = 37;

/// A small picture in every format that is read, with the bytes at its end that say nothing of the
/// picture.
pub(crate) fn one_of_each() -> Vec<(&'static str, Vec<u8>, usize)> {
    let (gray, color) = (gradient(24, 18, 1), gradient(24, 18, 3));
    let pnm = |image| {
        let mut bytes = Vec::new();
        pixmesh_codec::write_pnm(image, &mut bytes).unwrap();
        bytes
    };
    vec![
        // The last chunk of a PNG is empty, and the checksum before it tells of nothing else.
        ("PNG", disc(30, 20, 3), 16),
        ("JPEG", jpeg(&color, 90), 0),
        ("GIF", gray_gif(&gray), 3),
        ("WebP", webp(&color), 1),
        ("TIFF", tiff(&color, Compression::Lzw, Predictor::None), 0),
        ("BMP", bmp(&color), 2),
        ("PGM", pnm(&gray), 0),
        ("PPM", pnm(&color), 0),
    ]
}

/// A PNG of 4x2 gray pixels with other chunks in place of its own.
fn png(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    png_file(chunks)
}

fn header(width: u32, kind: u8) -> (&'static [u8; 4], Vec<u8>) {
    (b"IHDR", ihdr(width, 2, 8, kind, false))
}

fn pixels(rows: &[u8]) -> (&'static [u8; 4], Vec<u8>) {
    (b"IDAT", deflated(rows))
}

const END: (&[u8; 4], Vec<u8>) = (b"IEND", Vec::new());

fn labelled(label: &str, picture: Vec<u8>) -> Request {
    post("/v1/meshes", &[("Content-Type", label)], picture)
}

/// A form with a picture of some file name and label.
fn form_with(headers: &str, picture: &[u8]) -> Request {
    let (boundary, body) = form(&[(&format!("{}{headers}", field("image")), picture)]);
    post("/v1/meshes", &[("Content-Type", &boundary)], body)
}

fn of_pieces() -> Vec<Row> {
    vec![
        Row::picture("C01", "no bytes", Expected::Refused(400, "empty-file"), Vec::new),
        Row::picture("C02", "one byte", UNKNOWN, || b"x".to_vec()),
        Row::new("C03", "the signature of each format and nothing more", BROKEN, || {
            let starts: [&[u8]; 8] = [
                b"\x89PNG\r\n\x1a\n",
                b"\xFF\xD8\xFF",
                b"GIF89a",
                b"RIFF\0\0\0\0WEBP",
                b"II*\0",
                b"MM\0*",
                b"BM\0\0\0\0\0\0\0\0\x1A\0\0\0\x0C\0\0\0",
                b"P5\n",
            ];
            starts.map(|start| mesh("", start.to_vec())).into()
        }),
        Row::new(
            "C04",
            "each format cut at every 37th byte",
            Expected::OneOf(&[(415, "unsupported-image"), (422, "image-decode-failed")]),
            || {
                let cut = |(_, bytes, surplus): (&str, Vec<u8>, usize)| {
                    let ends = (1..bytes.len() - surplus).step_by(STEP);
                    ends.map(|end| mesh("", bytes[..end].to_vec())).collect::<Vec<_>>()
                };
                one_of_each().into_iter().flat_map(cut).collect()
            },
        ),
        Row::new("C05", "PNG with a flipped bit anywhere in its pixels", BROKEN, || {
            let bytes = disc(30, 20, 3);
            let start = bytes.windows(4).position(|kind| kind == b"IDAT").unwrap() + 4;
            (start..bytes.len() - 16)
                .step_by(STEP)
                .map(|place| {
                    let mut broken = bytes.clone();
                    broken[place] ^= 0x10;
                    mesh("", broken)
                })
                .collect()
        }),
        Row::picture("C06", "PNG with a wrong checksum of its header", BROKEN, || {
            let mut bytes = disc(20, 20, 1);
            bytes[29] ^= 1;
            bytes
        }),
    ]
}

fn of_png() -> Vec<Row> {
    let rows = [0, 1, 2, 3, 4, 0, 5, 6, 7, 8];
    vec![
        Row::picture("C07", "PNG of no columns", BROKEN, move || {
            png(&[header(0, 0), pixels(&rows), END])
        }),
        Row::new(
            "C07b",
            "BMP, GIF and PGM of no columns and no rows",
            Expected::Refused(422, "degenerate-image"),
            || {
                let mut old =
                    b"BM\0\0\0\0\0\0\0\0\x1A\0\0\0\x0C\0\0\0\0\0\0\0\x01\0\x18\0".to_vec();
                old.extend([0; 12]);
                let mut new = bmp(&gradient(24, 18, 3));
                new[18..26].fill(0);
                let gif = b"GIF89a\0\0\0\0\0\0\0;".to_vec();
                [old, new, gif, b"P5\n0 0\n255\n".to_vec()].map(|picture| mesh("", picture)).into()
            },
        ),
        Row::picture("C08", "PNG without pixels", BROKEN, || png(&[header(4, 0), END])),
        Row::picture("C09", "PNG of two headers", BROKEN, move || {
            png(&[header(4, 0), header(4, 0), pixels(&rows), END])
        }),
        Row::picture("C10", "PNG without its palette", BROKEN, move || {
            png(&[header(4, 3), pixels(&rows), END])
        }),
        Row::picture("C11", "PNG with an index beyond its palette", BROKEN, move || {
            png(&[header(4, 3), (b"PLTE", vec![9; 6]), pixels(&rows), END])
        }),
        Row::picture("C12", "PNG with an unknown filter", BROKEN, || {
            png(&[header(4, 0), pixels(&[9, 1, 2, 3, 4, 0, 5, 6, 7, 8]), END])
        }),
    ]
}

fn of_disguises() -> Vec<Row> {
    vec![
        Row::new("C13", "text as x.png", UNKNOWN, || {
            let headers = "; filename=\"x.png\"\r\nContent-Type: image/png";
            vec![form_with(headers, b"Dear sir or madam,\n")]
        }),
        Row::picture("C14", "SVG with a script, which no answer repeats", UNKNOWN, || {
            b"<svg xmlns=\"http://www.w3.org/2000/svg\" onload=\"alert(1)\"><script>alert(2)</script></svg>".to_vec()
        })
        .and(|answer| {
            assert!(!answer.text().contains("alert") && !answer.text().contains("<svg"));
            assert_eq!(answer.header("x-content-type-options"), "nosniff");
            assert!(answer.header("content-security-policy").contains("default-src 'none'"));
        }),
        Row::new("C15", "PNG that is a ZIP, too: nothing of that is in any answer", Expected::Served, || {
            let picture = [disc(20, 20, 3), b"PK\x03\x04smuggled-name".to_vec()].concat();
            ["model", "png", "glb", "glb&texture=embed", "svg"]
                .map(|format| mesh(&format!("format={format}"), picture.clone()))
                .into()
        })
        .and(without_smuggled),
        Row::picture("C16", "JPEG's first bytes and HTML", BROKEN, || {
            b"\xFF\xD8\xFF\xE0<html><script>alert(1)</script>".to_vec()
        })
        .and(|answer| assert!(!answer.text().contains("script"))),
        Row::new("C17", "PDF as x.png", UNKNOWN, || {
            vec![form_with("; filename=\"x.png\"", b"%PDF-1.7\n"), mesh("", b"%PDF-1.7\n".to_vec())]
        }),
        Row::picture("C18", "PNG with 31 MiB of zeros after its end", Expected::Served, || {
            [disc(20, 20, 1), vec![0; 31 << 20]].concat()
        })
        .within(Duration::from_secs(2))
        .taking(128),
        Row::picture("C18b", "PNG with 32 MiB of zeros after its end", Expected::Refused(413, "body-too-large"), || {
            [disc(20, 20, 1), vec![0; 32 << 20]].concat()
        })
        .within(Duration::from_secs(2))
        .taking(128),
        Row::new("C19", "JPEG labelled as PNG, as any image, as bytes", Expected::Served, || {
            let picture = jpeg(&gradient(24, 18, 3), 90);
            ["image/png", "image/nonsense", "application/octet-stream"]
                .map(|label| labelled(label, picture.clone()))
                .into()
        }),
        Row::new("C19b", "a picture labelled text/html", Expected::Refused(415, "unsupported-media-type"), || {
            let picture = disc(20, 20, 1);
            let part = form_with("\r\nContent-Type: text/html", &picture);
            vec![labelled("text/html", picture), part]
        }),
        Row::new("C20", "GIF as x.png", Expected::Served, || {
            vec![form_with("; filename=\"x.png\"", &gray_gif(&gradient(24, 18, 1)))]
        }),
        Row::new("C21", "formats that are not read: ICO, PSD, JPEG XL, HEIF, EXR, ELF, gzip, ZIP", UNKNOWN, || {
            let starts: [&[u8]; 9] = [
                b"\0\0\x01\0\x01\0\x10\x10",
                b"8BPS\0\x01",
                b"\xFF\x0A\xFA\x7F",
                b"\0\0\0\x0CJXL \r\n\x87\n",
                b"\0\0\0\x18ftypheic",
                b"v/1\x01\x02\0\0\0",
                b"\x7FELF\x02\x01\x01",
                b"\x1F\x8B\x08\0",
                b"PK\x03\x04",
            ];
            starts.map(|start| mesh("", [start, &[0; 200]].concat())).into()
        }),
        Row::new("C22", "PNG that begins with a byte-order mark, a blank, another PNG's signature", Expected::OneOf(&[
            (415, "unsupported-image"),
            (422, "image-decode-failed"),
        ]), || {
            let picture = disc(20, 20, 1);
            [&b"\xEF\xBB\xBF"[..], b" ", b"\x89PNG\r\n\x1a\n"]
                .map(|start| mesh("", [start, &picture].concat()))
                .into()
        }),
    ]
}

fn without_smuggled(answer: &Answer) {
    let holds = |part: &[u8]| answer.body.windows(part.len()).any(|seen| seen == part);
    assert!(!holds(b"smuggled-name"));
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_pieces(), of_png(), of_disguises()].into_iter().flatten().collect()
}

#[test]
fn broken_and_disguised_files_are_refused_as_what_they_are() {
    check(&[], &rows());
}
