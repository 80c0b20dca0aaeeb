//! 6.3: valid but awkward, which must be served, and served right.

use crate::client::Answer;
use crate::pictures::disc_image;
use crate::samples::bombs::{vp8x, webp};
use crate::samples::encoders::{self, GifFrame, gif};
use crate::samples::{deflated, exif, gradient, ihdr, jpeg, png_file};
use crate::table::{Expected, Request, Row, check, mesh};
use pixmesh_codec::{Limits, decode};
use pixmesh_meshing::Image;

const DEGENERATE: Expected = Expected::Refused(422, "degenerate-image");
const SERVED: Expected = Expected::Served;
/// Every pixel a vertex, so that the answer as PNM is the picture as it was read.
const EXACT: &str = "density=100&method=med&format=pnm";

fn pgm(width: usize, height: usize, samples: &[u8]) -> Vec<u8> {
    [format!("P5\n{width} {height}\n255\n").as_bytes(), samples].concat()
}

fn exact(picture: Vec<u8>) -> Vec<Request> {
    vec![mesh(EXACT, picture)]
}

/// The picture of an answer, its samples row by row from the top, those of a pixel side by side.
fn shown(answer: &Answer) -> (usize, usize, u8, Vec<u16>) {
    let image = decode(&answer.body, &Limits::default()).unwrap();
    let rows = (0..image.height()).rev();
    let samples = rows.flat_map(|y| pixels_of_row(&image, y)).collect();
    (image.width(), image.height(), image.precision(), samples)
}

fn pixels_of_row(image: &Image, y: usize) -> Vec<u16> {
    let places = 0..image.width();
    places.flat_map(|x| (0..image.component_count()).map(move |c| image.sample(c, x, y))).collect()
}

fn png(depth: u8, kind: u8, chunks: &[(&[u8; 4], Vec<u8>)], rows: &[u8]) -> Vec<u8> {
    let mut all: Vec<(&[u8; 4], Vec<u8>)> = vec![(b"IHDR", ihdr(2, 2, depth, kind, false))];
    all.extend(chunks.iter().cloned());
    all.extend([(b"IDAT" as &[u8; 4], deflated(rows)), (b"IEND", Vec::new())]);
    png_file(&all)
}

fn of_sizes() -> Vec<Row> {
    vec![
        Row::picture("V01", "1x1", DEGENERATE, || pgm(1, 1, &[7])),
        Row::new("V02", "2x2: two triangles, and the picture itself", SERVED, || {
            exact(pgm(2, 2, &[0, 1, 2, 3]))
        })
        .and(|answer| {
            assert_eq!((answer.header("mesh-vertices"), answer.header("mesh-faces")), ("4", "2"));
            assert_eq!(shown(answer), (2, 2, 8, vec![0, 1, 2, 3]));
        }),
        Row::picture("V03", "1x5000", DEGENERATE, || pgm(1, 5000, &[7; 5000])),
        Row::picture("V04", "5000x1", DEGENERATE, || pgm(5000, 1, &[7; 5000])),
        Row::new("V05", "one colour: the corners, and no error", SERVED, || {
            vec![mesh("size=4", pgm(30, 30, &[9; 900]))]
        })
        .and(|answer| {
            assert_eq!((answer.header("mesh-faces"), answer.header("mesh-psnr")), ("2", "inf"));
        }),
        Row::new("V05b", "one colour by every method", SERVED, || {
            let gray = pgm(30, 30, &[9; 900]);
            let color = [&b"P6\n30 30\n255\n"[..], &[9; 2700]].concat();
            let of = |method: &str, picture: &Vec<u8>| {
                mesh(&format!("method={method}"), picture.clone())
            };
            let mut requests: Vec<_> = ["ed", "med", "gprfsed", "mgprfs", "gpr", "mgpr"]
                .iter()
                .map(|m| of(m, &gray))
                .collect();
            requests.extend(["ced", "cgprfsed", "cgpr"].iter().map(|m| of(m, &color)));
            requests
        }),
        Row::new("V24", "the largest side there may be, two rows of it", SERVED, || {
            vec![
                mesh("", pgm(16_384, 2, &[5; 2 * 16_384])),
                mesh("", pgm(2, 16_384, &[5; 2 * 16_384])),
            ]
        }),
        Row::picture(
            "V25",
            "one column more than a side may have",
            Expected::Refused(422, "image-too-large"),
            || pgm(16_385, 2, &[5; 2 * 16_385]),
        )
        .and(|answer| assert_eq!(answer.json()["actual"], 16_385)),
    ]
}

