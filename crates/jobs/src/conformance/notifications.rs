//! Notifications and events.

use super::*;

pub(crate) async fn events_follow_every_change<E: Engine>(engine: &E) {
    let (queue, owner) = (engine.open(terms()).await, Owner::named("a"));
    let id = submit(&*queue, &owner, "image").await;
    let follower = tokio::spawn({
        let (queue, owner) = (Arc::clone(&queue), owner.clone());
        async move {
            let (mut received, mut last) = (Vec::new(), 0);
            loop {
                let events = queue.events(&owner, id, last).await.unwrap();
                if events.is_empty() {
                    return received;
                }
                last = events.last().unwrap().revision;
                received.extend(events);
            }
        }
    });
    let lease = claim(&queue).await.lease;
    let progress = Progress {
        stage: "simplify".into(),
        fraction: 0.5,
        overall_fraction: 0.25,
        remaining_s: Some(3.0),
    };
    queue.renew(lease, Some(progress.clone())).await.unwrap();
    assert_eq!(found(&queue, &owner, id).await.progress, Some(progress.clone()));
    let missed = queue.events(&owner, id, 1).await.unwrap();
    assert_eq!(states(&missed), [State::Running, State::Running]);
    assert_eq!(missed[1].progress, Some(progress));
    queue.finish(lease, Outcome::Completed(figures("mesh"))).await.unwrap();
    let received = timeout(PATIENCE, follower).await.unwrap().unwrap();
    let revisions: Vec<_> = received.iter().map(|event| event.revision).collect();
    assert!(revisions.is_sorted_by(|a, b| a < b), "{revisions:?}");
    let received = states(&received);
    assert_eq!(
        (received.first(), received.last()),
        (Some(&State::Queued), Some(&State::Completed))
    );
    assert!(received.contains(&State::Running));
    // After the end of a job its states are known, and a follower does not wait.
    let all = queue.events(&owner, id, 0).await.unwrap();
    assert_eq!(states(&all), [State::Queued, State::Running, State::Completed]);
    assert!(queue.events(&owner, id, u64::MAX).await.unwrap().is_empty());
    assert!(queue.events(&owner, JobId::new(), 0).await.unwrap().is_empty());
}

pub(crate) async fn submission_wakes_a_worker<E: Engine>(engine: &E) {
    // A worker without a notification would wait for an hour.
    let queue = engine.open(Terms { poll_period: LONG, ..terms() }).await;
    assert_eq!(queue.claim().await.unwrap(), None);
    let waiting = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { claim(&queue).await }
    });
    sleep(E::SHORT).await;
    assert!(!waiting.is_finished(), "there is no job to claim");
    let submitted = submit(&*queue, &Owner::Anonymous, "image").await;
    assert_eq!(waiting.await.unwrap().lease.job, submitted);
}

pub(crate) async fn handed_back_job_wakes_a_worker<E: Engine>(engine: &E) {
    // A worker without a notification would wait for an hour.
    let queue = engine.open(Terms { poll_period: LONG, ..terms() }).await;
    let id = submit(&*queue, &Owner::Anonymous, "image").await;
    let lease = claim(&queue).await.lease;
    assert_eq!(queue.claim().await.unwrap(), None);
    // The notification of the submission is used up.
    while timeout(E::SHORT, queue.work()).await.is_ok() {}
    let woken = tokio::spawn({
        let queue = Arc::clone(&queue);
        async move { queue.work().await }
    });
    sleep(E::SHORT).await;
    assert!(!woken.is_finished(), "there is no job to claim");
    let finish = queue.finish(lease, Outcome::HandedBack).await.unwrap();
    assert_eq!(finish, Finish::Committed(State::Queued));
    timeout(PATIENCE, woken).await.expect("the worker is notified").unwrap();
    let found = claim(&queue).await;
    assert_eq!(found.lease.job, id);
}

pub(crate) async fn change_wakes_a_follower<E: Engine>(engine: &E) {
    let queue = engine.open(Terms { poll_period: LONG, ..terms() }).await;
    let owner = Owner::named("a");
    let id = submit(&*queue, &owner, "image").await;
    let after = found(&queue, &owner, id).await.revision;
    let follower = tokio::spawn({
        let (queue, owner) = (Arc::clone(&queue), owner.clone());
        async move { queue.events(&owner, id, after).await.unwrap() }
    });
    sleep(E::SHORT).await;
    assert!(!follower.is_finished(), "nothing has changed");
    claim(&queue).await;
    let received = timeout(PATIENCE, follower).await.expect("the follower is notified").unwrap();
    assert_eq!(states(&received), [State::Running]);
}
