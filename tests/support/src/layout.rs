//! Which modules of a crate use which.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// For each module, named by its path from the crate's root, the modules that it uses.
pub type Uses = BTreeMap<String, BTreeSet<String>>;

/// The modules on cycles, with what they use of each other; empty where there is no cycle.
#[must_use]
pub fn cycles(mut uses: Uses) -> Uses {
    // A module that uses none of those left is on no cycle.
    while let Some(module) = uses.iter().find(|(_, used)| used.is_empty()).map(|(m, _)| m.clone()) {
        uses.remove(&module);
        uses.values_mut().for_each(|used| _ = used.remove(&module));
    }
    uses
}

/// What the modules below a folder `src` use, tests aside.
///
/// # Errors
/// When a file cannot be read.
pub fn uses(src: &Path) -> io::Result<Uses> {
    let mut texts = BTreeMap::new();
    for file in sources(src)? {
        let path = file.strip_prefix(src).unwrap_or(&file).with_extension("");
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
    let exports = |line: &str| line.starts_with("pub") && line.contains(" use ");
    let is_ignored = |line: &str| line.starts_with("//") || exports(line);
    for line in code.lines().filter(|line| !is_ignored(line.trim_start())) {
        let line = line.replace("pub(in crate::", "pub(in ");
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
