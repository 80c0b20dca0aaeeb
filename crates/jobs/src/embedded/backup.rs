//! Copies a data folder while a service may be using it, and checks one.
//!
//! The copy of the database is one state of it (SQLite's online backup). A service deletes no blobs
//! until all blobs of that state are copied. The copy is a data folder that a service can start with.
//!
//! Literature: SQLite, "SQLite Backup API", 2024.

use super::read::search;
use super::{DATABASE, log_damage, schema};
use crate::blobs::Blobs;
use crate::folder::DataFolder;
use crate::queue::{QueueError, Search};
use crate::record::{JobId, Record, State};
use pixmesh_engine::digest::Digest;
use rusqlite::Connection;
use rusqlite::backup::{Backup, StepResult};
use std::collections::HashSet;
use std::error::Error;
use std::fs::{self, File};
use std::path::Path;
use std::thread;
use std::time::Duration;

/// The records that are read together.
const PAGE: usize = 1000;
/// The pause before a busy database is copied again.
const PAUSE: Duration = Duration::from_millis(100);

/// What a backup or a check found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// Jobs.
    pub jobs: usize,
    /// Pictures and meshes of the jobs.
    pub blobs: usize,
    /// Bytes of those that were copied or read.
    pub bytes: u64,
    /// What is damaged, one sentence each.
    pub damage: Vec<String>,
}

/// Copies the jobs of a data folder with their blobs to another folder, which may have an earlier copy.
/// Blobs that the earlier copy has are not copied again. Damaged blobs are left out and named.
///
/// # Errors
/// When a folder or the database cannot be used, or there is no room. The earlier copy remains then.
pub async fn back_up(data_dir: &Path, to: &Path) -> Result<Findings, Box<dyn Error>> {
    let source = open(data_dir)?;
    let folder = DataFolder::take(to, 0).map_err(|error| {
        let text = error.to_string();
        text.replacen("--data-dir ", "", 1)
    })?;
    let (from, blobs) = (blobs_of(data_dir)?, blobs_of(folder.path())?);
    let _held = from.hold()?;
    let copy = to.join(format!("{DATABASE}.new"));
    remove(&copy)?;
    let mut target = Connection::open(&copy)?;
    {
        let backup = Backup::new(&source, &mut target)?;
        while backup.step(-1)? != StepResult::Done {
            thread::sleep(PAUSE);
        }
    }
    // A copy of one file, without a log beside it.
    target.pragma_update(None, "journal_mode", "DELETE")?;
    let mut findings = Findings::default();
    let used = visit(&target, &mut findings, async |digest| {
        if blobs.has(digest).await? {
            return Ok(0);
        }
        let bytes = from.get(digest).await?;
        let count = bytes.len() as u64;
        blobs.put(&blobs.pin().await, digest, bytes).await.map(|()| count)
    })
    .await?;
    drop(target);
    File::open(&copy)?.sync_all()?;
    for log in ["-wal", "-shm"] {
        remove(&to.join(format!("{DATABASE}{log}")))?;
    }
    fs::rename(&copy, to.join(DATABASE))?;
    File::open(to)?.sync_all()?;
    if let Some(collector) = blobs.collector().await {
        for digest in blobs.all()?.into_iter().filter(|digest| !used.contains(digest)) {
            collector.delete(digest).await?;
        }
    }
    Ok(findings)
}

/// Checks the database of a data folder, every record, and every blob that a job uses.
///
/// # Errors
/// When the folder or the database cannot be read.
pub async fn check(data_dir: &Path) -> Result<Findings, Box<dyn Error>> {
    let (source, blobs) = (open(data_dir)?, blobs_of(data_dir)?);
    let _held = blobs.hold()?;
    let mut findings = Findings::default();
    source.pragma_query(None, "integrity_check", |row| {
        let text: String = row.get(0)?;
        if text != "ok" {
            findings.damage.push(format!("the database: {text}"));
        }
        Ok(())
    })?;
    let read = async |digest| blobs.get(digest).await.map(|bytes| bytes.len() as u64);
    visit(&source, &mut findings, read).await?;
    Ok(findings)
}

/// Opens the database of a folder with jobs for reading. Where no process uses the folder, the
/// write-ahead log must be whole, because SQLite would ignore damaged frames without a word.
fn open(data_dir: &Path) -> Result<Connection, Box<dyn Error>> {
    let path = data_dir.join(DATABASE);
    if !path.exists() {
        return Err(
            format!("there are no jobs in {}: no file {DATABASE}", data_dir.display()).into()
        );
    }
    let is_unused =
        File::open(data_dir.join("lock")).is_ok_and(|lock| lock.try_lock_shared().is_ok());
    if is_unused && log_damage::dropped(&data_dir.join(format!("{DATABASE}-wal")))?.transactions > 0
    {
        return Err(
            "the write-ahead log is damaged: start the service, which sets aside what is lost"
                .into(),
        );
    }
    let connection = schema::open_unchanged(&path);
    connection.map_err(|error| format!("{} cannot be read: {error}", path.display()).into())
}

