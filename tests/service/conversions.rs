//! Mesh files to every other format and size.

use crate::client::{Answer, field, form, send};
use crate::in_process::Service;
use crate::pictures::disc_image;
use crate::pictures::{disc, flat, png};
use crate::server::{Client, Server};
use pixmesh_codec::{Format, Limits, read_model};
use pixmesh_meshing::rasterize;

fn convert(server: &Client, query: &str, file: &[u8]) -> Answer {
    send(server.public, "POST", &format!("/v1/conversions?{query}"), &[], file)
}

fn convert_form(server: &Client, query: &str, parts: &[(&str, &[u8])]) -> Answer {
    let fields: Vec<_> = parts.iter().map(|(name, content)| (field(name), *content)).collect();
    let parts: Vec<_> = fields.iter().map(|(name, content)| (name.as_str(), *content)).collect();
    let (label, body) = form(&parts);
    let target = format!("/v1/conversions?{query}");
    send(server.public, "POST", &target, &[("Content-Type", &label)], &body)
}

#[test]
fn model_pmesh_and_progression_convert_to_every_format() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let order = "size=60&initial_size=240";
    for (method, source) in
        [("mgprfs", "model"), ("mgprfs", "pmesh"), ("mgprfs", "progression"), ("flat", "pmesh")]
    {
        let order = format!("{order}&method={method}");
        let file = server.mesh(&format!("{order}&format={source}"), &[], &image).body;
        let writing = "relief=luma&compression=meshopt&shading=gradient";
        for &format in Format::ALL {
            // MODEL says in comments how it was made, which pmesh does not keep; JSON has the
            // errors, which only a progression keeps. A tile of terrain is for elevation models.
            if matches!(
                format,
                Format::Model | Format::Json | Format::Progression | Format::Terrain
            ) {
                continue;
            }
            let query = format!("{writing}&format={format}");
            let direct = server.mesh(&format!("{order}&{query}"), &[], &image);
            let converted = convert(&server, &query, &file);
            assert_eq!(converted.status, 200, "{source} to {format}: {}", converted.text());
            let vertices = |answer: &Answer| answer.header("mesh-vertices").to_owned();
            assert_eq!(vertices(&converted), vertices(&direct));
            // The order of the vertices differs between MODEL and pmesh; pictures do not.
            if source == "model" || matches!(format, Format::Png | Format::Pnm | Format::Pmesh) {
                assert!(converted.body == direct.body, "{method}: {source} to {format}");
            }
        }
        let picture =
            |file: &[u8]| rasterize(&read_model(file, &Limits::default()).unwrap(), &()).unwrap();
        let direct = server.mesh(&format!("{order}&format=model"), &[], &image).body;
        assert_eq!(picture(&convert(&server, "", &file).body), picture(&direct), "{source}");
    }
    server.wait_until_idle();
}

#[test]
fn progressions_convert_to_every_smaller_size_with_its_error() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let order = "initial_size=240&format=progression&size=60";
    let file = server.mesh(order, &[], &image).body;
    for size in [4, 30, 59, 60] {
        for format in ["model", "glb", "json", "png", "progression"] {
            let direct =
                server.mesh(&format!("size={size}&initial_size=240&format={format}"), &[], &image);
            let converted = convert(&server, &format!("size={size}&format={format}"), &file);
            assert_eq!(converted.header("mesh-vertices"), size.to_string());
            assert_eq!(converted.header("mesh-psnr"), direct.header("mesh-psnr"), "{size}");
            if !matches!(format, "model" | "progression") {
                assert!(converted.body == direct.body, "{size} as {format}");
            }
        }
    }
    for (size, status, slug) in
        [("3", 422, "parameter-out-of-range"), ("61", 422, "parameter-out-of-range")]
    {
        let problem = convert(&server, &format!("size={size}"), &file).problem(status, slug);
        assert_eq!((&problem["minimum"], &problem["maximum"]), (&4.into(), &60.into()));
    }
    let pmesh = server.mesh("size=60&format=pmesh", &[], &image).body;
    for query in ["size=10", "format=progression"] {
        let problem = convert(&server, query, &pmesh).problem(422, "format-not-possible");
        assert!(problem["detail"].as_str().unwrap().contains("format progression"), "{problem}");
    }
    server.wait_until_idle();
}