fn of_samples() -> Vec<Row> {
    vec![
        Row::new("V06", "gray PNG of 16 bits: all of them are kept", SERVED, || {
            exact(png(16, 0, &[], &[0, 0x12, 0x34, 0xFF, 0xFF, 0, 0, 1, 0x80, 0]))
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 16, vec![0x1234, 0xFFFF, 1, 0x8000]))),
        Row::new("V11", "PGM of 16 and of 12 bits", SERVED, || {
            exact([&b"P5\n2 2\n4095\n"[..], &[0, 1, 0x0F, 0xFF, 0, 0, 8, 0]].concat())
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 12, vec![1, 4095, 0, 2048]))),
        Row::new("V07", "PNG of 1 bit", SERVED, || exact(png(1, 0, &[], &[0, 0x80, 0, 0x40])))
            .and(|answer| assert_eq!(shown(answer), (2, 2, 1, vec![1, 0, 0, 1]))),
        Row::new("V10", "PBM as text, without blanks: 1 is black", SERVED, || {
            exact(b"P1\n2 2\n1001\n".to_vec())
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 1, vec![0, 1, 1, 0]))),
        Row::new("V08", "wholly transparent RGBA", SERVED, || {
            exact(png(8, 6, &[], &[0, 9, 8, 7, 0, 6, 5, 4, 0, 0, 3, 2, 1, 0, 1, 1, 1, 0]))
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 8, vec![0; 16]))),
        Row::new("V08b", "the same over a colour: that colour", SERVED, || {
            let rows = [0, 9, 8, 7, 0, 6, 5, 4, 0, 0, 3, 2, 1, 0, 1, 1, 1, 0];
            vec![mesh(&format!("{EXACT}&alpha=over:%23ff8000"), png(8, 6, &[], &rows))]
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 8, [255, 128, 0].repeat(4)))),
        Row::new("V09", "palette with tRNS: RGBA", SERVED, || {
            let palette = (b"PLTE", vec![10, 20, 30, 40, 50, 60]);
            exact(png(8, 3, &[palette, (b"tRNS", vec![51])], &[0, 0, 1, 0, 1, 0]))
        })
        .and(|answer| {
            // A fifth of 10, 20 and 30, premultiplied.
            let (a, b) = ([2, 4, 6, 51], [40, 50, 60, 255]);
            assert_eq!(shown(answer), (2, 2, 8, [a, b, b, a].concat()));
        }),
        Row::new("V19", "gray with alpha of 16 bits", SERVED, || {
            let rows = [0, 1, 2, 255, 255, 5, 6, 255, 255, 0, 9, 10, 255, 255, 13, 14, 255, 255];
            exact(png(16, 4, &[], &rows))
        })
        .and(|answer| {
            let samples = [0x0102, 0x0506, 0x090A, 0x0D0E].map(|gray| [gray, 0xFFFF]).concat();
            assert_eq!(shown(answer), (2, 2, 16, samples));
        }),
        Row::new("V22", "TIFF of 32-bit floats, NaN among them, filled", SERVED, || {
            vec![mesh("nodata=fill", float_tiff())]
        }),
    ]
}

/// A TIFF of 2x2 floats, one of which is no number.
fn float_tiff() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    let samples = [0.0, f32::NAN, f32::INFINITY, 1e30];
    encoder.write_image::<tiff::encoder::colortype::Gray32Float>(2, 2, &samples).unwrap();
    bytes.into_inner()
}

