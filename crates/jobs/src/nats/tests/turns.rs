//! Who sweeps, who is asked for work, and what a sweep finds of silent workers.

use super::*;
use crate::record::State;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_node_sweeps_until_it_falls_silent_and_another_takes_over() {
    let Some(engine) = engine("turns") else { return };
    let (one, other) = (opened(&engine).await, opened(&engine).await);
    let blob = Digest::of(b"image");
    one.expect(blob).await.unwrap();
    for _ in 0..2 {
        assert_eq!(one.sweep().await.unwrap().given_up, [blob]);
        assert_eq!(other.sweep().await.unwrap(), Swept::default(), "it is the turn of the first");
    }
    assert_eq!(other.sweep().await.unwrap().given_up, [blob], "the first has fallen silent");
    assert_eq!(one.sweep().await.unwrap(), Swept::default(), "it is the turn of the second");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_sweep_counts_the_jobs_whose_last_worker_fell_silent() {
    let Some(engine) = engine("exhausted") else { return };
    let terms = Terms { lease: InServers::LEASE, ..terms() };
    let open = async || Nats::open(engine.broker().await, terms).await.unwrap();
    let (one, other, sweeper) = (open().await, open().await, open().await);
    let poison = job("poison", None);
    one.submit(poison.clone()).await.unwrap();
    for _ in 1..crate::queue::MAX_ATTEMPTS {
        let lease = claimed(&one).await.lease;
        one.finish(lease, Outcome::Retry(serde_json::Value::Null)).await.unwrap();
    }
    assert_eq!(claimed(&one).await.lease.job, poison.id);
    let cancelled = ["1", "2"].map(|image| job(image, None));
    for job in &cancelled {
        other.submit(job.clone()).await.unwrap();
        assert_eq!(claimed(&other).await.lease.job, job.id);
        other.cancel(&job.owner, job.id).await.unwrap();
    }
    assert_eq!(sweeper.sweep().await.unwrap().exhausted, 0, "nobody has been silent for long");
    tokio::time::sleep(terms.lease).await;
    let swept = sweeper.sweep().await.unwrap();
    assert_eq!((swept.exhausted, swept.requeued), (1, 0));
    let ends = [(&poison, State::Failed), (&cancelled[0], State::Cancelled)];
    for (job, state) in ends {
        let Lookup::Found(record) = sweeper.get(&job.owner, job.id).await.unwrap() else {
            panic!()
        };
        assert_eq!(record.state, state);
    }
}

/// A worker counts as silent when its record has not changed: a client that asks again and again
/// must not keep it from that.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_cancels_a_running_job_once_more_changes_nothing() {
    let Some(engine) = engine("cancelled-twice") else { return };
    let (queue, job) = (opened(&engine).await, job("image", None));
    queue.submit(job.clone()).await.unwrap();
    claimed(&queue).await;
    let mut versions = Vec::new();
    for _ in 0..2 {
        let asked = queue.cancel(&job.owner, job.id).await.unwrap();
        assert_eq!(asked, Cancellation::Requested);
        versions.push(queue.record(&job.owner, job.id).await.unwrap().unwrap().version);
    }
    assert_eq!(versions[0], versions[1]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_owner_who_had_nothing_is_asked_again_in_time_and_not_before() {
    let Some(engine) = engine("ask-again") else { return };
    let open = async |look_again| {
        let terms = Terms { look_again, ..terms() };
        let queue = Nats::open(engine.broker().await, terms).await.unwrap();
        queue.owners.consumer(&Owner::Anonymous).await.unwrap();
        assert_eq!(queue.claim().await.unwrap(), None);
        queue
    };
    let (patient, other) = (open(Duration::from_secs(3600)).await, open(Duration::ZERO).await);
    // Nobody is called: the call may have been lost.
    let job = job("image", None);
    let (record, name) =
        (stored::StoredJob::new(&job, None), streams::record_name(&job.owner, job.id));
    patient.streams.jobs.put(&name, &record, table::Expected::Nothing).await.unwrap();
    let work = streams::work_name(&job.owner, job.id);
    patient.streams.work.put(&work, &(), table::Expected::Nothing).await.unwrap();
    tokio::time::sleep(InServers::SHORT).await;
    assert_eq!(patient.claim().await.unwrap(), None);
    assert_eq!(claimed(&other).await.lease.job, job.id);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_queue_that_is_let_go_listens_no_more() {
    let Some(engine) = engine("let-go") else { return };
    let queue = opened(&engine).await;
    let owners = Arc::downgrade(&queue.owners);
    drop(queue);
    let forgotten = async {
        while owners.upgrade().is_some() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(Duration::from_secs(60), forgotten).await.expect("nobody has them");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_known_of_a_job_may_be_old_and_is_looked_at_anew() {
    let Some(engine) = engine("old-record") else { return };
    let (queue, job) = (opened(&engine).await, job("image", None));
    queue.submit(job.clone()).await.unwrap();
    let old = queue.record(&job.owner, job.id).await.unwrap();
    claimed(&queue).await;
    let seen = queue.change(&job.owner, job.id, old, |job| records::Step::Leave(job.attempt()));
    assert_eq!(seen.await.unwrap().unwrap().0, 1);
}
