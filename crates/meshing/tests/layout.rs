//! The order of the crate's modules: each one uses only those before it.

use std::collections::BTreeSet;
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

#[test]
fn modules_use_only_those_before_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = BTreeSet::new();
    let mut upward = Vec::new();
    for file in sources(&src).unwrap() {
        let path = file.strip_prefix(&src).unwrap();
        let module = path.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs");
        let position = position(module).unwrap_or_else(|| panic!("{module} has no place in ORDER"));
        found.insert(module.to_owned());
        for used in used_modules(&fs::read_to_string(&file).unwrap()) {
            if position < self::position(&used).unwrap_or(usize::MAX) {
                upward.push(format!("{} uses {used}", path.display()));
            }
        }
    }
    assert!(upward.is_empty(), "{upward:#?}");
    assert_eq!(found.len(), ORDER.len(), "ORDER names a module that does not exist");
}

/// Index of a module in [`ORDER`].
fn position(module: &str) -> Option<usize> {
    ORDER.iter().position(|&name| name == module)
}

/// The Rust files below a folder, without those of tests.
fn sources(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(sources(&path)?);
        } else if path.file_name().is_some_and(|name| name != "tests.rs" && name != "tuning.rs") {
            found.push(path);
        }
    }
    Ok(found)
}

/// The modules that the part of a file before its tests names by `crate::`, in `use` or elsewhere.
fn used_modules(text: &str) -> BTreeSet<String> {
    let code = text.split_once("#[cfg(test)]").map_or(text, |(code, _)| code);
    let code = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    let is_of_name = |c: char| c.is_ascii_lowercase() || c == '_';
    let name = |rest: &str| rest.chars().take_while(|&c| is_of_name(c)).collect::<String>();
    code.flat_map(|line| line.split("crate::").skip(1).map(name).collect::<Vec<_>>())
        .filter(|name| !name.is_empty())
        .collect()
}