fn of_containers() -> Vec<Row> {
    vec![
        Row::new("V12", "animated GIF: its first frame", SERVED, || {
            let frame = |indices: &[u8]| GifFrame {
                width: 2,
                height: 2,
                indices: indices.to_vec(),
                ..GifFrame::default()
            };
            exact(gif(2, 2, &[frame(&[1, 2, 3, 4]), frame(&[9, 9, 9, 9])]))
        })
        .and(|answer| {
            let samples: Vec<u16> = [1, 2, 3, 4].into_iter().flat_map(|gray| [gray; 3]).collect();
            assert_eq!(shown(answer), (2, 2, 8, samples));
        }),
        Row::new("V13", "animated PNG: its default image", SERVED, || {
            let control = (b"acTL", vec![0, 0, 0, 2, 0, 0, 0, 0]);
            exact(png(8, 0, &[control], &[0, 1, 2, 0, 3, 4]))
        })
        .and(|answer| assert_eq!(shown(answer), (2, 2, 8, vec![1, 2, 3, 4]))),
        Row::new("V14", "animated WebP: its first frame", SERVED, || {
            exact(include_bytes!("../../crates/codec/tests/samples/animated.webp").to_vec())
        }),
        Row::new("V14b", "WebP of a canvas and a lossless frame", SERVED, || {
            let still = encoders::webp(&gradient(4, 4, 3));
            exact(webp(&[(b"VP8X", vp8x(4, 4)), (b"VP8L", still[20..].to_vec())]))
        }),
        Row::new(
            "V15",
            "JPEG in CMYK of Adobe's inverted inks: RGB, red rising with x",
            SERVED,
            || exact(include_bytes!("../../crates/codec/tests/samples/cmyk.jpg").to_vec()),
        )
        .and(red_rises),
        Row::new("V20", "progressive JPEG of 4:2:0 and odd sizes", SERVED, || {
            exact(include_bytes!("../../crates/codec/tests/samples/progressive.jpg").to_vec())
        })
        .and(red_rises),
        Row::new(
            "V16",
            "JPEG of arithmetic coding, of 12 bits, lossless, hierarchical",
            Expected::Refused(415, "unsupported-image"),
            || {
                [(0xC9, 8), (0xC1, 12), (0xC3, 8), (0xC5, 8)]
                    .map(|(marker, bits)| {
                        let mut bytes = jpeg(&gradient(16, 16, 3), 90);
                        let frame = bytes.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap();
                        (bytes[frame + 1], bytes[frame + 4]) = (marker, bits);
                        mesh("", bytes)
                    })
                    .into()
            },
        ),
        Row::steps(
            "V17",
            "JPEG of every EXIF orientation",
            "200: the mesh is that of the upright picture; 0, 9 and 65535 mean upright",
            |server| {
                let upright = server.mesh(EXACT, &[], &oriented(1));
                assert_eq!(upright.status, 200, "{}", upright.text());
                for orientation in [0, 9, 65_535] {
                    assert_eq!(server.mesh(EXACT, &[], &oriented(orientation)).body, upright.body);
                }
                let (width, height, _, stored) = shown(&upright);
                let at = |x: usize, y: usize| stored[3 * (y * width + x)];
                let (right, bottom) = (width - 1, height - 1);
                // Where in the stored picture each corner of the upright one is: top left, top right.
                for (orientation, top_left, top_right) in [
                    (2, (right, 0), (0, 0)),
                    (3, (right, bottom), (0, bottom)),
                    (4, (0, bottom), (right, bottom)),
                    (5, (0, 0), (0, bottom)),
                    (6, (0, bottom), (0, 0)),
                    (7, (right, bottom), (right, 0)),
                    (8, (right, 0), (right, bottom)),
                ] {
                    let (columns, rows, _, samples) =
                        shown(&server.mesh(EXACT, &[], &oriented(orientation)));
                    let turned = orientation >= 5;
                    assert_eq!(
                        (columns, rows),
                        if turned { (height, width) } else { (width, height) }
                    );
                    let corners = (samples[0], samples[3 * (columns - 1)]);
                    assert_eq!(
                        corners,
                        (at(top_left.0, top_left.1), at(top_right.0, top_right.1)),
                        "{orientation}"
                    );
                }
            },
        ),
        Row::new(
            "V18",
            "colour profiles of any kind: samples are taken as they are stored",
            SERVED,
            || {
                let profile = (b"iCCP", [&b"Display P3\0\0"[..], &deflated(&[7; 500])].concat());
                exact(png(8, 0, &[profile], &[0, 1, 2, 0, 3, 4]))
            },
        )
        .and(|answer| assert_eq!(shown(answer), (2, 2, 8, vec![1, 2, 3, 4]))),
        Row::new("V21", "JPEG of 2, 3, 7, 9 and 17 columns or rows", SERVED, || {
            let sides = [2, 3, 7, 9, 17];
            let of = |(width, height)| mesh("", jpeg(&gradient(width, height, 3), 80));
            sides.iter().flat_map(|&w| sides.map(|h| (w, h))).map(of).collect()
        }),
        Row::new("V23", "PNG of every depth and kind, interlaced or not", SERVED, || {
            let kinds: [(u8, u8, usize); 7] =
                [(1, 0, 1), (2, 0, 1), (4, 0, 1), (8, 2, 6), (16, 2, 12), (8, 4, 4), (16, 6, 16)];
            kinds
                .map(|(depth, kind, bytes)| {
                    let row = [vec![0], vec![0x5A; bytes]].concat();
                    mesh("", png(depth, kind, &[], &row.repeat(2)))
                })
                .into()
        }),
    ]
}

/// A JPEG of 16x8 pixels with an EXIF orientation.
fn oriented(orientation: u16) -> Vec<u8> {
    let bytes = jpeg(&disc_image(16, 8, 3), 95);
    let payload = [b"Exif\0\0".to_vec(), exif(orientation)].concat();
    let length = (payload.len() as u16 + 2).to_be_bytes();
    [&bytes[..2], &[0xFF, 0xE1], &length, &payload, &bytes[2..]].concat()
}

/// Checks that the first component rises from the left to the right.
fn red_rises(answer: &Answer) {
    let (width, _, _, samples) = shown(answer);
    let row: Vec<u16> = samples.chunks_exact(3).take(width).map(|pixel| pixel[0]).collect();
    assert!(row[width - 1] > row[0] + 100, "{row:?}");
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_sizes(), of_samples(), of_containers()].into_iter().flatten().collect()
}

#[test]
fn awkward_pictures_are_meshed_as_they_are() {
    check(&[], &rows());
}
