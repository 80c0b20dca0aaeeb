//! `pixmesh key`: creates a key and its line for the file of keys, lists the keys of a file, and revokes
//! some.

use super::{Key, file};
use clap::Args;
use pixmesh_jobs::record::Moment;
use std::error::Error;
use std::fmt::{Display, Write as _};
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// The digits of a digest that are shown of a key, and that name one.
const SHOWN_DIGITS: usize = 8;

/// The settings of `pixmesh key new`.
#[derive(Args, Clone, Debug)]
pub struct NewKey {
    /// Owner of the key: 1 to 64 letters, digits, '-', '_' and '.'.
    #[arg(value_parser = name)]
    pub name: String,
    /// File of keys to append the line to, created if missing. Without it the line is printed.
    #[arg(long)]
    pub keys_file: Option<PathBuf>,
    /// Let the key operate the jobs of all owners, on the listener for operations.
    #[arg(long)]
    pub operator: bool,
    /// When the key expires, such as 2027-01-31T00:00:00Z.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub expires: Option<Moment>,
}

/// A file of keys.
#[derive(Args, Clone, Debug)]
pub struct KeysFile {
    /// File of keys.
    #[arg(long = "keys-file", env = "PIXMESH_KEYS_FILE")]
    pub path: PathBuf,
}

/// The settings of `pixmesh key revoke`.
#[derive(Args, Clone, Debug)]
pub struct RevokedKey {
    /// The name whose keys are taken out, or the first 8 or more digits of one key's digest.
    pub key: String,
    /// The file.
    #[command(flatten)]
    pub file: KeysFile,
}

/// Prints a new key, once and for all: only its digest is kept. Its line goes to the file, or to
/// standard error.
///
/// # Errors
/// When the system has no random source, or the file cannot be written.
pub fn issue(order: &NewKey) -> Result<(), Box<dyn Error>> {
    let key = Key::random().map_err(|error| format!("no random numbers: {error}"))?;
    let mut line = format!("{} {}", order.name, key.digest());
    if order.operator {
        line += " operator";
    }
    if let Some(time) = order.expires {
        let _ = write!(line, " expires={time}");
    }
    line.push('\n');
    match &order.keys_file {
        Some(path) => append(path, &line)
            .map_err(|error| format!("--keys-file {}: {error}", path.display()))?,
        None => write!(io::stderr(), "line for --keys-file: {line}")?,
    }
    writeln!(io::stdout(), "{}", key.reveal())?;
    Ok(())
}

/// Prints the keys of a file: name, the digest's first digits, and what else their lines say.
///
/// # Errors
/// When the file cannot be read, or has a line that is none.
pub fn list(file: &KeysFile) -> Result<(), Box<dyn Error>> {
    for key in file::parse(&file.text()?).map_err(|error| file.error(&error))? {
        let (digest, now) = (key.digest.to_string(), Moment::now());
        let quota = key
            .requests_per_minute
            .map_or_else(String::new, |rate| format!(" requests-per-minute={rate}"));
        let operator = if key.is_operator { " operator" } else { "" };
        let expires = key.expires.map_or_else(String::new, |time| {
            format!("{}={time}", if time <= now { " expired" } else { " expires" })
        });
        let line = format!("{} {}{quota}{operator}{expires}", key.owner, &digest[..SHOWN_DIGITS]);
        writeln!(io::stdout(), "{line}")?;
    }
    Ok(())
}

/// Takes keys out of a file. A running service refuses them within a second.
///
/// # Errors
/// When there are no such keys, no other would be left, or the file cannot be replaced.
pub fn revoke(order: &RevokedKey) -> Result<(), Box<dyn Error>> {
    let (file, mut kept, mut revoked) = (&order.file, String::new(), 0);
    let text = file.text()?;
    file::parse(&text).map_err(|error| file.error(&error))?;
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let (name, digest) = (words.next(), words.next().unwrap_or_default());
        let is_digest = order.key.len() >= SHOWN_DIGITS
            && digest.to_ascii_lowercase().starts_with(&order.key.to_ascii_lowercase());
        if !line.trim_start().starts_with('#') && (name == Some(&order.key) || is_digest) {
            revoked += 1;
        } else {
            kept.extend([line, "\n"]);
        }
    }
    if revoked == 0 {
        return Err(file.error("there is no such key; `pixmesh key list` shows all").into());
    }
    if file::parse(&kept)?.is_empty() {
        let reason = "no key would be left, and a running service keeps the last ones in force: add \
                      another first, or stop the service and delete the file";
        return Err(file.error(reason).into());
    }
    file.replace(&kept).map_err(|error| file.error(&error))?;
    writeln!(io::stdout(), "keys revoked: {revoked}")?;
    Ok(())
}

impl KeysFile {
    fn text(&self) -> Result<String, String> {
        fs::read_to_string(&self.path).map_err(|error| self.error(&error))
    }

    /// Replaces the file at once, so that a service never reads half of it.
    fn replace(&self, text: &str) -> io::Result<()> {
        let permissions = fs::metadata(&self.path)?.permissions();
        let next = self.path.with_extension("new");
        let mut file = OpenOptions::new().create_new(true).write(true).mode(0o600).open(&next)?;
        let written = file
            .write_all(text.as_bytes())
            .and_then(|()| file.set_permissions(permissions))
            .and_then(|()| file.sync_all())
            .and_then(|()| fs::rename(&next, &self.path));
        if written.is_err() {
            let _ = fs::remove_file(&next);
        }
        written
    }

    fn error(&self, error: &(impl Display + ?Sized)) -> String {
        format!("--keys-file {}: {error}", self.path.display())
    }
}

/// Adds a line to a file that only its owner may read.
fn append(path: &Path, line: &str) -> io::Result<()> {
    let is_open = fs::read(path).is_ok_and(|text| text.last().is_some_and(|&b| b != b'\n'));
    let mut file = OpenOptions::new().create(true).append(true).mode(0o600).open(path)?;
    let separator = if is_open { "\n" } else { "" };
    file.write_all(format!("{separator}{line}").as_bytes())?;
    file.sync_all()
}

fn time(text: &str) -> Result<Moment, String> {
    Moment::parse(text).ok_or_else(|| "write a time as 2027-01-31T00:00:00Z".into())
}

fn name(text: &str) -> Result<String, String> {
    file::check_name(text).map(|()| text.to_owned())
}
