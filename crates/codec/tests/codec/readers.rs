//! PLY, OBJ, STL and GLB as trimesh and meshio read them, and JSON as anybody reads it.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::{lattice, meshes, written};
use pixmesh_codec::{
    Coloring, Encodable, EncodeError, EncodeOptions, Format, Geometry, LengthUnit, Relief,
    ReliefHeight, ReliefSource, UpAxis, ZOffset, encode,
};
use pixmesh_meshing::{Fidelity, Mesh};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the libraries say of files.
fn read_by_libraries(paths: &[PathBuf]) -> Vec<Value> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers"));
    let python = folder.join("venv/bin/python");
    let advice = "install requirements.txt in the environment venv";
    assert!(python.is_file(), "{} is missing: {advice}", python.display());
    let output = Command::new(python).arg(folder.join("read.py")).args(paths).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // meshio prints blank lines of its own.
    let lines = String::from_utf8(output.stdout).unwrap();
    let lines = lines.lines().filter(|line| line.starts_with('{'));
    lines.map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A lithophane in millimetres.
fn lithophane() -> Geometry {
    let height = ReliefHeight::Total(2.2);
    Geometry {
        pixel_size: 0.25,
        relief: Some(Relief { source: ReliefSource::Luma, height, invert: true }),
        base: 0.8,
        unit: Some(LengthUnit::Millimetre),
        up: Some(UpAxis::Z),
        ..Geometry::default()
    }
}

/// An elevation model: a metre a step, thirty metres a pixel.
fn elevation() -> Geometry {
    let height = ReliefHeight::PerSample(1.0);
    Geometry {
        pixel_size: 30.0,
        relief: Some(Relief { height, ..Relief::default() }),
        up: Some(UpAxis::Z),
        ..Geometry::default()
    }
}

const FORMATS: [Format; 4] = [Format::Ply, Format::Obj, Format::Stl, Format::Glb];

fn in_space(mesh: &Mesh, format: Format, geometry: Geometry) -> Result<Vec<u8>, EncodeError> {
    written(mesh, format, &EncodeOptions { geometry, ..EncodeOptions::default() })
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

fn close(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-5 * (1.0 + b.abs()))
}

