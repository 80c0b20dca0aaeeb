//! `pixmesh key new`: creates a key, and its line for the file of keys.

use super::{Key, file};
use clap::Args;
use std::error::Error;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// The settings of `pixmesh key new`.
#[derive(Args, Clone, Debug)]
pub struct NewKey {
    /// Owner of the key: 1 to 64 letters, digits, '-', '_' and '.'.
    #[arg(value_parser = name)]
    pub name: String,
    /// File of keys to append the line to, created if missing. Without it the line is printed.
    #[arg(long)]
    pub keys_file: Option<PathBuf>,
}

/// Prints a new key, once and for all: only its digest is kept. Its line goes to the file, or to
/// standard error.
///
/// # Errors
/// When the system has no random source, or the file cannot be written.
pub fn issue(order: &NewKey) -> Result<(), Box<dyn Error>> {
    let key = Key::random().map_err(|error| format!("no random numbers: {error}"))?;
    let line = format!("{} {}\n", order.name, key.digest());
    match &order.keys_file {
        Some(path) => append(path, &line)
            .map_err(|error| format!("--keys-file {}: {error}", path.display()))?,
        None => write!(io::stderr(), "line for --keys-file: {line}")?,
    }
    writeln!(io::stdout(), "{}", key.reveal())?;
    Ok(())
}

/// Adds a line to a file that only its owner may read.
fn append(path: &Path, line: &str) -> io::Result<()> {
    let is_open = std::fs::read(path).is_ok_and(|text| text.last().is_some_and(|&b| b != b'\n'));
    let mut file = OpenOptions::new().create(true).append(true).mode(0o600).open(path)?;
    let separator = if is_open { "\n" } else { "" };
    file.write_all(format!("{separator}{line}").as_bytes())?;
    file.sync_all()
}

fn name(text: &str) -> Result<String, String> {
    file::check_name(text).map(|()| text.to_owned())
}
