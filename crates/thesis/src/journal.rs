//! The journal of finished cases, so that a run that was stopped goes on where it was.
//!
//! A text file of comma-separated values, one line for each case, written at once when the case
//! is done. A line that was cut off when the program was stopped is taken away by the next run.
//! Cases are known by the picture's name and checksum, so that a changed picture is not taken from
//! the journal, and by the version of this crate, whose meshes another version need not make.

use crate::ThesisError;
use crate::csv;
use pixmesh_cli::CliError;
use std::collections::HashMap;
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The first line of every journal.
pub const HEADER: &str = "version,image,digest,components,case,psnr_db,seconds";

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What a case is known by.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Key {
    /// Name of the picture.
    pub image: String,
    /// Its checksum.
    pub digest: u64,
    /// Components of the image, 1 or 3.
    pub components: usize,
    /// [`code`](super::cases::Case::code) of the case.
    pub code: String,
}

/// What came of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// PSNR in decibels, [`f64::INFINITY`] for a perfect copy.
    pub psnr_db: f64,
    /// How long it took, in seconds, if it ran alone.
    pub seconds: Option<f64>,
}

/// The finished cases of earlier runs, and the file that this run's are added to.
#[derive(Default)]
pub struct Journal {
    known: HashMap<Key, Outcome>,
    file: Option<(Mutex<File>, String)>,
}

impl Journal {
    /// Opens a journal, or begins a new one.
    ///
    /// # Errors
    /// When the file cannot be read or written, is something else than a journal, which is left
    /// as it is, or is used by another run.
    pub fn open(path: &Path) -> Result<Self, ThesisError> {
        let name = path.display().to_string();
        let failed = |source| CliError::File { name: name.clone(), source };
        let mut options = File::options();
        let options = options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(path).map_err(failed)?;
        match file.try_lock() {
            // Where files cannot be locked, the user must see to it.
            Ok(()) | Err(TryLockError::Error(_)) => {}
            Err(TryLockError::WouldBlock) => return Err(ThesisError::JournalInUse { name }),
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        if !is_journal(&bytes) {
            return Err(ThesisError::NotAJournal { name });
        }
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        let known = String::from_utf8_lossy(&bytes[..whole]).lines().filter_map(read).collect();
        cut(&mut file, whole).map_err(failed)?;
        Ok(Self { known, file: Some((Mutex::new(file), name)) })
    }

    /// What came of a case in an earlier run.
    #[must_use]
    pub fn find(&self, key: &Key) -> Option<Outcome> {
        self.known.get(key).copied()
    }

    /// Adds a finished case.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&self, key: &Key, outcome: Outcome) -> Result<(), CliError> {
        let Some((file, name)) = &self.file else { return Ok(()) };
        let line = format!("{}\n", write(key, outcome));
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .map_err(|source| CliError::File { name: name.clone(), source })
    }
}

/// Tells whether a file is a journal, or was to become one.
fn is_journal(bytes: &[u8]) -> bool {
    let header = format!("{HEADER}\n");
    bytes.starts_with(header.as_bytes()) || header.as_bytes().starts_with(bytes)
}

/// Leaves the lines that are whole, at least the first, and goes to the end.
fn cut(file: &mut File, whole: usize) -> io::Result<()> {
    file.set_len(whole as u64)?;
    file.seek(SeekFrom::End(0))?;
    if whole == 0 { writeln!(file, "{HEADER}") } else { Ok(()) }
}

/// The line of a case.
fn write(key: &Key, outcome: Outcome) -> String {
    let seconds = outcome.seconds.map_or(String::new(), |seconds| seconds.to_string());
    csv::join(&[
        VERSION,
        &key.image,
        &format!("{:016x}", key.digest),
        &key.components.to_string(),
        &key.code,
        &outcome.psnr_db.to_string(),
        &seconds,
    ])
}

/// A line's case, if it is one of this version.
fn read(line: &str) -> Option<(Key, Outcome)> {
    let [version, image, digest, components, code, psnr_db, seconds] =
        <[String; 7]>::try_from(csv::split(line)?).ok()?;
    if version != VERSION {
        return None;
    }
    let (digest, components) = (u64::from_str_radix(&digest, 16).ok()?, components.parse().ok()?);
    let seconds = if seconds.is_empty() { None } else { Some(seconds.parse().ok()?) };
    let outcome = Outcome { psnr_db: psnr_db.parse().ok()?, seconds };
    Some((Key { image, digest, components, code }, outcome))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> Key {
        let (image, code) = ("a,\"b\"".to_owned(), "psa_d classic components 2".to_owned());
        Key { image, digest: 0xfeed, components: 1, code }
    }

    #[test]
    fn a_line_reads_back_as_the_case_it_was_written_for() {
        for (psnr_db, seconds) in [(26.123_456_789_012_345, None), (f64::INFINITY, Some(0.0125))] {
            let outcome = Outcome { psnr_db, seconds };
            assert_eq!(read(&write(&key(), outcome)), Some((key(), outcome)));
        }
    }

    #[test]
    fn lines_of_another_version_are_not_taken() {
        let line = write(&key(), Outcome { psnr_db: 30.0, seconds: None });
        assert_eq!(read(&line.replacen(VERSION, "0.0.0", 1)), None);
        assert_eq!(read("nonsense"), None);
    }

    #[test]
    fn only_a_journal_or_the_beginning_of_one_is_written_to() {
        assert!(is_journal(b"") && is_journal(b"version,im"));
        assert!(is_journal(format!("{HEADER}\n0.1.0,x").as_bytes()));
        assert!(!is_journal(b"\x89PNG") && !is_journal(format!("{HEADER},more\n").as_bytes()));
    }
}
