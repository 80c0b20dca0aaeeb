//! Presets: one table, the same over HTTP, for jobs and for the program.

use crate::pictures::disc;
use crate::server::{Server, program};
use serde_json::Value;
use tempfile::TempDir;

/// The media type of each preset's format.
const FORMATS: [(&str, &str); 8] = [
    ("photo", "text/plain; charset=utf-8"),
    ("lowpoly", "image/svg+xml"),
    ("print", "model/stl"),
    ("terrain", "model/gltf-binary"),
    ("sprite", "model/gltf-binary"),
    ("logo", "image/svg+xml"),
    ("placeholder", "image/svg+xml"),
    ("draft", "text/plain; charset=utf-8"),
];

#[test]
fn every_preset_is_listed_and_makes_the_mesh_of_its_parameters() {
    let server = Server::start(&[]);
    let image = disc(48, 40, 4);
    let listed = server.get("/v1/presets").json();
    let listed = listed["presets"].as_array().unwrap();
    let names: Vec<_> = listed.iter().map(|preset| preset["name"].as_str().unwrap()).collect();
    assert_eq!(names, FORMATS.map(|(name, _)| name));
    for (preset, (name, media_type)) in listed.iter().zip(FORMATS) {
        // The picture is smaller than what prints are made of.
        let size = if name == "print" { "&size=900" } else { "" };
        let made = server.mesh(&format!("preset={name}{size}"), &[], &image);
        assert_eq!((made.status, made.header("content-type")), (200, media_type), "{name}");
        let members = preset["parameters"].as_object().unwrap().iter();
        let text = |value: &Value| value.to_string().trim_matches('"').replace('#', "%23");
        let members = members.filter(|(member, _)| *member != "size" || size.is_empty());
        let query = members.map(|(member, value)| format!("{member}={}", text(value)));
        let query = query.collect::<Vec<_>>().join("&") + size;
        let same = server.mesh(&query, &[("Accept", media_type)], &image);
        assert!(same.body == made.body, "{name}: {query}");
        assert_eq!(same.header("mesh-parameters"), made.header("mesh-parameters"));
        let texts = ["about", "not_for"].map(|member| preset[member].as_str().unwrap());
        assert!(texts.iter().all(|text| text.ends_with('.')), "{name}");
    }
}

#[test]
fn what_is_given_beside_a_preset_wins() {
    let server = Server::start(&[]);
    let image = disc(48, 40, 4);
    let obj = server.mesh("preset=print&size=60&height=9&format=obj", &[], &image);
    assert_eq!(obj.header("content-type"), "model/obj");
    assert_eq!(obj.header("mesh-vertices"), "60");
    assert!(obj.header("mesh-parameters").contains("&height=9&invert_relief=true"));
    let png = server.mesh("preset=logo", &[("Accept", "image/png")], &image);
    assert_eq!(png.header("content-type"), "image/png");
    let any = server.mesh("preset=logo", &[("Accept", "*/*")], &image);
    assert_eq!(any.header("content-type"), "image/svg+xml");
    let problem = server.mesh("preset=terain", &[], &image).problem(422, "unknown-value");
    assert_eq!((&problem["nearest"], &problem["param"]), (&"terrain".into(), &"preset".into()));
    assert!(problem["detail"].as_str().unwrap().contains("photo, lowpoly"), "{problem}");
}

#[test]
fn a_job_and_the_program_make_the_same_of_a_preset() {
    let server = Server::start(&[]);
    let folder = TempDir::new().unwrap();
    let image = disc(48, 40, 4);
    std::fs::write(folder.path().join("in.png"), &image).unwrap();
    for (name, ending) in [("placeholder", "svg"), ("sprite", "glb")] {
        let made = server.mesh(&format!("preset={name}&size=40"), &[], &image);
        let job = server.job(&format!("preset={name}&size=40"), &image);
        server.wait_for(&job, "completed");
        let kept = server.get(&format!("{job}/mesh"));
        assert_eq!(kept.header("content-type"), made.header("content-type"));
        assert!(kept.body == made.body, "{name}");
        let words = ["batch", "in.png", "-o", "out", "-p", name, "-n", "40"];
        let status = program().current_dir(folder.path()).args(words).status().unwrap();
        assert!(status.success());
        let written = std::fs::read(folder.path().join(format!("out/in.{ending}"))).unwrap();
        assert!(written == made.body, "{name}");
    }
}

#[test]
fn the_program_lists_presets_and_refuses_an_unknown_one_with_the_nearest() {
    let output = program().args(["presets", "--json"]).output().unwrap();
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told, Server::start(&[]).get("/v1/presets").json());
    let output = program().args(["mesh", "in.png", "-p", "terain"]).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("lowpoly") && message.contains("'terrain'"), "{message}");
}
