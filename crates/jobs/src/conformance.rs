//! What every engine of the queue must do: one suite, whatever keeps the jobs.
//!
//! [`conforms`] makes a test of each promise for an engine, which is given as something that opens
//! its queue, and opens it again as a new process would after the last one was killed.

use super::fairness::Caps;
use super::queue::{
    Cancellation, Claim, Finish, Lease, Lookup, MAX_ATTEMPTS, Outcome, Page, PageRequest, Queue,
    Renewal, Stats, Submitted, Terms,
};
use super::record::{Event, JobId, MeshFigures, NewJob, Picture, Progress, Record, State};
use async_trait::async_trait;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::{sleep, timeout};

mod hearing;
mod keeping;

pub(super) use hearing::*;
pub(super) use keeping::*;

/// Opens the queue of an engine.
#[async_trait]
pub(super) trait Engine: Sync {
    /// A short time; nothing that is checked fails where a busy machine takes longer for something.
    const SHORT: Duration;

    /// How long workers keep jobs in tests where processes are killed.
    const LEASE: Duration;

    /// Opens the queue.
    async fn open(&self, terms: Terms) -> Arc<dyn Queue>;

    /// Opens the queue after the one process that had it was killed, and waits until that is known.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue>;
}

/// Makes a test of each promise for an engine.
macro_rules! conforms {
    ($engine:expr, $of:ty) => {
        $crate::conformance::conforms! { $engine, $of;
            a_job_goes_from_queued_by_running_to_completed
            a_failed_job_keeps_its_problem
            what_was_acknowledged_is_there_after_a_kill
            a_job_whose_worker_falls_silent_is_given_to_another
            a_job_is_tried_three_times_and_then_failed_as_such
            the_last_attempt_is_made_alone
            a_last_attempt_waits_for_what_runs_and_what_is_new_waits_for_it
            an_attempt_that_was_handed_back_does_not_count
            what_may_succeed_another_time_is_tried_again
            a_waiting_job_is_cancelled_at_once_and_then_deleted
            the_worker_of_a_cancelled_job_is_told
            a_cancelled_job_stays_cancelled_when_its_worker_is_killed
            nobody_sees_or_cancels_the_jobs_of_others
            jobs_are_listed_newest_first_page_by_page
            the_same_word_with_the_same_content_is_the_same_job
            words_are_forgotten_in_time
            no_more_jobs_wait_than_may
            owners_take_turns_and_have_no_more_running_than_they_may
            every_change_can_be_followed_from_any_point
            work_is_heard_of_as_it_comes
            what_was_handed_back_is_called_for
            a_change_is_heard_of_as_it_comes
            an_interruption_is_heard_of_as_it_comes
            jobs_are_gone_after_their_time_and_then_unknown
            blobs_are_given_up_with_the_last_job_that_has_them
            a_blob_stored_for_nothing_is_given_up
            a_mesh_is_kept_while_its_job_is
            there_is_a_count_of_what_waits_and_runs
            many_at_once_are_each_done_once
        }
    };
    ($engine:expr, $of:ty; $($promise:ident)+) => {
        $(#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $promise() {
            // An engine whose program is not there says so.
            let engine: Option<$of> = $engine(stringify!($promise)).into();
            if let Some(engine) = engine {
                $crate::conformance::$promise::<$of>(&engine).await;
            }
        })+
    };
}
pub(super) use conforms;

const CAPS: Caps = Caps { queued: 1000, queued_per_owner: 1000, running_per_owner: 1000 };
const LONG: Duration = Duration::from_secs(3600);

/// Longer than a busy machine holds anything up, and short enough to be waited for.
const BRIEF: Duration = Duration::from_secs(4);
/// What is waited for has come within this time, or never comes.
const PATIENCE: Duration = Duration::from_secs(300);
const LOOK_AGAIN: Duration = Duration::from_secs(1);

fn terms() -> Terms {
    Terms {
        caps: CAPS,
        lease: LONG,
        result_ttl: LONG,
        idempotency_ttl: LONG,
        gone_ttl: LONG,
        look_again: LOOK_AGAIN,
    }
}

fn job(owner: &Owner, image: &str) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: owner.clone(),
        order: "method=med&density=2".into(),
        picture: Picture::of_bytes(image.as_bytes()),
        idempotency_key: None,
    }
}

fn figures(text: &str) -> MeshFigures {
    MeshFigures {
        progression: None,
        digest: Digest::of(text.as_bytes()).to_string(),
        bytes: text.len() as u64,
        vertices: 4,
        faces: 2,
        mse: 0.25,
        psnr_db: Some(54.15),
        timings_ms: vec![("decode".into(), 1.5)],
        chunks: vec![Digest::of(b"a chunk")],
    }
}

