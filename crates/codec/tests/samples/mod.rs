//! Images and meshes for the tests, and strategies that draw them.

// Each test program uses its own part of this.
#![allow(dead_code)]

pub(crate) mod bombs;
pub(crate) mod encoders;
pub(crate) mod memory;

use pixmesh_codec::{Encodable, EncodeError, EncodeOptions, Format, encode};
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{Image, Mesh, Point, Shape};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A mesh in a format.
pub(crate) fn written(
    mesh: &Mesh,
    format: Format,
    options: &EncodeOptions<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = Vec::new();
    encode(&Encodable::new(mesh), format, options, &mut bytes, &|| Ok(()))?;
    Ok(bytes)
}

/// An image whose samples are scattered over the whole range by a fixed rule.
pub(crate) fn scattered(
    width: usize,
    height: usize,
    component_count: usize,
    precision: u8,
) -> Image {
    let plane = |c: usize| {
        let sample = |i: usize| ((i * 40_503 + c * 9_973 + i / width * 31) >> 3) as u16;
        (0..width * height).map(|i| sample(i) >> (16 - precision)).collect()
    };
    Image::from_bottom_up(width, height, precision, (0..component_count).map(plane).collect())
        .unwrap()
}

/// An image with a gradient, which lossy formats keep nearly as it is.
pub(crate) fn gradient(width: usize, height: usize, component_count: usize) -> Image {
    let plane = |c: usize| {
        let sample = |x: usize, y: usize| match c {
            0 => 20 + 200 * x / width,
            1 => 20 + 200 * y / height,
            _ => 60 + 100 * (x + y) / (width + height),
        };
        (0..width * height).map(|i| sample(i % width, i / width) as u16).collect()
    };
    Image::from_bottom_up(width, height, 8, (0..component_count).map(plane).collect()).unwrap()
}

/// A mesh over the crossings of the given columns and rows, which begin with 0 and end with the
/// image's last; the diagonals of the cells alternate. The samples' colours are straight.
pub(crate) fn crossings(
    columns: &[usize],
    rows: &[usize],
    component_count: usize,
    precision: u8,
    mut sample: impl FnMut(usize) -> u16,
) -> Mesh {
    let (width, height) = (columns[columns.len() - 1] + 1, rows[rows.len() - 1] + 1);
    let shape = Shape { width, height, component_count, precision };
    let place = |(&x, &y): (&usize, &usize)| Point::new(x as i32, y as i32);
    let points: Vec<Point> =
        rows.iter().flat_map(|y| columns.iter().map(move |x| place((x, y)))).collect();
    let largest = u16::MAX >> (16 - precision);
    let mut samples: Vec<u16> =
        (0..points.len() * component_count).map(|i| sample(i) & largest).collect();
    premultiply_vectors(&mut samples, component_count, largest);
    let mut faces = Vec::new();
    for row in 0..rows.len() - 1 {
        for column in 0..columns.len() - 1 {
            let a = (row * columns.len() + column) as u32;
            let (b, d) = (a + 1, a + columns.len() as u32);
            let c = d + 1;
            faces.extend(if (row + column).is_multiple_of(2) {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            });
        }
    }
    Mesh::new(shape, points, samples, faces, &()).unwrap()
}

/// A mesh of every lattice point.
pub(crate) fn lattice(width: usize, height: usize, component_count: usize, precision: u8) -> Mesh {
    let (columns, rows): (Vec<_>, Vec<_>) = ((0..width).collect(), (0..height).collect());
    crossings(&columns, &rows, component_count, precision, |i| ((i * 40_503) >> 2) as u16)
}

/// Small images of 1 to 4 components and 1 to 16 bits.
pub(crate) fn images() -> impl Strategy<Value = Image> {
    (2..24_usize, 2..24_usize, 1..=4_usize, 1..=16_u8).prop_flat_map(
        |(width, height, component_count, precision)| {
            let sample = 0..=u16::MAX >> (16 - precision);
            let plane = proptest::collection::vec(sample, width * height);
            proptest::collection::vec(plane, component_count).prop_map(move |planes| {
                Image::from_bottom_up(width, height, precision, planes).unwrap().premultiplied()
            })
        },
    )
}

/// Small meshes of 1 to 6 components and 1 to 16 bits.
pub(crate) fn meshes() -> impl Strategy<Value = Mesh> {
    let side = || {
        proptest::collection::btree_set(1..40_usize, 1..6)
            .prop_map(|places| std::iter::once(0).chain(places).collect::<Vec<_>>())
    };
    (side(), side(), 1..=6_usize, 1..=16_u8, any::<u64>()).prop_map(
        |(columns, rows, component_count, precision, seed)| {
            let sample = |i: usize| (seed.wrapping_mul(2 * i as u64 + 1) >> 40) as u16;
            crossings(&columns, &rows, component_count, precision, sample)
        },
    )
}

/// The folder of test images: `PIXMESH_TEST_IMAGES`, or one beside the repository.
pub(crate) fn test_images() -> Option<PathBuf> {
    let beside = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/images"));
    let folder = std::env::var_os("PIXMESH_TEST_IMAGES").map_or_else(beside, PathBuf::from);
    folder.is_dir().then_some(folder)
}

/// The folder of the programs for Node.js, which need a package.
#[track_caller]
pub(crate) fn node_folder(package: &str) -> &'static Path {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/web"));
    let is_installed = folder.join("node_modules").join(package).is_dir();
    assert!(is_installed, "{package} is missing: run npm ci in {}", folder.display());
    folder
}

/// An image of 8 bits as baseline JPEG of a quality of 1 to 100.
pub(crate) fn jpeg(image: &Image, quality: u8) -> Vec<u8> {
    let rows = (0..image.height()).rev();
    let pixels = rows.flat_map(|y| {
        (0..image.width()).flat_map(move |x| {
            (0..image.component_count()).map(move |c| image.sample(c, x, y) as u8)
        })
    });
    let pixels: Vec<u8> = pixels.collect();
    let color = if image.component_count() == 1 {
        image::ExtendedColorType::L8
    } else {
        image::ExtendedColorType::Rgb8
    };
    let (width, height) = (image.width() as u32, image.height() as u32);
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(&pixels, width, height, color)
        .unwrap();
    bytes
}

/// A PNG of the given chunks, with its signature and their checksums.
pub(crate) fn png_file(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in chunks {
        let mut checksum = flate2::Crc::new();
        checksum.update(*kind);
        checksum.update(data);
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(*kind);
        bytes.extend(data);
        bytes.extend(checksum.sum().to_be_bytes());
    }
    bytes
}

/// The data of an IHDR chunk; kind 0 is gray, 2 RGB, 3 indexed, 4 gray and alpha, 6 RGBA.
pub(crate) fn ihdr(width: u32, height: u32, depth: u8, kind: u8, interlaced: bool) -> Vec<u8> {
    let mut data = [width.to_be_bytes(), height.to_be_bytes()].concat();
    data.extend([depth, kind, 0, 0, u8::from(interlaced)]);
    data
}

/// Bytes compressed as PNG wants it.
pub(crate) fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    encoder.finish().unwrap()
}

/// EXIF data, from the TIFF header on, that hold nothing but a value of the orientation tag.
pub(crate) fn exif(orientation: u16) -> Vec<u8> {
    let mut bytes = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01".to_vec();
    bytes.extend(orientation.to_be_bytes());
    bytes.extend([0; 6]);
    bytes
}
