//! The interface as it is documented: methods, problems, metrics and the OpenAPI document.

use crate::client::send;
use crate::in_process::Service;
use crate::pictures::disc;
use crate::server::{Server, program};

#[test]
fn the_checked_in_document_is_the_one_that_the_program_prints_and_serves() {
    let printed = program().arg("openapi").output().unwrap().stdout;
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi/openapi.json");
    let checked_in = std::fs::read(path).unwrap_or_default();
    assert!(
        printed == checked_in,
        "openapi/openapi.json is not up to date: write `pixmesh openapi` into it"
    );
    let server = Service::start(&[]);
    let served = server.get("/openapi.json");
    assert_eq!(served.body, printed);
    assert_eq!(served.header("content-type"), "application/json");
}

#[test]
fn methods_are_listed_with_parameters_defaults_and_bounds() {
    let server = Service::start(&[]);
    let list = server.get("/v1/methods").json();
    assert_eq!(list["default"], "mgprfs");
    let methods = list["methods"].as_array().unwrap();
    assert_eq!(methods.len(), 13);
    let mgprfs = methods.iter().find(|method| method["name"] == "mgprfs").unwrap();
    assert_eq!(mgprfs["defaults"]["gamma"], 4);
    assert_eq!(mgprfs["defaults"]["density"], 2);
    assert!(mgprfs["components"].is_null());
    let parameters = list["parameters"].as_array().unwrap();
    let density = parameters.iter().find(|row| row["name"] == "density").unwrap();
    assert_eq!((&density["type"], &density["maximum"]), (&"number".into(), &100.0.into()));
    let policies = list["policies"].as_array().unwrap();
    assert!(policies.iter().any(|policy| policy["name"] == "psc" && policy["components"] == 3));
}

#[test]
fn the_type_of_a_problem_can_be_looked_up() {
    let server = Service::start(&[]);
    let problem = server.mesh("density=0", &[], &disc(20, 20, 1)).json();
    let row = server.get(problem["type"].as_str().unwrap());
    assert_eq!(row.status, 200);
    for member in ["type", "title", "status"] {
        assert_eq!(row.json()[member], problem[member]);
    }
    server.get("/problems/none-such").problem(404, "not-found");
}

#[test]
fn every_type_of_problem_has_cause_example_and_remedy_as_json_and_as_a_page() {
    let server = Service::start(&[]);
    let document = server.get("/openapi.json").json();
    let types = &document["components"]["schemas"]["Problem"]["properties"]["type"]["enum"];
    let types: Vec<&str> = types.as_array().unwrap().iter().map(|t| t.as_str().unwrap()).collect();
    assert!(types.len() > 50, "{types:?}");
    for reference in types {
        let row = server.get(reference);
        assert_eq!((row.status, row.header("content-type")), (200, "application/json"));
        assert_eq!(row.header("vary"), "Accept");
        let row = row.json();
        assert_eq!(row["example"]["type"], reference);
        let accept = [("Accept", "text/html,application/xhtml+xml,*/*;q=0.8")];
        let page = send(server.public, "GET", reference, &accept, &[]);
        assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
        assert!(page.header("content-security-policy").starts_with("default-src 'none'"));
        let text = page.text();
        assert!(!text.contains("<script") && !text.contains("://"), "{text}");
        let shown = |heading: &str, tag: &str| {
            let (_, rest) = text.split_once(&format!("<h2>{heading}</h2>\n<{tag}>")).unwrap();
            let (part, _) = rest.split_once(&format!("</{tag}>")).unwrap();
            part.replace("&lt;", "<").replace("&amp;", "&")
        };
        for (heading, member) in [("Cause", "cause"), ("Remedy", "remedy")] {
            let words = row[member].as_str().unwrap();
            assert!(words.len() > 20 && words.ends_with('.'), "{reference}: {words}");
            assert_eq!(shown(heading, "p"), words, "{reference}");
        }
        let example: serde_json::Value = serde_json::from_str(&shown("Example", "pre")).unwrap();
        assert_eq!(example, row["example"]);
    }
}

#[test]
fn the_index_links_to_what_there_is_and_head_has_no_body() {
    let server = Service::start(&[]);
    let as_json = [("Accept", "application/json")];
    let index = send(server.public, "GET", "/", &as_json, &[]).json();
    assert_eq!(server.get(index["links"]["methods"].as_str().unwrap()).status, 200);
    assert_eq!(server.get(index["links"]["openapi"].as_str().unwrap()).status, 200);
    use std::io::{Read, Write};
    let mut stream = crate::client::connect(server.public);
    stream
        .write_all(b"HEAD /v1/methods HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        .unwrap();
    let mut head = String::new();
    stream.read_to_string(&mut head).unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.ends_with("\r\n\r\n"), "{head}");
}

#[test]
fn the_metrics_count_what_was_answered_and_name_no_client_text() {
    let server = Server::start(&["--workers", "2"]);
    server.mesh("", &[], &disc(30, 30, 3));
    server.get("/secret-path?token=abc");
    send(server.public, "BREW", "/secret-path", &[], &[]);
    let metrics = server.operate("/metrics");
    assert!(metrics.header("content-type").starts_with("text/plain; version=0.0.4"));
    let text = metrics.text();
    for line in [
        "pixmesh_http_requests_total{route=\"/v1/meshes\",method=\"POST\",code=\"200\"} 1",
        "pixmesh_http_requests_total{route=\"UNKNOWN\",method=\"GET\",code=\"404\"} 1",
        "pixmesh_http_requests_total{route=\"UNKNOWN\",method=\"OTHER\",code=\"404\"} 1",
        "pixmesh_workers 2",
        "pixmesh_memory_permits_mib{state=\"total\"} 768",
        "pixmesh_panics_total 0",
        "pixmesh_input_pixels_count 1",
        "pixmesh_mesh_vertices_sum 18",
        "pixmesh_stage_duration_seconds_count{stage=\"simplify\"} 1",
        "pixmesh_queue_wait_seconds_count 1",
    ] {
        assert!(text.contains(line), "{line} is not in\n{text}");
    }
    assert!(!text.contains("secret") && !text.contains("BREW"));
    server.operate("/nothing").problem(404, "not-found");
    send(server.operations, "POST", "/livez", &[], &[]).problem(405, "method-not-allowed");
}
