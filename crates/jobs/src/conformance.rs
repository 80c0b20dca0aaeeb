//! The tests that every engine of the queue passes.
//!
//! [`conforms`] defines them for an engine, which is given as something that opens its queue, and
//! opens it again as a new process would after the last one was killed.

use super::queue::{
    Cancellation, Caps, Claim, Finish, Lease, Lookup, MAX_ATTEMPTS, Outcome, Page, PageRequest,
    Queue, Renewal, Stats, Submitted, Terms,
};
use super::record::{
    Event, JobId, MeshFigures, NewJob, Progress, Record, State, StoredPart, StoredWeights,
};
use super::testing::{figures, job, picture, submit, terms};
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::{sleep, timeout};

mod notifications;
mod operating;
mod retention;

pub(super) use notifications::*;
pub(super) use operating::*;
pub(super) use retention::*;

/// Opens the queue of an engine.
#[async_trait]
pub(super) trait Engine: Sync {
    /// A time in which the engine does what it does at once.
    const SHORT: Duration;

    /// The leases of tests that kill processes.
    const LEASE: Duration;

    /// Opens the queue.
    async fn open(&self, terms: Terms) -> Arc<dyn Queue>;

    /// Opens the queue after its process was killed, once the leases of that process have ended.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue>;
}

/// Defines the tests of an engine.
macro_rules! conforms {
    ($engine:expr, $of:ty) => {
        $crate::conformance::conforms! { $engine, $of;
            job_completes
            failed_job_keeps_its_problem
            acknowledged_jobs_survive_a_kill
            expired_lease_requeues_the_job
            job_fails_after_three_killed_attempts
            last_attempt_runs_alone
            last_attempt_waits_and_blocks_claims
            handed_back_attempt_does_not_count
            retryable_failure_is_retried
            queued_job_is_cancelled_then_deleted
            worker_learns_of_a_cancellation
            cancellation_survives_a_kill
            jobs_of_other_owners_are_hidden
            list_pages_newest_first
            idempotency_key_returns_the_same_job
            idempotency_key_expires
            idempotency_key_outlives_an_expired_job
            caps_of_queued_jobs_hold
            owners_take_turns_up_to_their_cap
            events_follow_every_change
            submission_wakes_a_worker
            handed_back_job_wakes_a_worker
            change_wakes_a_follower
            expired_job_is_gone_then_unknown
            picture_is_orphaned_with_its_last_job
            picture_of_a_refused_job_is_orphaned
            mesh_is_referenced_until_its_job_is_deleted
            stored_bytes_are_those_of_pictures_then_of_meshes
            stats_count_queued_and_running_jobs
            concurrent_workers_run_each_job_once
            search_finds_jobs_of_all_owners
            failed_job_is_retried_with_its_picture
            operator_cancels_and_deletes
            what_is_paused_is_kept
        }
    };
    ($engine:expr, $of:ty; $($case:ident)+) => {
        $(#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $case() {
            $crate::conformance::$case::<$of>(&$engine(stringify!($case))).await;
        })+
    };
}
pub(super) use conforms;

const LONG: Duration = Duration::from_hours(1);
/// Longer than a busy machine delays anything.
const BRIEF: Duration = Duration::from_secs(4);
/// How long a test waits for an event that must come.
const PATIENCE: Duration = Duration::from_secs(300);

fn problem() -> Value {
    json!({ "type": "/problems/image-decode-failed", "detail": "no picture" })
}

/// The next claim of a worker.
async fn claim(queue: &Arc<dyn Queue>) -> Claim {
    let looking = async {
        loop {
            match queue.claim().await.unwrap() {
                Some(claim) => return claim,
                None => queue.work().await,
            }
        }
    };
    timeout(PATIENCE, looking).await.expect("a job waits")
}

async fn found(queue: &Arc<dyn Queue>, owner: &Owner, id: JobId) -> Record {
    match queue.get(owner, id).await.unwrap() {
        Lookup::Found(record) => *record,
        other => panic!("not found: {other:?}"),
    }
}

async fn list(queue: &Arc<dyn Queue>, owner: &Owner, request: PageRequest) -> Page {
    queue.list(owner, request).await.unwrap()
}

fn request(limit: usize) -> PageRequest {
    PageRequest { state: None, before: None, limit }
}

fn states(events: &[Event]) -> Vec<State> {
    events.iter().map(|event| event.state).collect()
}

