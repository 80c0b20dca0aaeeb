//! The embedded engine keeps the promises of all engines, and a few of its own.

use super::*;
use crate::conformance::{Engine, conforms};
use crate::fairness::Caps;
use crate::folder_for_test;
use crate::queue::MAX_ATTEMPTS;
use crate::record::Picture;
use rusqlite::Connection;
use std::path::PathBuf;
use std::time::Duration;

/// A queue in a folder of its own.
struct InFolder(PathBuf);

#[async_trait]
impl Engine for InFolder {
    const SHORT: Duration = Duration::from_millis(50);
    const LEASE: Duration = Duration::from_secs(3600);

    async fn open(&self, terms: Terms) -> Arc<dyn Queue> {
        Arc::new(open(&self.0, terms))
    }

    /// The folder is this process's alone: whoever ran jobs there before has ended.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue> {
        self.open(terms).await
    }
}

impl Drop for InFolder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn open(path: &std::path::Path, terms: Terms) -> Embedded {
    // The thread that writes has the last of the database, and ends soon after its queue.
    let folder = Arc::new(DataFolder::take(path).unwrap());
    Embedded::open(folder, terms).unwrap()
}

fn engine(name: &str) -> InFolder {
    InFolder(folder_for_test(name))
}

conforms! { engine, InFolder }

fn terms() -> Terms {
    let hour = Duration::from_secs(3600);
    let caps = Caps { queued: 1000, queued_per_owner: 1000, running_per_owner: 1000 };
    Terms {
        caps,
        lease: hour,
        result_ttl: hour,
        idempotency_ttl: hour,
        gone_ttl: hour,
        look_again: hour,
    }
}

fn job(image: &str) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: Owner::Anonymous,
        order: "density=2".into(),
        picture: Picture::of_bytes(image.as_bytes()),
        idempotency_key: None,
    }
}

#[test]
fn a_second_process_is_refused_the_folder() {
    let engine = engine("second");
    let first = DataFolder::take(&engine.0).unwrap();
    let error = DataFolder::take(&engine.0).unwrap_err().to_string();
    assert!(error.contains("another process") && error.contains("--data-dir"), "{error}");
    drop(first);
    assert!(DataFolder::take(&engine.0).is_ok());
}

#[tokio::test]
async fn a_damaged_record_is_set_aside_and_the_others_go_on() {
    let engine = engine("damaged");
    let queue = open(&engine.0, terms());
    let (damaged, whole) = (job("damaged"), job("whole"));
    queue.submit(damaged.clone()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    let connection = Connection::open(engine.0.join(DATABASE)).unwrap();
    let sql = "UPDATE jobs SET image_shape = '{' WHERE id = ?1";
    connection.execute(sql, [damaged.id.as_bytes()]).unwrap();
    let claim = queue.claim().await.unwrap().unwrap();
    assert_eq!(claim.lease.job, whole.id);
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&Owner::Anonymous, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole.id]);
    let Stats { queued, running, .. } = queue.stats().await.unwrap();
    assert_eq!((queued, running), (0, 1), "the damaged one has come to its end");
    drop(queue);
    assert!(open(&engine.0, terms()).claim().await.unwrap().is_some());
}

#[tokio::test]
async fn a_queue_without_work_is_waited_for_and_tells_a_node_its_own_mean() {
    let engine = engine("idle");
    let queue = open(&engine.0, terms());
    let moment = Duration::from_millis(20);
    assert!(tokio::time::timeout(moment, queue.work()).await.is_err());
    queue.submit(job("work")).await.unwrap();
    queue.work().await;
    for own in [None, Some(2.5)] {
        assert_eq!(queue.mean_duration_s(own).await.unwrap(), own);
    }
}

#[tokio::test]
async fn a_sweep_counts_the_jobs_that_wait_again_and_those_that_failed_for_good() {
    let engine = engine("swept");
    let queue = open(&engine.0, Terms { lease: Duration::ZERO, ..terms() });
    queue.submit(job("silent")).await.unwrap();
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(queue.claim().await.unwrap().unwrap().attempt, attempt);
        let Swept { requeued, exhausted, .. } = queue.sweep().await.unwrap();
        let is_last = attempt == MAX_ATTEMPTS;
        assert_eq!((requeued, exhausted), if is_last { (0, 1) } else { (1, 0) });
    }
}

#[test]
fn tables_of_another_version_are_refused_with_both_numbers() {
    let engine = engine("version");
    drop(open(&engine.0, terms()));
    let connection = Connection::open(engine.0.join(DATABASE)).unwrap();
    connection.pragma_update(None, "user_version", 99).unwrap();
    let folder = Arc::new(DataFolder::take(&engine.0).unwrap());
    let error = Embedded::open(folder, terms()).unwrap_err().to_string();
    assert!(error.contains("99") && error.contains("version"), "{error}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn all_submissions_at_once_are_acknowledged() {
    let engine = engine("group");
    let queue = Arc::new(open(&engine.0, terms()));
    let submissions = (0..640).map(|i| queue.submit(job(&i.to_string())));
    let submitted = futures_util::future::join_all(submissions).await;
    assert!(submitted.iter().all(|submitted| matches!(submitted, Ok(Submitted::Created(_)))));
}

#[test]
fn no_question_that_is_asked_often_looks_at_every_job() {
    let engine = engine("plans");
    drop(open(&engine.0, terms()));
    let connection = Connection::open(engine.0.join(DATABASE)).unwrap();
    for sql in [
        "SELECT COUNT(*) FROM jobs WHERE state < 2 AND state = 0",
        "SELECT COUNT(*) FROM jobs WHERE state < 2 AND state = 0 AND owner = 'a'",
        "SELECT id FROM jobs WHERE state < 2 AND state = 0 AND owner = 'a' ORDER BY id LIMIT 1",
        "SELECT owner FROM jobs WHERE state < 2 GROUP BY owner",
        "SELECT id FROM jobs WHERE state < 2 AND state = 1 AND lease_end_ms <= 5",
        "SELECT id FROM jobs WHERE is_gone = 0 AND expires_ms <= 5",
        "SELECT id FROM jobs WHERE owner = 'a' AND is_gone = 0 AND id < 'x' ORDER BY id DESC",
        "SELECT 1 FROM jobs WHERE has_image = 1 AND image_digest = 'x'",
        "SELECT 1 FROM jobs WHERE mesh_digest IS NOT NULL AND mesh_digest = 'x'",
    ] {
        let plan: Vec<String> = connection
            .prepare(&format!("EXPLAIN QUERY PLAN {sql}"))
            .unwrap()
            .query_map([], |row| row.get("detail"))
            .unwrap()
            .collect::<Result<_, _>>()
            .unwrap();
        let looks_at_all = |step: &String| step.starts_with("SCAN") && !step.contains("INDEX");
        assert!(!plan.iter().any(looks_at_all), "{sql}: {plan:?}");
    }
}
