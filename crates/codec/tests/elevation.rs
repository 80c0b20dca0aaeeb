//! Elevation models as GDAL writes them, and meshes of them. `samples/elevation/write.py` makes the
//! files.

#![allow(clippy::unwrap_used, clippy::expect_used)] // A failing test may stop anywhere.

use pixmesh_codec::{
    DecodeError, DecodeOptions, Encodable, EncodeOptions, Format, Geometry, Nodata, Terrain, encode,
};
use pixmesh_meshing::{Image, Method, ParameterError, Target, mesh_image, rasterize};

/// The heights of the files.
fn height(x: usize, y: usize) -> f64 {
    ((x * x * 7 + y * 13 + x * y) % 998) as f64 / 4.0 - 20.0
}

fn is_in_hole(x: usize, y: usize) -> bool {
    (8..13).contains(&x) && (6..10).contains(&y)
}

fn decoded(file: &[u8], options: &DecodeOptions) -> (Image, Terrain) {
    let (image, terrain) = options.decode_terrain_while(file, &|| Ok(())).unwrap();
    (image, terrain.expect("an elevation model"))
}

/// Checks every height of a file; the largest difference that its steps may make is `rounding`.
fn check(file: &[u8], size: (usize, usize), has_holes: bool, expected: impl Fn(f64) -> f64) {
    let (image, terrain) = decoded(file, &DecodeOptions::default());
    assert_eq!((image.width(), image.height()), size);
    assert_eq!(terrain.has_holes, has_holes);
    assert_eq!(image.component_count(), 1 + usize::from(has_holes));
    for y in 0..size.1 {
        for x in 0..size.0 {
            let at = |c: usize| image.row(c, size.1 - 1 - y)[x];
            if has_holes && is_in_hole(x, y) {
                assert_eq!([at(0), at(1)], [0, 0]);
                continue;
            }
            assert!(!has_holes || at(1) > 0);
            let found = terrain.steps.height(at(0).into());
            let expected = expected(height(x, y));
            let most = terrain.steps.rounding + 1e-9;
            assert!((found - expected).abs() <= most, "({x}, {y}): {found} for {expected}");
        }
    }
}

macro_rules! file {
    ($name:literal) => {
        include_bytes!(concat!("samples/elevation/", $name))
    };
}

#[test]
fn samples_of_every_type_are_heights() {
    check(file!("f32_tiled.tif"), (70, 50), true, |height| height);
    check(file!("f64_strips.tif"), (40, 30), false, |height| height);
    check(file!("f32_nan.tif"), (40, 30), true, |height| height);
    check(file!("i8.tif"), (40, 30), true, |height| height.floor().min(127.0));
    check(file!("i16_strips.tif"), (40, 30), true, f64::floor);
    check(file!("i32_big.tif"), (70, 50), false, f64::floor);
    check(file!("u32.tif"), (40, 30), false, |height| height);
    check(file!("u16_scaled.tif"), (40, 30), true, |height| height);
}

#[test]
fn steps_are_those_of_whole_numbers_or_follow_the_bound() {
    let whole = decoded(file!("i16_strips.tif"), &DecodeOptions::default()).1.steps;
    assert_eq!((whole.base, whole.step, whole.rounding), (-20.0, 1.0, 0.0));
    let scaled = decoded(file!("u16_scaled.tif"), &DecodeOptions::default()).1.steps;
    assert_eq!((scaled.step, scaled.rounding), (0.25, 0.0));
    let float = file!("f32_tiled.tif");
    let of_bound = DecodeOptions { bound: Some(4.0), ..DecodeOptions::default() };
    let eighth = decoded(float, &of_bound).1.steps;
    assert_eq!((eighth.step, eighth.rounding), (0.5, 0.25));
    let given = DecodeOptions { step: Some(0.125), ..of_bound };
    assert_eq!(decoded(float, &given).1.steps.rounding, 0.0);
    let fine = decoded(float, &DecodeOptions::default()).1.steps;
    assert!(fine.step < 0.004 && fine.rounding <= 0.5001 * fine.step);
    let small = DecodeOptions { step: Some(0.001), ..of_bound };
    let refusal = small.decode(float).unwrap_err();
    assert!(matches!(refusal, DecodeError::Unsupported { .. }), "{refusal}");
    assert!(refusal.to_string().contains("give a step of at least 0.0038"), "{refusal}");
}

#[test]
fn meshes_keep_the_bound_in_units_of_the_heights() {
    for (file, bound) in [
        (&file!("f32_tiled.tif")[..], 4.0),
        (file!("f64_strips.tif"), 30.0),
        (file!("i16_strips.tif"), 12.5),
        (file!("u16_scaled.tif"), 6.0),
    ] {
        let reading =
            DecodeOptions { bound: Some(bound), nodata: Nodata::Fill, ..DecodeOptions::default() };
        let (image, terrain) = decoded(file, &reading);
        assert!(!terrain.has_holes);
        let own = Method::Mgprfs.parameters(Target::MaxError(bound as u16));
        let mesh = mesh_image(&image, &terrain.parameters(own, Some(bound)).unwrap(), &()).unwrap();
        assert!(mesh.mesh.points().len() < image.pixel_count() * 9 / 10);
        // The picture of the mesh is rounded to steps.
        let rebuilt = rasterize(&mesh.mesh, &()).unwrap();
        let bottom = image.height() - 1;
        for y in 0..image.height() {
            for x in 0..image.width() {
                let is_filled = !matches!(bound, 30.0) && is_in_hole(x, y);
                let found = terrain.steps.height(rebuilt.row(0, bottom - y)[x].into());
                let original = terrain.steps.height(image.row(0, bottom - y)[x].into());
                let most = bound + terrain.steps.step / 2.0 + 1e-9;
                assert!((found - original).abs() <= most);
                let whole = if bound == 12.5 { height(x, y).floor() } else { height(x, y) };
                assert!(is_filled || (found - whole).abs() <= most, "({x}, {y})");
            }
        }
    }
}

