//! A mesh that is stored as MODEL and converted has the bytes of one that is written at once.

// A panic tells a test that something is wrong, in its own functions too.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use pixmesh_engine::pipeline::{Conversion, Shown, convert, mesh_of_job};
use pixmesh_engine::{
    Context, EngineError, Format, Limits, MeshOptions, ParameterSet, Weighed, mesh,
};
use pixmesh_meshing::Method;

const WIDTH: usize = 48;
const HEIGHT: usize = 36;

/// A picture of discs and slopes as PPM.
fn picture() -> Vec<u8> {
    let sample = |i: usize| {
        let (x, y, c) = (i / 3 % WIDTH, i / 3 / WIDTH, i % 3);
        let disc = x.abs_diff(20).pow(2) + y.abs_diff(15).pow(2) < 90;
        if disc { 230 - 60 * c } else { x * (c + 1) + 2 * y }
    };
    let mut file = format!("P6 {WIDTH} {HEIGHT} 255\n").into_bytes();
    file.extend((0..3 * WIDTH * HEIGHT).map(|i| sample(i) as u8));
    file
}

fn options(query: &str) -> MeshOptions {
    ParameterSet::of_query(Some(query)).unwrap().finish().unwrap()
}

/// The bytes that the mesh of a file has in a format, at once and from a job.
fn both(file: &[u8], options: &MeshOptions, format: Format) -> [Result<Vec<u8>, String>; 2] {
    let (limits, context) = (Limits::default(), Context::default());
    let at_once = mesh(file.to_vec().into(), options, format, &limits, &context);
    let from_job = converted(file, options, format);
    [at_once.map(|answer| answer.bytes), from_job].map(|made| made.map_err(|e| e.to_string()))
}

/// The bytes that a job's mesh has in a format.
fn converted(file: &[u8], options: &MeshOptions, format: Format) -> Result<Vec<u8>, EngineError> {
    let (limits, context) = (Limits::default(), Context::default());
    let source = Weighed::from(file.to_vec());
    let keeps_progression = format == Format::Progression;
    let made = mesh_of_job(source, options, keeps_progression, &limits, &context)?;
    match format {
        Format::Model => Ok(made.answer.bytes),
        Format::Progression => Ok(made.progression.unwrap()),
        _ => {
            let conversion = Conversion {
                file: made.answer.bytes,
                shown: made.texture.map(Shown::Texture),
                size: None,
                format,
                output: options.output,
                mse: Some(made.answer.mse),
            };
            convert(conversion, &limits, &context).map(|converted| converted.bytes)
        }
    }
}

#[test]
fn every_method_and_format_gives_the_same_bytes_at_once_and_from_a_job() {
    for method in Method::NAMES {
        for choices in
            ["", "&relief=luma&base=2&compression=meshopt&shading=gradient&texture=embed"]
        {
            let name = method.replace('+', "%2B");
            let options = options(&format!("method={name}&size=60{choices}"));
            // A tile of terrain is for elevation models.
            for &format in Format::ALL.iter().filter(|&&format| format != Format::Terrain) {
                let [at_once, from_job] = both(&picture(), &options, format);
                assert!(at_once == from_job, "{method}, {format}{choices}");
            }
        }
    }
}

macro_rules! model {
    ($name:literal) => {
        include_bytes!(concat!("../../../codec/tests/samples/elevation/", $name)).to_vec()
    };
}

#[test]
fn elevation_models_give_the_same_bytes_at_once_and_from_a_job() {
    for (file, query) in [
        // With holes, in degrees; once with a step of its own, and once filled.
        (model!("f32_tiled.tif"), "max_error=4"),
        (model!("f32_tiled.tif"), "max_error=4&step=0.5&connectivity=free"),
        (model!("f32_tiled.tif"), "size=60&nodata=fill&center=true&color=hillshade"),
        (model!("f32_nan.tif"), "max_error=10&method=preview&relief=c0&height=7"),
        // Without holes, in metres; of whole numbers, and scaled.
        (model!("f64_strips.tif"), "max_error=6.5&compression=meshopt"),
        (model!("i16_strips.tif"), "max_error=12.5&pixel_size=2"),
        (model!("u16_scaled.tif"), "max_error=6&z_scale=2"),
    ] {
        let options = options(query);
        for &format in Format::ALL {
            let [at_once, from_job] = both(&file, &options, format);
            assert!(at_once == from_job, "{query}, {format}: {at_once:?}");
        }
        // Most formats can hold each of these meshes.
        let glb = both(&file, &options, Format::Glb)[1].clone().unwrap();
        assert!(glb.windows(11).any(|part| part == b"\"elevation\""), "{query}");
    }
}

#[test]
fn mesh_files_of_elevation_models_are_converted_with_their_place() {
    let (file, options) = (model!("f32_tiled.tif"), options("max_error=4"));
    let (limits, context) = (Limits::default(), Context::default());
    let made = |format| both(&file, &options, format)[0].clone().unwrap();
    let converted = |format, size, to| {
        let (file, output) = (made(format), options.output);
        let conversion = Conversion { file, shown: None, size, format: to, output, mse: None };
        convert(conversion, &limits, &context).unwrap().bytes
    };
    for format in [Format::Model, Format::Pmesh, Format::Progression] {
        for to in [Format::Model, Format::Pmesh] {
            assert_eq!(
                converted(format, None, to).len(),
                converted(to, None, to).len(),
                "{format} to {to}"
            );
        }
        let glb = String::from_utf8_lossy(&converted(format, None, Format::Glb)).into_owned();
        assert!(glb.contains("\"epsg\":4326") && glb.contains("\"max_error\":4.0"), "{format}");
    }
    // Of fewer vertices the bound does not hold.
    let small = converted(Format::Progression, Some(30), Format::Glb);
    assert!(String::from_utf8_lossy(&small).contains("\"max_error\":null"));
}
