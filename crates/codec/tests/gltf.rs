//! Binary glTF, taken apart here and checked by the Khronos validator.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod samples;

use pixmesh_codec::write_glb;
use pixmesh_meshing::Mesh;
use samples::{lattice, skip};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn glb(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_glb(mesh, &mut bytes).unwrap();
    bytes
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
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/gltf"));
    if !folder.join("node_modules/gltf-validator").is_dir() {
        return skip("the glTF validator is not installed (npm ci in crates/codec/tests/gltf)");
    }
    let temporary = std::env::temp_dir().join(format!("pixmesh-glb-{}", std::process::id()));
    std::fs::create_dir_all(&temporary).unwrap();
    let mut command = Command::new("node");
    command.arg("validate.mjs").current_dir(folder);
    let meshes = meshes();
    for (name, mesh) in &meshes {
        let path = temporary.join(name).with_extension("glb");
        std::fs::write(&path, glb(mesh)).unwrap();
        command.arg(path);
    }
    let output = command.output();
    std::fs::remove_dir_all(&temporary).unwrap();
    let Ok(output) = output else {
        return skip("node is not installed, so that glTF files are not validated");
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let reports = String::from_utf8(output.stdout).unwrap();
    assert_eq!(reports.lines().count(), meshes.len());
    for report in reports.lines() {
        let parsed: Value = serde_json::from_str(report).unwrap();
        assert_eq!((&parsed["errors"], &parsed["warnings"]), (&0.into(), &0.into()), "{report}");
    }
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
        let sample = |i: usize| samples.get(i).copied().unwrap_or(0);
        first_color(&samples::crossings(&[0, 1], &[0, 1], component_count, 8, sample))
    };
    assert_eq!(color(1, &[128]), [14146, 14146, 14146, 65535]);
    assert_eq!(color(2, &[255, 128]), [65535, 65535, 65535, 32896]);
    assert_eq!(color(3, &[0, 128, 255]), [0, 14146, 65535, 65535]);
    assert_eq!(color(4, &[0, 128, 255, 1]), [0, 14146, 65535, 257]);
    assert_eq!(color(5, &[0, 128, 255, 1, 1]), [0, 14146, 65535, 65535]);
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
