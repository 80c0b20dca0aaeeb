//! A command line and a query with the same names and values give the same mesh.

#![allow(clippy::unwrap_used, clippy::expect_used)] // A failing test may stop anywhere.

use pixmesh_engine::params::{Parameter, TABLE, Takes};
use pixmesh_engine::{Context, Limits, ParameterSet, mesh};
use std::io::Write;
use std::process::{Command, Output, Stdio};

/// Parameters with a value that changes the mesh or its file, alone or with what makes it matter.
const VALUES: [(&str, &[(&str, &str)]); 52] = [
    ("method", &[("method", "cgprfsed"), ("size", "40")]),
    ("density", &[("density", "9")]),
    ("size", &[("size", "50")]),
    ("target_psnr", &[("target_psnr", "25")]),
    ("target_error", &[("target_error", "60")]),
    ("max_error", &[("max_error", "90")]),
    ("gamma", &[("gamma", "3"), ("size", "40")]),
    ("initial_density", &[("initial_density", "20"), ("method", "mgprfs"), ("size", "40")]),
    ("initial_size", &[("initial_size", "150"), ("size", "40")]),
    ("initial", &[("initial", "uniform"), ("size", "40")]),
    ("policy", &[("policy", "psb_d"), ("size", "40")]),
    ("psc_tie", &[("psc_tie", "exact"), ("policy", "psc"), ("size", "40")]),
    ("startup", &[("startup", "classic"), ("size", "40")]),
    ("scan", &[("scan", "raster"), ("size", "40")]),
    ("leaky", &[("leaky", "true"), ("size", "40")]),
    ("tolerance", &[("tolerance", "0"), ("size", "40")]),
    ("smoothing", &[("smoothing", "mean"), ("size", "40")]),
    ("smoothing_order", &[("smoothing_order", "5"), ("size", "40")]),
    ("smoothing_direction", &[("smoothing_direction", "orthogonal"), ("size", "40")]),
    ("double_convolution", &[("double_convolution", "true"), ("size", "40")]),
    (
        "smoothing_boundary",
        &[("smoothing_boundary", "symmetric"), ("double_convolution", "true"), ("size", "40")],
    ),
    ("boundary", &[("boundary", "constant"), ("size", "40")]),
    ("meshed", &[("meshed", "luma"), ("size", "40")]),
    ("error_metric", &[("error_metric", "luma_se"), ("size", "40")]),
    ("bad_point_removal", &[("bad_point_removal", "false"), ("size", "40")]),
    ("effort", &[("effort", "1"), ("size", "40")]),
    ("connectivity", &[("connectivity", "free"), ("size", "40")]),
    ("values", &[("values", "fitted"), ("size", "40")]),
    ("reconstruction", &[("reconstruction", "flat"), ("size", "40")]),
    ("parallel", &[("parallel", "tiles"), ("size", "40")]),
    ("seed", &[("seed", "5"), ("initial", "random"), ("size", "40")]),
    ("alpha", &[("alpha", "drop"), ("size", "40")]),
    ("lenient", &[("lenient", "true"), ("size", "40")]),
    ("step", &[("step", "2"), ("size", "40")]),
    ("nodata", &[("nodata", "fill"), ("size", "40")]),
    ("relief", &[("relief", "c1"), ("format", "obj")]),
    ("height", &[("height", "3"), ("format", "obj")]),
    ("z_scale", &[("z_scale", "0.5"), ("format", "obj")]),
    ("invert_relief", &[("invert_relief", "true"), ("format", "obj")]),
    ("base", &[("base", "2"), ("format", "obj")]),
    ("z_offset", &[("z_offset", "-2.5"), ("format", "obj")]),
    ("pixel_size", &[("pixel_size", "0.5"), ("format", "obj")]),
    ("width", &[("width", "80"), ("format", "obj")]),
    ("center", &[("center", "true"), ("format", "obj")]),
    ("up", &[("up", "y"), ("height", "2"), ("format", "obj")]),
    ("color", &[("color", "ramp"), ("height", "2"), ("format", "obj")]),
    ("unit", &[("unit", "mm"), ("format", "glb")]),
    ("compression", &[("compression", "meshopt"), ("format", "glb")]),
    ("texture", &[("texture", "embed"), ("format", "glb")]),
    ("shading", &[("shading", "gradient"), ("format", "svg")]),
    ("png_compression", &[("png_compression", "small"), ("format", "png")]),
    ("format", &[("format", "ply")]),
];

