//! A database that is killed and restarted.

use super::*;
use crate::record::State;
use serde_json::json;
use std::sync::atomic::{AtomicBool, Ordering};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn acknowledged_jobs_survive_a_killed_database() {
    let mut server = PostgresServer::start(&[]);
    let terms = Terms { lease: Duration::from_secs(3), ..terms() };
    let queue = Arc::new(open(&server.url(), "killed", terms).await.unwrap());
    let (stop, owner) = (Arc::new(AtomicBool::new(false)), Owner::named("a"));
    let submitting: Vec<_> = (0..8)
        .map(|_| {
            let (queue, stop, owner) = (Arc::clone(&queue), Arc::clone(&stop), owner.clone());
            tokio::spawn(async move {
                let mut acknowledged = Vec::new();
                while !stop.load(Ordering::Acquire) {
                    match queue.submit(job(&owner, "image")).await {
                        Ok(Submitted::Created(record)) => acknowledged.push(record.id),
                        Ok(other) => panic!("{other:?}"),
                        Err(error) => {
                            assert!(matches!(error, QueueError::Unreachable(_)), "{error}");
                        }
                    }
                    sleep(Duration::from_millis(5)).await;
                }
                acknowledged
            })
        })
        .collect();
    let working = tokio::spawn({
        let (queue, stop) = (Arc::clone(&queue), Arc::clone(&stop));
        async move {
            let mut ended = Vec::new();
            while !stop.load(Ordering::Acquire) {
                let Ok(Some(claim)) = queue.claim().await else {
                    sleep(Duration::from_millis(5)).await;
                    continue;
                };
                let failed = || Outcome::Failed(json!({}));
                if let Ok(Finish::Committed(_)) = queue.finish(claim.lease, failed()).await {
                    ended.push(claim.lease.job);
                }
            }
            ended
        }
    });
    for _ in 0..3 {
        sleep(Duration::from_millis(500)).await;
        server.kill();
        sleep(Duration::from_millis(300)).await;
        server.restart();
        let back = Instant::now();
        let accepted = queue.submit(job(&owner, "after")).await;
        assert!(matches!(accepted, Ok(Submitted::Created(_))), "{accepted:?}");
        assert!(back.elapsed() < Duration::from_secs(2), "{:?}", back.elapsed());
    }
    stop.store(true, Ordering::Release);
    let mut acknowledged = Vec::new();
    for submitting in submitting {
        acknowledged.extend(submitting.await.unwrap());
    }
    let ended = working.await.unwrap();
    assert!(acknowledged.len() > 100 && ended.len() > 10, "{} {}", acknowledged.len(), ended.len());
    for id in acknowledged {
        assert!(matches!(queue.get(&owner, id).await.unwrap(), Lookup::Found(_)), "{id} is lost");
    }
    for id in ended {
        let Lookup::Found(record) = queue.get(&owner, id).await.unwrap() else { panic!("{id}") };
        assert_eq!(record.state, State::Failed);
    }
    assert!(queue.is_healthy());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stopped_database_is_unreachable_within_8_s() {
    let mut server = PostgresServer::start(&["fsync=off"]);
    let queue = open(&server.url(), "stopped", terms()).await.unwrap();
    server.kill();
    let began = Instant::now();
    let error = queue.submit(job(&Owner::Anonymous, "image")).await.unwrap_err();
    assert!(matches!(error, QueueError::Unreachable(_)), "{error}");
    assert!(began.elapsed() < Duration::from_secs(8), "{:?}", began.elapsed());
    assert!(!queue.is_healthy());
}
