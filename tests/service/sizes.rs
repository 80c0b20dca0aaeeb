//! Meshes of every size from one job, and the order of vertices that they come from.

use crate::client::{Answer, send};
use crate::pictures::{disc, disc_image};
use crate::server::{Client, Folder, Server};
use pixmesh_codec::{Limits, read_model, read_pmesh, read_progression};
use pixmesh_meshing::{Fidelity, rasterize};
use std::sync::Arc;

/// A job of 100 vertices, which starts with 400 points.
const QUERY: &str = "size=100&initial_size=400";

fn get(server: &Client, target: &str, headers: &[(&str, &str)]) -> Answer {
    send(server.public, "GET", target, headers, &[])
}

/// Submits a job and waits for it; tells where its mesh is.
fn mesh_of(server: &Client, query: &str, image: &[u8]) -> String {
    let job = server.job(query, image);
    server.wait_for(&job, "completed");
    format!("{job}/mesh")
}

#[test]
fn a_job_answers_with_the_mesh_of_any_smaller_size_as_a_request_makes_it() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let mesh = mesh_of(&server, QUERY, &image);
    for size in [4, 5, 37, 99, 100] {
        for format in ["model", "glb", "png", "svg", "pmesh"] {
            let query = format!("size={size}&initial_size=400&format={format}");
            let direct = server.mesh(&query, &[], &image);
            let stored = server.get(&format!("{mesh}?size={size}&format={format}"));
            assert_eq!(stored.status, 200, "{}", stored.text());
            assert!(stored.body == direct.body, "{size} as {format}");
            for name in ["content-type", "mesh-vertices", "mesh-faces", "mesh-psnr", "mesh-mse"] {
                assert_eq!(stored.header(name), direct.header(name), "{size}: {name}");
            }
        }
    }
    let json = server.get(&format!("{mesh}?size=37&format=json")).json();
    let direct = server.mesh("size=37&initial_size=400&format=json", &[], &image).json();
    assert_eq!(json, direct);
    server.wait_until_idle();
}

#[test]
fn each_size_has_a_tag_of_its_own_and_its_parts_are_sent() {
    let server = Server::start(&[]);
    let mesh = mesh_of(&server, QUERY, &disc(60, 50, 1));
    let of =
        |query: &str, headers: &[(&str, &str)]| get(&server, &format!("{mesh}?{query}"), headers);
    let tags = ["size=50", "size=51", "size=50&format=png", "format=png", "", "format=progression"]
        .map(|query| of(query, &[]).header("etag").to_owned());
    for (i, tag) in tags.iter().enumerate() {
        assert!(!tags[..i].contains(tag) && tag.len() > 60, "{tags:?}");
    }
    assert_eq!(of("size=100", &[]).header("etag"), tags[4], "all vertices are the mesh itself");
    let known = of("size=50", &[("If-None-Match", &tags[0])]);
    assert_eq!((known.status, known.body.len()), (304, 0));
    for query in ["size=50", "format=progression"] {
        let whole = of(query, &[]);
        let part = of(query, &[("Range", "bytes=10-19")]);
        assert_eq!((part.status, &part.body[..]), (206, &whole.body[10..20]), "{query}");
        let length = whole.body.len();
        let beyond = of(query, &[("Range", &format!("bytes={length}-"))]);
        assert_eq!(beyond.problem(416, "range-not-satisfiable")["limit"], length);
    }
    server.wait_until_idle();
}

#[test]
fn the_order_of_vertices_is_one_download_from_which_a_client_makes_every_size() {
    let server = Server::start(&[]);
    let (image, limits) = (disc_image(60, 50, 3), Limits::default());
    let job = server.job(QUERY, &disc(60, 50, 3));
    let document = server.wait_for(&job, "completed");
    let answer = server.get(document["links"]["progression"].as_str().unwrap());
    assert_eq!(answer.header("content-type"), "application/vnd.pixmesh.pmesh");
    assert!(answer.header("content-disposition").contains("progression.pmesh"));
    assert_eq!(document["mesh"]["progression_bytes"], answer.body.len());
    let progression = read_progression(&answer.body, &limits).unwrap();
    for size in [4, 20, 77, 100] {
        let mesh = progression.mesh(size, &()).unwrap();
        let model = server.get(&format!("{job}/mesh?size={size}")).body;
        assert_eq!(read_model(&model, &limits).unwrap(), mesh, "{size}");
        let rebuilt = rasterize(&mesh, &()).unwrap();
        assert_eq!(
            progression.fidelity(size),
            Ok(Fidelity::between(&image, &rebuilt, &()).unwrap())
        );
        let short = server.get(&format!("{job}/mesh?size={size}&format=progression")).body;
        let short = read_progression(&short, &limits).unwrap();
        assert_eq!(short, progression.clone().shortened(size).unwrap());
    }
    let direct = server.mesh(&format!("{QUERY}&format=progression"), &[], &disc(60, 50, 3));
    assert!(direct.body == answer.body, "a request's is the same");
    let accept = [("Accept", "application/vnd.pixmesh.pmesh")];
    let pmesh = get(&server, &format!("{job}/mesh"), &accept);
    assert_eq!(read_pmesh(&pmesh.body, &limits).unwrap(), progression.mesh(100, &()).unwrap());
    server.wait_until_idle();
}

