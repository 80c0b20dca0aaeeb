//! Who is told of what, and how soon.

use super::*;

pub(crate) async fn every_change_can_be_followed_from_any_point<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&queue, &owner, "image").await;
    let follower = tokio::spawn({
        let (queue, owner) = (Arc::clone(&queue), owner.clone());
        async move {
            let (mut heard, mut last) = (Vec::new(), 0);
            loop {
                let events = queue.events(&owner, id, last).await.unwrap();
                if events.is_empty() {
                    return heard;
                }
                last = events.last().unwrap().revision;
                heard.extend(events);
            }
        }
    });
    let lease = claim(&queue).await.lease;
    let progress = Progress { stage: "simplify".into(), fraction: 0.5 };
    queue.renew(lease, Some(progress.clone())).await.unwrap();
    assert_eq!(found(&queue, &owner, id).await.progress, Some(progress.clone()));
    let missed = queue.events(&owner, id, 1).await.unwrap();
    assert_eq!(states(&missed), [State::Running, State::Running]);
    assert_eq!(missed[1].progress, Some(progress));
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    let heard = timeout(PATIENCE, follower).await.unwrap().unwrap();
    let revisions: Vec<_> = heard.iter().map(|event| event.revision).collect();
    assert!(revisions.is_sorted_by(|a, b| a < b), "{revisions:?}");
    let heard = states(&heard);
    assert_eq!((heard.first(), heard.last()), (Some(&State::Queued), Some(&State::Completed)));
    assert!(heard.contains(&State::Running));
    // Afterwards the changes of state are known, and nothing more is waited for.
    let all = queue.events(&owner, id, 0).await.unwrap();
    assert_eq!(states(&all), [State::Queued, State::Running, State::Completed]);
    assert!(queue.events(&owner, id, u64::MAX).await.unwrap().is_empty());
    assert!(queue.events(&owner, JobId::new(), 0).await.unwrap().is_empty());
}

pub(crate) async fn work_is_heard_of_as_it_comes<E: Engine>(engine: &E) {
    // Who is not called never looks again in this test.
    let queue = engine.open(Terms { look_again: LONG, ..terms() }).await;
    assert_eq!(queue.claim().await.unwrap(), None);
    let mut waiting = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move {
            loop {
                if let Some(claim) = queue.claim().await.unwrap() {
                    return claim;
                }
                queue.work().await;
            }
        }
    });
    sleep(E::SHORT).await;
    let mut submitted = Vec::new();
    let heard = async {
        loop {
            submitted.push(submit(&queue, &Owner::Anonymous, "image").await);
            // A server of several may hear of a job a moment after the call; the next call finds it.
            if let Ok(claim) = timeout(BRIEF, &mut waiting).await {
                return claim.unwrap();
            }
        }
    };
    let claim = timeout(PATIENCE, heard).await.expect("work is called for");
    assert!(submitted.contains(&claim.lease.job));
}

/// What a worker gets who looks only where it is called: a server of several may hear of a job a moment
/// after the call, and one more call, for a job that is cancelled at once, finds it.
async fn claim_when_called(queue: &Arc<dyn Queue>, owner: &Owner) -> Claim {
    let looking = async {
        loop {
            if let Some(claim) = queue.claim().await.unwrap() {
                return claim;
            }
            let calling = submit(queue, owner, "another image").await;
            queue.cancel(owner, calling).await.unwrap();
        }
    };
    timeout(PATIENCE, looking).await.expect("a job waits")
}

pub(crate) async fn what_was_handed_back_is_called_for<E: Engine>(engine: &E) {
    // Who is not called never looks again in this test.
    let queue = engine.open(Terms { look_again: LONG, ..terms() }).await;
    let owner = Owner::Anonymous;
    let id = submit(&queue, &owner, "image").await;
    let lease = claim_when_called(&queue, &owner).await.lease;
    assert_eq!(queue.claim().await.unwrap(), None);
    // Of the call to the job as it came in nobody is to hear any more.
    while timeout(E::SHORT, queue.work()).await.is_ok() {}
    let called = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { queue.work().await }
    });
    sleep(E::SHORT).await;
    assert!(!called.is_finished(), "nothing is to be done");
    let finish = queue.finish(lease, Outcome::HandedBack).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Queued));
    timeout(PATIENCE, called).await.expect("work is called for").unwrap();
    let found = claim_when_called(&queue, &owner).await;
    assert_eq!(found.lease.job, id);
}

pub(crate) async fn a_change_is_heard_of_as_it_comes<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { look_again: LONG, ..terms() }).await;
    let owner = Owner::named("a");
    let id = submit(&queue, &owner, "image").await;
    let after = found(&queue, &owner, id).await.revision;
    let follower = tokio::spawn({
        let (queue, owner) = (Arc::clone(&queue), owner.clone());
        async move { queue.events(&owner, id, after).await.unwrap() }
    });
    sleep(E::SHORT).await;
    assert!(!follower.is_finished(), "nothing has changed");
    claim_when_called(&queue, &owner).await;
    let heard = timeout(PATIENCE, follower).await.expect("it has changed").unwrap();
    assert_eq!(states(&heard), [State::Running]);
}

pub(crate) async fn an_interruption_is_heard_of_as_it_comes<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { look_again: LONG, ..terms() }).await;
    let owner = Owner::named("a");
    let id = submit(&queue, &owner, "image").await;
    let lease = claim_when_called(&queue, &owner).await.lease;
    let told = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { queue.interruption(lease).await }
    });
    sleep(E::SHORT).await;
    assert!(!told.is_finished(), "nobody wants it to stop");
    queue.cancel(&owner, id).await.unwrap();
    let told = timeout(PATIENCE, told).await.expect("it must stop").unwrap();
    assert_eq!(told, Renewal::CancelRequested);
}
