//! Times the writers on a mesh of a million vertices: `cargo run --release -p pixmesh-codec
//! --example encoding_speed`.

#![allow(clippy::print_stdout, clippy::unwrap_used)] // It is a program to look at.

use pixmesh_codec::{
    Compression, Encodable, EncodeOptions, Format, PngCompression, encode, write_png_while,
    write_pnm,
};
use pixmesh_meshing::{Mesh, Point, Shape, rasterize};
use std::time::Instant;

/// A mesh of points four pixels apart, its samples a smooth pattern with some noise.
fn mesh(side: usize, components: usize) -> Mesh {
    let (pixels, step) = (4 * (side - 1) + 1, 4);
    let shape = Shape { width: pixels, height: pixels, component_count: components, precision: 8 };
    let place = |i: usize| Point::new((i % side * step) as i32, (i / side * step) as i32);
    let points: Vec<Point> = (0..side * side).map(place).collect();
    let sample = |i: usize| {
        let (v, c) = (i / components, i % components);
        let wave = (v % side) * (c + 1) / 3 + v / side / 2 + (((v * 40_503) >> 4) & 7);
        (wave % 256) as u16
    };
    let samples = (0..points.len() * components).map(sample).collect();
    let cells = (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (y * side + x) as u32));
    let above = side as u32;
    let faces = cells.flat_map(|a| [[a, a + 1, a + above + 1], [a, a + above + 1, a + above]]);
    Mesh::new(shape, points, samples, faces.collect(), &()).unwrap()
}

/// The best of five runs.
fn time(what: &str, mut action: impl FnMut() -> usize) {
    let run = |_| {
        let start = Instant::now();
        let bytes = action();
        (start.elapsed(), bytes)
    };
    let (took, bytes) = (0..5).map(run).min().unwrap();
    let rate = bytes as f64 / took.as_secs_f64() / 1e6;
    println!("{what:<24} {:>8.1} ms {bytes:>10} bytes {rate:>8.0} MB/s", 1e3 * took.as_secs_f64());
}

fn main() {
    let mesh = mesh(1000, 3);
    let mut out = Vec::new();
    let mut written = |write: &dyn Fn(&mut Vec<u8>)| {
        out.clear();
        write(&mut out);
        out.len()
    };
    let source = Encodable::new(&mesh);
    for format in [Format::Model, Format::Ply, Format::Obj, Format::Svg, Format::Json] {
        let options = EncodeOptions::default();
        time(format.name(), || {
            written(&|out| encode(&source, format, &options, out, &|| Ok(())).unwrap())
        });
    }
    for compression in Compression::ALL {
        let options = EncodeOptions { compression: *compression, ..EncodeOptions::default() };
        time(&format!("GLB, {compression}"), || {
            written(&|out| encode(&source, Format::Glb, &options, out, &|| Ok(())).unwrap())
        });
    }
    let image = rasterize(&mesh, &()).unwrap();
    let samples = image.pixel_count() * image.component_count();
    time("rebuilding", || rasterize(&mesh, &()).map(|_| samples).unwrap());
    time("PNM", || written(&|out| write_pnm(&image, out).unwrap()));
    for compression in PngCompression::ALL {
        time(&format!("PNG, {compression}"), || {
            written(&|out| write_png_while(&image, *compression, out, &|| Ok(())).unwrap())
        });
    }
}
