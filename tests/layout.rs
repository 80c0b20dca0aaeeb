//! The modules of the service and of the crates that it is made of use each other without cycles.

use pixmesh_test_support::layout::{cycles, uses};
use std::io;
use std::path::Path;

/// The modules on cycles below a folder of sources.
fn cycles_below(src: &str) -> io::Result<Vec<String>> {
    let uses = uses(&Path::new(env!("CARGO_MANIFEST_DIR")).join(src))?;
    assert!(uses.len() > 5, "{src} has {} modules", uses.len());
    Ok(cycles(uses).into_iter().map(|(module, used)| format!("{module} uses {used:?}")).collect())
}

#[test]
fn the_service_has_no_cycles() {
    assert_eq!(cycles_below("src").unwrap(), [""; 0]);
}

#[test]
fn the_engine_has_no_cycles() {
    assert_eq!(cycles_below("crates/engine/src").unwrap(), [""; 0]);
}

#[test]
fn the_programs_have_no_cycles() {
    assert_eq!(cycles_below("crates/cli/src").unwrap(), [""; 0]);
}

#[test]
fn the_queue_has_no_cycles() {
    assert_eq!(cycles_below("crates/jobs/src").unwrap(), [""; 0]);
}