pub(super) async fn job_completes<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.attempt), (State::Queued, 0));
    let claim = claim(&queue).await;
    assert_eq!((claim.lease.job, claim.attempt, &claim.owner), (id, 1, &owner));
    assert_eq!(claim.options, "method=med&density=2");
    assert_eq!(claim.picture, picture(b"image"));
    let record = found(&queue, &owner, id).await;
    assert!(record.state == State::Running && record.started.is_some());
    let finish = queue.finish(claim.lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Completed));
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.mesh), (State::Completed, Some(figures("mesh"))));
    assert!(record.finished.is_some() && record.expires > record.finished);
    assert_eq!(queue.claim().await.unwrap(), None);
}

pub(super) async fn failed_job_keeps_its_problem<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::Anonymous);
    let id = submit(&*queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Failed(problem())).await.unwrap();
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.problem), (State::Failed, Some(problem())));
}

pub(super) async fn acknowledged_jobs_survive_a_kill<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let queue = engine.open(terms).await;
    let waiting = submit(&*queue, &owner, "waiting").await;
    let running = submit(&*queue, &owner, "running").await;
    let lease = claim(&queue).await.lease;
    assert_eq!(lease.job, waiting, "the oldest job comes first");
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    let lost = claim(&queue).await.lease;
    drop(queue);
    let queue = engine.open_after_kill(terms).await;
    assert_eq!(found(&queue, &owner, waiting).await.mesh, Some(figures("mesh")));
    assert_eq!(found(&queue, &owner, running).await.state, State::Queued);
    let again = claim(&queue).await;
    assert_eq!((again.lease.job, again.attempt), (running, 2));
    let late = queue.finish(lost, Outcome::Completed(figures("late"))).await.unwrap();
    assert_eq!(late, Finish::Fenced);
    assert_eq!(found(&queue, &owner, running).await.state, State::Running);
}

pub(super) async fn expired_lease_requeues_the_job<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(Terms { lease: BRIEF, ..terms() }).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    let expired = claim(&queue).await.lease;
    assert_eq!(queue.sweep().await.unwrap().requeued, 0, "the lease has not ended");
    for _ in 0..6 {
        sleep(BRIEF / 5).await;
        assert_eq!(queue.renew(expired, None).await.unwrap(), Renewal::Ok);
        assert_eq!(queue.sweep().await.unwrap().requeued, 0, "the lease is renewed");
    }
    let requeued = async {
        loop {
            let count = queue.sweep().await.unwrap().requeued;
            if count > 0 {
                return count;
            }
            sleep(BRIEF / 10).await;
        }
    };
    assert_eq!(timeout(PATIENCE, requeued).await.unwrap(), 1);
    let second = claim(&queue).await;
    assert_eq!((second.lease.job, second.attempt), (id, 2));
    assert!(second.lease.fence > expired.fence);
    assert_eq!(queue.renew(expired, None).await.unwrap(), Renewal::Lost);
    assert_eq!(queue.interruption(expired).await, Renewal::Lost);
    let late = queue.finish(expired, Outcome::Completed(figures("late"))).await.unwrap();
    assert_eq!(late, Finish::Fenced);
    queue.finish(second.lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(found(&queue, &owner, id).await.mesh, Some(figures("mesh")));
}

pub(super) async fn job_fails_after_three_killed_attempts<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let mut queue = engine.open(terms).await;
    let id = submit(&*queue, &owner, "poison").await;
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(claim(&queue).await.attempt, attempt);
        drop(queue);
        queue = engine.open_after_kill(terms).await;
    }
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.attempt), (State::Failed, MAX_ATTEMPTS));
    assert_eq!(record.problem.unwrap()["type"], "/problems/attempts-exhausted");
    assert_eq!(queue.claim().await.unwrap(), None);
}

pub(super) async fn last_attempt_runs_alone<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let mut queue = engine.open(terms).await;
    let poison = submit(&*queue, &owner, "poison").await;
    let innocent = submit(&*queue, &owner, "innocent").await;
    for _ in 0..2 {
        claim(&queue).await;
        claim(&queue).await;
        drop(queue);
        queue = engine.open_after_kill(terms).await;
    }
    let last = claim(&queue).await;
    assert_eq!((last.lease.job, last.attempt), (poison, MAX_ATTEMPTS));
    assert_eq!(queue.claim().await.unwrap(), None, "no other job runs meanwhile");
    drop(queue);
    let queue = engine.open_after_kill(terms).await;
    assert_eq!(found(&queue, &owner, poison).await.state, State::Failed);
    let lease = claim(&queue).await.lease;
    assert_eq!(lease.job, innocent);
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(found(&queue, &owner, innocent).await.state, State::Completed);
}