fn problem() -> Value {
    json!({ "type": "/problems/image-decode-failed", "detail": "no picture" })
}

async fn submit(queue: &Arc<dyn Queue>, owner: &Owner, image: &str) -> JobId {
    match queue.submit(job(owner, image)).await.unwrap() {
        Submitted::Created(record) => record.id,
        other => panic!("not created: {other:?}"),
    }
}

/// What a worker gets, which looks again where an engine needs a moment.
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

pub(super) async fn a_job_goes_from_queued_by_running_to_completed<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.attempt), (State::Queued, 0));
    let claim = claim(&queue).await;
    assert_eq!((claim.lease.job, claim.attempt, &claim.owner), (id, 1, &owner));
    assert_eq!(claim.order, "method=med&density=2");
    assert_eq!(claim.picture, Picture::of_bytes(b"image"));
    let record = found(&queue, &owner, id).await;
    assert!(record.state == State::Running && record.started.is_some());
    let finish = queue.finish(claim.lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Completed));
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.mesh), (State::Completed, Some(figures("mesh"))));
    assert!(record.finished.is_some() && record.expires > record.finished);
    assert_eq!(queue.claim().await.unwrap(), None);
}

pub(super) async fn a_failed_job_keeps_its_problem<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::Anonymous);
    let id = submit(&queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Failed(problem())).await.unwrap();
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.problem), (State::Failed, Some(problem())));
}

pub(super) async fn what_was_acknowledged_is_there_after_a_kill<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let queue = engine.open(terms).await;
    let waiting = submit(&queue, &owner, "waiting").await;
    let running = submit(&queue, &owner, "running").await;
    let lease = claim(&queue).await.lease;
    assert_eq!(lease.job, waiting, "the oldest first");
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

pub(super) async fn a_job_whose_worker_falls_silent_is_given_to_another<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(Terms { lease: BRIEF, ..terms() }).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let silent = claim(&queue).await.lease;
    assert_eq!(queue.sweep().await.unwrap().requeued, 0, "the lease has not ended");
    for _ in 0..6 {
        sleep(BRIEF / 5).await;
        assert_eq!(queue.renew(silent, None).await.unwrap(), Renewal::Ok);
        assert_eq!(queue.sweep().await.unwrap().requeued, 0, "the lease is renewed");
    }
    let fallen_silent = async {
        loop {
            let requeued = queue.sweep().await.unwrap().requeued;
            if requeued > 0 {
                return requeued;
            }
            sleep(BRIEF / 10).await;
        }
    };
    assert_eq!(timeout(PATIENCE, fallen_silent).await.unwrap(), 1);
    let second = claim(&queue).await;
    assert_eq!((second.lease.job, second.attempt), (id, 2));
    assert!(second.lease.fence > silent.fence);
    assert_eq!(queue.renew(silent, None).await.unwrap(), Renewal::Lost);
    assert_eq!(queue.interruption(silent).await, Renewal::Lost);
    let late = queue.finish(silent, Outcome::Completed(figures("late"))).await.unwrap();
    assert_eq!(late, Finish::Fenced);
    queue.finish(second.lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(found(&queue, &owner, id).await.mesh, Some(figures("mesh")));
}

pub(super) async fn a_job_is_tried_three_times_and_then_failed_as_such<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let mut queue = engine.open(terms).await;
    let id = submit(&queue, &owner, "poison").await;
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

pub(super) async fn the_last_attempt_is_made_alone<E: Engine>(engine: &E) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let mut queue = engine.open(terms).await;
    let poison = submit(&queue, &owner, "poison").await;
    let innocent = submit(&queue, &owner, "innocent").await;
    for _ in 0..2 {
        claim(&queue).await;
        claim(&queue).await;
        drop(queue);
        queue = engine.open_after_kill(terms).await;
    }
    let last = claim(&queue).await;
    assert_eq!((last.lease.job, last.attempt), (poison, MAX_ATTEMPTS));
    assert_eq!(queue.claim().await.unwrap(), None, "nothing runs beside it");
    drop(queue);
    let queue = engine.open_after_kill(terms).await;
    assert_eq!(found(&queue, &owner, poison).await.state, State::Failed);
    let lease = claim(&queue).await.lease;
    assert_eq!(lease.job, innocent);
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(found(&queue, &owner, innocent).await.state, State::Completed);
}