#[test]
fn sizes_are_asked_for_within_the_bounds_and_of_jobs_that_keep_an_order() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 1);
    let mesh = mesh_of(&server, QUERY, &image);
    for (size, status, slug) in [
        ("3", 422, "parameter-out-of-range"),
        ("101", 422, "parameter-out-of-range"),
        ("-5", 422, "parameter-out-of-range"),
        ("99999999999999999999", 422, "parameter-out-of-range"),
        ("many", 400, "parameter-malformed"),
        ("", 400, "parameter-malformed"),
        ("5.0", 400, "parameter-malformed"),
    ] {
        let problem = server.get(&format!("{mesh}?size={size}")).problem(status, slug);
        assert_eq!(problem["param"], "size");
    }
    let problem = server.get(&format!("{mesh}?size=3")).json();
    assert_eq!((&problem["minimum"], &problem["maximum"]), (&4.into(), &100.into()));
    for query in ["method=med", "connectivity=free&size=50", "values=fitted&size=50", "method=flat"]
    {
        let mesh = mesh_of(&server, query, &image);
        for wish in ["size=10", "format=progression"] {
            let answer = server.get(&format!("{mesh}?{wish}"));
            let problem = answer.problem(409, "job-without-order");
            let detail = problem["detail"].as_str().unwrap();
            assert!(detail.contains("submit a job whose method ends with removal"), "{detail}");
        }
        assert_eq!(server.get(&mesh).status, 200);
    }
    let asked = mesh_of(&server, "method=med&size=60&format=progression", &image);
    let answer = server.get(&format!("{asked}?size=10&format=model"));
    assert_eq!(answer.header("mesh-vertices"), "10", "{}", answer.text());
    for query in ["connectivity=free", "values=fitted", "method=flat"] {
        let query = format!("{query}&format=progression");
        server.submit(&query, &[], &image).problem(422, "format-not-possible");
        server.mesh(&query, &[], &image).problem(422, "format-not-possible");
    }
    server.mesh("connectivity=free&format=pmesh", &[], &image).problem(422, "format-not-possible");
    server.wait_until_idle();
}

#[test]
fn the_order_survives_a_kill_and_goes_with_the_job() {
    let folder = Arc::new(Folder::new());
    let mut server = Server::start_in(&folder, &[]);
    let mesh = mesh_of(&server, QUERY, &disc(60, 50, 1));
    let before = server.get(&format!("{mesh}?size=40"));
    server.kill();
    let server = Server::start_in(&folder, &[]);
    let after = server.get(&format!("{mesh}?size=40"));
    assert_eq!((after.status, &after.body), (200, &before.body));
    assert_eq!(after.header("etag"), before.header("etag"));
    let job = mesh.strip_suffix("/mesh").unwrap();
    assert_eq!(send(server.public, "DELETE", job, &[], &[]).status, 204);
    server.get(&format!("{mesh}?size=40")).problem(404, "not-found");
    server.wait_until_idle();
}

#[test]
fn refined_meshes_and_those_of_a_quality_have_an_order_too() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    for query in
        ["method=optimal&size=80", "target_psnr=35", "method=cgprfsed&size=80", "max_error=60"]
    {
        let mesh = mesh_of(&server, query, &image);
        let answer = server.get(&format!("{mesh}?size=20&format=png"));
        assert_eq!(answer.status, 200, "{query}: {}", answer.text());
        let rebuilt = pixmesh_codec::decode(&answer.body, &Limits::default()).unwrap();
        let fidelity = Fidelity::between(&disc_image(60, 50, 3), &rebuilt, &()).unwrap();
        assert_eq!(answer.header("mesh-mse"), fidelity.mse().to_string(), "{query}");
    }
    server.wait_until_idle();
}