#[test]
fn a_bound_below_the_rounding_is_refused() {
    let reading = DecodeOptions { step: Some(10.0), ..DecodeOptions::default() };
    let (_, terrain) = decoded(file!("f64_strips.tif"), &reading);
    let own = Method::Mgprfs.parameters(Target::MaxError(2));
    let refused = terrain.parameters(own, Some(2.0)).unwrap_err();
    assert!(matches!(refused, ParameterError::OutOfRange { parameter: "max_error", .. }));
}

/// The glTF document of a mesh of a file.
fn gltf(file: &[u8], bound: f64) -> serde_json::Value {
    let reading = DecodeOptions { bound: Some(bound), ..DecodeOptions::default() };
    let (image, terrain) = decoded(file, &reading);
    let own = Method::Mgprfs.parameters(Target::MaxError(bound as u16));
    let made = mesh_image(&image, &terrain.parameters(own, Some(bound)).unwrap(), &()).unwrap();
    let options = EncodeOptions {
        geometry: terrain.geometry(Geometry::default()),
        terrain: Some(terrain),
        ..EncodeOptions::default()
    };
    let mut bytes = Vec::new();
    encode(&Encodable::from(&made), Format::Gltf, &options, &mut bytes, &|| Ok(())).unwrap();
    serde_json::from_slice(&bytes).unwrap()
}

#[test]
fn a_mesh_lies_at_its_size_and_tells_its_place() {
    let geographic = gltf(file!("f32_tiled.tif"), 4.0);
    let elevation = &geographic["asset"]["extras"]["elevation"];
    assert_eq!(elevation["epsg"], 4326);
    // The middle of the lower left pixel.
    let origin =
        [elevation["origin"][0].as_f64().unwrap(), elevation["origin"][1].as_f64().unwrap()];
    assert!((origin[0] - 12.5005).abs() < 1e-9 && (origin[1] - (47.25 - 0.0495)).abs() < 1e-9);
    // A thousandth of a degree at 47 degrees: 75.8 m across, 111.2 m along.
    let most = &geographic["accessors"][0]["max"];
    let [x, y] = [0, 1].map(|i| {
        let least = geographic["accessors"][0]["min"][i].as_f64().unwrap();
        most[i].as_f64().unwrap() - least
    });
    assert!((x / 69.0 - 75.8).abs() < 0.1 && (y / 49.0 - 111.2).abs() < 0.1, "{x}, {y}");
    let projected = gltf(file!("f64_strips.tif"), 30.0);
    assert_eq!(projected["asset"]["extras"]["elevation"]["epsg"], 32633);
    let x = projected["accessors"][0]["max"][0].as_f64().unwrap();
    assert!((x - 39.0 * 30.0).abs() < 1e-3, "{x}");
    // Heights are those of the file: up to 229.25, not from 0.
    let top = projected["accessors"][0]["max"][2].as_f64().unwrap();
    assert!(top > 190.0 && top < 229.3, "{top}");
}

#[test]
fn missing_samples_are_no_vertices() {
    let reading = DecodeOptions { bound: Some(4.0), ..DecodeOptions::default() };
    let (image, terrain) = decoded(file!("f32_tiled.tif"), &reading);
    let own = Method::Mgprfs.parameters(Target::MaxError(4));
    let made = mesh_image(&image, &terrain.parameters(own, Some(4.0)).unwrap(), &()).unwrap();
    for format in [Format::Ply, Format::Obj, Format::Json, Format::Glb, Format::Svg] {
        let write = |terrain| {
            let options = EncodeOptions { terrain, ..EncodeOptions::default() };
            let mut bytes = Vec::new();
            encode(&Encodable::from(&made), format, &options, &mut bytes, &|| Ok(())).unwrap();
            bytes
        };
        assert!(write(Some(terrain)).len() < write(None).len(), "{format}");
    }
    let options = EncodeOptions { terrain: Some(terrain), ..EncodeOptions::default() };
    let mut bytes = Vec::new();
    encode(&Encodable::from(&made), Format::Json, &options, &mut bytes, &|| Ok(())).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    let numbers = |name: &str| -> Vec<f64> {
        json[name].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let (positions, samples) = (numbers("positions"), numbers("samples"));
    for (position, sample) in positions.chunks(3).zip(samples.chunks(2)) {
        let (x, y) = (position[0] as usize, 49 - position[1] as usize);
        assert!(!is_in_hole(x, y) && sample[1] > 0.0, "({x}, {y})");
    }
    // The border of the hole is there, with a vertex beside each of its corners.
    for corner in [(7, 5), (13, 5), (7, 10), (13, 10)] {
        let at = |p: &[f64]| {
            let (x, y) = (p[0] as usize, 49 - p[1] as usize);
            x.abs_diff(corner.0) <= 1 && y.abs_diff(corner.1) <= 1
        };
        assert!(positions.chunks(3).any(at), "{corner:?}");
    }
}

#[test]
fn cut_files_are_refused() {
    for file in [&file!("f32_tiled.tif")[..], file!("i32_big.tif"), file!("i16_strips.tif")] {
        for end in (0..file.len()).step_by(97) {
            let cut = &file[..end];
            // A picture or an error: no panic, and no model of other heights.
            if let Ok((image, _)) = DecodeOptions::default().decode_terrain_while(cut, &|| Ok(())) {
                assert!(image.width() == 40 || image.width() == 70);
            }
        }
    }
}
