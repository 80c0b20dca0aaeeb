//! How long jobs and their blobs are kept.

use super::*;

pub(crate) async fn jobs_are_gone_after_their_time_and_then_unknown<E: Engine>(engine: &E) {
    let terms = Terms { result_ttl: E::SHORT, gone_ttl: E::SHORT + BRIEF, ..terms() };
    let (queue, owner) = (engine.open(terms).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let waiting = submit(&queue, &owner, "waiting").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    sleep(2 * E::SHORT).await;
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Gone, "before any sweep");
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Gone);
    assert_eq!(list(&queue, &owner, request(9)).await.jobs.len(), 1);
    let swept = queue.sweep().await.unwrap();
    assert_eq!(swept.expired, 1);
    let mesh = Digest::of(b"mesh");
    assert!(swept.given_up.contains(&mesh) && swept.given_up.contains(&Digest::of(b"image")));
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Gone);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Gone);
    let unknown = async {
        while queue.get(&owner, id).await.unwrap() != Lookup::Unknown {
            sleep(BRIEF / 10).await;
            queue.sweep().await.unwrap();
        }
    };
    timeout(PATIENCE, unknown).await.unwrap();
    assert_eq!(found(&queue, &owner, waiting).await.state, State::Queued, "it has not ended");
}

pub(crate) async fn blobs_are_given_up_with_the_last_job_that_has_them<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let image = Digest::of(b"image");
    let first = submit(&queue, &owner, "image").await;
    let second = submit(&queue, &owner, "image").await;
    queue.cancel(&owner, first).await.unwrap();
    assert!(!queue.sweep().await.unwrap().given_up.contains(&image), "the second job has it");
    assert!(queue.referenced(vec![image]).await.unwrap().contains(&image));
    queue.cancel(&owner, second).await.unwrap();
    assert!(queue.sweep().await.unwrap().given_up.contains(&image));
    assert!(queue.referenced(vec![image]).await.unwrap().is_empty());
    assert!(queue.sweep().await.unwrap().given_up.contains(&image), "until it is seen to");
    queue.forget(vec![image]).await.unwrap();
    assert!(queue.sweep().await.unwrap().given_up.is_empty());
}

pub(crate) async fn a_blob_stored_for_nothing_is_given_up<E: Engine>(engine: &E) {
    let caps = Caps { queued: 1, ..CAPS };
    let (queue, owner) = (engine.open(Terms { caps, ..terms() }).await, Owner::named("a"));
    submit(&queue, &owner, "image").await;
    queue.submit(job(&owner, "refused")).await.unwrap();
    assert_eq!(queue.sweep().await.unwrap().given_up, [Digest::of(b"refused")]);
}

pub(crate) async fn a_mesh_is_kept_while_its_job_is<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let [image, mesh] = [b"image", b"mesh!"].map(|bytes| Digest::of(bytes));
    let id = submit(&queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Completed(figures("mesh!"))).await.unwrap();
    let kept = queue.referenced(vec![image, mesh]).await.unwrap();
    assert!(kept.contains(&mesh) && !kept.contains(&image));
    assert_eq!(queue.sweep().await.unwrap().given_up, [image]);
    queue.forget(vec![image]).await.unwrap();
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Deleted);
    assert!(queue.referenced(vec![image, mesh]).await.unwrap().is_empty());
    assert!(queue.sweep().await.unwrap().given_up.contains(&mesh));
}
