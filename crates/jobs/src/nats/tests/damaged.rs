//! Records and other values that cannot be read.

use super::*;

/// Puts what nothing can read in the place of a value.
pub(super) async fn damage(table: &table::Table, name: &str) {
    let nonsense = async_nats::jetstream::message::PublishMessage::build().payload("{".into());
    let put = table.publish(name, nonsense).await.unwrap();
    assert!(matches!(put, table::Put::Stored(_)), "{put:?}");
}

async fn damage_record(queue: &Nats, job: &NewJob) {
    damage(&queue.streams.jobs, &streams::record_name(&job.owner, job.id)).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_record_that_cannot_be_read_is_set_aside_and_the_others_go_on() {
    let Some(engine) = engine("damaged") else { return };
    let queue = opened(&engine).await;
    let (damaged, whole) = (job("damaged", None), job("whole", None));
    queue.submit(damaged.clone()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    damage_record(&queue, &damaged).await;
    assert_eq!(claimed(&queue).await.lease.job, whole.id);
    assert_eq!(queue.claim().await.unwrap(), None);
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
    let stats = queue.stats().await.unwrap();
    assert_eq!((stats.queued, stats.running), (0, 1), "nobody is given it again");
    let found = queue.get(&damaged.owner, damaged.id).await;
    assert!(matches!(found, Err(QueueError::Damaged(_))), "{found:?}");
    let request = PageRequest { state: None, before: None, limit: 10 };
    let page = queue.list(&whole.owner, request).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [whole.id]);
    let image = damaged.picture.digest;
    assert!(queue.referenced(vec![image]).await.unwrap().contains(&image), "it may be mended");
    let deleted = queue.cancel(&damaged.owner, damaged.id).await.unwrap();
    assert_eq!(deleted, Cancellation::Deleted);
    assert_eq!(queue.get(&damaged.owner, damaged.id).await.unwrap(), Lookup::Unknown);
    assert_eq!(queue.sweep().await.unwrap().given_up, [image]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_whose_record_is_damaged_as_it_runs_is_lost_to_its_worker() {
    let Some(engine) = engine("damaged-running") else { return };
    let queue = opened(&engine).await;
    let (one, other) = (job("one", None), job("other", None));
    for job in [&one, &other] {
        queue.submit(job.clone()).await.unwrap();
        let lease = claimed(&queue).await.lease;
        damage_record(&queue, job).await;
        if job.id == one.id {
            assert_eq!(queue.renew(lease, None).await.unwrap(), Renewal::Lost);
            assert_eq!(queue.interruption(lease).await, Renewal::Lost);
        }
        let finish = queue.finish(lease, Outcome::Cancelled).await.unwrap();
        assert_eq!(finish, Finish::Fenced);
    }
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_record_that_cannot_be_read_is_gone_in_its_time() {
    let Some(engine) = engine("damaged-gone") else { return };
    let result_ttl = Duration::from_secs(4);
    let terms = Terms { result_ttl, ..terms() };
    let queue = Nats::open(engine.broker().await, terms).await.unwrap();
    let damaged = job("damaged", None);
    queue.submit(damaged.clone()).await.unwrap();
    damage_record(&queue, &damaged).await;
    assert_eq!(queue.sweep().await.unwrap().expired, 0);
    tokio::time::sleep(result_ttl + InServers::SHORT).await;
    let swept = queue.sweep().await.unwrap();
    assert_eq!((swept.expired, swept.given_up), (1, vec![damaged.picture.digest]));
    assert_eq!(queue.get(&damaged.owner, damaged.id).await.unwrap(), Lookup::Gone);
    assert_eq!(queue.claim().await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_word_a_mark_and_an_end_that_cannot_be_read_stop_nothing() {
    let Some(engine) = engine("damaged-others") else { return };
    let queue = opened(&engine).await;
    let first = job("image", Some("word"));
    queue.submit(first.clone()).await.unwrap();
    for (table, name) in [
        (&queue.streams.words, queue.streams.words.names("word.*").await.unwrap().remove(0)),
        (&queue.streams.blobs, "turn.sweep".into()),
        (&queue.streams.gone, streams::gone_name(&first.owner, first.id)),
    ] {
        damage(table, &name).await;
    }
    let again = queue.submit(job("image", Some("word"))).await.unwrap();
    assert!(matches!(again, Submitted::Created(_)), "{again:?}");
    for _ in 0..2 {
        queue.sweep().await.unwrap();
    }
    queue.cancel(&first.owner, first.id).await.unwrap();
    queue.cancel(&first.owner, first.id).await.unwrap();
    assert_eq!(queue.get(&first.owner, first.id).await.unwrap(), Lookup::Gone);
}
