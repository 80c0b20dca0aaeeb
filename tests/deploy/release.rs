//! What a release says of itself, in one place.

use crate::read;

/// The value of a key in a section of the workspace's manifest.
fn manifest(section: &str, key: &str) -> String {
    let manifest = read("Cargo.toml");
    let section = manifest.split(&format!("[{section}]\n")).nth(1).unwrap();
    let section = section.split("\n[").next().unwrap();
    let line = section.lines().find_map(|line| line.strip_prefix(&format!("{key} = "))).unwrap();
    line.trim_matches('"').to_owned()
}

#[test]
fn the_image_is_built_with_the_least_version_of_rust_that_is_promised() {
    let recipe = read("Dockerfile");
    let version = recipe.lines().find_map(|line| line.strip_prefix("ARG RUST_VERSION=")).unwrap();
    assert_eq!(version, manifest("workspace.package", "rust-version"));
}

#[test]
fn the_changelog_and_the_crates_have_the_version_of_the_workspace() {
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(manifest("workspace.package", "version"), version);
    let changelog = read("CHANGELOG.md");
    let newest = changelog.lines().find_map(|line| line.strip_prefix("## ")).unwrap();
    assert!(newest.starts_with(version), "the changelog begins with {newest}");
    for name in ["meshing", "codec", "cli"] {
        let text = read(&format!("crates/{name}/Cargo.toml"));
        assert!(text.contains("version.workspace = true"), "{name} has a version of its own");
    }
    for dependency in ["pixmesh-meshing", "pixmesh-codec"] {
        let line = manifest("workspace.dependencies", dependency);
        assert!(line.contains(&format!("version = \"{version}\"")), "{line}");
    }
}
