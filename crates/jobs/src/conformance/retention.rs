//! How long jobs and their blobs are stored.

use super::*;

pub(crate) async fn expired_job_is_gone_then_unknown<E: Engine>(engine: &E) {
    let terms = Terms { result_ttl: E::SHORT, gone_ttl: E::SHORT + BRIEF, ..terms() };
    let (queue, owner) = (engine.open(terms).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    let waiting = submit(&*queue, &owner, "waiting").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    sleep(2 * E::SHORT).await;
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Gone, "before any sweep");
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Gone);
    assert_eq!(list(&queue, &owner, request(9)).await.jobs.len(), 1);
    let swept = queue.sweep().await.unwrap();
    assert_eq!(swept.expired, 1);
    let mesh = Digest::of(b"mesh");
    assert!(swept.orphans.contains(&mesh) && swept.orphans.contains(&Digest::of(b"image")));
    assert_eq!(queue.get(&owner, id).await.unwrap(), Lookup::Gone);
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Gone);
    let unknown = async {
        while queue.get(&owner, id).await.unwrap() != Lookup::Unknown {
            sleep(BRIEF / 10).await;
            queue.sweep().await.unwrap();
        }
    };
    timeout(PATIENCE, unknown).await.unwrap();
    assert_eq!(
        found(&queue, &owner, waiting).await.state,
        State::Queued,
        "queued jobs do not expire"
    );
}

pub(crate) async fn picture_is_orphaned_with_its_last_job<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let image = Digest::of(b"image");
    let first = submit(&*queue, &owner, "image").await;
    let second = submit(&*queue, &owner, "image").await;
    queue.cancel(&owner, first).await.unwrap();
    assert!(!queue.sweep().await.unwrap().orphans.contains(&image), "the second job uses it");
    assert!(queue.referenced(vec![image]).await.unwrap().contains(&image));
    queue.cancel(&owner, second).await.unwrap();
    assert!(queue.sweep().await.unwrap().orphans.contains(&image));
    assert!(queue.referenced(vec![image]).await.unwrap().is_empty());
    queue.forget(vec![image]).await.unwrap();
    assert!(queue.sweep().await.unwrap().orphans.is_empty());
}

pub(crate) async fn picture_of_a_refused_job_is_orphaned<E: Engine>(engine: &E) {
    let caps = Caps { queued: 1, ..terms().caps };
    let (queue, owner) = (engine.open(Terms { caps, ..terms() }).await, Owner::named("a"));
    submit(&*queue, &owner, "image").await;
    queue.submit(job(&owner, "refused")).await.unwrap();
    assert_eq!(queue.sweep().await.unwrap().orphans, [Digest::of(b"refused")]);
}

pub(crate) async fn mesh_is_referenced_until_its_job_is_deleted<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let [image, mesh] = [b"image", b"mesh!"].map(|bytes| Digest::of(bytes));
    let id = submit(&*queue, &owner, "image").await;
    let lease = claim(&queue).await.lease;
    queue.finish(lease, Outcome::Completed(figures("mesh!"))).await.unwrap();
    let kept = queue.referenced(vec![image, mesh]).await.unwrap();
    assert!(kept.contains(&mesh) && !kept.contains(&image));
    assert_eq!(queue.sweep().await.unwrap().orphans, [image]);
    queue.forget(vec![image]).await.unwrap();
    assert_eq!(queue.cancel(&owner, id).await.unwrap(), Cancellation::Deleted);
    assert!(queue.referenced(vec![image, mesh]).await.unwrap().is_empty());
    assert!(queue.sweep().await.unwrap().orphans.contains(&mesh));
}

pub(crate) async fn stored_bytes_are_those_of_pictures_then_of_meshes<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    assert_eq!(queue.stored_bytes().await.unwrap(), []);
    let weights =
        StoredWeights { bytes: 20, digest: Digest::of(b"w"), picture_digest: Digest::of(b"p") };
    let mut with_weights = job(&owner, "a picture");
    with_weights.picture.shape.weights = Some(weights);
    queue.submit(with_weights).await.unwrap();
    submit(&*queue, &Owner::Anonymous, "another").await;
    let stored = async || {
        let mut stored = queue.stored_bytes().await.unwrap();
        stored.sort();
        stored
    };
    assert_eq!(stored().await, [(Owner::Anonymous, 7), (owner.clone(), 29)]);
    let claims = [claim(&queue).await, claim(&queue).await];
    for Claim { lease, owner, .. } in claims {
        let part = StoredPart { bytes: 100, model_digest: String::new() };
        let parts = owner.is_key().then_some(part);
        let mesh = MeshFigures {
            texture: parts.clone(),
            image: parts.clone(),
            progression: parts,
            ..figures("mesh!")
        };
        queue.finish(lease, Outcome::Completed(mesh)).await.unwrap();
    }
    assert_eq!(stored().await, [(Owner::Anonymous, 5), (owner.clone(), 305)]);
    for job in list(&queue, &owner, request(9)).await.jobs {
        queue.cancel(&owner, job.id).await.unwrap();
    }
    assert_eq!(stored().await, [(Owner::Anonymous, 5)]);
}