/// The service's parameters; presets, which stand for some of them, are known to `pixmesh` alone.
fn parameters() -> impl Iterator<Item = &'static Parameter> {
    TABLE.iter().filter(|row| row.name != "preset")
}

/// A picture of a disc on a slope in colour, as PAM.
fn picture() -> Vec<u8> {
    let (width, height) = (48, 36);
    let head =
        format!("P7\nWIDTH {width}\nHEIGHT {height}\nDEPTH 3\nMAXVAL 255\nTUPLTYPE RGB\nENDHDR\n");
    let sample = |i: usize| {
        let (x, y, c) = (i / 3 % width, i / 3 / width, i % 3);
        let disc = x.abs_diff(20).pow(2) + y.abs_diff(15).pow(2) < 90;
        (if disc { 230 - 60 * c } else { x * (c + 1) + 2 * y + (7 * x + 3 * y) % 5 }) as u8
    };
    head.into_bytes().into_iter().chain((0..3 * width * height).map(sample)).collect()
}

fn by_query(pairs: &[(&str, &str)]) -> Vec<u8> {
    let query: Vec<String> = pairs.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let options = ParameterSet::of_query(Some(&query.join("&"))).unwrap().finish().unwrap();
    let format = options.format.unwrap_or_default();
    let made = mesh(picture().into(), &options, format, &Limits::default(), &Context::default());
    made.unwrap().bytes
}

fn by_command_line(pairs: &[(&str, &str)]) -> Vec<u8> {
    let output = run(pairs);
    assert!(output.status.success(), "{pairs:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn run(pairs: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_make_model"));
    for (name, value) in pairs {
        let option = format!("--{}", name.replace('_', "-"));
        // These are switches of the command line.
        match (*name, *value) {
            ("lenient" | "invert_relief" | "center", "true") => command.arg(option),
            _ => command.arg(format!("{option}={value}")),
        };
    }
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(&picture()).unwrap();
    child.wait_with_output().unwrap()
}

#[test]
fn every_parameter_of_the_service_is_an_option_of_the_same_meaning() {
    let mut ineffective = Vec::new();
    // Only jobs keep images.
    for row in parameters().filter(|row| row.name != "keep_image") {
        let (_, pairs) = VALUES.iter().find(|(name, _)| *name == row.name).expect(row.name);
        let made = by_query(pairs);
        assert!(made == by_command_line(pairs), "{pairs:?}");
        let without: Vec<_> = pairs.iter().copied().filter(|pair| pair.0 != row.name).collect();
        if made == by_query(&without) {
            ineffective.push(row.name);
        }
    }
    // The picture has no alpha, does not end early and is no elevation model, none of its gradients are
    // ties, no point is bad, and it is smaller than a tile.
    let expected =
        ["psc_tie", "bad_point_removal", "parallel", "alpha", "lenient", "step", "nodata"];
    assert_eq!(ineffective, expected);
}

#[test]
fn every_word_of_the_service_is_understood() {
    for row in parameters() {
        let Takes::Word(words) = row.takes else { continue };
        let (_, pairs) = VALUES.iter().find(|(name, _)| *name == row.name).expect(row.name);
        for word in words {
            if row.name == "relief" && *word == "c3"
                || row.name == "format" && *word == "progression"
            {
                continue;
            }
            let replaced: Vec<_> = pairs
                .iter()
                .map(|&(name, value)| (name, if name == row.name { *word } else { value }))
                .collect();
            // A word may be refused for a picture of three components, but not as unknown.
            let output = run(&replaced);
            let message = String::from_utf8_lossy(&output.stderr);
            assert_ne!(output.status.code(), Some(2), "{replaced:?}: {message}");
        }
    }
}