pub(super) async fn last_attempt_waits_and_blocks_claims<E: Engine>(engine: &E) {
    let queue = engine.open(terms()).await;
    let (poisoner, other) = (Owner::named("a"), Owner::named("b"));
    let poison = submit(&*queue, &poisoner, "poison").await;
    for _ in 1..MAX_ATTEMPTS {
        let lease = claim(&queue).await.lease;
        queue.finish(lease, Outcome::Retry(problem())).await.unwrap();
    }
    // It is the turn of the other owner.
    let before = submit(&*queue, &other, "before").await;
    let runs = claim(&queue).await.lease;
    assert_eq!(runs.job, before);
    let new = submit(&*queue, &other, "new").await;
    for _ in 0..2 {
        assert_eq!(queue.claim().await.unwrap(), None, "another job is running");
    }
    queue.finish(runs, Outcome::Completed(figures("mesh"))).await.unwrap();
    let last = claim(&queue).await;
    assert_eq!((last.lease.job, last.attempt), (poison, MAX_ATTEMPTS));
    assert_eq!(queue.claim().await.unwrap(), None, "a last attempt is running");
    queue.finish(last.lease, Outcome::Retry(problem())).await.unwrap();
    assert_eq!(claim(&queue).await.lease.job, new);
}

pub(super) async fn handed_back_attempt_does_not_count<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    for _ in 0..5 {
        let claim = claim(&queue).await;
        assert_eq!(claim.attempt, 1);
        let finish = queue.finish(claim.lease, Outcome::HandedBack).await.unwrap();
        assert_eq!(finish, Finish::Committed(State::Queued));
    }
    assert_eq!(found(&queue, &owner, id).await.attempt, 0);
}

pub(super) async fn retryable_failure_is_retried<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    let mut ends = Vec::new();
    for _ in 0..MAX_ATTEMPTS {
        let lease = claim(&queue).await.lease;
        ends.push(queue.finish(lease, Outcome::Retry(problem())).await.unwrap());
    }
    let [queued, failed] = [State::Queued, State::Failed].map(Finish::Committed);
    assert_eq!(ends, [queued, queued, failed]);
    assert_eq!(found(&queue, &owner, id).await.problem, Some(problem()));
}

pub(super) async fn queued_job_is_cancelled_then_deleted<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Cancelled);
    assert_eq!(found(&queue, &owner, id).await.state, State::Cancelled);
    sleep(E::SHORT).await;
    assert_eq!(queue.stats().await.unwrap().queued, 0);
    assert_eq!(queue.claim().await.unwrap(), None);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Deleted);
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Unknown);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Unknown);
}

pub(super) async fn worker_learns_of_a_cancellation<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { poll_period: LONG, ..terms() }).await;
    let owner = Owner::named("a");
    let id = submit(&*queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    let renewal = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { queue.interruption(lease).await }
    });
    sleep(E::SHORT).await;
    assert!(!renewal.is_finished());
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Requested);
    let renewal = timeout(PATIENCE, renewal).await.expect("the worker is notified").unwrap();
    assert_eq!(renewal, Renewal::CancelRequested);
    assert_eq!(queue.renew(lease, None).await.unwrap(), Renewal::CancelRequested);
    // The job is cancelled even if its mesh is stored.
    let finish = queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Cancelled));
    assert_eq!(found(&queue, &owner, id).await.mesh, None);
}

pub(super) async fn cancellation_survives_a_kill<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let queue = engine.open(terms).await;
    let id = submit(&*queue, &owner, "image").await;
    claim(&queue).await;
    queue.cancel(&owner, id).await.unwrap();
    drop(queue);
    let queue = engine.open_after_kill(terms).await;
    assert_eq!(found(&queue, &owner, id).await.state, State::Cancelled);
}

pub(super) async fn jobs_of_other_owners_are_hidden<E: Engine>(engine: &E) {
    let queue = engine.open(terms()).await;
    let (mine, other) = (Owner::named("a"), Owner::named("b"));
    let id = submit(&*queue, &mine, "image").await;
    for stranger in [&other, &Owner::Anonymous, &Owner::named("a ")] {
        assert_eq!(queue.get(stranger, id).await.unwrap(), Lookup::Unknown);
        assert_eq!(queue.cancel(stranger, id).await.unwrap(), Cancellation::Unknown);
        assert!(list(&queue, stranger, request(10)).await.jobs.is_empty());
    }
    assert_eq!(list(&queue, &mine, request(10)).await.jobs.len(), 1);
}

