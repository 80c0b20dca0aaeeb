//! What operators do to jobs of all owners.

use super::*;
use crate::queue::{Change, Paused, Search};

async fn search(queue: &Arc<dyn Queue>, search: Search) -> Vec<JobId> {
    let page = queue.search(search, 100).await.unwrap();
    page.jobs.iter().map(|job| job.id).collect()
}

/// Fails the next job in the queue.
async fn fail(queue: &Arc<dyn Queue>, problem: &str) -> JobId {
    let lease = claim(queue).await.lease;
    queue.finish(lease, Outcome::Failed(json!({ "type": problem }))).await.unwrap();
    lease.job
}

pub(crate) async fn search_finds_jobs_of_all_owners<E: Engine>(engine: &E) {
    let queue = engine.open(terms()).await;
    let (a, b) = (Owner::named("a"), Owner::named("b"));
    let first = submit(&*queue, &a, "first").await;
    assert_eq!(fail(&queue, "/problems/image-decode-failed").await, first);
    let second = submit(&*queue, &a, "second").await;
    assert_eq!(fail(&queue, "/problems/attempts-exhausted").await, second);
    let third = submit(&*queue, &b, "third").await;
    let fourth = submit(&*queue, &a, "fourth").await;
    let all = Search::default;
    assert_eq!(search(&queue, all()).await, [fourth, third, second, first]);
    let of_a = Search { owner: Some(a), ..all() };
    assert_eq!(search(&queue, of_a.clone()).await, [fourth, second, first]);
    let queued = Search { state: Some(State::Queued), ..all() };
    assert_eq!(search(&queue, queued).await, [fourth, third]);
    let failed_of_a = Search { state: Some(State::Failed), ..of_a };
    assert_eq!(search(&queue, failed_of_a).await, [second, first]);
    let exhausted = Search { problem: Some("/problems/attempts-exhausted".into()), ..all() };
    assert_eq!(search(&queue, exhausted).await, [second]);
    let between = Search { from: Some(second), before: Some(fourth), ..all() };
    assert_eq!(search(&queue, between).await, [third, second]);
    let page = queue.search(all(), 2).await.unwrap();
    assert_eq!((page.jobs.len(), page.next), (2, Some(third)));
}

pub(crate) async fn failed_job_is_retried_with_its_picture<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let image = Digest::of(b"image");
    let id = submit(&*queue, &owner, "image").await;
    assert_eq!(fail(&queue, "/problems/deadline-exceeded").await, id);
    assert!(!queue.sweep().await.unwrap().orphans.contains(&image), "it may be retried");
    assert!(queue.referenced(vec![image]).await.unwrap().contains(&image));
    assert_eq!(queue.stored_bytes().await.unwrap(), [(owner.clone(), 5)]);
    let unknown = JobId::new();
    let changed = queue.change(vec![id, unknown], Change::Retry).await.unwrap();
    assert_eq!(changed, [State::Queued]);
    assert_eq!(queue.change(vec![id], Change::Retry).await.unwrap(), [], "it waits");
    let record = found(&queue, &owner, id).await;
    assert_eq!((record.state, record.attempt, record.problem), (State::Queued, 0, None));
    assert_eq!((record.finished, record.expires), (None, None));
    assert_eq!(queue.stats().await.unwrap().queued, 1);
    let again = claim(&queue).await;
    assert_eq!((again.lease.job, again.attempt), (id, 1));
    queue.finish(again.lease, Outcome::Failed(problem())).await.unwrap();
    queue.cancel(&owner, id).await.unwrap();
    assert!(queue.sweep().await.unwrap().orphans.contains(&image), "the job is deleted");
}

pub(crate) async fn operator_cancels_and_deletes<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let running = submit(&*queue, &owner, "running").await;
    let lease = claim(&queue).await.lease;
    let queued = submit(&*queue, &owner, "queued").await;
    let both = vec![running, queued];
    assert_eq!(queue.change(both.clone(), Change::Delete).await.unwrap(), [], "none has ended");
    let mut changed = queue.change(both, Change::Cancel).await.unwrap();
    changed.sort_by_key(|state| *state as usize);
    assert_eq!(changed, [State::Running, State::Cancelled]);
    assert_eq!(queue.renew(lease, None).await.unwrap(), Renewal::CancelRequested);
    assert_eq!(queue.change(vec![queued], Change::Delete).await.unwrap(), [State::Cancelled]);
    assert_eq!(queue.get(&owner, queued).await.unwrap(), Lookup::Gone);
    assert_eq!(queue.sweep().await.unwrap().expired, 1);
    assert_eq!(queue.get(&owner, queued).await.unwrap(), Lookup::Gone);
    let stats = queue.stats().await.unwrap();
    assert_eq!((stats.queued, stats.running), (0, 1));
}

pub(crate) async fn what_is_paused_is_kept<E: Engine>(engine: &E) {
    let queue = engine.open(terms()).await;
    assert_eq!(queue.paused().await.unwrap(), Paused::default());
    let paused = Paused { intake: false, work: true };
    queue.pause(Paused { intake: true, work: true }).await.unwrap();
    queue.pause(paused).await.unwrap();
    drop(queue);
    assert_eq!(engine.open(terms()).await.paused().await.unwrap(), paused);
}
