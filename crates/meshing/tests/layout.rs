//! The order of the crate's modules: each one uses only those before it, without cycles.

use pixmesh_test_support::layout::{Uses, cycles, uses};
use std::io;
use std::path::Path;

/// The modules of `src`, each before all that may use it.
const ORDER: [&str; 22] = [
    "alpha",
    "control",
    "image",
    "convert",
    "parallel",
    "parameters",
    "progress",
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
    let position = |module: &str| {
        let top = module.split("::").next().unwrap_or_default();
        ORDER.iter().position(|&name| name == top)
    };
    let mut upward = Vec::new();
    for (module, used) in crate_uses().unwrap() {
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
    let cycles = cycles(crate_uses().unwrap());
    assert!(cycles.is_empty(), "cycles among {cycles:#?}");
}

/// What the modules of the crate use.
fn crate_uses() -> io::Result<Uses> {
    uses(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"))
}
