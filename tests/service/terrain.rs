//! Elevation models over HTTP: meshes of requests and jobs, their conversion and comparison.

use crate::client::{Answer, field, form, send};
use crate::pictures::disc;
use crate::server::{Client, Server};
use pixmesh_codec::Format;

/// In degrees, with a hole; and in metres, without one.
const DEGREES: &[u8] = include_bytes!("../../crates/codec/tests/samples/elevation/f32_tiled.tif");
const METRES: &[u8] = include_bytes!("../../crates/codec/tests/samples/elevation/f64_strips.tif");

fn compare(server: &Client, image: &[u8], approximation: &[u8]) -> Answer {
    let (image_field, mesh_field) = (field("image"), field("approximation"));
    let (label, body) = form(&[(&image_field, image), (&mesh_field, approximation)]);
    send(server.public, "POST", "/v1/comparisons", &[("Content-Type", &label)], &body)
}

#[test]
fn mesh_of_a_job_has_the_bytes_of_a_request_in_every_format() {
    let server = Server::start(&[]);
    for (file, query) in [(DEGREES, "max_error=4"), (METRES, "max_error=6.5&format=progression")] {
        let job = server.job(query, file);
        server.wait_for(&job, "completed");
        for format in Format::NAMES {
            let query = query.replace("&format=progression", "");
            let direct = server.mesh(&format!("{query}&format={format}"), &[], file);
            let stored = server.get(&format!("{job}/mesh?format={format}"));
            if *format == "terrain" && file == METRES {
                for answer in [direct, stored] {
                    let problem = answer.problem(422, "format-not-possible");
                    assert!(problem["detail"].as_str().unwrap().contains("gdalwarp"), "{problem}");
                }
                continue;
            }
            assert_eq!((direct.status, stored.status), (200, 200), "{format}: {}", stored.text());
            assert!(direct.body == stored.body, "{query}, {format}");
            assert_eq!(direct.header("content-type"), stored.header("content-type"));
        }
        // A smaller mesh keeps its place, and no bound.
        let small = server.get(&format!("{job}/mesh?format=gltf&size=40"));
        let extras = &small.json()["asset"]["extras"]["elevation"];
        let epsg = if file == METRES { 32633 } else { 4326 };
        assert!(extras["epsg"] == epsg && extras["max_error"].is_null(), "{extras}");
    }
    server.wait_until_idle();
}

#[test]
fn mesh_files_keep_their_place() {
    let server = Server::start(&[]);
    let direct = server.mesh("max_error=4&format=terrain", &[], DEGREES);
    assert_eq!(direct.header("content-type"), "application/vnd.quantized-mesh");
    for source in ["model", "pmesh"] {
        let file = server.mesh(&format!("max_error=4&format={source}"), &[], DEGREES).body;
        let target = "/v1/conversions?format=terrain";
        let converted = send(server.public, "POST", target, &[], &file);
        assert_eq!(converted.status, 200, "{}", converted.text());
        assert_eq!(converted.header("mesh-vertices"), direct.header("mesh-vertices"));
        assert!(source == "pmesh" || converted.body == direct.body);
    }
    let damaged = b"2 2 1 8\nOFF\n# elevation model: base 0 step 0 rounding 0 unit 1\n4 2 5\n";
    let refused = send(server.public, "POST", "/v1/conversions?format=glb", &[], damaged);
    let problem = refused.problem(422, "mesh-invalid");
    assert!(problem["line"] == 3 && problem["detail"].as_str().unwrap().contains("'step'"));
    server.wait_until_idle();
}

#[test]
fn heights_are_compared_in_their_units() {
    let server = Server::start(&[]);
    for (file, bound) in [(DEGREES, 4.0), (METRES, 6.5)] {
        for choices in ["", "&connectivity=free", "&method=preview"] {
            let model = server.mesh(&format!("max_error={bound}{choices}"), &[], file).body;
            let answer = compare(&server, file, &model);
            assert_eq!(answer.status, 200, "{}", answer.text());
            let figures = answer.json();
            let of = |name: &str| figures["elevation"][name].as_f64().unwrap();
            // The bound is used, and holds for the heights of the file.
            let is_used = of("max_error") > 0.5 * bound && of("max_error") <= bound + 1e-9;
            assert!(is_used, "{choices}: {figures}");
            assert!(of("rmse") < of("max_error") && of("step") == bound / 8.0, "{figures}");
            assert!((figures["mse"].as_f64().unwrap() - of("rmse").powi(2)).abs() < 1e-9);
            let pixels = figures["width"].as_u64().unwrap() * figures["height"].as_u64().unwrap();
            let missing = if file == DEGREES { 20.0 } else { 0.0 };
            assert_eq!((of("compared"), of("unmatched")), (pixels as f64 - missing, 0.0));
            assert!(figures["ssim"].is_null() && figures["identical"] == false);
        }
    }
    let same = compare(&server, DEGREES, DEGREES).json();
    assert!(same["identical"] == true && same["elevation"]["step"].is_null(), "{same}");
    let filled = server.mesh("max_error=4&nodata=fill", &[], DEGREES).body;
    assert_eq!(compare(&server, DEGREES, &filled).json()["elevation"]["unmatched"], 20);
    // A picture and a mesh of one have no heights.
    let picture = disc(70, 50, 1);
    for approximation in [server.mesh("size=50", &[], &picture).body, picture] {
        let problem = compare(&server, DEGREES, &approximation).problem(422, "shape-mismatch");
        assert!(problem["detail"].as_str().unwrap().contains("no heights"), "{problem}");
    }
    compare(&server, DEGREES, METRES).problem(422, "shape-mismatch");
    server.wait_until_idle();
}
