//! A worker does its jobs to whatever end, stops when it is told, and outlives kernels that panic.

use super::*;
use crate::embedded::Embedded;
use crate::fairness::Caps;
use crate::folder::DataFolder;
use crate::queue::{Lookup, Submitted, Terms};
use crate::record::{JobId, KeptWeights, NewJob, Picture, Record, State};
use crate::{blobs::Blobs, folder_for_test};
use pixmesh_codec::probe;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::pipeline;
use pixmesh_engine::scheduler::Limits as WorkLimits;
use pixmesh_meshing::{Control, Stage};
use serde_json::json;
use std::path::{Path, PathBuf};
use tokio::task::JoinHandle;

const PICTURE: &[u8] = b"P2\n4 3\n9\n0 1 2 3 4 5 6 7 8 9 0 1\n";

/// Makes meshes, but panics for those of five vertices.
fn panicking(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<(Answer, Option<Vec<u8>>), EngineError> {
    assert!(!options.query().contains("size=5"), "on purpose");
    pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
}

/// Works on meshes of five vertices until it is stopped, half of one stage done.
fn endless(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<(Answer, Option<Vec<u8>>), EngineError> {
    if !options.query().contains("size=5") {
        return pipeline::mesh_of_job(source, options, keeps_progression, limits, context);
    }
    context.begin(Stage::Simplify.name());
    while context.poll(Stage::Simplify, 1, 2).is_ok() {
        std::thread::sleep(Duration::from_millis(1));
    }
    Err(Cancelled.into())
}

/// Lets a worker work, with time enough to end when it is told to.
fn start(worker: Worker) -> (CancellationToken, JoinHandle<()>) {
    let stop = CancellationToken::new();
    let working = tokio::spawn(worker.run(stop.clone(), Duration::from_secs(5)));
    (stop, working)
}

fn jobs() -> Jobs {
    jobs_with_leases_of(Duration::from_hours(1))
}

fn jobs_with_leases_of(lease: Duration) -> Jobs {
    let folder = Arc::new(DataFolder::take(&folder_for_test("worker")).unwrap());
    let hour = Duration::from_hours(1);
    let caps = Caps { queued: 100, queued_per_owner: 100, running_per_owner: 100 };
    let look_again = Duration::from_secs(1);
    let terms =
        Terms { caps, lease, result_ttl: hour, idempotency_ttl: hour, gone_ttl: hour, look_again };
    let blobs = Blobs::in_folder(&folder.path().join("blobs")).unwrap();
    let queue = Arc::new(Embedded::open(folder, terms).unwrap());
    Jobs { queue, blobs, durations: Arc::default() }
}

async fn submit(jobs: &Jobs, size: usize) -> JobId {
    let header = probe(PICTURE, &Limits::default()).unwrap();
    let job = NewJob {
        id: JobId::new(),
        owner: Owner::Anonymous,
        order: format!("method=med&size={size}"),
        picture: Picture::new(Digest::of(PICTURE), PICTURE.len(), &header),
        idempotency_key: None,
    };
    match jobs.submit(job, Bytes::from_static(PICTURE)).await.unwrap() {
        Submitted::Created(record) => record.id,
        other => panic!("{other:?}"),
    }
}

/// The job once it has come to its end.
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

/// A worker with one slot, some of whose jobs are endless.
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

/// The job as soon as it is like that.
async fn once(jobs: &Jobs, id: JobId, is_so: impl Fn(&Record) -> bool) -> Record {
    let found = async {
        loop {
            match jobs.queue.get(&Owner::Anonymous, id).await.unwrap() {
                Lookup::Found(record) if is_so(&record) => return *record,
                Lookup::Found(_) => tokio::time::sleep(Duration::from_millis(5)).await,
                other => panic!("{other:?}"),
            }
        }
    };
    timeout(Duration::from_mins(1), found).await.unwrap()
}

/// Searches for 50 ms before it begins.
fn searching(
    source: Weighed<Bytes>,
    options: &MeshOptions,
    keeps_progression: bool,
    limits: &Limits,
    context: &Context,
) -> Result<(Answer, Option<Vec<u8>>), EngineError> {
    context.begin(Stage::Search.name());
    std::thread::sleep(Duration::from_millis(50));
    pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_leaves_its_mesh_and_what_is_known_of_it() {
    let jobs = jobs();
    let id = submit(&jobs, 6).await;
    assert_eq!(jobs.durations.mean_s(), None);
    let began = Instant::now();
    let worker = Worker { make: searching, ..worker(&jobs) };
    let (stop, working) = start(worker);
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
    working.await.unwrap();
}

/// Puts files in the way of all blobs but those whose shelves are there, and returns them.
fn block(folder: &Path) -> Vec<PathBuf> {
    let shelves = (0..=255).map(|shelf| folder.join(format!("{shelf:02x}")));
    let free: Vec<PathBuf> = shelves.filter(|shelf| !shelf.exists()).collect();
    free.iter().for_each(|shelf| std::fs::write(shelf, b"").unwrap());
    free
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mesh_that_the_store_does_not_take_is_stored_as_soon_as_it_does() {
    let jobs = jobs();
    let id = submit(&jobs, 4).await;
    let in_the_way = block(jobs.blobs.folder_for_test());
    let (stop, working) = start(worker(&jobs));
    once(&jobs, id, |record| record.state == State::Running).await;
    // Far longer than the mesh takes.
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(once(&jobs, id, |_| true).await.state, State::Running);
    in_the_way.iter().for_each(|file| std::fs::remove_file(file).unwrap());
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Completed, 1));
    stop.cancel();
    working.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mesh_that_the_store_never_takes_uses_up_the_attempts_of_its_job() {
    let jobs = jobs();
    let id = submit(&jobs, 4).await;
    block(jobs.blobs.folder_for_test());
    let worker = Worker { deadline: Duration::from_secs(3), ..worker(&jobs) };
    let (stop, working) = start(worker);
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Failed, 3));
    assert!(record.problem.unwrap().to_string().contains("Storage("));
    stop.cancel();
    working.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_picture_that_a_shared_store_does_not_give_is_waited_for_until_the_deadline() {
    let own = jobs();
    let jobs = Jobs { blobs: own.blobs.as_if_shared(), ..own.clone() };
    let id = submit(&jobs, 4).await;
    let shelf = own.blobs.folder_for_test().join(&Digest::of(PICTURE).to_string()[..2]);
    let aside = shelf.with_extension("aside");
    for (deadline, state, attempt) in [
        (Duration::from_mins(1), State::Completed, 1),
        (Duration::from_millis(50), State::Failed, 3),
    ] {
        let id = if attempt == 1 { id } else { submit(&jobs, 6).await };
        std::fs::rename(&shelf, &aside).unwrap();
        let worker = Worker { deadline, ..worker(&jobs) };
        let (stop, working) = start(worker);
        once(&jobs, id, |record| record.state == State::Running).await;
        if attempt == 1 {
            // Longer than all looks of one attempt to read it.
            tokio::time::sleep(Duration::from_millis(1500)).await;
            std::fs::rename(&aside, &shelf).unwrap();
        }
        let record = once(&jobs, id, |record| record.state.is_final()).await;
        assert_eq!((record.state, record.attempt), (state, attempt));
        stop.cancel();
        working.await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_cancelled_job_stops_and_makes_room_for_the_next() {
    let jobs = jobs();
    let (unwanted, next) = (submit(&jobs, 5).await, submit(&jobs, 4).await);
    let (stop, working) = start(worker(&jobs));
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
    working.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_that_does_not_end_in_time_is_handed_back_when_the_worker_stops() {
    let jobs = jobs();
    let id = submit(&jobs, 5).await;
    let stop = CancellationToken::new();
    let working = tokio::spawn(worker(&jobs).run(stop.clone(), Duration::from_millis(50)));
    once(&jobs, id, |record| record.state == State::Running).await;
    stop.cancel();
    timeout(Duration::from_secs(20), working).await.unwrap().unwrap();
    let record = once(&jobs, id, |_| true).await;
    assert_eq!((record.state, record.attempt), (State::Queued, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_has_nothing_to_do_stops_at_once_and_so_does_one_at_work_that_ends() {
    fn slow(
        source: Weighed<Bytes>,
        options: &MeshOptions,
        keeps_progression: bool,
        limits: &Limits,
        context: &Context,
    ) -> Result<(Answer, Option<Vec<u8>>), EngineError> {
        std::thread::sleep(Duration::from_millis(300));
        pipeline::mesh_of_job(source, options, keeps_progression, limits, context)
    }
    let jobs = jobs();
    let stop = CancellationToken::new();
    let run = |make| Worker { make, ..worker(&jobs) }.run(stop.clone(), Duration::from_mins(1));
    let idle = tokio::spawn(run(endless));
    let at_work = tokio::spawn(run(slow));
    let id = submit(&jobs, 4).await;
    once(&jobs, id, |record| record.state != State::Queued).await;
    stop.cancel();
    for working in [idle, at_work] {
        timeout(Duration::from_secs(20), working).await.unwrap().unwrap();
    }
    assert_eq!(once(&jobs, id, |_| true).await.state, State::Completed);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_past_its_deadline_fails() {
    let jobs = jobs();
    let id = submit(&jobs, 5).await;
    let worker = Worker { deadline: Duration::from_millis(200), ..worker(&jobs) };
    let (stop, working) = start(worker);
    let record = once(&jobs, id, |record| record.state.is_final()).await;
    assert_eq!((record.state, record.attempt), (State::Failed, 1));
    assert!(record.problem.unwrap().to_string().contains("DeadlineExceeded"));
    assert!(jobs.durations.mean_s().is_some_and(|mean_s| mean_s >= 0.2));
    stop.cancel();
    working.await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_lease_of_a_job_is_renewed_while_it_runs() {
    let jobs = jobs_with_leases_of(Duration::from_secs(5));
    let id = submit(&jobs, 5).await;
    let stop = CancellationToken::new();
    // Renewed whenever progress is looked at, though there is none.
    let worker = Worker { lease: Duration::from_secs(1), ..worker(&jobs) };
    let working = tokio::spawn(worker.run(stop.clone(), Duration::from_millis(1)));
    once(&jobs, id, |record| record.state == State::Running).await;
    for _ in 0..60 {
        tokio::time::sleep(Duration::from_millis(100)).await;
        assert_eq!(jobs.queue.sweep().await.unwrap().requeued, 0);
    }
    assert_eq!(once(&jobs, id, |_| true).await.attempt, 1);
    stop.cancel();
    working.await.unwrap();
}

#[test]
fn only_failures_of_the_storage_are_tried_again() {
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
fn weights_lie_behind_the_picture_and_nothing_behind_them() {
    let header = probe(PICTURE, &Limits::default()).unwrap();
    let file = Bytes::from([PICTURE, b"weights".as_slice()].concat());
    let digest = Digest::of(&file);
    let mut picture = Picture::new(digest, PICTURE.len(), &header);
    let whole = parted(&file, &picture).ok().unwrap();
    assert!(whole.image == file && whole.weights.is_none());
    for bytes in [6, 7, 8] {
        picture.shape.weights = Some(KeptWeights { bytes, digest, picture_digest: digest });
        match parted(&file, &picture) {
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
async fn a_kernel_that_panics_fails_its_job_and_the_others_go_on() {
    let jobs = jobs();
    let worker = Worker { make: panicking, ..worker(&jobs) };
    let mut submitted = Vec::new();
    for size in [4, 5, 6, 5, 5, 7] {
        submitted.push((size, submit(&jobs, size).await));
    }
    let (stop, working) = start(worker);
    for (size, id) in submitted {
        let record = timeout(Duration::from_secs(60), end(&jobs, id)).await.unwrap();
        let problem = record.problem.map(|problem| problem.to_string()).unwrap_or_default();
        assert_eq!(record.mesh.is_some(), size != 5, "{problem}");
        assert_eq!(problem.contains("Panicked"), size == 5, "{problem}");
        assert_eq!(record.attempt, 1);
    }
    stop.cancel();
    working.await.unwrap();
}
