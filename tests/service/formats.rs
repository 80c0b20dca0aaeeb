//! What comes back: each format, its headers, and the same bytes every time.

use crate::client::Answer;
use crate::in_process::Service;
use crate::pictures::{disc, disc_image};
use crate::server::Server;
use pixmesh_codec::{Limits, decode, read_model};
use pixmesh_meshing::{Fidelity, rasterize};

/// Name, media type, file name, and the first bytes of every format.
const FORMATS: [(&str, &str, &str, &[u8]); 11] = [
    ("model", "text/plain; charset=utf-8", "mesh.model", b"60 40 3 8\nOFF\n"),
    ("glb", "model/gltf-binary", "mesh.glb", b"glTF\x02\0\0\0"),
    ("png", "image/png", "mesh.png", b"\x89PNG"),
    ("pnm", "image/x-portable-anymap", "mesh.pnm", b"P6\n60 40\n255\n"),
    ("gltf", "model/gltf+json", "mesh.gltf", b"{\"asset\":{\"version\":\"2.0\""),
    ("svg", "image/svg+xml", "mesh.svg", b"<svg xmlns="),
    ("ply", "application/ply", "mesh.ply", b"ply\nformat binary_little_endian 1.0\n"),
    ("obj", "model/obj", "mesh.obj", b"# lengths in m\n"),
    ("stl", "model/stl", "mesh.stl", b"binary STL, lengths in mm "),
    ("json", "application/json", "mesh.json", b"{\"width\":60,\"height\":40,"),
    ("pmesh", "application/vnd.pixmesh.pmesh", "mesh.pmesh", b"PMSH\x03\0\x08\x03"),
];

#[test]
fn every_format_is_answered_by_name_and_by_accept() {
    let server = Service::start(&[]);
    let image = disc(60, 40, 3);
    for (name, content_type, file_name, start) in FORMATS {
        let media_type = content_type.split(';').next().unwrap();
        let named = server.mesh(&format!("format={name}&density=4"), &[], &image);
        let accepted = server.mesh("density=4", &[("Accept", media_type)], &image);
        for answer in [&named, &accepted] {
            assert_eq!(answer.status, 200, "{}", answer.text());
            assert_eq!(answer.header("content-type"), content_type);
            assert!(answer.body.starts_with(start), "{name}");
            assert!(answer.header("content-disposition").contains(file_name));
        }
        assert_eq!(named.body, accepted.body);
        assert_eq!(named.header("etag"), accepted.header("etag"));
    }
}

#[test]
fn the_format_asked_for_by_name_wins_over_accept_and_model_is_the_default() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let content_type = |query: &str, headers: &[(&str, &str)]| {
        server.mesh(query, headers, &image).header("content-type").to_owned()
    };
    assert_eq!(content_type("format=png", &[("Accept", "text/html")]), "image/png");
    assert_eq!(content_type("", &[]), "text/plain; charset=utf-8");
    assert_eq!(content_type("", &[("Accept", "*/*")]), "text/plain; charset=utf-8");
    let vendor = "application/vnd.pixmesh.model";
    assert_eq!(content_type("", &[("Accept", vendor)]), vendor);
    let weighted = "text/plain;q=0.2, model/gltf-binary;q=0.9, image/png;q=0.5";
    assert_eq!(content_type("", &[("Accept", weighted)]), "model/gltf-binary");
    for accept in ["text/html", "*/*;q=0"] {
        let problem = server.mesh("", &[("Accept", accept)], &image).problem(406, "not-acceptable");
        assert!(problem["allowed"].as_array().unwrap().contains(&"image/png".into()));
    }
}