pub(super) async fn a_last_attempt_waits_for_what_runs_and_what_is_new_waits_for_it<E: Engine>(
    engine: &E,
) {
    let queue = engine.open(terms()).await;
    let (poisoner, other) = (Owner::named("a"), Owner::named("b"));
    let poison = submit(&queue, &poisoner, "poison").await;
    for _ in 1..MAX_ATTEMPTS {
        let lease = claim(&queue).await.lease;
        queue.finish(lease, Outcome::Retry(problem())).await.unwrap();
    }
    // An owner who had no turn comes first.
    let before = submit(&queue, &other, "before").await;
    let runs = claim(&queue).await.lease;
    assert_eq!(runs.job, before);
    let new = submit(&queue, &other, "new").await;
    for _ in 0..2 {
        assert_eq!(queue.claim().await.unwrap(), None, "something runs");
    }
    queue.finish(runs, Outcome::Completed(figures("mesh"))).await.unwrap();
    let last = claim(&queue).await;
    assert_eq!((last.lease.job, last.attempt), (poison, MAX_ATTEMPTS));
    assert_eq!(queue.claim().await.unwrap(), None, "a last attempt runs");
    queue.finish(last.lease, Outcome::Retry(problem())).await.unwrap();
    assert_eq!(claim(&queue).await.lease.job, new);
}

pub(super) async fn an_attempt_that_was_handed_back_does_not_count<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    for _ in 0..5 {
        let claim = claim(&queue).await;
        assert_eq!(claim.attempt, 1);
        let finish = queue.finish(claim.lease, Outcome::HandedBack).await.unwrap();
        assert_eq!(finish, Finish::Committed(State::Queued));
    }
    assert_eq!(found(&queue, &owner, id).await.attempt, 0);
}

pub(super) async fn what_may_succeed_another_time_is_tried_again<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let mut ends = Vec::new();
    for _ in 0..MAX_ATTEMPTS {
        let lease = claim(&queue).await.lease;
        ends.push(queue.finish(lease, Outcome::Retry(problem())).await.unwrap());
    }
    let [queued, failed] = [State::Queued, State::Failed].map(Finish::Committed);
    assert_eq!(ends, [queued, queued, failed]);
    assert_eq!(found(&queue, &owner, id).await.problem, Some(problem()));
}

pub(super) async fn a_waiting_job_is_cancelled_at_once_and_then_deleted<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Cancelled);
    assert_eq!(found(&queue, &owner, id).await.state, State::Cancelled);
    sleep(E::SHORT).await;
    assert_eq!(queue.stats().await.unwrap().queued, 0);
    assert_eq!(queue.claim().await.unwrap(), None);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Deleted);
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Unknown);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Unknown);
}

pub(super) async fn the_worker_of_a_cancelled_job_is_told<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    let told = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { queue.interruption(lease).await }
    });
    sleep(E::SHORT).await;
    assert!(!told.is_finished());
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Requested);
    let told = timeout(PATIENCE, told).await.unwrap().unwrap();
    assert_eq!(told, Renewal::CancelRequested);
    assert_eq!(queue.renew(lease, None).await.unwrap(), Renewal::CancelRequested);
    // However the worker leaves it: its owner does not want it.
    let finish = queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Cancelled));
    assert_eq!(found(&queue, &owner, id).await.mesh, None);
}

pub(super) async fn a_cancelled_job_stays_cancelled_when_its_worker_is_killed<E: Engine>(
    engine: &E,
) {
    let terms = Terms { lease: E::LEASE, ..terms() };
    let owner = Owner::named("a");
    let queue = engine.open(terms).await;
    let id = submit(&queue, &owner, "image").await;
    claim(&queue).await;
    queue.cancel(&owner, id).await.unwrap();
    drop(queue);
    let queue = engine.open_after_kill(terms).await;
    assert_eq!(found(&queue, &owner, id).await.state, State::Cancelled);
}

pub(super) async fn nobody_sees_or_cancels_the_jobs_of_others<E: Engine>(engine: &E) {
    let queue = engine.open(terms()).await;
    let (mine, other) = (Owner::named("a"), Owner::named("b"));
    let id = submit(&queue, &mine, "image").await;
    for stranger in [&other, &Owner::Anonymous, &Owner::named("a ")] {
        assert_eq!(queue.get(stranger, id).await.unwrap(), Lookup::Unknown);
        assert_eq!(queue.cancel(stranger, id).await.unwrap(), Cancellation::Unknown);
        assert!(list(&queue, stranger, request(10)).await.jobs.is_empty());
    }
    assert_eq!(list(&queue, &mine, request(10)).await.jobs.len(), 1);
}

pub(super) async fn jobs_are_listed_newest_first_page_by_page<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let mut ids = Vec::new();
    for image in ["1", "2", "3", "4", "5"] {
        ids.push(submit(&queue, &owner, image).await);
        submit(&queue, &Owner::named("b"), image).await;
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
    assert_eq!(list(&queue, &owner, request(5)).await.next, None, "there is no empty page");
    queue.cancel(&owner, ids[2]).await.unwrap();
    let cancelled = PageRequest { state: Some(State::Cancelled), ..request(10) };
    let page = list(&queue, &owner, cancelled).await;
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [ids[2]]);
}

