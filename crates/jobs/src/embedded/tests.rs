//! The conformance tests, and tests of the folder, of damage and of versions.

use super::*;
use crate::conformance::{Engine, conforms};
use crate::queue::MAX_ATTEMPTS;
use crate::testing::{job, submit, terms};
use rusqlite::Connection;
use std::path::Path;
use tempfile::TempDir;

/// A queue in a folder of its own.
struct InFolder(TempDir);

#[async_trait]
impl Engine for InFolder {
    const SHORT: Duration = Duration::from_millis(50);
    const LEASE: Duration = Duration::from_hours(1);

    async fn open(&self, terms: Terms) -> Arc<dyn Queue> {
        Arc::new(open(self.0.path(), terms))
    }

    /// The folder belongs to one process, so a new one ends all leases.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue> {
        self.open(terms).await
    }
}

fn open(path: &Path, terms: Terms) -> Embedded {
    let folder = Arc::new(DataFolder::take(path, 0).unwrap());
    Embedded::open(folder, terms).unwrap()
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn engine(_: &str) -> InFolder {
    InFolder(folder())
}

conforms! { engine, InFolder }

#[test]
fn folder_of_another_process_is_refused() {
    let folder = folder();
    let first = DataFolder::take(folder.path(), 0).unwrap();
    let error = DataFolder::take(folder.path(), 0).unwrap_err().to_string();
    assert!(error.contains("another process") && error.contains("--data-dir"), "{error}");
    drop(first);
    assert!(DataFolder::take(folder.path(), 0).is_ok());
}

#[tokio::test]
async fn damaged_record_fails_its_job_only() {
    let folder = folder();
    let queue = open(folder.path(), terms());
    let (damaged, whole) = (job(&Owner::Anonymous, "damaged"), job(&Owner::Anonymous, "whole"));
    queue.submit(damaged.clone()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
    let sql = "UPDATE jobs SET image_shape = '{' WHERE id = ?1";
    connection.execute(sql, [damaged.id.as_bytes()]).unwrap();
    let claim = queue.claim().await.unwrap().unwrap();
    assert_eq!(claim.lease.job, whole.id);
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&Owner::Anonymous, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole.id]);
    let Stats { queued, running, .. } = queue.stats().await.unwrap();
    assert_eq!((queued, running), (0, 1), "the damaged job has failed");
    drop(queue);
    assert!(open(folder.path(), terms()).claim().await.unwrap().is_some());
}

#[tokio::test]
async fn record_with_a_damaged_id_is_ignored() {
    let folder = folder();
    let (queue, owner) = (open(folder.path(), terms()), Owner::named("a"));
    let damaged = submit(&queue, &owner, "damaged").await;
    let whole = submit(&queue, &owner, "whole").await;
    let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
    let sql = "UPDATE jobs SET id = x'00' WHERE id = ?1";
    connection.execute(sql, [damaged.as_bytes()]).unwrap();
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&owner, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole]);
    drop(queue);
    let queue = open(folder.path(), terms());
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, whole);
    assert_eq!(queue.claim().await.unwrap(), None);
    queue.sweep().await.unwrap();
}

#[tokio::test]
async fn removed_or_replaced_folder_is_noticed() {
    let parent = folder();
    let path = parent.path().join("data");
    let queue = open(&path, terms());
    assert!(queue.is_healthy() && queue.check_room().is_ok());
    let away = parent.path().join("away");
    fs::rename(&path, &away).unwrap();
    assert!(!queue.is_healthy());
    assert!(matches!(queue.check_room(), Err(QueueError::Storage(_))));
    fs::create_dir(&path).unwrap();
    assert!(!queue.is_healthy(), "another folder in its place");
    fs::remove_dir(&path).unwrap();
    fs::rename(&away, &path).unwrap();
    assert!(queue.is_healthy() && queue.check_room().is_ok());
    fs::remove_file(path.join(DATABASE)).unwrap();
    assert!(!queue.is_healthy());
}

#[tokio::test]
async fn idle_queue_waits_and_returns_its_own_mean() {
    let folder = folder();
    let queue = open(folder.path(), terms());
    let short = Duration::from_millis(20);
    assert!(tokio::time::timeout(short, queue.work()).await.is_err());
    queue.submit(job(&Owner::Anonymous, "work")).await.unwrap();
    queue.work().await;
    for own in [None, Some(2.5)] {
        assert_eq!(queue.mean_duration_s(own).await.unwrap(), own);
    }
}

