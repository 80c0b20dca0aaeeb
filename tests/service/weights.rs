//! Pictures that say how much each pixel of another one matters.

use crate::client::{Answer, field, form, send};
use crate::in_process::Service;
use crate::pictures::{disc, disc_image, noise, png};
use crate::server::{Client, Folder, Server};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_codec::{Limits, decode, read_model, read_weights};
use pixmesh_meshing::{Image, Method, Target, mesh_image};
use std::sync::Arc;

const SIDE: usize = 48;
const QUERY: &str = "size=120";

/// Weights that say that only the left half matters much.
fn left() -> Vec<u8> {
    let sample = |i: usize| if i % SIDE < SIDE / 2 { 255 } else { 3 };
    png(&Image::from_bottom_up(SIDE, SIDE, 8, vec![(0..SIDE * SIDE).map(sample).collect()])
        .unwrap())
}

fn post(server: &Client, path: &str, parts: &[(&str, &[u8])]) -> Answer {
    let fields: Vec<(String, &[u8])> =
        parts.iter().map(|(name, bytes)| (field(name), *bytes)).collect();
    let fields: Vec<(&str, &[u8])> =
        fields.iter().map(|(lines, bytes)| (lines.as_str(), *bytes)).collect();
    let (content_type, body) = form(&fields);
    send(server.public, "POST", path, &[("Content-Type", &content_type)], &body)
}

#[test]
fn a_request_and_a_job_with_weights_make_the_mesh_that_the_library_makes() {
    let folder = Arc::new(Folder::new());
    let server = Server::start_in(&folder, &[]);
    let (picture, weights) = (noise(SIDE), left());
    let parts: [(&str, &[u8]); 2] = [("image", &picture), ("weights", &weights)];
    let direct = post(&server, &format!("/v1/meshes?{QUERY}"), &parts);
    assert_eq!(direct.status, 200, "{}", direct.text());

    let limits = Limits::default();
    let image = decode(&picture, &limits).unwrap();
    let mask = read_weights(&weights, (SIDE, SIDE), &limits).ok();
    let parameters = Method::Mgprfs.parameters(Target::Size(120)).weights(mask.clone());
    let model = mesh_image(&image, &parameters, &()).unwrap();
    assert_eq!(read_model(&direct.body, &limits).unwrap(), model.mesh);
    let plain = server.mesh(QUERY, &[], &picture);
    let on_the_left = |answer: &Answer| {
        let mesh = read_model(&answer.body, &limits).unwrap();
        mesh.points().iter().filter(|point| (point.x as usize) < SIDE / 2).count()
    };
    assert!(on_the_left(&direct) > on_the_left(&plain) + 20);

    let accepted = post(&server, &format!("/v1/jobs?{QUERY}"), &parts);
    let job = accepted.header("location").to_owned();
    let document = server.wait_for(&job, "completed");
    assert_eq!(document["image"]["bytes"], picture.len());
    assert_eq!(document["image"]["weights"]["bytes"], weights.len());
    let plain = server.job(QUERY, &picture);
    let plain = server.wait_for(&plain, "completed");
    assert_eq!(document["image"]["sha256"], plain["image"]["sha256"]);
    assert!(plain["image"]["weights"].is_null());
    assert!(server.get(&format!("{job}/mesh")).body == direct.body);
    let answer = server.get(&format!("{job}/mesh?size=30"));
    let parameters = Method::Mgprfs
        .parameters(Target::Size(30))
        .weights(mask)
        .initial_size(pixmesh_meshing::parameters::InitialSize::Size(480));
    let smaller = mesh_image(&image, &parameters, &()).unwrap();
    assert_eq!(read_model(&answer.body, &limits).unwrap(), smaller.mesh);
    assert_eq!(answer.header("mesh-mse"), smaller.fidelity.mse().to_string());

    let body = format!(
        "{{\"image\":\"{}\",\"weights\":\"{}\",\"params\":{{\"size\":120}}}}",
        STANDARD.encode(&picture),
        STANDARD.encode(&weights)
    );
    let json = [("Content-Type", "application/json")];
    let accepted = send(server.public, "POST", "/v1/jobs", &json, body.as_bytes());
    let job = accepted.header("location").to_owned();
    server.wait_for(&job, "completed");
    assert!(server.get(&format!("{job}/mesh")).body == direct.body);
    server.wait_until_idle();
}

#[test]
fn a_job_that_waits_keeps_its_weights_when_the_process_is_killed() {
    let folder = Arc::new(Folder::new());
    let (picture, weights) = (noise(SIDE), left());
    let mut server = Server::start_in(&folder, &["--workers", "1"]);
    server.job("method=mgpr&density=1", &noise(900));
    let parts: [(&str, &[u8]); 2] = [("image", &picture), ("weights", &weights)];
    let accepted = post(&server, &format!("/v1/jobs?{QUERY}"), &parts);
    let job = accepted.header("location").to_owned();
    server.kill();
    let server = Server::start_in(&folder, &["--workers", "2"]);
    server.wait_for(&job, "completed");
    let direct = post(&server, &format!("/v1/meshes?{QUERY}"), &parts);
    assert!(server.get(&format!("{job}/mesh")).body == direct.body);
}

#[test]
fn equal_weights_change_nothing_whatever_their_depth_colour_or_alpha() {
    let server = Service::start(&[]);
    let image = disc(SIDE, SIDE, 3);
    let plain = server.mesh(QUERY, &[], &image);
    for components in 1..=4 {
        let planes = vec![vec![180; SIDE * SIDE]; components];
        let weights = png(&Image::from_bottom_up(SIDE, SIDE, 8, planes).unwrap());
        let parts: [(&str, &[u8]); 2] = [("image", &image), ("weights", &weights)];
        let answer = post(&server, &format!("/v1/meshes?{QUERY}"), &parts);
        assert!(answer.body == plain.body, "{components}: {}", answer.status);
    }
}

#[test]
fn weights_that_do_not_fit_are_refused_by_name_before_any_work() {
    let server = Server::start(&[]);
    let image = disc(SIDE, SIDE, 1);
    let narrow = png(&disc_image(SIDE - 1, SIDE, 1));
    let cut = &left()[..40];
    for path in ["/v1/meshes", "/v1/jobs"] {
        for (weights, status, slug) in [
            (&narrow[..], 422, "shape-mismatch"),
            (b"nothing", 415, "unsupported-image"),
            (b"", 400, "empty-file"),
        ] {
            let parts: [(&str, &[u8]); 2] = [("image", &image), ("weights", weights)];
            let problem = post(&server, path, &parts).problem(status, slug);
            assert_eq!(problem["param"], "weights", "{problem}");
        }
        let twice: [(&str, &[u8]); 3] =
            [("image", &image), ("weights", &narrow), ("weights", &narrow)];
        post(&server, path, &twice).problem(400, "duplicate-part");
        let alone: [(&str, &[u8]); 1] = [("weights", &narrow)];
        post(&server, path, &alone).problem(400, "image-missing");
        let refused = send(server.public, "POST", &format!("{path}?weights=x"), &[], &image);
        let problem = refused.problem(400, "unknown-parameter");
        assert!(problem["detail"].as_str().unwrap().contains("part of a form"), "{problem}");
    }
    let parts: [(&str, &[u8]); 2] = [("image", &image), ("weights", cut)];
    post(&server, "/v1/meshes", &parts).problem(422, "image-decode-failed");
    server.wait_until_idle();
}