#[test]
fn trimesh_and_meshio_read_what_was_written() {
    let folder = std::env::temp_dir().join(format!("pixmesh-readers-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut meshes_ = vec![lattice(9, 6, 1, 16), lattice(9, 6, 3, 8), lattice(5, 7, 4, 8)];
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let drawn = (0..4).map(|_| meshes().new_tree(&mut runner).unwrap().current());
    meshes_.extend(drawn);
    let geometries =
        [("flat", Geometry::default()), ("elevation", elevation()), ("litho", lithophane())];
    let mut cases = Vec::new();
    for (number, mesh) in meshes_.iter().enumerate() {
        for (name, geometry) in geometries {
            for format in FORMATS {
                let path = folder.join(format!("{number}_{name}.{format}"));
                std::fs::write(&path, in_space(mesh, format, geometry).unwrap()).unwrap();
                cases.push((path, mesh, geometry, format.name()));
            }
        }
    }
    let paths: Vec<PathBuf> = cases.iter().map(|case| case.0.clone()).collect();
    let reports = read_by_libraries(&paths);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(reports.len(), cases.len());
    for ((path, mesh, geometry, extension), report) in cases.into_iter().zip(&reports) {
        check(&path, mesh, geometry, extension, report);
    }
}

/// A relief in its smallest box: 80 long, centred, its lowest vertex at 0, and lying in glTF.
#[test]
fn a_relief_lies_where_it_is_asked_to() {
    let folder = std::env::temp_dir().join(format!("pixmesh-placed-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    // Heights of 7 to 43 in 16 bits.
    let mesh = crate::samples::crossings(&[0, 4, 8], &[0, 5], 1, 16, |i| [7, 43, 30, 9, 12, 20][i]);
    let placed = Geometry {
        relief: elevation().relief,
        width: Some(80.0),
        center: true,
        z_offset: ZOffset::Least,
        ..Geometry::default()
    };
    let lying = [[-40.0, 0.0, -25.0], [40.0, 36.0, 25.0]];
    let standing = [[-40.0, -25.0, 0.0], [40.0, 25.0, 36.0]];
    let solid = [[-40.0, -25.0, -2.0], [40.0, 25.0, 36.0]];
    let lying_solid = [[-40.0, -2.0, -25.0], [40.0, 36.0, 25.0]];
    let cases = [
        (Format::Glb, placed, lying),
        (Format::Glb, Geometry { up: Some(UpAxis::Z), ..placed }, standing),
        (Format::Ply, placed, standing),
        (Format::Ply, Geometry { up: Some(UpAxis::Y), ..placed }, lying),
        (Format::Obj, Geometry { up: Some(UpAxis::Y), base: 2.0, ..placed }, lying_solid),
        (Format::Stl, Geometry { base: 2.0, ..placed }, solid),
        (Format::Stl, Geometry { up: Some(UpAxis::Y), base: 2.0, ..placed }, lying_solid),
        // A base reaches below the lowest vertex, which lies below 0 here.
        (
            Format::Stl,
            Geometry { z_offset: ZOffset::Length(43.0), base: 2.0, ..placed },
            [[-40.0, -25.0, -38.0], [40.0, 25.0, 0.0]],
        ),
    ];
    let path = |number: usize, format| folder.join(format!("{number}.{format}"));
    let paths: Vec<PathBuf> =
        cases.iter().enumerate().map(|(number, (format, ..))| path(number, *format)).collect();
    for (path, (format, geometry, _)) in paths.iter().zip(&cases) {
        std::fs::write(path, in_space(&mesh, *format, *geometry).unwrap()).unwrap();
    }
    let reports = read_by_libraries(&paths);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(reports.len(), cases.len());
    for ((path, (_, _, bounds)), report) in paths.iter().zip(cases).zip(&reports) {
        let read = numbers(&report["trimesh"]["bounds"]);
        assert!(close(&read, bounds.as_flattened()), "{path:?}: {read:?}");
        assert_eq!(report["trimesh"]["winding"], true, "{path:?}");
    }
}

/// Checks what the libraries say of one file.
fn check(path: &Path, mesh: &Mesh, geometry: Geometry, extension: &str, report: &Value) {
    let shape = mesh.shape();
    // STL is always a solid, others are where they have a base.
    let geometry = if extension == "stl" {
        let relief = Some(geometry.relief.unwrap_or_default());
        Geometry { relief, ..geometry }.with_base(shape)
    } else {
        geometry
    };
    let solid = geometry.base > 0.0;
    let rim = 2 * (mesh.points().len() - 1) - mesh.faces().len();
    let faces = mesh.faces().len() + if solid { 3 * rim } else { 0 };
    let vertices = mesh.points().len() + if solid { rim + 1 } else { 0 };
    let metres = match (extension, geometry.unit) {
        ("glb", Some(LengthUnit::Millimetre)) => 0.001,
        _ => 1.0,
    };
    let by_trimesh = &report["trimesh"];
    assert_eq!(by_trimesh["faces"], faces, "{path:?}");
    assert_eq!(by_trimesh["vertices"], vertices, "{path:?}");
    assert_eq!(by_trimesh["watertight"], solid, "{path:?}: {report}");
    assert_eq!(by_trimesh["winding"], true, "{path:?}");
    let bounds = numbers(&by_trimesh["bounds"]);
    let side = |side: usize| (side - 1) as f64 * geometry.pixel_size * metres;
    assert!(close(&bounds[..2], &[0.0, 0.0]), "{path:?}: {bounds:?}");
    assert!(close(&bounds[3..5], &[side(shape.width), side(shape.height)]), "{path:?}: {bounds:?}");
    if solid {
        assert!(close(&bounds[2..3], &[-geometry.base * metres]), "{path:?}: {bounds:?}");
        let area = side(shape.width) * side(shape.height);
        let volume = by_trimesh["volume"].as_f64().unwrap();
        let (least, most) =
            (geometry.base * metres, (geometry.base + geometry.total_height(shape)) * metres);
        assert!(
            volume > 0.999 * area * least && volume < 1.001 * area * most,
            "{path:?}: {volume}"
        );
    } else if geometry.relief.is_some() {
        let largest = mesh.samples().iter().max().unwrap();
        assert!(bounds[5] <= f64::from(*largest) + 1e-6, "{path:?}: {bounds:?}");
    } else {
        assert!(close(&[bounds[2], bounds[5]], &[0.0, 0.0]), "{path:?}: {bounds:?}");
    }
    if matches!(extension, "ply" | "obj") && shape.precision == 8 && shape.component_count >= 3 {
        let straight = mesh.straight_samples();
        let expected = straight.iter().map(|&sample| f64::from(sample));
        let expected: Vec<f64> = expected.take(3).collect();
        assert!(close(&numbers(&by_trimesh["color"])[..3], &expected), "{path:?}: {report}");
    }
    if extension != "glb" {
        let by_meshio = &report["meshio"];
        assert_eq!(by_meshio["faces"], faces, "{path:?}");
        // meshio does not unite the corners of STL's triangles.
        if extension != "stl" {
            assert_eq!(by_meshio["vertices"], vertices, "{path:?}");
        }
        assert!(close(&numbers(&by_meshio["bounds"]), &bounds), "{path:?}: {report}");
    }
}

#[test]
fn trimesh_shows_each_face_in_its_color() {
    let folder = std::env::temp_dir().join(format!("pixmesh-colors-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mesh = lattice(9, 6, 3, 8);
    let count = 3 * mesh.faces().len();
    let samples: Vec<u16> = (0..count).map(|i| (i * 37 % 256) as u16).collect();
    let flat = mesh.with_face_samples(samples.clone()).unwrap();
    let formats = [Format::Ply, Format::Obj];
    let paths = formats.map(|format| {
        let path = folder.join(format!("flat.{format}"));
        std::fs::write(&path, in_space(&flat, format, elevation()).unwrap()).unwrap();
        path
    });
    let reports = read_by_libraries(&paths);
    std::fs::remove_dir_all(&folder).unwrap();
    for report in reports {
        let shown = report["trimesh"]["face_colors"].as_array().unwrap();
        assert_eq!(shown.len(), flat.faces().len());
        for (shown, expected) in shown.iter().zip(samples.chunks(3)) {
            let expected: Vec<f64> = expected.iter().map(|&sample| sample.into()).collect();
            assert_eq!(numbers(shown)[..3], expected);
        }
    }
    let mut json = Vec::new();
    encode(&Encodable::new(&flat), Format::Json, &EncodeOptions::default(), &mut json, &|| Ok(()))
        .unwrap();
    let parsed: Value = serde_json::from_slice(&json).unwrap();
    let expected: Vec<f64> = samples.iter().map(|&sample| sample.into()).collect();
    assert_eq!(numbers(&parsed["face_samples"]), expected);
    let colors = numbers(&parsed["face_colors"]);
    let rgb = colors.chunks(4).flat_map(|color| color[..3].to_vec());
    assert_eq!(rgb.collect::<Vec<f64>>(), expected);
}

/// The colours of an OBJ's vertices, red, green and blue of 0 to 255; empty where it has none.
fn colors_of_obj(mesh: &Mesh, geometry: Geometry) -> Vec<[f64; 3]> {
    let text = String::from_utf8(in_space(mesh, Format::Obj, geometry).unwrap()).unwrap();
    let vertices = text.lines().filter(|line| line.starts_with("v "));
    let parts = vertices.map(|line| {
        line.split(' ').skip(4).map(|part| 255.0 * part.parse::<f64>().unwrap()).collect::<Vec<_>>()
    });
    parts.filter_map(|parts| parts.try_into().ok()).collect()
}

#[test]
fn colors_show_the_picture_the_height_or_the_light() {
    // A slope of elevations that rises to the right, and is dark in 16 bits.
    let mesh = crate::samples::crossings(&[0, 2, 4], &[0, 4], 1, 16, |i| [100, 300, 500][i % 3]);
    let relief = Geometry { relief: elevation().relief, ..Geometry::default() };
    let colors = |color| colors_of_obj(&mesh, Geometry { color, ..relief });
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.6);
    let image = colors(Coloring::Image);
    for (color, gray) in image.iter().zip([0.0, 127.5, 255.0].iter().cycle()) {
        assert!(near(*color, [*gray; 3]), "{image:?}");
    }
    let ramp = colors(Coloring::Ramp);
    assert!(near(ramp[0], [42.0, 113.0, 72.0]) && near(ramp[2], [250.0; 3]), "{ramp:?}");
    assert!(colors(Coloring::None).is_empty());
    // The slope looks to the left, towards the light: it is brighter than the plane.
    let gray = |geometry| colors_of_obj(&mesh, geometry)[0][0];
    let steps = |step| Some(Relief { height: ReliefHeight::PerSample(step), ..Relief::default() });
    let shaded = |step| {
        gray(Geometry { color: Coloring::Hillshade, relief: steps(step), ..Geometry::default() })
    };
    assert!((shaded(0.0) - 255.0 * (0.15 + 0.85 * 0.5f64.sqrt())).abs() < 0.6);
    assert!(shaded(0.005) > shaded(0.0) + 20.0, "{} {}", shaded(0.005), shaded(0.0));
    // Without a relief the picture keeps its 16 bits.
    let flat = colors_of_obj(&mesh, Geometry::default());
    assert!(near(flat[2], [255.0 * 500.0 / 65535.0; 3]), "{flat:?}");
    let ply = in_space(&mesh, Format::Ply, Geometry { color: Coloring::None, ..relief }).unwrap();
    assert!(!String::from_utf8_lossy(&ply).contains("red"));
}

#[test]
fn a_solid_is_written_in_the_order_of_its_parts() {
    let mesh = crate::samples::crossings(&[0, 2], &[0, 2], 1, 8, |i| [0, 255, 51, 102][i]);
    let relief = Relief { height: ReliefHeight::Total(5.0), ..Relief::default() };
    let geometry = Geometry { relief: Some(relief), base: 0.5, ..Geometry::default() };
    let obj = in_space(&mesh, Format::Obj, geometry).unwrap();
    let expected = "\
        # lengths in m\no picture\n\
        v 0 0 0 0.0000 0.0000 0.0000\nv 2 0 5 1.0000 1.0000 1.0000\n\
        v 0 2 1 0.2000 0.2000 0.2000\nv 2 2 2 0.4000 0.4000 0.4000\n\
        v 0 0 -0.5 0.0000 0.0000 0.0000\nv 2 0 -0.5 1.0000 1.0000 1.0000\n\
        v 2 2 -0.5 0.4000 0.4000 0.4000\nv 0 2 -0.5 0.2000 0.2000 0.2000\n\
        v 1 1 -0.5 0.0000 0.0000 0.0000\n\
        f 1 2 4\nf 1 4 3\n\
        f 2 1 5\nf 2 5 6\nf 6 5 9\nf 4 2 6\nf 4 6 7\nf 7 6 9\n\
        f 3 4 7\nf 3 7 8\nf 8 7 9\nf 1 3 8\nf 1 8 5\nf 5 8 9\n";
    assert_eq!(String::from_utf8(obj).unwrap(), expected);
}

proptest! {
    #[test]
    fn json_holds_the_mesh(mesh in meshes(), squared_error in 0..1000_u64) {
        let shape = mesh.shape();
        let fidelity = Fidelity::new(squared_error, shape);
        let mut bytes = Vec::new();
        let source = Encodable { fidelity: Some(&fidelity), ..Encodable::new(&mesh) };
        let options = EncodeOptions::default();
        encode(&source, Format::Json, &options, &mut bytes, &|| Ok(())).unwrap();
        let parsed: Value = serde_json::from_slice(&bytes).unwrap();
        for (name, value) in [
            ("width", shape.width), ("height", shape.height), ("components", shape.component_count),
            ("precision", shape.precision.into()), ("vertices", mesh.points().len()),
            ("faces", mesh.faces().len()),
        ] {
            prop_assert_eq!(&parsed[name], value);
        }
        prop_assert!(close(&[parsed["mse"].as_f64().unwrap()], &[fidelity.mse()]));
        let psnr = parsed["psnr_db"].as_f64().unwrap_or(f64::INFINITY);
        prop_assert!((psnr - fidelity.psnr_db()).abs() < 1e-9 || psnr == fidelity.psnr_db());
        let positions: Vec<f64> =
            mesh.points().iter().flat_map(|p| [p.x.into(), p.y.into(), 0.0]).collect();
        prop_assert_eq!(numbers(&parsed["positions"]), positions);
        let samples: Vec<f64> = mesh.straight_samples().iter().map(|&sample| sample.into()).collect();
        prop_assert_eq!(numbers(&parsed["samples"]), samples);
        let triangles: Vec<f64> = mesh.faces().iter().flatten().map(|&i| i.into()).collect();
        prop_assert_eq!(numbers(&parsed["triangles"]), triangles);
        prop_assert_eq!(numbers(&parsed["colors"]).len(), 4 * mesh.points().len());
    }

    #[test]
    fn the_same_mesh_gives_the_same_bytes_in_every_format(mesh in meshes()) {
        for geometry in [Geometry::default(), elevation(), lithophane()] {
            for format in FORMATS {
                let once = |mesh: &Mesh| in_space(mesh, format, geometry).unwrap();
                prop_assert_eq!(once(&mesh), once(&mesh.clone()), "{}", format);
            }
        }
    }
}

#[test]
fn a_relief_of_a_component_that_is_not_there_is_refused() {
    let relief = Relief { source: ReliefSource::Third, ..Relief::default() };
    let geometry = Geometry { relief: Some(relief), ..Geometry::default() };
    let mesh = lattice(3, 3, 2, 8);
    let message = "the relief is to follow component 2 (counted from 0) of 2";
    assert_eq!(geometry.check(2).unwrap_err().to_string(), message);
    for format in FORMATS {
        assert_eq!(in_space(&mesh, format, geometry).unwrap_err().to_string(), message);
    }
    assert!(geometry.check(3).is_ok());
}