pub(super) async fn the_same_word_with_the_same_content_is_the_same_job<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let with_word = |owner: &Owner, image: &str, order: &str| NewJob {
        idempotency_key: Some("word".into()),
        order: order.into(),
        ..job(owner, image)
    };
    let first = queue.submit(with_word(&owner, "image", "size=5")).await.unwrap();
    let Submitted::Created(first) = first else { panic!("{first:?}") };
    let again = queue.submit(with_word(&owner, "image", "size=5")).await.unwrap();
    assert_eq!(again, Submitted::Existing(first.clone()));
    for (image, order) in [("other", "size=5"), ("image", "size=6")] {
        let other = queue.submit(with_word(&owner, image, order)).await.unwrap();
        assert_eq!(other, Submitted::KeyReused, "{image}, {order}");
    }
    let stranger = queue.submit(with_word(&Owner::named("b"), "other", "size=6")).await.unwrap();
    assert!(matches!(stranger, Submitted::Created(_)), "others have words of their own");
    // All at once they are one job, too.
    let queue_ref = &queue;
    let tries = (0..8).map(|_| queue_ref.submit(with_word(&owner, "image", "size=5")));
    for submitted in futures_util::future::join_all(tries).await {
        assert_eq!(submitted.unwrap(), Submitted::Existing(first.clone()));
    }
    queue.cancel(&owner, first.id).await.unwrap();
    queue.cancel(&owner, first.id).await.unwrap();
    let fresh = queue.submit(with_word(&owner, "other", "size=6")).await.unwrap();
    assert!(matches!(fresh, Submitted::Created(_)), "a deleted job takes its word with it");
}

pub(super) async fn words_are_forgotten_in_time<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { idempotency_ttl: E::SHORT, ..terms() }).await;
    let with_word =
        |image| NewJob { idempotency_key: Some("word".into()), ..job(&Owner::named("a"), image) };
    queue.submit(with_word("image")).await.unwrap();
    sleep(2 * E::SHORT).await;
    let forgotten = async {
        loop {
            match queue.submit(with_word("other")).await.unwrap() {
                Submitted::Created(_) => return,
                Submitted::KeyReused => sleep(E::SHORT).await,
                other => panic!("{other:?}"),
            }
        }
    };
    timeout(PATIENCE, forgotten).await.unwrap();
}

pub(super) async fn no_more_jobs_wait_than_may<E: Engine>(engine: &E) {
    let caps = Caps { queued: 3, queued_per_owner: 2, ..CAPS };
    let queue = engine.open(Terms { caps, ..terms() }).await;
    let (a, b) = (Owner::named("a"), Owner::named("b"));
    submit(&queue, &a, "1").await;
    submit(&queue, &a, "2").await;
    let refused = queue.submit(job(&a, "3")).await.unwrap();
    assert_eq!(refused, Submitted::OwnerFull { limit: 2 });
    submit(&queue, &b, "3").await;
    assert_eq!(queue.submit(job(&b, "4")).await.unwrap(), Submitted::QueueFull { limit: 3 });
    claim(&queue).await;
    submit(&queue, &b, "4").await;
    assert_eq!(queue.submit(job(&a, "5")).await.unwrap(), Submitted::QueueFull { limit: 3 });
    // More run and wait together than may wait.
    for _ in 0..2 {
        claim(&queue).await;
    }
    submit(&queue, &a, "5").await;
}

pub(super) async fn owners_take_turns_and_have_no_more_running_than_they_may<E: Engine>(
    engine: &E,
) {
    let caps = Caps { running_per_owner: 2, ..CAPS };
    let queue = engine.open(Terms { caps, ..terms() }).await;
    let (a, b) = (Owner::named("a"), Owner::named("b"));
    for image in ["1", "2", "3", "4", "5"] {
        submit(&queue, &a, image).await;
    }
    submit(&queue, &b, "6").await;
    submit(&queue, &b, "7").await;
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

pub(super) async fn there_is_a_count_of_what_waits_and_runs<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    for image in ["1", "2", "3"] {
        submit(&queue, &owner, image).await;
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
    // What runs waits no more, however long ago it came.
    let came = Instant::now();
    submit(&queue, &owner, "4").await;
    let waited_s = queue.stats().await.unwrap().oldest_queued_s;
    // Moments are kept to the millisecond.
    assert!(waited_s <= came.elapsed().as_secs_f64() + 0.002, "{waited_s}");
}

pub(super) async fn many_at_once_are_each_done_once<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let images: Vec<String> = (0..100).map(|i| i.to_string()).collect();
    let submissions = images.iter().map(|image| submit(&queue, &owner, image));
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
