//! Binary glTF, taken apart here and checked by the Khronos validator.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use crate::samples::{gradient, lattice, node_folder, scattered, written};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_codec::{
    Compression, EncodeOptions, Format, Geometry, LengthUnit, Relief, ReliefHeight, ReliefSource,
    Texture,
};
use pixmesh_meshing::{Mesh, Point, rasterize};
use proptest::strategy::{Strategy, ValueTree};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

fn glb(mesh: &Mesh) -> Vec<u8> {
    glb_with(mesh, &EncodeOptions::default())
}

fn glb_with(mesh: &Mesh, options: &EncodeOptions<'_>) -> Vec<u8> {
    written(mesh, Format::Glb, options).unwrap()
}

/// A relief on a base, in millimetres.
fn solid() -> Geometry {
    let height = ReliefHeight::Total(2.5);
    Geometry {
        pixel_size: 0.2,
        relief: Some(Relief { source: ReliefSource::Luma, height, invert: true }),
        base: 0.8,
        unit: Some(LengthUnit::Millimetre),
        ..Geometry::default()
    }
}

/// Options that every part of the writer is needed for.
fn options(texture: &Texture) -> Vec<(&'static str, EncodeOptions<'_>)> {
    let mut all = Vec::new();
    for compression in Compression::ALL {
        let plain = EncodeOptions { compression: *compression, ..EncodeOptions::default() };
        let relief = Geometry { relief: Some(Relief::default()), ..Geometry::default() };
        all.push((compression.name(), plain));
        all.push(("relief", EncodeOptions { geometry: relief, ..plain }));
        all.push(("solid", EncodeOptions { geometry: solid(), ..plain }));
        all.push(("texture", EncodeOptions { texture: Some(texture), ..plain }));
        let both = EncodeOptions { texture: Some(texture), geometry: solid(), ..plain };
        all.push(("solid_texture", both));
    }
    all
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// The document and the buffer of a file whose headers are right.
fn parts(bytes: &[u8]) -> (Value, &[u8]) {
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!((word(bytes, 4), word(bytes, 8)), (2, bytes.len()));
    let json = word(bytes, 12);
    assert_eq!(&bytes[16..20], b"JSON");
    assert_eq!(&bytes[24 + json..28 + json], b"BIN\0");
    assert_eq!(word(bytes, 20 + json), bytes.len() - 28 - json);
    (serde_json::from_slice(&bytes[20..20 + json]).unwrap(), &bytes[28 + json..])
}

/// The meshes that every part of the writer is needed for.
fn meshes() -> Vec<(&'static str, Mesh)> {
    vec![
        ("gray", lattice(3, 2, 1, 8)),
        ("gray_alpha", lattice(4, 3, 2, 8)),
        ("rgb", lattice(5, 4, 3, 8)),
        ("rgba", lattice(6, 5, 4, 8)),
        ("five_components", lattice(4, 4, 5, 8)),
        ("rgb_16_bit", lattice(9, 9, 3, 16)),
        ("bilevel", lattice(2, 2, 1, 1)),
        ("most_short_indices", lattice(257, 255, 1, 8)),
        ("long_indices", lattice(256, 256, 3, 8)),
    ]
}

#[test]
fn the_khronos_validator_finds_neither_errors_nor_warnings() {
    let folder = node_folder("gltf-validator");
    let temporary = std::env::temp_dir().join(format!("pixmesh-glb-{}", std::process::id()));
    std::fs::create_dir_all(&temporary).unwrap();
    let mut command = Command::new("node");
    command.arg("validate.mjs").current_dir(folder);
    let meshes = meshes();
    let textures = [Texture::of_image(&scattered(9, 7, 3, 16)).unwrap(), jpeg_texture()];
    let mut count = 0;
    let mut add = |bytes: Vec<u8>, name: &str| {
        count += 1;
        let path = temporary.join(format!("{count}_{name}"));
        std::fs::write(&path, bytes).unwrap();
        command.arg(path);
    };
    for (name, mesh) in &meshes {
        add(glb(mesh), &format!("{name}.glb"));
        for (options_name, options) in options(&textures[count_of(name) % 2]) {
            if mesh.points().len() < 1000 {
                add(glb_with(mesh, &options), &format!("{name}_{options_name}.glb"));
            }
        }
    }
    for (name, options) in options(&textures[0]) {
        let bytes = written(&lattice(5, 4, 3, 8), Format::Gltf, &options).unwrap();
        add(bytes, &format!("{name}.gltf"));
    }
    let output = command.output();
    std::fs::remove_dir_all(&temporary).unwrap();
    let output = output.expect("Node.js is missing: install nodejs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let reports = String::from_utf8(output.stdout).unwrap();
    assert_eq!(reports.lines().count(), count);
    for report in reports.lines() {
        let parsed: Value = serde_json::from_str(report).unwrap();
        assert_eq!((&parsed["errors"], &parsed["warnings"]), (&0.into(), &0.into()), "{report}");
    }
}

fn count_of(name: &str) -> usize {
    name.len()
}

/// A JPEG carried as it is.
fn jpeg_texture() -> Texture {
    let image = gradient(16, 9, 3);
    let jpeg = crate::samples::jpeg(&image, 80);
    let texture = Texture::of_file_while(&jpeg, &image, &|| Ok(())).unwrap();
    let options = EncodeOptions { texture: Some(&texture), ..EncodeOptions::default() };
    let glb = glb_with(&lattice(3, 3, 3, 8), &options);
    assert!(String::from_utf8_lossy(&glb).contains("\"mimeType\":\"image/jpeg\""));
    texture
}

/// A triangle's corners as positions and colours, from the least on.
type Corners = Vec<(Vec<u16>, Vec<u16>)>;

/// Runs the decoder of the library that defines the compression.
fn decompressed(paths: &[PathBuf]) -> Vec<(Value, Vec<Vec<u8>>)> {
    let folder = node_folder("meshoptimizer");
    let mut command = Command::new("node");
    command.arg("decompress.mjs").args(paths).current_dir(folder);
    let output = command.output().expect("Node.js is missing: install nodejs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    let files = lines.lines().map(|line| {
        let parsed: Value = serde_json::from_str(line).unwrap();
        let views = parsed["views"].as_array().unwrap().iter();
        let views = views.map(|view| STANDARD.decode(view.as_str().unwrap()).unwrap()).collect();
        (parsed["document"].clone(), views)
    });
    files.collect()
}

/// Sixteen-bit numbers of one record of a view.
fn record(view: &[u8], stride: usize, index: usize, count: usize) -> Vec<u16> {
    let bytes = &view[index * stride..][..2 * count];
    bytes.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect()
}

/// The triangles of the views of positions, colours and indices, rotated to their least corner.
fn triangles(document: &Value, views: &[Vec<u8>]) -> BTreeSet<Corners> {
    let long = document["accessors"].as_array().unwrap().last().unwrap()["componentType"] == 5125;
    let indices: Vec<usize> = if long {
        views[2].as_chunks().0.iter().map(|&word| u32::from_le_bytes(word) as usize).collect()
    } else {
        views[2].as_chunks().0.iter().map(|&word| u16::from_le_bytes(word).into()).collect()
    };
    let names = &document["meshes"][0]["primitives"][0]["attributes"];
    let (position, color) = (names["POSITION"].as_u64(), names["COLOR_0"].as_u64());
    let corner = |&index: &usize| {
        let position = record(&views[position.unwrap() as usize], 8, index, 3);
        (position, record(&views[color.unwrap() as usize], 8, index, 4))
    };
    let faces = indices.chunks_exact(3).map(|face| {
        let mut corners: Corners = face.iter().map(corner).collect();
        let least = (0..3).min_by_key(|&i| corners[i].clone()).unwrap();
        corners.rotate_left(least);
        corners
    });
    faces.collect()
}

#[test]
fn compressed_files_hold_the_same_triangles_for_the_library_that_defines_them() {
    let folder = std::env::temp_dir().join(format!("pixmesh-meshopt-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut meshes: Vec<Mesh> = meshes().into_iter().map(|(_, mesh)| mesh).collect();
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    for _ in 0..40 {
        meshes.push(crate::samples::meshes().new_tree(&mut runner).unwrap().current());
    }
    let write = |mesh: &Mesh, index: usize| {
        let options =
            EncodeOptions { compression: Compression::Meshopt, ..EncodeOptions::default() };
        let path = folder.join(format!("{index}.glb"));
        std::fs::write(&path, glb_with(mesh, &options)).unwrap();
        path
    };
    let paths: Vec<PathBuf> =
        meshes.iter().enumerate().map(|(index, mesh)| write(mesh, index)).collect();
    let files = decompressed(&paths);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(files.len(), meshes.len());
    for (mesh, (document, views)) in meshes.iter().zip(&files) {
        let options =
            EncodeOptions { compression: Compression::Quantized, ..EncodeOptions::default() };
        let plain = glb_with(mesh, &options);
        let (plain_document, buffer) = parts(&plain);
        let plain_views: Vec<Vec<u8>> = plain_document["bufferViews"]
            .as_array()
            .unwrap()
            .iter()
            .map(|view| {
                let at = view["byteOffset"].as_u64().unwrap() as usize;
                buffer[at..][..view["byteLength"].as_u64().unwrap() as usize].to_vec()
            })
            .collect();
        assert_eq!(triangles(document, views), triangles(&plain_document, &plain_views));
    }
}

#[test]
fn compression_makes_large_meshes_several_times_smaller() {
    let mesh = lattice(200, 200, 3, 8);
    let size = |compression| {
        glb_with(&mesh, &EncodeOptions { compression, ..EncodeOptions::default() }).len()
    };
    let (plain, quantized) = (size(Compression::None), size(Compression::Quantized));
    let compressed = size(Compression::Meshopt);
    println!("40000 vertices: {plain} bytes, quantized {quantized}, compressed {compressed}");
    assert!(quantized < plain && 2 * compressed < quantized);
}

#[test]
fn positions_are_lattice_points_with_their_bounds() {
    let mesh = lattice(5, 3, 1, 8);
    let bytes = glb(&mesh);
    let (document, buffer) = parts(&bytes);
    assert_eq!(document["accessors"][0]["min"], serde_json::json!([0.0, 0.0, 0.0]));
    assert_eq!(document["accessors"][0]["max"], serde_json::json!([4.0, 2.0, 0.0]));
    for (point, position) in mesh.points().iter().zip(buffer.chunks_exact(12)) {
        let float = |at| f32::from_le_bytes(position[at..at + 4].try_into().unwrap());
        assert_eq!([float(0), float(4), float(8)], [point.x as f32, point.y as f32, 0.0]);
    }
}

/// The first vertex's colour.
fn first_color(mesh: &Mesh) -> [u16; 4] {
    let bytes = glb(mesh);
    let (document, buffer) = parts(&bytes);
    let offset = document["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    std::array::from_fn(|i| {
        u16::from_le_bytes(buffer[offset + 2 * i..offset + 2 * i + 2].try_into().unwrap())
    })
}

#[test]
fn colors_are_linear_and_alpha_is_kept() {
    let color = |component_count, samples: &[u16]| {
        let sample = |i: usize| samples[i % samples.len()];
        first_color(&crate::samples::crossings(&[0, 1], &[0, 1], component_count, 8, sample))
    };
    assert_eq!(color(1, &[128]), [14146, 14146, 14146, 65535]);
    assert_eq!(color(2, &[255, 128]), [65535, 65535, 65535, 32896]);
    assert_eq!(color(3, &[0, 128, 255]), [0, 14146, 65535, 65535]);
    let [light, ..] = color(1, &[51]);
    assert_eq!(color(4, &[0, 51, 255, 128]), [0, light, 65535, 32896]);
    assert_eq!(color(5, &[0, 128, 255, 1, 1]), [0, 14146, 65535, 65535]);
}

/// The PSNR of what a viewer shows of a gray mesh, which interpolates light of these shares.
fn viewer_psnr(mesh: &Mesh, light: &[f64]) -> f64 {
    let picture = rasterize(mesh, &()).unwrap();
    let srgb = |light: f64| {
        let low = 12.92 * light;
        255.0 * if light <= 0.003_130_8 { low } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
    };
    let mut squared_error = 0.0;
    for (y, row) in (0..picture.height()).map(|y| (y as i32, picture.row(0, y))) {
        for (x, &sample) in (0..).zip(row) {
            let shares = |face: &[u32; 3]| {
                let [a, b, c] = face.map(|vertex| mesh.points()[vertex as usize]);
                let cross = |p: Point, q: Point| {
                    f64::from((q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x))
                };
                let parts = [cross(b, c), cross(c, a), cross(a, b)];
                let sum: f64 = parts.iter().sum();
                parts.iter().all(|part| *part >= 0.0).then(|| parts.map(|part| part / sum))
            };
            let (face, shares) =
                mesh.faces().iter().find_map(|face| Some((face, shares(face)?))).unwrap();
            let shown: f64 = face
                .iter()
                .zip(shares)
                .map(|(&vertex, share)| share * light[vertex as usize])
                .sum();
            squared_error += (srgb(shown) - f64::from(sample)).powi(2);
        }
    }
    let count = (picture.width() * picture.height()) as f64;
    10.0 * (255.0 * 255.0 * count / squared_error).log10()
}

#[test]
fn colors_are_fitted_to_viewers_that_interpolate_light() {
    let sides = [0, 10, 20, 30, 40];
    let gray = |i: usize| [0, 250, 40, 160, 20, 90, 255][i * 5 % 7];
    let mesh = crate::samples::crossings(&sides, &sides, 1, 8, gray);
    let bytes = glb(&mesh);
    let (document, buffer) = parts(&bytes);
    let offset = document["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    let red = |vertex: usize| u16::from_le_bytes([0, 1].map(|i| buffer[offset + 8 * vertex + i]));
    let count = mesh.points().len();
    let fitted: Vec<f64> = (0..count).map(|v| f64::from(red(v)) / 65535.0).collect();
    let linear = |sample: u16| {
        let value = f64::from(sample) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let exact: Vec<f64> = mesh.samples().iter().map(|&sample| linear(sample)).collect();
    let (fitted, exact) = (viewer_psnr(&mesh, &fitted), viewer_psnr(&mesh, &exact));
    assert!(fitted > exact + 1.0, "{fitted} dB with the fit, {exact} dB without");
}

#[test]
fn only_alpha_makes_a_material_blend() {
    for component_count in 1..=5 {
        let bytes = glb(&lattice(2, 2, component_count, 8));
        let (document, _) = parts(&bytes);
        let mode = document["materials"][0].get("alphaMode").and_then(Value::as_str);
        assert_eq!(mode, matches!(component_count, 2 | 4).then_some("BLEND"));
    }
}

#[test]
fn no_index_is_the_one_that_restarts_primitives() {
    let index_type = |mesh: &Mesh| {
        let bytes = glb(mesh);
        parts(&bytes).0["accessors"][2]["componentType"].clone()
    };
    assert_eq!(index_type(&lattice(257, 255, 1, 8)), 5123);
    assert_eq!(index_type(&lattice(256, 256, 1, 8)), 5125);
}

#[test]
fn the_same_mesh_gives_the_same_bytes() {
    for (name, mesh) in meshes() {
        assert_eq!(glb(&mesh), glb(&mesh.clone()), "{name}");
    }
}