#[test]
fn the_headers_tell_the_figures_of_the_mesh_that_the_body_holds() {
    let server = Server::start(&[]);
    let image = disc_image(60, 40, 3);
    let answer = server.mesh("size=100", &[("X-Request-ID", "my-id_7")], &disc(60, 40, 3));
    let mesh = read_model(&answer.body, &Limits::default()).unwrap();
    assert_eq!(figure(&answer, "mesh-vertices"), mesh.points().len() as f64);
    assert_eq!(figure(&answer, "mesh-faces"), mesh.faces().len() as f64);
    assert_eq!(mesh.points().len(), 100);
    let rebuilt = rasterize(&mesh, &()).unwrap();
    let fidelity = Fidelity::between(&image, &rebuilt, &()).unwrap();
    assert_eq!(figure(&answer, "mesh-mse"), fidelity.mse());
    assert_eq!(figure(&answer, "mesh-psnr"), fidelity.psnr_db());
    assert_eq!(answer.header("x-request-id"), "my-id_7");
    assert_eq!(answer.header("x-content-type-options"), "nosniff");
    assert_eq!(answer.header("vary"), "Accept");
    assert!(answer.header("mesh-parameters").starts_with("method=mgprfs&size=100&gamma=4&"));
    let kernels = ["density", "diffuse", "triangulate", "simplify"];
    for stage in ["queue", "decode", "encode"].iter().chain(&kernels) {
        assert!(answer.header("server-timing").contains(&format!("{stage};dur=")), "{stage}");
    }
    server.wait_until("the log names the request", || server.log().contains("my-id_7"));
}

#[test]
fn the_picture_rebuilt_is_the_one_that_the_figures_are_about() {
    let server = Service::start(&[]);
    let image = disc_image(50, 50, 1);
    for format in ["png", "pnm"] {
        let answer = server.mesh(&format!("format={format}&density=5"), &[], &disc(50, 50, 1));
        let rebuilt = decode(&answer.body, &Limits::default()).unwrap();
        let fidelity = Fidelity::between(&image, &rebuilt, &()).unwrap();
        assert_eq!(figure(&answer, "mesh-mse"), fidelity.mse(), "{format}");
    }
}

#[test]
fn a_perfect_copy_has_infinite_psnr() {
    let server = Service::start(&[]);
    let answer = server.mesh("density=100&method=mgpr", &[], &disc(16, 12, 1));
    assert_eq!(answer.header("mesh-psnr"), "inf", "{}", answer.text());
    assert_eq!(answer.header("mesh-vertices"), (16 * 12).to_string());
}

#[test]
fn the_same_request_gives_the_same_bytes_and_the_tag_is_theirs() {
    let server = Service::start(&["--workers", "2"]);
    let image = disc(64, 64, 3);
    let first = server.mesh("density=3", &[], &image);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..5 {
                    let again = server.mesh("density=3", &[], &image);
                    assert_eq!(again.body, first.body);
                    assert_eq!(again.header("etag"), first.header("etag"));
                }
            });
        }
    });
    let other = server.mesh("density=4", &[], &image);
    assert_ne!(other.header("etag"), first.header("etag"));
    assert_eq!(first.header("etag").len(), 66, "64 digits between quotes");
}

#[test]
fn what_was_run_can_be_asked_for_again() {
    let server = Service::start(&[]);
    let image = disc(40, 40, 1);
    for query in
        ["method=gprfsed&density=3", "method=med&size=50&policy=psd_avg_l", "target_psnr=30"]
    {
        let first = server.mesh(query, &[], &image);
        let again = server.mesh(first.header("mesh-parameters"), &[], &image);
        assert_eq!(first.status, 200, "{}", first.text());
        assert_eq!(first.body, again.body, "{query}");
    }
}

#[test]
fn every_method_makes_a_mesh_of_the_size_asked_for() {
    let server = Service::start(&[]);
    let methods = server.get("/v1/methods").json();
    for method in methods["methods"].as_array().unwrap() {
        let components = method["components"].as_u64().unwrap_or(3) as usize;
        let name = method["name"].as_str().unwrap();
        let query = format!("method={name}&size=60");
        let answer = server.mesh(&query, &[], &disc(48, 48, components));
        assert_eq!(answer.status, 200, "{name}: {}", answer.text());
        let vertices = figure(&answer, "mesh-vertices");
        assert!((50.0..=75.0).contains(&vertices), "{name}: {vertices} vertices");
    }
}

fn figure(answer: &Answer, header: &str) -> f64 {
    answer.header(header).parse().unwrap_or_else(|_| panic!("{header}: {}", answer.text()))
}
