//! Programs of others, which `./test` installs.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A path in the checkout.
pub(crate) fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Fails a test that needs a program or file of the checkout where it is missing.
#[track_caller]
pub(crate) fn require(tool: &str) {
    let as_file = checkout(tool).exists();
    let finds = Command::new("sh").args(["-c", &format!("command -v '{tool}'")]).output().unwrap();
    assert!(as_file || finds.status.success(), "{tool} is missing; ./test installs it");
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
