//! What a release says of itself, in one place.

use crate::read;
use crate::tools::checkout;
use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

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
    for package in published() {
        let name = package["name"].as_str().unwrap();
        assert_eq!(package["version"], version, "{name}");
        if name != "pixmesh" {
            let line = manifest("workspace.dependencies", name);
            assert!(line.contains(&format!("version = \"{version}\"")), "{line}");
        }
    }
}

/// The crates of a workspace, as Cargo understands their manifests.
fn crates(manifest: &str) -> Vec<Value> {
    let flags = ["metadata", "--no-deps", "--offline", "--format-version", "1"];
    let printed = Command::new(env!("CARGO"))
        .args(flags)
        .arg("--manifest-path")
        .arg(checkout(manifest))
        .output()
        .unwrap();
    let known: Value = serde_json::from_slice(&printed.stdout).unwrap();
    known["packages"].as_array().unwrap().clone()
}

/// The crates that `cargo publish --workspace` publishes: all but those that are never published.
fn published() -> Vec<Value> {
    let is_published = |package: &Value| package["publish"].is_null();
    crates("Cargo.toml").into_iter().filter(is_published).collect()
}

#[test]
fn the_document_on_releases_names_every_crate_that_is_published() {
    let document = read("docs/release.md");
    let step = document.split("`cargo publish --workspace` publishes ").nth(1).unwrap();
    let sentence = step.split(", each after").next().unwrap();
    let named: BTreeSet<_> = sentence.split('`').skip(1).step_by(2).collect();
    let published = published();
    let names: BTreeSet<_> =
        published.iter().filter_map(|package| package["name"].as_str()).collect();
    assert_eq!(named, names);
}

#[test]
fn every_crate_is_described() {
    for package in [crates("Cargo.toml"), crates("fuzz/Cargo.toml")].concat() {
        let name = package["name"].as_str().unwrap();
        for key in ["description", "license", "repository", "readme"] {
            assert!(package[key].is_string(), "{name} has no {key}");
        }
        for key in ["keywords", "categories"] {
            assert!(!package[key].as_array().unwrap().is_empty(), "{name} has no {key}");
        }
    }
}
