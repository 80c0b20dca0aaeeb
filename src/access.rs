//! API keys, their quotas, and the [`Shares`] of connections and event streams.
//!
//! Without a file of keys everyone is [anonymous](Owner::Anonymous), without a quota. With one,
//! every request below `/v1/` needs a key. The file holds a digest of each key and never the key
//! ([`file`]). It is read again when it changes, so that a key can be added before the old one of
//! the same name is taken out, and a leaked one is refused within seconds; a file that cannot be
//! read leaves the keys in force as they are.

mod file;
mod issue;
mod key;
mod quota;
mod shares;

pub use file::{KeyLine, parse};
pub use issue::{KeysFile, NewKey, RevokedKey, issue, list, revoke};
pub use key::{Digest, Key};
pub use quota::{Quota, Standing};
pub use shares::{Share, Shares};

use crate::config::AccessSettings;
use pixmesh_engine::Owner;
use pixmesh_jobs::record::Moment;
use std::error::Error;
use std::fs;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;
use tokio::task::spawn_blocking;

/// How often the file of keys is looked at.
const RELOAD_EVERY: Duration = Duration::from_secs(1);

/// The keys in force.
#[derive(Debug)]
pub struct KeyRing {
    path: PathBuf,
    requests_per_minute: NonZeroU32,
    entries: RwLock<Vec<Entry>>,
}

/// One key, and the quota that all keys of its name share.
#[derive(Clone, Debug)]
struct Entry {
    line: KeyLine,
    quota: Arc<Quota>,
}

/// Whom a key stands for.
#[derive(Clone, Debug)]
pub struct Holder {
    /// The owner of what the key's requests make.
    pub owner: Owner,
    /// Whether the key may operate the jobs of all owners.
    pub is_operator: bool,
    /// The quota of the key's name.
    pub quota: Arc<Quota>,
}

impl KeyRing {
    /// The keys of the file that the settings name, if they name one.
    ///
    /// # Errors
    /// When the file cannot be read, has an invalid line, or has no key.
    pub fn of(settings: &AccessSettings) -> Result<Option<Self>, Box<dyn Error>> {
        let Some(path) = settings.keys_file.clone() else { return Ok(None) };
        let ring = Self {
            path,
            requests_per_minute: settings.key_requests_per_minute,
            entries: RwLock::default(),
        };
        ring.replace(&read(&ring.path)?);
        Ok(Some(ring))
    }

    /// Whom a key stands for, unless it has expired. Every key is compared in full, so that the time
    /// tells nothing of how much of one was guessed.
    #[must_use]
    pub fn find(&self, presented: &str) -> Option<Holder> {
        let digest = Digest::of(presented);
        let entries = self.entries.read().unwrap_or_else(PoisonError::into_inner);
        let mut found = None;
        for entry in &*entries {
            if entry.line.digest.matches(&digest) {
                found = Some(entry);
            }
        }
        let found =
            found.filter(|found| found.line.expires.is_none_or(|time| time > Moment::now()));
        found.map(|Entry { line, quota }| Holder {
            owner: line.owner.clone(),
            is_operator: line.is_operator,
            quota: Arc::clone(quota),
        })
    }

    /// Reloads the file whenever it changes, for ever.
    pub async fn keep_up(self: Arc<Self>) {
        let mut ticks = tokio::time::interval(RELOAD_EVERY);
        let mut before = None;
        loop {
            ticks.tick().await;
            let ring = Arc::clone(&self);
            let now = spawn_blocking(move || read(&ring.path)).await;
            let now = now.unwrap_or_else(|error| Err(error.to_string()));
            if before.as_ref() != Some(&now) {
                self.report_and_replace(&now, before.is_none());
                before = Some(now);
            }
        }
    }

    fn report_and_replace(&self, lines: &Result<Vec<KeyLine>, String>, is_first: bool) {
        match lines {
            Ok(lines) => {
                self.replace(lines);
                if !is_first {
                    tracing::info!(keys = lines.len(), "keys file reloaded");
                }
            }
            Err(error) => {
                tracing::error!(error, "keys file not reloaded; the previous keys stay valid");
            }
        }
    }

    /// Replaces the keys; a name that stays keeps the rest of its quota.
    fn replace(&self, lines: &[KeyLine]) {
        let mut entries = self.entries.write().unwrap_or_else(PoisonError::into_inner);
        let mut next: Vec<Entry> = Vec::with_capacity(lines.len());
        for line in lines {
            let rate = line.requests_per_minute.unwrap_or(self.requests_per_minute);
            let mut known = next.iter().chain(entries.iter());
            let same = known.find(|e| e.line.owner == line.owner && e.quota.per_minute() == rate);
            let quota = same.map_or_else(|| Arc::new(Quota::new(rate)), |e| Arc::clone(&e.quota));
            next.push(Entry { line: line.clone(), quota });
        }
        *entries = next;
    }
}

/// The lines of a file of keys. A file without any is refused: it may be about to be written.
fn read(path: &Path) -> Result<Vec<KeyLine>, String> {
    let text = fs::read_to_string(path)
        .map_err(|error| format!("--keys-file {} cannot be read: {error}", path.display()))?;
    match parse(&text) {
        Ok(lines) if lines.is_empty() => {
            Err(format!("--keys-file {} holds no key: `pixmesh key new` makes one", path.display()))
        }
        read => read.map_err(|error| format!("--keys-file {}: {error}", path.display())),
    }
}
