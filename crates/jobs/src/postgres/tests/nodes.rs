//! Several nodes with one queue.

use super::*;
use crate::queue::MAX_ATTEMPTS;
use crate::record::State;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use tokio::time::timeout;

/// Claims all jobs on all nodes at once; returns the most jobs of each owner that ran at the same
/// time.
async fn claim_all(nodes: &[Arc<Postgres>], jobs: usize) -> BTreeMap<Owner, usize> {
    let running = Arc::new(Mutex::new((BTreeMap::<Owner, usize>::new(), BTreeMap::new())));
    let done = Arc::new(Mutex::new(BTreeSet::new()));
    let worker = |node: Arc<Postgres>| {
        let (running, done) = (Arc::clone(&running), Arc::clone(&done));
        async move {
            while done.lock().unwrap().len() < jobs {
                let Some(claim) = node.claim().await.unwrap() else {
                    sleep(Duration::from_millis(5)).await;
                    continue;
                };
                {
                    let (now, most) = &mut *running.lock().unwrap();
                    let running = now.entry(claim.owner.clone()).or_default();
                    *running += 1;
                    let most: &mut usize = most.entry(claim.owner.clone()).or_default();
                    *most = (*most).max(*running);
                }
                sleep(Duration::from_millis(10)).await;
                *running.lock().unwrap().0.get_mut(&claim.owner).unwrap() -= 1;
                let finish = node.finish(claim.lease, Outcome::Failed(json!({}))).await.unwrap();
                assert_eq!(finish, Finish::Committed(State::Failed));
                assert!(done.lock().unwrap().insert(claim.lease.job), "twice");
            }
        }
    };
    let workers =
        nodes.iter().flat_map(|node| (0..8).map(|_| tokio::spawn(worker(Arc::clone(node)))));
    futures_util::future::join_all(workers.collect::<Vec<_>>())
        .await
        .into_iter()
        .for_each(Result::unwrap);
    running.lock().unwrap().1.clone()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_claim_each_job_once_and_keep_caps() {
    for is_pooled in [false, true] {
        let engine = engine("claims", is_pooled);
        let caps = Caps { running_per_owner: 3, ..terms().caps };
        let terms = Terms { caps, ..terms() };
        let mut nodes = Vec::new();
        for _ in 0..3 {
            nodes.push(Arc::new(engine.opened(terms).await));
        }
        let owners = ["", "a", "b", "c"].map(Owner::of_stored);
        let images: Vec<String> = (0..40).map(|n| n.to_string()).collect();
        for owner in &owners {
            let jobs = images.iter().map(|image| submit(&*nodes[0], owner, image));
            futures_util::future::join_all(jobs).await;
        }
        let most = claim_all(&nodes, 160).await;
        for owner in &owners[1..] {
            assert!(most[owner] <= 3, "{owner}: {}", most[owner]);
        }
        assert_eq!(nodes[1].stats().await.unwrap(), Stats::default());
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_keep_the_cap_of_queued_jobs() {
    let engine = engine("queued", false);
    let terms = Terms { caps: Caps { queued_per_owner: 25, ..terms().caps }, ..terms() };
    let nodes = [engine.opened(terms).await, engine.opened(terms).await];
    let owner = Owner::named("a");
    let submissions = (0..100).map(|n| nodes[n % 2].submit(job(&owner, &n.to_string())));
    let submitted = futures_util::future::join_all(submissions).await;
    let created = submitted.iter().filter(|done| matches!(done, Ok(Submitted::Created(_))));
    assert_eq!(created.count(), 25);
    assert!(submitted.iter().all(Result::is_ok));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn idempotency_key_on_two_nodes_is_one_job() {
    let engine = engine("keys", false);
    let nodes = [engine.opened(terms()).await, engine.opened(terms()).await];
    let with_key =
        |_| NewJob { idempotency_key: Some("key".into()), ..job(&Owner::Anonymous, "i") };
    let submissions = (0..40).map(|n| nodes[n % 2].submit(with_key(n)));
    let submitted = futures_util::future::join_all(submissions).await;
    let id = |done: &Result<Submitted, QueueError>| match done {
        Ok(Submitted::Created(record) | Submitted::Existing(record)) => record.id,
        other => panic!("{other:?}"),
    };
    let ids: BTreeSet<JobId> = submitted.iter().map(id).collect();
    assert_eq!(ids.len(), 1);
    assert_eq!(nodes[0].stats().await.unwrap().queued, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn idempotency_key_repeated_in_a_batch_is_one_job() {
    let engine = engine("batch", false);
    let queue = engine.opened(terms()).await;
    let with_key =
        |image| NewJob { idempotency_key: Some("key".into()), ..job(&Owner::Anonymous, image) };
    let batch = [with_key("image"), with_key("image"), with_key("other")];
    let submitted = queue.node.submit(&batch).await.unwrap();
    let [Submitted::Created(first), Submitted::Existing(again), Submitted::KeyReused] =
        &submitted[..]
    else {
        panic!("{submitted:?}")
    };
    assert_eq!((first.id, first), (batch[0].id, again));
    assert_eq!(queue.stats().await.unwrap().queued, 1);
    assert!(queue.sweep().await.unwrap().orphans.contains(&batch[2].picture.digest));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn blob_marked_by_another_node_is_not_deleted() {
    let engine = engine("marks", false);
    let submitting = Terms { unused_blob_ttl: Duration::from_hours(1), ..terms() };
    let (node, sweeping) = (engine.opened(submitting).await, engine.opened(terms()).await);
    let marked = Digest::of(b"marked");
    node.expect(marked).await.unwrap();
    assert!(sweeping.sweep().await.unwrap().orphans.is_empty());
    // A job that uses the blob already takes the mark away, and ends while the node stores it.
    let id = submit(&node, &Owner::Anonymous, "used").await;
    let used = Digest::of(b"used");
    node.expect(used).await.unwrap();
    assert!(sweeping.sweep().await.unwrap().orphans.is_empty());
    node.cancel(&Owner::Anonymous, id).await.unwrap();
    assert!(sweeping.sweep().await.unwrap().orphans.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn node_waits_until_a_blob_is_deleted() {
    let engine = engine("deletion", false);
    let (node, sweeping) = (engine.opened(terms()).await, engine.opened(terms()).await);
    let blob = Digest::of(b"blob");
    node.expect(blob).await.unwrap();
    assert_eq!(sweeping.sweep().await.unwrap().orphans, [blob]);
    let marking = tokio::spawn(async move { node.expect(blob).await.map(|()| node) });
    sleep(InSchema::SHORT).await;
    assert!(!marking.is_finished());
    assert!(sweeping.sweep().await.unwrap().orphans.is_empty(), "one node deletes it");
    sweeping.forget(vec![blob]).await.unwrap();
    let marked = timeout(Duration::from_secs(20), marking).await.unwrap().unwrap();
    assert!(marked.is_ok());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn expired_lease_is_fenced() {
    let engine = engine("fence", false);
    let terms = Terms { lease: Duration::from_millis(200), ..terms() };
    let [slow, other] = [engine.opened(terms).await, engine.opened(terms).await];
    let id = submit(&slow, &Owner::Anonymous, "image").await;
    let lost = slow.claim().await.unwrap().unwrap().lease;
    sleep(2 * terms.lease).await;
    assert_eq!(other.sweep().await.unwrap().requeued, 1);
    let lease = other.claim().await.unwrap().unwrap().lease;
    assert_eq!(lease.job, id);
    let late = slow.finish(lost, Outcome::Failed(json!({}))).await.unwrap();
    assert_eq!(late, Finish::Fenced);
    assert_eq!(slow.renew(lost, None).await.unwrap(), Renewal::Lost);
    assert_eq!(other.renew(lease, None).await.unwrap(), Renewal::Ok);
    // A repeated outcome, whose acknowledgement may have been lost, has the same result.
    for _ in 0..2 {
        let finish = other.finish(lease, Outcome::Cancelled).await.unwrap();
        assert_eq!(finish, Finish::Committed(State::Cancelled));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn change_reaches_another_node_within_200_ms() {
    let engine = engine("change", false);
    let hour = Terms { poll_period: Duration::from_hours(1), ..terms() };
    let [one, other] = [engine.opened(hour).await, engine.opened(hour).await].map(Arc::new);
    let owner = Owner::named("a");
    let id = submit(&*one, &owner, "image").await;
    let mut took = Vec::new();
    for _ in 0..20 {
        let after = other.events(&owner, id, 0).await.unwrap().last().unwrap().revision;
        let follower = tokio::spawn({
            let (other, owner) = (Arc::clone(&other), owner.clone());
            async move {
                other.events(&owner, id, after).await.unwrap();
                Instant::now()
            }
        });
        sleep(Duration::from_millis(50)).await;
        let began = Instant::now();
        let lease = one.claim().await.unwrap().unwrap().lease;
        took.push(timeout(Duration::from_secs(60), follower).await.unwrap().unwrap() - began);
        one.finish(lease, Outcome::HandedBack).await.unwrap();
    }
    took.sort();
    assert!(took[took.len() / 2] < Duration::from_millis(200), "{took:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn last_attempt_is_reserved_by_one_node() {
    let engine = engine("reserved", false);
    let [busy, other] = [engine.opened(terms()).await, engine.opened(terms()).await];
    let poison = submit(&busy, &Owner::named("a"), "poison").await;
    for _ in 1..MAX_ATTEMPTS {
        let lease = busy.claim().await.unwrap().unwrap().lease;
        busy.finish(lease, Outcome::Retry(json!({}))).await.unwrap();
    }
    let first = submit(&busy, &Owner::named("b"), "first").await;
    let second = submit(&busy, &Owner::named("b"), "second").await;
    let runs = busy.claim().await.unwrap().unwrap().lease;
    assert_eq!(runs.job, first);
    assert_eq!(busy.claim().await.unwrap(), None, "another job is running");
    assert_eq!(other.claim().await.unwrap().unwrap().lease.job, second);
    assert_eq!(other.claim().await.unwrap(), None, "the first node has reserved it");
    busy.finish(runs, Outcome::Cancelled).await.unwrap();
    let last = busy.claim().await.unwrap().unwrap();
    assert_eq!((last.lease.job, last.attempt), (poison, MAX_ATTEMPTS));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn schemas_are_separate_queues() {
    let engine = engine("schemas", false);
    let one = engine.opened(terms()).await;
    submit(&one, &Owner::Anonymous, "image").await;
    let other = open(&engine.server.0.url(), "schemas-other", terms()).await.unwrap();
    assert_eq!(other.claim().await.unwrap(), None);
    assert_eq!(other.stats().await.unwrap(), Stats::default());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_share_the_mean_duration() {
    let engine = engine("mean", false);
    let [one, other] = [engine.opened(terms()).await, engine.opened(terms()).await];
    assert_eq!(other.mean_duration_s(None).await.unwrap(), None);
    assert_eq!(one.mean_duration_s(Some(2.5)).await.unwrap(), Some(2.5));
    assert_eq!(other.mean_duration_s(Some(4.0)).await.unwrap(), Some(4.0));
    // The first node has shared its mean before.
    assert_eq!(one.mean_duration_s(Some(2.5)).await.unwrap(), Some(4.0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn damaged_record_fails_its_job_only() {
    let engine = engine("damaged", false);
    let queue = engine.opened(terms()).await;
    let owner = Owner::Anonymous;
    let damaged = submit(&queue, &owner, "damaged").await;
    let whole = submit(&queue, &owner, "whole").await;
    let table = format!("\"{}\".jobs", engine.schema);
    engine
        .server
        .0
        .run_sql(&format!("UPDATE {table} SET image_shape = '{{' WHERE id = '{damaged}'"));
    assert_eq!(queue.claim().await.unwrap(), None);
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, whole);
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&owner, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole]);
    let Stats { queued, running, .. } = queue.stats().await.unwrap();
    assert_eq!((queued, running), (0, 1), "the damaged job has failed");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn refused_request_fails_alone() {
    let engine = engine("refused", false);
    let queue = engine.opened(terms()).await;
    let options = |n: usize| if n == 5 { "a\0b".into() } else { "density=2".to_owned() };
    let submissions = (0..20)
        .map(|n| queue.submit(NewJob { options: options(n), ..job(&Owner::Anonymous, "i") }));
    let submitted = futures_util::future::join_all(submissions).await;
    let refused: Vec<usize> = (0..20).filter(|&n| submitted[n].is_err()).collect();
    assert_eq!(refused, [5]);
    assert!(matches!(submitted[5], Err(QueueError::Database(_))));
}
