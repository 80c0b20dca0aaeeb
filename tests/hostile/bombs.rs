//! 6.1: little that would like to become much.

use crate::client::{field, form};
use crate::pictures::{disc, png_claiming};
use crate::samples::bombs::{
    bmp, contradictions, huge_headers, many_frames, tiff, tiny_webp, vp8x, webp,
};
use crate::samples::encoders::{GifFrame, gif};
use crate::samples::{gradient, ihdr, jpeg, png_file};
use crate::table::{Expected, Request, Row, check, mesh, post, rebuild};
use flate2::{Compress, Compression, FlushCompress};
use std::time::Duration;

const TOO_LARGE: Expected = Expected::Refused(422, "image-too-large");
const BROKEN: Expected = Expected::Refused(422, "image-decode-failed");

/// As many MiB of zeros as a zlib stream, without ever having them: the same flushed piece again
/// and again.
pub(crate) fn zeros_deflated(mib: usize) -> Vec<u8> {
    let mut piece = Vec::with_capacity(1 << 14);
    let mut deflate = Compress::new(Compression::best(), false);
    deflate.compress_vec(&vec![0; 1 << 20], &mut piece, FlushCompress::Full).unwrap();
    // The checksum of n zeros: its low half stays 1, which the high half sums up.
    let checksum = (((mib << 20) % 65_521) as u32) << 16 | 1;
    let pieces = piece.repeat(mib);
    [&[0x78, 0xDA][..], &pieces, &[3, 0], &checksum.to_be_bytes()].concat()
}

/// A PNG of a header and compressed data.
fn png(width: u32, height: u32, depth: u8, interlaced: bool, data: Vec<u8>) -> Vec<u8> {
    let header = (b"IHDR", ihdr(width, height, depth, 0, interlaced));
    png_file(&[header, (b"IDAT", data), (b"IEND", Vec::new())])
}