pub(super) async fn list_pages_newest_first<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let mut ids = Vec::new();
    for image in ["1", "2", "3", "4", "5"] {
        ids.push(submit(&*queue, &owner, image).await);
        submit(&*queue, &Owner::named("b"), image).await;
    }
    ids.reverse();
    let (mut listed, mut before) = (Vec::new(), None);
    loop {
        let page = list(&queue, &owner, PageRequest { before, ..request(2) }).await;
        assert!(page.jobs.len() <= 2);
        listed.extend(page.jobs.iter().map(|job| job.id));
        before = page.next;
        if before.is_none() {
            break;
        }
    }
    assert_eq!(listed, ids);
    assert_eq!(list(&queue, &owner, request(5)).await.next, None, "no empty page follows");
    queue.cancel(&owner, ids[2]).await.unwrap();
    let cancelled = PageRequest { state: Some(State::Cancelled), ..request(10) };
    let page = list(&queue, &owner, cancelled).await;
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [ids[2]]);
}

pub(super) async fn idempotency_key_returns_the_same_job<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let with_key = |owner: &Owner, image: &str, options: &str| NewJob {
        idempotency_key: Some("key".into()),
        options: options.into(),
        ..job(owner, image)
    };
    let first = queue.submit(with_key(&owner, "image", "size=5")).await.unwrap();
    let Submitted::Created(first) = first else { panic!("{first:?}") };
    let again = queue.submit(with_key(&owner, "image", "size=5")).await.unwrap();
    assert_eq!(again, Submitted::Existing(first.clone()));
    for (image, options) in [("other", "size=5"), ("image", "size=6")] {
        let other = queue.submit(with_key(&owner, image, options)).await.unwrap();
        assert_eq!(other, Submitted::KeyReused, "{image}, {options}");
    }
    let stranger = queue.submit(with_key(&Owner::named("b"), "other", "size=6")).await.unwrap();
    assert!(matches!(stranger, Submitted::Created(_)), "each owner has keys of its own");
    // Concurrent submissions return the same job, too.
    let queue_ref = &queue;
    let tries = (0..8).map(|_| queue_ref.submit(with_key(&owner, "image", "size=5")));
    for submitted in futures_util::future::join_all(tries).await {
        assert_eq!(submitted.unwrap(), Submitted::Existing(first.clone()));
    }
    queue.cancel(&owner, first.id).await.unwrap();
    queue.cancel(&owner, first.id).await.unwrap();
    for (image, options) in [("other", "size=6"), ("image", "size=5")] {
        let again = queue.submit(with_key(&owner, image, options)).await.unwrap();
        assert_eq!(again, Submitted::KeyOfGone, "the key outlives its job");
    }
}

pub(super) async fn idempotency_key_outlives_an_expired_job<E: Engine>(engine: &E) {
    let terms = Terms { result_ttl: E::SHORT, idempotency_ttl: 2 * BRIEF, ..terms() };
    let (queue, owner) = (engine.open(terms).await, Owner::named("a"));
    let with_key = || NewJob { idempotency_key: Some("key".into()), ..job(&owner, "image") };
    let submitted = Instant::now();
    let Submitted::Created(first) = queue.submit(with_key()).await.unwrap() else { panic!() };
    queue.cancel(&owner, first.id).await.unwrap();
    sleep(2 * E::SHORT).await;
    assert_eq!(queue.submit(with_key()).await.unwrap(), Submitted::KeyOfGone, "before any sweep");
    assert_eq!(queue.sweep().await.unwrap().expired, 1);
    assert_eq!(queue.submit(with_key()).await.unwrap(), Submitted::KeyOfGone);
    let fresh = async {
        loop {
            queue.sweep().await.unwrap();
            match queue.submit(with_key()).await.unwrap() {
                Submitted::Created(_) => return,
                Submitted::KeyOfGone => sleep(BRIEF / 4).await,
                other => panic!("{other:?}"),
            }
        }
    };
    timeout(PATIENCE, fresh).await.unwrap();
    assert!(submitted.elapsed() >= 2 * BRIEF);
}

