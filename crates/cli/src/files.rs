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

/// The file of an argument; `None` for `-`, the standard stream.
#[must_use]
pub fn named(path: &Path) -> Option<&Path> {
    Some(path).filter(|path| path.as_os_str() != "-")
}

/// Writes a file whole as [`write()`] does, but one that exists stays as it was until the new one is
/// complete.
///
/// # Errors
/// When it cannot be written; the error carries the name.
pub fn replace(path: Option<&Path>, bytes: &[u8]) -> Result<(), CliError> {
    let Some(path) = path else { return write(None, bytes) };
    let before = std::fs::symlink_metadata(path);
    if before.as_ref().is_ok_and(|before| !before.is_file()) {
        // A device or a link is written to, not replaced.
        return write(Some(&path.to_owned()), bytes);
    }
    let part = path.with_added_extension(format!("{}.part", std::process::id()));
    let keep = |before: std::fs::Metadata| std::fs::set_permissions(&part, before.permissions());
    let written = std::fs::write(&part, bytes)
        .and_then(|()| before.map_or(Ok(()), keep))
        .and_then(|()| std::fs::rename(&part, path));
    written.map_err(|source| {
        // What is left of it is of no use, and the first error is the one to tell.
        let _ = std::fs::remove_file(&part);
        CliError::File { name: path.display().to_string(), source }
    })
}

/// What messages call a file, or the stream that stands for it.
#[must_use]
pub fn name(path: Option<&Path>, stream: &str) -> String {
    path.map_or_else(|| stream.to_owned(), |path| path.display().to_string())
}
