//! The order of the crate's modules: each one uses only those before it, without cycles.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// The modules of `src`, each before all that may use it.
const ORDER: [&str; 20] = [
    "control",
    "image",
    "convert",
    "parallel",
    "parameters",
    "error",
    "density",
    "triangulation",
    "face_error",
    "dynamic_mesh",
    "points",
    "quality",
    "guide",
    "removal",
    "refinement",
    "model",
    "serialize",
    "search",
    "pipeline",
    "lib",
];

/// For each module, named by its path from the crate's root, the modules that it uses.
type Uses = BTreeMap<String, BTreeSet<String>>;

#[test]
fn modules_use_only_those_before_them() {
    let position = |module: &str| {
        let top = module.split("::").next().unwrap_or_default();
        ORDER.iter().position(|&name| name == top)
    };
    let mut upward = Vec::new();
    for (module, used) in uses().unwrap() {
        assert!(position(&module).is_some(), "{module} is missing in ORDER");
        upward.extend(
            used.into_iter()
                .filter(|used| position(used) > position(&module))
                .map(|used| format!("{module} uses {used}")),
        );
    }
    assert!(upward.is_empty(), "{upward:#?}");
}

#[test]
fn modules_use_each_other_without_cycles() {
    let mut uses = uses().unwrap();
    // A module that uses none of those left is on no cycle.
    while let Some(module) = uses.iter().find(|(_, used)| used.is_empty()).map(|(m, _)| m.clone()) {
        uses.remove(&module);
        uses.values_mut().for_each(|used| _ = used.remove(&module));
    }
    assert!(uses.is_empty(), "cycles among {uses:#?}");
}

/// What the modules of the crate use, tests aside.
fn uses() -> io::Result<Uses> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut texts = BTreeMap::new();
    for file in sources(&src)? {
        let path = file.strip_prefix(&src).unwrap_or(&file).with_extension("");
        let path = if path.ends_with("mod") { path.parent().unwrap_or(&path) } else { &path };
        let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
        texts.insert(parts.join("::"), fs::read_to_string(&file)?);
    }
    let modules: BTreeSet<String> = texts.keys().cloned().collect();
    let used = |(module, text): (&String, &String)| {
        let mut used: BTreeSet<String> =
            paths(module, text).iter().filter_map(|path| module_of(path, &modules)).collect();
        used.remove(module);
        (module.clone(), used)
    };
    Ok(texts.iter().map(used).collect())
}

/// The Rust files below a folder, without those of tests.
fn sources(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(sources(&path)?);
        } else if path.extension().is_some_and(|ending| ending == "rs")
            && !path.ends_with("tests.rs")
            && !path.ends_with("tuning.rs")
        {
            found.push(path);
        }
    }
    Ok(found)
}

/// What the code of a module, up to its tests, names by `crate::`, by `super::` or by a `use` of a
/// module inside it, as paths from the crate's root. What it only exports does not count.
fn paths(module: &str, text: &str) -> Vec<String> {
    let code = text.split_once("#[cfg(test)]").map_or(text, |(code, _)| code);
    let is_of_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let path = |rest: &str| rest.chars().take_while(|&c| is_of_path(c)).collect::<String>();
    let parent = module.rsplit_once("::").map_or("", |(parent, _)| parent);
    let mut found = Vec::new();
    let is_ignored = |line: &str| line.starts_with("//") || line.starts_with("pub use ");
    for line in code.lines().filter(|line| !is_ignored(line.trim_start())) {
        found.extend(line.split("crate::").skip(1).map(path));
        found.extend(line.split("super::").skip(1).map(|rest| format!("{parent}::{}", path(rest))));
        found.extend(line.split_once("use ").map(|(_, rest)| format!("{module}::{}", path(rest))));
    }
    found
}

/// The innermost module that a path goes through.
fn module_of(path: &str, modules: &BTreeSet<String>) -> Option<String> {
    let parts: Vec<&str> = path.split("::").collect();
    (1..=parts.len()).rev().map(|n| parts[..n].join("::")).find(|m| modules.contains(m))
}