#[tokio::test]
async fn sweep_counts_requeued_and_exhausted_jobs() {
    let folder = folder();
    let queue = open(folder.path(), Terms { lease: Duration::ZERO, ..terms() });
    queue.submit(job(&Owner::Anonymous, "image")).await.unwrap();
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(queue.claim().await.unwrap().unwrap().attempt, attempt);
        let Swept { requeued, exhausted, .. } = queue.sweep().await.unwrap();
        let is_last = attempt == MAX_ATTEMPTS;
        assert_eq!((requeued, exhausted), if is_last { (0, 1) } else { (1, 0) });
    }
}

#[tokio::test]
async fn version_2_is_migrated() {
    let folder = folder();
    drop(open(folder.path(), terms()));
    let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
    let tables_of_version_2 = "
        DROP TABLE kept_keys; DROP TABLE paused; DROP INDEX jobs_in_state;
        DROP INDEX jobs_with_problem; ALTER TABLE jobs DROP COLUMN problem_type;
        PRAGMA user_version = 2";
    connection.execute_batch(tables_of_version_2).unwrap();
    drop(connection);
    let queue = open(folder.path(), terms());
    let id = submit(&queue, &Owner::Anonymous, "image").await;
    queue.cancel(&Owner::Anonymous, id).await.unwrap();
    assert_eq!(
        queue.cancel(&Owner::Anonymous, id).await.unwrap(),
        Cancellation::Deleted,
        "which writes to the new table"
    );
}

#[test]
fn other_version_is_refused() {
    let folder = folder();
    drop(open(folder.path(), terms()));
    let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
    connection.pragma_update(None, "user_version", 99).unwrap();
    let taken = Arc::new(DataFolder::take(folder.path(), 0).unwrap());
    let error = Embedded::open(taken, terms()).unwrap_err().to_string();
    assert!(error.contains("99") && error.contains("version"), "{error}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn concurrent_submissions_are_acknowledged() {
    let folder = folder();
    let queue = Arc::new(open(folder.path(), terms()));
    let submissions = (0..640).map(|i| queue.submit(job(&Owner::Anonymous, &i.to_string())));
    let submitted = futures_util::future::join_all(submissions).await;
    assert!(submitted.iter().all(|submitted| matches!(submitted, Ok(Submitted::Created(_)))));
}

#[test]
fn frequent_queries_use_indexes() {
    let folder = folder();
    drop(open(folder.path(), terms()));
    let connection = Connection::open(folder.path().join(DATABASE)).unwrap();
    for sql in [
        "SELECT COUNT(*) FROM jobs WHERE state = 0",
        "SELECT COUNT(*) FROM jobs WHERE state = 0 AND owner = 'a'",
        "SELECT id FROM jobs WHERE state = 0 AND owner = 'a' ORDER BY id LIMIT 1",
        "SELECT min(owner) FROM jobs WHERE state = 0 AND owner > 'a'",
        "SELECT id FROM jobs WHERE state = 1 AND lease_end <= 5",
        "SELECT id FROM jobs WHERE expires_at <= 5",
        "SELECT id FROM jobs WHERE owner = 'a' AND id < 'x' ORDER BY id DESC",
        "SELECT 1 FROM jobs WHERE state IN (0, 1, 3) AND image_digest = 'x'",
        "SELECT id FROM jobs WHERE length(id) = 16 AND NULL IS NULL AND state = 3 AND NULL IS NULL
           AND id >= x'00' AND id < x'ff' ORDER BY id DESC LIMIT 9",
        "SELECT id FROM jobs WHERE length(id) = 16 AND owner = 'a' AND state = 3 AND NULL IS NULL
           AND id >= x'00' AND id < x'ff' ORDER BY id DESC LIMIT 9",
        "SELECT id FROM jobs WHERE length(id) = 16 AND NULL IS NULL AND NULL IS NULL
           AND problem_type = 'b' AND id >= x'00' AND id < x'ff' ORDER BY id DESC LIMIT 9",
    ] {
        let plan: Vec<String> = connection
            .prepare(&format!("EXPLAIN QUERY PLAN {sql}"))
            .unwrap()
            .query_map([], |row| row.get("detail"))
            .unwrap()
            .collect::<Result<_, _>>()
            .unwrap();
        let scans = |step: &String| step.starts_with("SCAN jobs") && !step.contains("INDEX");
        let sorts = |step: &String| step.contains("TEMP B-TREE");
        assert!(!plan.iter().any(|step| scans(step) || sorts(step)), "{sql}: {plan:?}");
    }
}
