//! A file of keys for a test.

use crate::server::program;
use std::fs;
use std::path::PathBuf;

/// A file of keys of its own for a test, empty at first.
pub(crate) struct KeysFile(PathBuf);

impl KeysFile {
    pub(crate) fn new(test: &str) -> Self {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}.keys"));
        let _ = fs::remove_file(&path);
        Self(path)
    }

    pub(crate) fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }

    /// Makes a key with the program, as an operator would.
    pub(crate) fn issue(&self, name: &str) -> String {
        self.issue_as(name, &[])
    }

    /// Makes a key with further flags.
    pub(crate) fn issue_as(&self, name: &str, flags: &[&str]) -> String {
        let mut command = program();
        command.args(["key", "new", name, "--keys-file", self.path()]).args(flags);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }

    pub(crate) fn edit(&self, change: impl FnOnce(String) -> String) {
        let text = fs::read_to_string(&self.0).unwrap();
        fs::write(&self.0, change(text)).unwrap();
    }
}
