//! The README's commands, as a reader would paste them.

use crate::server::{Server, program};
use std::process::Command;

const README: &str = include_str!("../../README.md");

/// The shell blocks of the README.
fn shell_blocks() -> Vec<&'static str> {
    README.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect()
}

#[test]
fn the_curl_examples_work_as_printed() {
    let server = Server::start(&[]);
    let blocks = shell_blocks();
    let examples = blocks.iter().find(|block| block.contains("curl")).unwrap();
    let script = examples
        .replace("127.0.0.1:8080", &server.public.to_string())
        .replace("127.0.0.1:8081", &server.operations.to_string())
        .replace("@docs/", concat!("@", env!("CARGO_MANIFEST_DIR"), "/docs/"));
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("readme");
    std::fs::create_dir_all(&folder).unwrap();
    let run = Command::new("sh").args(["-ec", &script]).current_dir(&folder).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let file = |name: &str| std::fs::read(folder.join(name)).unwrap();
    assert!(file("picture.model").starts_with(b"384 256 3 8\nOFF\n1966 3877 5842\n"));
    assert!(file("picture.glb").starts_with(b"glTF"));
    assert!(file("rebuilt.png").starts_with(b"\x89PNG"));
    assert!(file("job.glb").starts_with(b"glTF") && file("picture.png").starts_with(b"\x89PNG"));
    let printed = String::from_utf8(run.stdout).unwrap();
    assert!(printed.contains("\"state\":\"completed\""), "the job was followed: {printed}");
    assert!(printed.contains("\"ssim\":0.9"), "{printed}");
    assert!(String::from_utf8(file("headers.txt")).unwrap().contains("mesh-vertices: 1000"));
}

#[test]
fn the_two_commands_start_what_there_is() {
    let blocks = shell_blocks();
    assert_eq!(blocks[0], "cargo run --release -- serve\n");
    assert_eq!(blocks[1], "./test\n");
    // Cargo passes the words after the two dashes to the package's program.
    let help = program().args(["serve", "--help"]).output().unwrap();
    assert!(help.status.success());
    let defaults = String::from_utf8(help.stdout).unwrap();
    for address in ["127.0.0.1:8080", "127.0.0.1:8081"] {
        assert!(defaults.contains(address) && README.contains(address), "{address}");
    }
}

#[test]
fn every_setting_that_the_readme_names_exists() {
    let help = program().args(["serve", "--help"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let limits = README.split("## Limits").nth(1).unwrap().split("## ").next().unwrap();
    let named = limits.split('`').filter(|word| word.starts_with("--"));
    let unknown: Vec<&str> = named
        .filter(|flag| !help.contains(&format!("{flag} ")) && !help.contains(&format!("{flag}\n")))
        .collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}