/// A picture of 2x2 pixels with chunks before its own.
fn with_chunks(mut chunks: Vec<(&'static [u8; 4], Vec<u8>)>) -> Vec<u8> {
    chunks.insert(0, (b"IHDR", ihdr(2, 2, 8, 0, false)));
    chunks.extend([(b"IDAT", crate::samples::deflated(&[0, 1, 2, 0, 3, 4])), (b"IEND", vec![])]);
    png_file(&chunks)
}

/// A JPEG of 16x16 pixels that says it is of other sizes.
fn jpeg_claiming(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = jpeg(&gradient(16, 16, 1), 90);
    let frame = bytes.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

/// A gray progressive JPEG whose constant coefficients are refined again and again.
fn refined_jpeg(side: u16, scans: usize) -> Vec<u8> {
    let side_bytes = side.to_be_bytes();
    let mut bytes = vec![0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0];
    bytes.extend([1; 64]);
    bytes.extend([
        0xFF,
        0xC2,
        0,
        11,
        8,
        side_bytes[0],
        side_bytes[1],
        side_bytes[0],
        side_bytes[1],
    ]);
    bytes.extend([1, 1, 0x11, 0]);
    // One code, of one bit: no difference to the block before.
    bytes.extend([0xFF, 0xC4, 0, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let blocks = usize::from(side).div_ceil(8).pow(2);
    for scan in 0..scans {
        let bits = if scan == 0 { 0x01 } else { 0x10 };
        bytes.extend([0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 0, bits]);
        bytes.extend(vec![0; blocks.div_ceil(8)]);
    }
    bytes.extend([0xFF, 0xD9]);
    bytes
}

/// A TIFF of a chain of directories without a picture.
fn tiff_chain(directories: u32) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    for n in 1..=directories {
        bytes.extend([1, 0]);
        bytes.extend([0x3B, 0x01, 2, 0, 1, 0, 0, 0, 65, 0, 0, 0]);
        bytes.extend((if n == directories { 8 } else { 8 + n * 18 }).to_le_bytes());
    }
    bytes
}

/// A TIFF whose one strip inflates to far more than the picture.
fn tiff_bomb() -> Vec<u8> {
    let strip = zeros_deflated(256);
    let mut bytes = tiff(64, 64, 1);
    let compression = bytes.windows(4).position(|field| field == [3, 1, 3, 0]).unwrap() + 8;
    bytes[compression] = 8;
    let counts = bytes.windows(4).position(|field| field == [23, 1, 4, 0]).unwrap() + 8;
    bytes[counts..counts + 4].copy_from_slice(&(strip.len() as u32).to_le_bytes());
    [bytes, strip].concat()
}

/// A gray picture as PGM.
fn pgm(width: usize, height: usize, sample: impl Fn(usize, usize) -> u8) -> Vec<u8> {
    let mut bytes = format!("P5\n{width} {height}\n255\n").into_bytes();
    bytes.extend((0..width * height).map(|i| sample(i % width, i / width)));
    bytes
}

fn of_limits() -> Vec<Row> {
    let claims = |name: &'static str| {
        move || huge_headers().into_iter().find(|(known, _)| *known == name).unwrap().1
    };
    vec![
        Row::picture("B01", "PNG header of 100000x100000, one byte of data", TOO_LARGE, || {
            png_claiming(100_000, 100_000)
        })
        .and(|answer| {
            let problem = answer.json();
            assert!(problem["limit"].is_u64() && problem["actual"].is_u64(), "{problem}");
            assert!(problem["setting"].as_str().unwrap().starts_with("--max-"), "{problem}");
        }),
        Row::picture("B02", "flat PNG of 20000x20000, 1 bit, 48 kB", TOO_LARGE, || {
            png(20_000, 20_000, 1, false, zeros_deflated(48))
        }),
        Row::picture("B03", "flat PNG of 14000x14000, 8 bits, 190 kB", TOO_LARGE, || {
            png(14_000, 14_000, 8, false, zeros_deflated(187))
        }),
        Row::picture("B04", "flat PNG of 100000x100000, 1 bit, 1.2 MB", TOO_LARGE, || {
            png(100_000, 100_000, 1, false, zeros_deflated(1193))
        }),
        Row::picture("B05", "PNG of 2^31-1 rows and columns", TOO_LARGE, || {
            png_claiming(0x7FFF_FFFF, 0x7FFF_FFFF)
        }),
        Row::picture("B06", "PNG of 1x2000000000", TOO_LARGE, || png_claiming(1, 2_000_000_000)),
        Row::picture("B13", "PNG of 14000x14000, interlaced", TOO_LARGE, || {
            png(14_000, 14_000, 8, true, zeros_deflated(187))
        }),
        Row::picture("B14", "JPEG of 4 kB that claims 64250x64250", TOO_LARGE, || {
            jpeg_claiming(64_250, 64_250)
        }),
        Row::picture("B14b", "JPEG of 4 kB that claims 12000x12000", TOO_LARGE, || {
            jpeg_claiming(12_000, 12_000)
        }),
        Row::picture("B15", "GIF of a screen of 65535x65535", TOO_LARGE, claims("GIF 65535x65535")),
        Row::picture("B17", "PGM of 100000x100000", TOO_LARGE, || {
            b"P5\n100000 100000\n255\nx".to_vec()
        }),
        Row::new("B18", "PGM of 2^32-1 rows and columns, and of 10^40 columns", TOO_LARGE, || {
            let endless = format!("P5 1{:040} 3 255\n", 0).into_bytes();
            vec![mesh("", b"P5 4294967295 4294967295 255\n".to_vec()), mesh("", endless)]
        }),
        Row::picture(
            "B19",
            "BMP of 2000000000 rows and columns",
            Expected::OneOf(&[(422, "image-too-large"), (422, "image-decode-failed")]),
            || bmp(2_000_000_000, 2_000_000_000),
        ),
        Row::new("B32", "every container that claims more than the limits", TOO_LARGE, || {
            huge_headers().into_iter().map(|(_, bytes)| mesh("", bytes)).collect()
        }),
    ]
}

fn of_metadata() -> Vec<Row> {
    vec![
        Row::new("B07", "PNG whose iCCP inflates to 1 MiB, to 64 MiB", Expected::Served, || {
            let bomb = |mib| {
                with_chunks(vec![(b"iCCP", [b"p\0\0".to_vec(), zeros_deflated(mib)].concat())])
            };
            vec![mesh("", bomb(1)), mesh("", bomb(64))]
        }),
        Row::picture("B20", "PNG whose iCCP inflates to 1 GiB", Expected::Served, || {
            with_chunks(vec![(b"iCCP", [b"p\0\0".to_vec(), zeros_deflated(1024)].concat())])
        })
        .taking(16),
        Row::picture("B08", "PNG whose zTXt inflates to 256 MiB", Expected::Served, || {
            with_chunks(vec![(b"zTXt", [b"p\0\0".to_vec(), zeros_deflated(256)].concat())])
        })
        .taking(16),
        Row::picture("B09", "PNG whose iTXt inflates to 256 MiB", Expected::Served, || {
            let start = b"p\0\x01\0\0\0".to_vec();
            with_chunks(vec![(b"iTXt", [start, zeros_deflated(256)].concat())])
        })
        .taking(16),
        Row::picture("B10", "PNG of 200000 text chunks", Expected::Served, || {
            with_chunks((0..200_000).map(|_| (b"tEXt", b"Comment\0text".to_vec())).collect())
        }),
        Row::picture(
            "B28",
            "PNG of 200000 empty IDAT chunks before the pixels",
            Expected::Served,
            || {
                let mut chunks: Vec<(&[u8; 4], Vec<u8>)> = vec![(b"IHDR", ihdr(2, 2, 8, 0, false))];
                chunks.extend((0..200_000).map(|_| (b"IDAT", Vec::new())));
                chunks.push((b"IDAT", crate::samples::deflated(&[0, 1, 2, 0, 3, 4])));
                chunks.push((b"IEND", Vec::new()));
                png_file(&chunks)
            },
        ),
        Row::new(
            "B29",
            "PGM of 16 MiB of comment, of blanks, of digits",
            Expected::OneOf(&[(422, "image-decode-failed"), (422, "image-too-large")]),
            || {
                let flood = |start: &str, with| [start.as_bytes(), &vec![with; 16 << 20]].concat();
                [("P5\n#", b'x'), ("P5\n", b' '), ("P5\n", b'9'), ("P2\n2 2\n", b'7')]
                    .map(|(start, with)| mesh("", flood(start, with)))
                    .into()
            },
        )
        .within(Duration::from_secs(2))
        .taking(96),
        Row::picture("B33", "eXIf of 9 MiB", Expected::Refused(422, "metadata-too-large"), || {
            with_chunks(vec![(b"eXIf", vec![b'I'; 9 << 20])])
        }),
    ]
}

fn of_pixels() -> Vec<Row> {
    vec![
        Row::picture(
            "B11",
            "PNG of 64x64 whose IDAT inflates to 256 MiB",
            Expected::Served,
            || png(64, 64, 8, false, zeros_deflated(256)),
        )
        .taking(16),
        Row::picture("B12", "PNG with a chunk of 2^32-1 bytes", BROKEN, || {
            let mut bytes = disc(20, 20, 1);
            bytes[33..37].fill(0xFF);
            bytes
        }),
        Row::picture(
            "B16",
            "GIF of 20001 frames: the first is meshed",
            Expected::Served,
            many_frames,
        ),
        Row::new(
            "B21",
            "TIFF of 60000 directories, of one that refers to itself, of 2^31 strips",
            BROKEN,
            || {
                let made =
                    contradictions().into_iter().filter(|(name, _)| name.starts_with("TIFF"));
                let made: Vec<Vec<u8>> =
                    made.map(|(_, bytes)| bytes).chain([tiff_chain(60_000)]).collect();
                made.into_iter().map(|bytes| mesh("", bytes)).collect()
            },
        ),
        Row::new("B22", "WebP of a canvas of 16384x16384 and a tiny frame", TOO_LARGE, || {
            vec![mesh("", webp(&[(b"VP8X", vp8x(16_384, 16_384)), (b"VP8L", tiny_webp())]))]
        }),
        Row::picture(
            "B22b",
            "AVIF, a grid or not",
            Expected::Refused(415, "unsupported-image"),
            || [&b"\0\0\0\x20ftypavif\0\0\0\0avifmif1miaf"[..], &[0; 4096]].concat(),
        ),
        Row::picture("B22c", "progressive JPEG of 2000x2000 in 1000 scans", BROKEN, || {
            refined_jpeg(2000, 1000)
        }),
        Row::picture(
            "B22d",
            "progressive JPEG of 4000x4000 in 100 scans, as many as may be",
            Expected::Served,
            || refined_jpeg(4000, 100),
        )
        .within(Duration::from_secs(30))
        .taking(512),
        Row::picture(
            "B26",
            "JPEG of 4 kB that claims 4000x4000, within the limits",
            BROKEN,
            || jpeg_claiming(4000, 4000),
        ),
        Row::new(
            "B27",
            "WebP, GIF and BMP that contradict themselves",
            Expected::OneOf(&[(422, "image-decode-failed"), (422, "metadata-too-large")]),
            || {
                let made =
                    contradictions().into_iter().filter(|(name, _)| !name.starts_with("TIFF"));
                made.map(|(_, bytes)| mesh("", bytes)).collect()
            },
        ),
        Row::picture("B30", "GIF whose frame is larger than its screen", BROKEN, || {
            let frame = GifFrame {
                width: 4000,
                height: 4000,
                indices: vec![0; 16_000_000],
                ..GifFrame::default()
            };
            gif(2, 2, &[frame])
        }),
        Row::picture(
            "B31",
            "TIFF of 64x64 whose strip inflates to 256 MiB",
            Expected::ServedOr(&[(422, "image-decode-failed")]),
            tiff_bomb,
        )
        .taking(16),
    ]
}

fn of_work() -> Vec<Row> {
    let slow = Duration::from_secs(30);
    vec![
        Row::new(
            "B23",
            "gzip body of 1000:1, unread",
            Expected::Refused(415, "unsupported-encoding"),
            || vec![post("/v1/meshes", &[("Content-Encoding", "gzip")], zeros_deflated(64))],
        ),
        Row::new(
            "B24",
            "MODEL of 100 bytes that announces 4 G vertices",
            Expected::Refused(422, "mesh-too-large"),
            || vec![rebuild(&b"4000 4000 3 8\nOFF\n4294967295 8589934590 0\n0 0 1 2 3\n"[..])],
        ),
        Row::new(
            "B25",
            "16384x3 with a bright middle row; checkerboard and noise with every pixel a vertex",
            Expected::Served,
            || {
                let row = pgm(16_384, 3, |_, y| if y == 1 { 255 } else { 0 });
                let board = pgm(300, 300, |x, y| if (x + y) % 2 == 0 { 255 } else { 0 });
                let noise = crate::pictures::noise(300);
                let mut requests = vec![mesh("", row.clone()), mesh("density=100", row)];
                requests.extend([board, noise].map(|picture| mesh("density=100", picture)));
                requests
            },
        )
        .within(slow)
        .taking(256),
        Row::picture(
            "B25b",
            "1x16384: no triangles in one column",
            Expected::Refused(422, "degenerate-image"),
            || pgm(1, 16_384, |_, y| y as u8),
        ),
        Row::picture("B25c", "1x100000", TOO_LARGE, || pgm(1, 100_000, |_, y| y as u8)),
        Row::new(
            "B34",
            "every format of the largest mesh that 256x256 pixels have",
            Expected::Served,
            || {
                // Quantized-mesh is for elevation models alone.
                let names = pixmesh_codec::Format::NAMES.iter().filter(|name| **name != "terrain");
                let picture = crate::pictures::noise(256);
                names
                    .map(|format| {
                        mesh(&format!("density=100&method=med&format={format}"), picture.clone())
                    })
                    .collect()
            },
        )
        .within(slow)
        .taking(256),
    ]
}

/// A picture beside weights that say how much its pixels matter.
fn weighed(picture: &[u8], weights: &[u8]) -> Request {
    let (content_type, body) = form(&[(&field("image"), picture), (&field("weights"), weights)]);
    post("/v1/meshes", &[("Content-Type", &content_type)], body)
}

fn of_weights() -> Vec<Row> {
    let beside = |weights: fn() -> Vec<u8>| move || vec![weighed(&disc(20, 20, 1), &weights())];
    vec![
        Row::new(
            "B35",
            "weights that claim 100000x100000",
            TOO_LARGE,
            beside(|| png_claiming(100_000, 100_000)),
        )
        .and(|answer| assert_eq!(answer.json()["param"], "weights")),
        Row::new(
            "B35b",
            "weights of another size than the picture",
            Expected::Refused(422, "shape-mismatch"),
            beside(|| disc(21, 20, 1)),
        ),
        Row::new(
            "B35c",
            "weights whose pixels inflate to 256 MiB",
            Expected::Served,
            beside(|| png(20, 20, 8, false, zeros_deflated(256))),
        )
        .taking(16),
        Row::new(
            "B35d",
            "weights that are cut short",
            BROKEN,
            beside(|| disc(20, 20, 1)[..60].to_vec()),
        ),
        Row::new(
            "B35e",
            "weights that are no picture",
            Expected::Refused(415, "unsupported-image"),
            beside(|| b"all the same".to_vec()),
        ),
        Row::new("B35f", "weights of nothing but zeros", Expected::Served, || {
            vec![weighed(&disc(20, 20, 1), &pgm(20, 20, |_, _| 0))]
        }),
    ]
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_limits(), of_metadata(), of_pixels(), of_work(), of_weights()]
        .into_iter()
        .flatten()
        .collect()
}

#[test]
fn bombs_cost_neither_time_nor_memory() {
    check(&[], &rows());
}

#[test]
fn a_stream_of_zeros_is_one() {
    let mut inflated = Vec::new();
    let stream = zeros_deflated(3);
    std::io::Read::read_to_end(&mut flate2::read::ZlibDecoder::new(&stream[..]), &mut inflated)
        .unwrap();
    assert!(inflated.len() == 3 << 20 && inflated.iter().all(|&byte| byte == 0));
}
