//! The subcommands that work on files, as a user types them.

use crate::client::send;
use crate::in_process::Service;
use crate::pictures::disc;
use crate::server::program;
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::{Output, Stdio};
use tempfile::TempDir;

/// Runs the program in a folder, its words split at blanks.
fn run(folder: &Path, words: &str, input: &[u8]) -> Output {
    let mut child = program()
        .current_dir(folder)
        .args(words.split_whitespace())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A program that refuses its options does not read.
    let _ = child.stdin.take().unwrap().write_all(input);
    child.wait_with_output().unwrap()
}

/// What a run that must succeed printed. It says nothing where no terminal is.
fn succeed(folder: &Path, words: &str, input: &[u8]) -> Vec<u8> {
    let output = run(folder, words, input);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}: {message}");
    assert!(message.is_empty() || words.contains("--json"), "{words}: {message}");
    output.stdout
}

/// What a run that must fail with a status said.
fn fail(folder: &Path, words: &str, status: i32) -> String {
    let output = run(folder, words, b"");
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{words}: {message}");
    assert!(!message.contains("panicked"), "{message}");
    message
}

/// A folder with the picture `in.ppm`.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("in.ppm"), disc(60, 50, 3)).unwrap();
    folder
}

#[test]
fn the_same_parameters_give_the_bytes_of_the_service() {
    let (server, folder) = (Service::start(&[]), folder());
    let (path, image) = (folder.path(), disc(60, 50, 3));
    for (words, query) in [
        ("-n 80 -f glb", "size=80&format=glb"),
        ("-m med --density 4 -f svg", "method=med&density=4&format=svg"),
        ("-n 60 --invert-relief --base 2 -f stl", "size=60&invert_relief=true&base=2&format=stl"),
        ("-n 90 --effort=1 --values=fitted", "size=90&effort=1&values=fitted"),
    ] {
        let made = succeed(path, &format!("mesh in.ppm {words}"), b"");
        assert!(made == server.mesh(query, &[], &image).body, "{words}");
        let piped = succeed(path, &format!("mesh - -o - {words}"), &image);
        assert!(piped == made, "{words}");
    }
    let kept = succeed(path, "mesh in.ppm -n 90 -f progression", b"");
    for (words, query) in
        [("convert - -n 40 -f ply", "size=40&format=ply"), ("render -", "format=png")]
    {
        let answer = send(server.public, "POST", &format!("/v1/conversions?{query}"), &[], &kept);
        assert!(succeed(path, words, &kept) == answer.body, "{words}");
    }
}

#[test]
fn a_mesh_is_made_converted_rendered_compared_and_described() {
    let folder = folder();
    let path = folder.path();
    let line = succeed(path, "mesh in.ppm -o mesh.pmesh -n 80 --json", b"");
    let facts: Value = serde_json::from_slice(&line).unwrap();
    assert_eq!((&facts["vertices"], &facts["format"]), (&80.into(), &"pmesh".into()));
    assert!(succeed(path, "convert mesh.pmesh -o mesh.svg", b"").is_empty());
    assert!(std::fs::read(path.join("mesh.svg")).unwrap().starts_with(b"<svg"));
    succeed(path, "render mesh.pmesh -o out.png", b"");
    let told = |words| serde_json::from_slice::<Value>(&succeed(path, words, b"")).unwrap();
    let of_mesh = told("compare in.ppm mesh.pmesh --json");
    assert_eq!(of_mesh, told("compare in.ppm out.png --json"));
    assert_eq!(of_mesh["psnr_db"], facts["psnr_db"]);
    let info = told("info mesh.pmesh --json");
    assert_eq!((&info["kind"], &info["vertices"]), (&"mesh".into(), &80.into()));
    assert_eq!((&info["width"], &info["height"]), (&60.into(), &50.into()));
    let info = String::from_utf8(succeed(path, "info in.ppm", b"")).unwrap();
    assert!(info.contains("picture") && info.contains("60 by 50 pixels"), "{info}");
}

#[test]
fn a_refusal_names_what_is_wrong_and_keeps_the_output() {
    let folder = folder();
    let path = folder.path();
    std::fs::write(path.join("out.svg"), "kept").unwrap();
    std::fs::write(path.join("bad.png"), "no picture").unwrap();
    for (words, status, named) in [
        ("mesh in.ppm -o out.svg --density 101", 1, "density is 101"),
        ("mesh in.ppm -o out.svg -n 3", 1, "size is 3, but must lie in 4 to"),
        ("mesh in.ppm -o out.svg -n 3001", 1, "size"),
        ("mesh in.ppm -o out.svg -n 80 --density 2", 1, "density and size exclude each other"),
        ("mesh in.ppm -o out.svg -m meth", 2, "--method"),
        ("mesh in.ppm -o out.svg --desnity 2", 2, "--density"),
        ("mesh in.ppm -o out.xyz", 1, ".xyz"),
        ("mesh bad.png -o out.svg", 1, "bad.png"),
        ("mesh none.png -o out.svg", 1, "none.png"),
        ("convert in.ppm -o out.svg", 1, "in.ppm"),
        ("render in.ppm -o out.svg", 1, "svg"),
        ("compare - -", 1, "standard input"),
        ("info bad.png", 1, "bad.png"),
    ] {
        let message = fail(path, words, status);
        assert!(message.contains(named), "{words}: {message}");
    }
    assert_eq!(std::fs::read(path.join("out.svg")).unwrap(), b"kept");
    assert_eq!(std::fs::read_dir(path).unwrap().count(), 3);
}

#[test]
fn a_batch_goes_on_past_a_bad_picture_and_says_so() {
    let folder = folder();
    let path = folder.path();
    std::fs::write(path.join("a.ppm"), disc(40, 30, 1)).unwrap();
    std::fs::write(path.join("b.ppm"), "P6 broken").unwrap();
    let message = fail(path, "batch *.ppm -o out --format glb -n 50", 1);
    assert!(message.contains("b.ppm") && message.contains("1 of 3 pictures"), "{message}");
    let one = succeed(path, "mesh in.ppm -n 50 -f glb", b"");
    assert!(std::fs::read(path.join("out/in.glb")).unwrap() == one);
    assert!(path.join("out/a.glb").exists() && !path.join("out/b.glb").exists());
    let message = fail(path, "batch none*.ppm -o out", 1);
    assert!(message.contains("none*.ppm"), "{message}");
    let message = fail(path, "batch in.ppm ./in.ppm -o out", 1);
    assert!(message.contains("rename"), "{message}");
}

#[test]
fn help_completions_and_manual_page_tell_of_the_subcommands() {
    let folder = folder();
    for words in ["completions bash", "completions zsh", "completions fish", "man", "--help"] {
        let text = String::from_utf8(succeed(folder.path(), words, b"")).unwrap();
        assert!(text.contains("batch") && text.contains("serve"), "{words}");
    }
    let help = String::from_utf8(succeed(folder.path(), "mesh --help", b"")).unwrap();
    for named in ["-n, --size", "-m, --method", "-f, --format", "-o, --output", "Exit status"] {
        assert!(help.contains(named), "{named}");
    }
}
