//! The worker with real jobs, a real store and kernels that panic or never end.

use super::*;
use crate::queue::{Lookup, Submitted, Terms};
use crate::record::{JobId, NewJob, Picture, Record, State, StoredWeights};
use crate::testing::{self, terms};
use pixmesh_codec::probe;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::pipeline;
use pixmesh_engine::scheduler::Limits as WorkLimits;
use pixmesh_meshing::{Control, Stage};
use serde_json::json;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use tokio::task::JoinHandle;

const PICTURE: &[u8] = b"P2\n4 3\n9\n0 1 2 3 4 5 6 7 8 9 0 1\n";

/// Panics for meshes of five vertices.
fn panicking(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<JobMesh, EngineError> {
    assert!(!options.query().contains("size=5"), "on purpose");
    pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
}

/// Runs until it is cancelled for meshes of five vertices, with half of a stage done.
fn endless(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<JobMesh, EngineError> {
    if !options.query().contains("size=5") {
        return pipeline::mesh_of_job(source, options, keeps_progression, limits, context);
    }
    context.begin(Stage::Simplify.name());
    while context.poll(Stage::Simplify, 1, 2).is_ok() {
        std::thread::sleep(Duration::from_millis(1));
    }
    Err(Cancelled.into())
}

/// Starts a worker with a grace period of 5 s.
fn start(worker: Worker) -> (CancellationToken, JoinHandle<()>) {
    let stop = CancellationToken::new();
    let running = tokio::spawn(worker.run(stop.clone(), Duration::from_secs(5)));
    (stop, running)
}

fn jobs() -> (Jobs, TempDir) {
    testing::jobs(terms())
}

async fn submit(jobs: &Jobs, size: usize) -> JobId {
    let header = probe(PICTURE, &Limits::default()).unwrap();
    let job = NewJob {
        id: JobId::new(),
        owner: Owner::Anonymous,
        options: format!("method=med&size={size}"),
        picture: Picture::new(Digest::of(PICTURE), PICTURE.len(), &header),
        idempotency_key: None,
    };
    match jobs.submit(job, Bytes::from_static(PICTURE)).await.unwrap() {
        Submitted::Created(record) => record.id,
        other => panic!("{other:?}"),
    }
}

/// The record of a job after its end.
async fn end(jobs: &Jobs, id: JobId) -> Record {
    loop {
        match jobs.queue.get(&Owner::Anonymous, id).await.unwrap() {
            Lookup::Found(record) if record.state.is_final() => return *record,
            Lookup::Found(record) => {
                jobs.queue.events(&Owner::Anonymous, id, record.revision).await.unwrap();
            }
            other => panic!("{other:?}"),
        }
    }
}

/// A worker with one slot, for which meshes of five vertices never end.
fn worker(jobs: &Jobs) -> Worker {
    let scheduler = Scheduler::new(&WorkLimits {
        workers: 1,
        threads: 1,
        memory_bytes: 64 << 20,
        queue_s: 10.0,
        running_per_key: 1,
        queued_per_key: 10,
    });
    Worker {
        jobs: jobs.clone(),
        scheduler,
        workers: Workers::start(1).unwrap(),
        pictures: Limits::default(),
        deadline: Duration::from_mins(1),
        lease: Duration::from_mins(1),
        make: endless,
        describe: |error| json!({ "detail": format!("{error:?}") }),
    }
}

/// The record of a job as soon as a condition holds.
async fn once(jobs: &Jobs, id: JobId, holds: impl Fn(&Record) -> bool) -> Record {
    let found = async {
        loop {
            match jobs.queue.get(&Owner::Anonymous, id).await.unwrap() {
                Lookup::Found(record) if holds(&record) => return *record,
                Lookup::Found(_) => tokio::time::sleep(Duration::from_millis(5)).await,
                other => panic!("{other:?}"),
            }
        }
    };
    timeout(Duration::from_mins(1), found).await.unwrap()
}

/// Adds a search of 50 ms.
fn searching(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<JobMesh, EngineError> {
    context.begin(Stage::Search.name());
    std::thread::sleep(Duration::from_millis(50));
    pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn job_stores_its_mesh_and_figures() {
    let (jobs, _folder) = jobs();
    let id = submit(&jobs, 6).await;
    assert_eq!(jobs.durations.mean_s(), None);
    let began = Instant::now();
    let worker = Worker { make: searching, ..worker(&jobs) };
    let (stop, running) = start(worker);
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    let mesh = record.mesh.unwrap();
    assert_eq!(record.state, State::Completed);
    assert!((4..=12).contains(&mesh.vertices) && mesh.faces >= 2, "{mesh:?}");
    assert!(mesh.psnr_db.is_some_and(|psnr| psnr > 0.0) && mesh.mse > 0.0);
    let took_ms = began.elapsed().as_secs_f64() * 1e3;
    let search = mesh.timings_ms.iter().find(|(stage, _)| stage == "search").unwrap();
    assert!((50.0..took_ms).contains(&search.1), "{search:?} of {took_ms} ms");
    let blob = jobs.blobs.get(mesh.digest.parse().unwrap()).await.unwrap();
    let behind = mesh.progression.as_ref().map_or(0, |progression| progression.bytes);
    assert_eq!(blob.len() as u64, mesh.bytes + behind);
    assert!(blob.starts_with(b"4 3"), "the MODEL of a picture of 4 columns and 3 rows");
    assert!(jobs.durations.mean_s().is_some_and(|mean_s| mean_s > 0.0));
    stop.cancel();
    running.await.unwrap();
}

/// Blocks all new folders of blobs by files, and returns the files.
fn block(folder: &Path) -> Vec<PathBuf> {
    let prefixes = (0..=255).map(|prefix| folder.join(format!("{prefix:02x}")));
    let free: Vec<PathBuf> = prefixes.filter(|prefix| !prefix.exists()).collect();
    free.iter().for_each(|prefix| std::fs::write(prefix, b"").unwrap());
    free
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn mesh_is_stored_when_the_store_recovers() {
    let (jobs, _folder) = jobs();
    let id = submit(&jobs, 4).await;
    let blocking = block(jobs.blobs.folder_for_test());
    let (stop, running) = start(worker(&jobs));
    once(&jobs, id, |record| record.state == State::Running).await;
    // Far longer than the mesh takes.
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(once(&jobs, id, |_| true).await.state, State::Running);
    blocking.iter().for_each(|file| std::fs::remove_file(file).unwrap());
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Completed, 1));
    stop.cancel();
    running.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn failing_store_exhausts_the_attempts() {
    let (jobs, _folder) = jobs();
    let id = submit(&jobs, 4).await;
    block(jobs.blobs.folder_for_test());
    let worker = Worker { deadline: Duration::from_secs(3), ..worker(&jobs) };
    let (stop, running) = start(worker);
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Failed, 3));
    assert!(record.problem.unwrap().to_string().contains("Storage("));
    stop.cancel();
    running.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn picture_of_a_failing_shared_store_is_retried_until_the_deadline() {
    let (own, _folder) = jobs();
    let jobs = Jobs { blobs: own.blobs.as_if_shared(), ..own.clone() };
    let id = submit(&jobs, 4).await;
    let prefix = own.blobs.folder_for_test().join(&Digest::of(PICTURE).to_string()[..2]);
    let aside = prefix.with_extension("aside");
    for (deadline, state, attempt) in [
        (Duration::from_mins(1), State::Completed, 1),
        (Duration::from_millis(50), State::Failed, 3),
    ] {
        let id = if attempt == 1 { id } else { submit(&jobs, 6).await };
        std::fs::rename(&prefix, &aside).unwrap();
        let worker = Worker { deadline, ..worker(&jobs) };
        let (stop, running) = start(worker);
        once(&jobs, id, |record| record.state == State::Running).await;
        if attempt == 1 {
            // Longer than all reads of one attempt.
            tokio::time::sleep(Duration::from_millis(1500)).await;
            std::fs::rename(&aside, &prefix).unwrap();
        }
        let record = once(&jobs, id, |record| record.state.is_final()).await;
        assert_eq!((record.state, record.attempt), (state, attempt));
        stop.cancel();
        running.await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn cancelled_job_stops_and_the_next_one_runs() {
    let (jobs, _folder) = jobs();
    let (unwanted, next) = (submit(&jobs, 5).await, submit(&jobs, 4).await);
    let (stop, running) = start(worker(&jobs));
    let record = once(&jobs, unwanted, |record| record.progress.is_some()).await;
    assert_eq!(record.state, State::Running);
    let progress = record.progress.unwrap();
    assert_eq!((progress.stage.as_str(), progress.fraction), ("simplify", 0.5));
    jobs.queue.cancel(&Owner::Anonymous, unwanted).await.unwrap();
    let record = once(&jobs, unwanted, |record| record.state.is_final()).await;
    assert_eq!(record.state, State::Cancelled);
    let record = once(&jobs, next, |record| record.state.is_final()).await;
    assert_eq!(record.state, State::Completed);
    stop.cancel();
    running.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stopping_worker_hands_back_a_long_job() {
    let (jobs, _folder) = jobs();
    let id = submit(&jobs, 5).await;
    let stop = CancellationToken::new();
    let running = tokio::spawn(worker(&jobs).run(stop.clone(), Duration::from_millis(50)));
    once(&jobs, id, |record| record.state == State::Running).await;
    stop.cancel();
    timeout(Duration::from_secs(20), running).await.unwrap().unwrap();
    let record = once(&jobs, id, |_| true).await;
    assert_eq!((record.state, record.attempt), (State::Queued, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn idle_worker_stops_at_once_and_busy_worker_after_its_job() {
    fn slow(
        source: Weighed<Bytes>,
        options: &MeshOptions,
        keeps_progression: bool,
        limits: &Limits,
        context: &Context,
    ) -> Result<JobMesh, EngineError> {
        std::thread::sleep(Duration::from_millis(300));
        pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
    }
    let (jobs, _folder) = jobs();
    let stop = CancellationToken::new();
    let run = |make| Worker { make, ..worker(&jobs) }.run(stop.clone(), Duration::from_mins(1));
    let idle = tokio::spawn(run(endless));
    let busy = tokio::spawn(run(slow));
    let id = submit(&jobs, 4).await;
    once(&jobs, id, |record| record.state != State::Queued).await;
    stop.cancel();
    for running in [idle, busy] {
        timeout(Duration::from_secs(20), running).await.unwrap().unwrap();
    }
    assert_eq!(once(&jobs, id, |_| true).await.state, State::Completed);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn job_fails_at_its_deadline() {
    let (jobs, _folder) = jobs();
    let id = submit(&jobs, 5).await;
    let worker = Worker { deadline: Duration::from_millis(200), ..worker(&jobs) };
    let (stop, running) = start(worker);
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Failed, 1));
    assert!(record.problem.unwrap().to_string().contains("DeadlineExceeded"));
    assert!(jobs.durations.mean_s().is_some_and(|mean_s| mean_s >= 0.2));
    stop.cancel();
    running.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn lease_is_renewed_while_a_job_runs() {
    let (jobs, _folder) = testing::jobs(Terms { lease: Duration::from_secs(5), ..terms() });
    let id = submit(&jobs, 5).await;
    let stop = CancellationToken::new();
    // The worker renews the lease every 500 ms, although there is no new progress.
    let worker = Worker { lease: Duration::from_secs(1), ..worker(&jobs) };
    let running = tokio::spawn(worker.run(stop.clone(), Duration::from_millis(1)));
    once(&jobs, id, |record| record.state == State::Running).await;
    for _ in 0..60 {
        tokio::time::sleep(Duration::from_millis(100)).await;
        assert_eq!(jobs.queue.sweep().await.unwrap().requeued, 0);
    }
    assert_eq!(once(&jobs, id, |_| true).await.attempt, 1);
    stop.cancel();
    running.await.unwrap();
}

#[test]
fn only_storage_errors_are_retried() {
    let storage = |error| AttemptError::Storage(error).may_succeed_later();
    assert!(storage(QueueError::StorageFull("why".into())));
    assert!(storage(QueueError::Storage("why".into())));
    assert!(storage(QueueError::Blobs("why".into())));
    assert!(AttemptError::PictureChanged.may_succeed_later());
    assert!(!storage(QueueError::Damaged("why".into())));
    let too_large = EngineError::TooLarge { needed_mib: 2, budget_mib: 1 };
    assert!(!AttemptError::Engine(too_large).may_succeed_later());
}

#[test]
fn blob_splits_into_picture_and_weights() {
    let header = probe(PICTURE, &Limits::default()).unwrap();
    let file = Bytes::from([PICTURE, b"weights".as_slice()].concat());
    let digest = Digest::of(&file);
    let mut picture = Picture::new(digest, PICTURE.len(), &header);
    let whole = split(&file, &picture).ok().unwrap();
    assert!(whole.image == file && whole.weights.is_none());
    for bytes in [6, 7, 8] {
        picture.shape.weights = Some(StoredWeights { bytes, digest, picture_digest: digest });
        match split(&file, &picture) {
            Ok(parts) if bytes == 7 => {
                assert_eq!(
                    (&parts.image[..], parts.weights.as_deref()),
                    (PICTURE, Some(&b"weights"[..]))
                );
            }
            Err(AttemptError::PictureChanged) => assert_ne!(bytes, 7),
            _ => panic!("{bytes}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn panic_fails_its_job_only() {
    let (jobs, _folder) = jobs();
    let worker = Worker { make: panicking, ..worker(&jobs) };
    let mut submitted = Vec::new();
    for size in [4, 5, 6, 5, 5, 7] {
        submitted.push((size, submit(&jobs, size).await));
    }
    let (stop, running) = start(worker);
    for (size, id) in submitted {
        let record = timeout(Duration::from_secs(60), end(&jobs, id)).await.unwrap();
        let problem = record.problem.map(|problem| problem.to_string()).unwrap_or_default();
        assert_eq!(record.mesh.is_some(), size != 5, "{problem}");
        assert_eq!(problem.contains("Panicked"), size == 5, "{problem}");
        assert_eq!(record.attempt, 1);
    }
    stop.cancel();
    running.await.unwrap();
}