fn blobs_of(data_dir: &Path) -> Result<Blobs, Box<dyn Error>> {
    Blobs::in_folder(&data_dir.join("blobs"))
}

fn remove(path: &Path) -> std::io::Result<()> {
    if path.exists() { fs::remove_file(path) } else { Ok(()) }
}

/// Visits each blob that a job uses once, and returns them all.
async fn visit(
    connection: &Connection,
    findings: &mut Findings,
    blob: impl AsyncFn(Digest) -> Result<u64, QueueError>,
) -> Result<HashSet<Digest>, Box<dyn Error>> {
    let (mut query, mut used) = (Search::default(), HashSet::new());
    loop {
        let page = search(connection, &query, PAGE)?;
        findings.jobs += page.jobs.len() + page.damaged.len();
        let unreadable = |job: &JobId| format!("job {job}: its record cannot be read");
        findings.damage.extend(page.damaged.iter().map(unreadable));
        for job in &page.jobs {
            for digest in blobs_of_job(job) {
                if !used.insert(digest) {
                    continue;
                }
                findings.blobs += 1;
                match blob(digest).await {
                    Ok(bytes) => findings.bytes += bytes,
                    Err(QueueError::Damaged(what)) => {
                        findings.damage.push(format!("job {}: {what}", job.id));
                    }
                    Err(error) => return Err(error.into()),
                }
            }
        }
        query.before = page.next;
        if page.next.is_none() {
            return Ok(used);
        }
    }
}

/// The picture until the job is completed or cancelled, and the mesh.
fn blobs_of_job(job: &Record) -> impl Iterator<Item = Digest> {
    let keeps_picture = !matches!(job.state, State::Completed | State::Cancelled);
    let mesh = job.mesh.as_ref().and_then(|mesh| mesh.digest.parse().ok());
    keeps_picture.then_some(job.picture.digest).into_iter().chain(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queue::Lookup;
    use crate::testing::{jobs, jobs_in, submit_picture, terms};
    use pixmesh_engine::Owner;

    #[tokio::test]
    async fn backup_of_a_folder_in_use_starts_with_all_its_jobs() {
        let (jobs, folder) = jobs(terms());
        let backup = tempfile::tempdir().unwrap();
        let (first, _) = submit_picture(&jobs, "first").await;
        let findings = back_up(folder.path(), backup.path()).await.unwrap();
        assert_eq!((findings.jobs, findings.blobs, findings.bytes), (1, 1, 5));
        jobs.queue.cancel(&Owner::Anonymous, first).await.unwrap();
        let (second, _) = submit_picture(&jobs, "second").await;
        let findings = back_up(folder.path(), backup.path()).await.unwrap();
        assert_eq!((findings.jobs, findings.blobs, findings.bytes), (2, 1, 6));
        assert_eq!(check(backup.path()).await.unwrap(), findings);
        let restored = jobs_in(backup.path(), terms());
        assert!(matches!(
            restored.queue.get(&Owner::Anonymous, second).await.unwrap(),
            Lookup::Found(record) if restored.blobs.get(record.picture.digest).await.unwrap() == "second"
        ));
        assert_eq!(restored.blobs.all().unwrap(), [Digest::of(b"second")]);
    }

    #[tokio::test]
    async fn service_deletes_no_blobs_during_a_backup() {
        let (jobs, folder) = jobs(terms());
        submit_picture(&jobs, "picture").await;
        let held = blobs_of(folder.path()).unwrap().hold().unwrap();
        assert!(jobs.blobs.collector().await.is_none());
        drop(held);
        assert!(jobs.blobs.collector().await.is_some());
    }

    #[tokio::test]
    async fn check_names_the_job_with_a_damaged_blob_or_record() {
        let (jobs, folder) = jobs(terms());
        let (first, digest) = submit_picture(&jobs, "picture").await;
        let (second, _) = submit_picture(&jobs, "another").await;
        assert_eq!(check(folder.path()).await.unwrap().damage, [""; 0]);
        let name = digest.to_string();
        fs::write(folder.path().join("blobs").join(&name[..2]).join(&name), "other").unwrap();
        let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
        let sql = "UPDATE jobs SET image_shape = '{' WHERE id = ?1";
        connection.execute(sql, [second.as_bytes()]).unwrap();
        let damage = check(folder.path()).await.unwrap().damage;
        assert_eq!(damage.len(), 2, "{damage:?}");
        assert!(damage.iter().any(|what| what.contains(&first.to_string())), "{damage:?}");
        assert!(damage.iter().any(|what| what.contains(&second.to_string())), "{damage:?}");
    }

    #[tokio::test]
    async fn folder_without_jobs_and_target_in_use_are_refused() {
        let (jobs, folder) = jobs(terms());
        let empty = tempfile::tempdir().unwrap();
        let error = check(&empty.path().join("nowhere")).await.unwrap_err().to_string();
        assert!(error.contains("no jobs"), "{error}");
        assert_eq!(empty.path().read_dir().unwrap().count(), 0);
        let error = back_up(folder.path(), folder.path()).await.unwrap_err().to_string();
        assert!(error.contains("another process"), "{error}");
        drop(jobs);
    }
}