#[test]
fn a_texture_comes_with_the_mesh_or_is_kept_by_the_job() {
    let server = Server::start(&[]);
    let image = png(&disc_image(60, 50, 3));
    let query = "format=glb&texture=embed";
    let direct = server.mesh(&format!("size=60&{query}"), &[], &image).body;
    let model = server.mesh("size=60", &[], &image).body;
    let converted = convert_form(&server, query, &[("mesh", &model), ("image", &image)]);
    assert!(converted.status == 200 && converted.body == direct, "{}", converted.text());
    let job = server.job(&format!("size=60&{query}"), &image);
    server.wait_for(&job, "completed");
    assert!(server.get(&format!("{job}/mesh")).body == direct);
    let smaller = server.get(&format!("{job}/mesh?size=20"));
    let smaller_at_once =
        server.mesh(&format!("size=20&initial_size=240&{query}"), &[], &image).body;
    assert!(smaller.body == smaller_at_once, "a smaller mesh shows it too");
    let plain = server.get(&format!("{job}/mesh?texture=none"));
    assert!(plain.body == server.mesh("size=60&format=glb", &[], &image).body);
    assert_eq!(server.get(&format!("{job}/mesh?format=model")).body, model);

    for (query, parts, status, slug) in [
        (query, &[("mesh", &model)][..], 400, "part-missing"),
        ("format=svg", &[("mesh", &model), ("image", &image)], 422, "conflicting-parameters"),
        (query, &[("mesh", &model), ("image", &flat(9, 9))], 422, "shape-mismatch"),
        (query, &[("mesh", &model), ("image", &b"nonsense".to_vec())], 415, "unsupported-image"),
    ] {
        let parts: Vec<_> = parts.iter().map(|(name, file)| (*name, &file[..])).collect();
        let problem = convert_form(&server, query, &parts).problem(status, slug);
        assert_eq!(problem["param"], "image", "{problem}");
    }
    server.wait_until_idle();
}

#[test]
fn damaged_mesh_files_are_refused_by_name() {
    let server = Server::start(&[]);
    let pmesh = server.mesh("size=60&format=pmesh", &[], &disc(60, 50, 3)).body;
    // The header has a byte each for the width, the height and the vertices, from the eighth on.
    let announced = |at: usize, number: &[u8]| {
        let mut file = pmesh.clone();
        file.splice(at..=at, number.iter().copied());
        file
    };
    for (file, status, slug) in [
        (Vec::new(), 400, "empty-file"),
        (b"nonsense".to_vec(), 422, "mesh-invalid"),
        (pmesh[..20].to_vec(), 422, "mesh-invalid"),
        (pmesh[..pmesh.len() - 9].to_vec(), 422, "mesh-invalid"),
        (announced(4, &[9]), 422, "mesh-invalid"),
        (announced(8, &[0xff, 0xff, 0xff, 9]), 422, "image-too-large"),
        (announced(10, &[0xff, 0x7f]), 422, "mesh-too-large"),
    ] {
        for target in ["conversions", "reconstructions"] {
            let answer = send(server.public, "POST", &format!("/v1/{target}"), &[], &file);
            answer.problem(status, slug);
        }
    }
    for (query, status, slug) in [
        ("density=2", 400, "unknown-parameter"),
        ("format=dae", 422, "unknown-value"),
        ("size=many", 400, "parameter-malformed"),
        ("relief=c3", 422, "format-not-possible"),
        ("height=-1", 422, "parameter-out-of-range"),
        ("reconstruction=smooth", 422, "unknown-value"),
    ] {
        convert(&server, query, &pmesh).problem(status, slug);
    }
    server.wait_until_idle();
}

#[test]
fn pictures_are_rebuilt_from_and_compared_with_pmesh_too() {
    let server = Service::start(&[]);
    let image = disc(60, 50, 3);
    let direct = server.mesh("size=60&format=png", &[], &image);
    let pmesh = server.mesh("size=60&format=pmesh", &[], &image).body;
    let rebuilt = send(server.public, "POST", "/v1/reconstructions", &[], &pmesh);
    assert!(rebuilt.body == direct.body, "{}", rebuilt.text());
    let (label, body) = form(&[(&field("image"), &image), (&field("approximation"), &pmesh)]);
    let compared =
        send(server.public, "POST", "/v1/comparisons", &[("Content-Type", &label)], &body);
    let psnr: f64 = direct.header("mesh-psnr").parse().unwrap();
    assert_eq!(compared.json()["psnr_db"], psnr);
}
