//! Programs of others, which may not be there.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A path in the checkout.
pub(crate) fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Whether a program or file is there; where all must be, its absence is a failure.
pub(crate) fn is_there(tool: &str) -> bool {
    let as_file = checkout(tool).exists();
    let finds = Command::new("sh").args(["-c", &format!("command -v '{tool}'")]).output().unwrap();
    if as_file || finds.status.success() {
        return true;
    }
    assert!(std::env::var_os("PIXMESH_REQUIRE_TOOLS").is_none(), "{tool} is missing");
    eprintln!("left out: {tool} is missing; ./test installs it");
    false
}

/// Runs a program, and returns what it printed.
#[track_caller]
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", text(&output));
    text(&output)
}

/// All that a program printed.
pub(crate) fn text(output: &Output) -> String {
    String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned()
}
