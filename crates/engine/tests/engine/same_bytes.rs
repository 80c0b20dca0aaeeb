//! A mesh that is stored as MODEL and converted has the bytes of one that is written at once.

// A panic tells a test that something is wrong, in its own functions too.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use pixmesh_engine::pipeline::{Conversion, Shown, convert, mesh_of_job};
use pixmesh_engine::{
    Context, EngineError, Format, Limits, MeshOptions, ParameterSet, Weighed, mesh,
};
use pixmesh_meshing::{Fidelity, Method, Shape};

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

/// The bytes that a job's mesh has in a format.
fn converted(options: &MeshOptions, format: Format) -> Result<Vec<u8>, EngineError> {
    let (limits, context) = (Limits::default(), Context::default());
    let source = Weighed::from(picture());
    let keeps_progression = format == Format::Progression;
    let made = mesh_of_job(source, options, keeps_progression, &limits, &context)?;
    let shape = Shape { width: WIDTH, height: HEIGHT, component_count: 3, precision: 8 };
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
                fidelity: Some(Fidelity::of_mse(made.answer.mse, shape)),
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
            for &format in Format::ALL {
                let (limits, context) = (Limits::default(), Context::default());
                let at_once = mesh(picture().into(), &options, format, &limits, &context);
                let at_once = at_once.map(|answer| answer.bytes).map_err(|e| e.to_string());
                let from_job = converted(&options, format).map_err(|e| e.to_string());
                assert!(at_once == from_job, "{method}, {format}{choices}");
            }
        }
    }
}