pub(super) async fn idempotency_key_expires<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { idempotency_ttl: E::SHORT, ..terms() }).await;
    let with_key =
        |image| NewJob { idempotency_key: Some("key".into()), ..job(&Owner::named("a"), image) };
    queue.submit(with_key("image")).await.unwrap();
    sleep(2 * E::SHORT).await;
    let expired = async {
        loop {
            match queue.submit(with_key("other")).await.unwrap() {
                Submitted::Created(_) => return,
                Submitted::KeyReused => sleep(E::SHORT).await,
                other => panic!("{other:?}"),
            }
        }
    };
    timeout(PATIENCE, expired).await.unwrap();
}

pub(super) async fn caps_of_queued_jobs_hold<E: Engine>(engine: &E) {
    let caps = Caps { queued: 3, queued_per_owner: 2, ..terms().caps };
    let queue = engine.open(Terms { caps, ..terms() }).await;
    let (a, b) = (Owner::named("a"), Owner::named("b"));
    submit(&*queue, &a, "1").await;
    submit(&*queue, &a, "2").await;
    let refused = queue.submit(job(&a, "3")).await.unwrap();
    assert_eq!(refused, Submitted::OwnerFull { limit: 2 });
    submit(&*queue, &b, "3").await;
    assert_eq!(queue.submit(job(&b, "4")).await.unwrap(), Submitted::QueueFull { limit: 3 });
    claim(&queue).await;
    submit(&*queue, &b, "4").await;
    assert_eq!(queue.submit(job(&a, "5")).await.unwrap(), Submitted::QueueFull { limit: 3 });
    // Running jobs do not count.
    for _ in 0..2 {
        claim(&queue).await;
    }
    submit(&*queue, &a, "5").await;
}

pub(super) async fn owners_take_turns_up_to_their_cap<E: Engine>(engine: &E) {
    let caps = Caps { running_per_owner: 2, ..terms().caps };
    let queue = engine.open(Terms { caps, ..terms() }).await;
    let (a, b) = (Owner::named("a"), Owner::named("b"));
    for image in ["1", "2", "3", "4", "5"] {
        submit(&*queue, &a, image).await;
    }
    submit(&*queue, &b, "6").await;
    submit(&*queue, &b, "7").await;
    let mut turns = Vec::new();
    while let Some(claim) = queue.claim().await.unwrap() {
        turns.push(claim);
    }
    let names: Vec<_> = turns.iter().map(|claim| claim.owner.as_str()).collect();
    assert_eq!(names, ["a", "b", "a", "b"]);
    queue.finish(turns[0].lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(claim(&queue).await.owner, a);
    assert_eq!(queue.claim().await.unwrap(), None);
}

pub(super) async fn stats_count_queued_and_running_jobs<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    for image in ["1", "2", "3"] {
        submit(&*queue, &owner, image).await;
    }
    claim(&queue).await;
    sleep(E::SHORT).await;
    let stats = queue.stats().await.unwrap();
    assert_eq!((stats.queued, stats.running), (2, 1));
    assert!(stats.oldest_queued_s >= E::SHORT.as_secs_f64() && stats.oldest_queued_s < 60.0);
    assert!(queue.is_healthy());
    for _ in 0..2 {
        claim(&queue).await;
    }
    assert_eq!(queue.stats().await.unwrap(), Stats { running: 3, ..Stats::default() });
    // Only the age of queued jobs counts.
    let submitted = Instant::now();
    submit(&*queue, &owner, "4").await;
    let age_s = queue.stats().await.unwrap().oldest_queued_s;
    // Times are stored in milliseconds.
    assert!(age_s <= submitted.elapsed().as_secs_f64() + 0.002, "{age_s}");
}

pub(super) async fn concurrent_workers_run_each_job_once<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let images: Vec<String> = (0..100).map(|i| i.to_string()).collect();
    let submissions = images.iter().map(|image| submit(&*queue, &owner, image));
    let mut ids = futures_util::future::join_all(submissions).await;
    let worker = |queue: Arc<dyn Queue>| async move {
        let mut done: Vec<Lease> = Vec::new();
        while let Some(claim) = queue.claim().await.unwrap() {
            let outcome = Outcome::Completed(figures(&claim.lease.job.to_string()));
            let finish = queue.finish(claim.lease, outcome).await.unwrap();
            assert_eq!(finish, Finish::Committed(State::Completed));
            done.push(claim.lease);
        }
        done
    };
    let workers: Vec<_> = (0..4).map(|_| tokio::spawn(worker(Arc::clone(&queue)))).collect();
    let mut done = Vec::new();
    for worker in workers {
        done.extend(worker.await.unwrap().into_iter().map(|lease| lease.job));
    }
    ids.sort();
    done.sort();
    assert_eq!(done, ids);
}
