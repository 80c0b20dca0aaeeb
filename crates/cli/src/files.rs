//! Where bytes come from and go to: named files, or the standard streams.

use crate::CliError;
use pixmesh_codec::Limits;
use pixmesh_meshing::MAX_SIDE;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// What the programs read: a user's own files are bounded by what the methods can do alone.
pub const LIMITS: Limits = Limits { max_pixels: 1 << 32, max_side: MAX_SIDE };

/// Reads a file whole, or standard input when none is named.
///
/// # Errors
/// When it cannot be read; the error carries the name.
pub fn read(path: Option<&Path>) -> Result<Vec<u8>, CliError> {
    let mut bytes = Vec::new();
    match path {
        Some(path) => File::open(path).and_then(|mut file| file.read_to_end(&mut bytes)),
        None => io::stdin().lock().read_to_end(&mut bytes),
    }
    .map_err(|source| CliError::File { name: name(path, "standard input"), source })?;
    Ok(bytes)
}

/// Writes a file whole, or standard output when none is named.
///
/// # Errors
/// When it cannot be written; the error carries the name.
pub fn write(path: Option<&PathBuf>, bytes: &[u8]) -> Result<(), CliError> {
    match path {
        Some(path) => std::fs::write(path, bytes),
        None => {
            let mut output = io::stdout().lock();
            output.write_all(bytes).and_then(|()| output.flush())
        }
    }
    .map_err(|source| CliError::File {
        name: name(path.map(PathBuf::as_path), "standard output"),
        source,
    })
}

/// What messages call a file, or the stream that stands for it.
#[must_use]
pub fn name(path: Option<&Path>, stream: &str) -> String {
    path.map_or_else(|| stream.to_owned(), |path| path.display().to_string())
}
