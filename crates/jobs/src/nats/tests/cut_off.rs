//! What was cut off half-way is completed or cleared away.

use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_blob_whose_submission_was_cut_off_is_given_up() {
    let Some(engine) = engine("cut-blob") else { return };
    let queue = opened(&engine).await;
    let blob = Digest::of(b"image");
    queue.expect(blob).await.unwrap();
    drop(queue);
    let other = opened(&engine).await;
    assert_eq!(other.sweep().await.unwrap().given_up, [blob]);
}

/// A moment after which a sweep looks for what belongs to what was written before.
async fn time_to_complete() {
    tokio::time::sleep(Duration::from_secs(11)).await;
}

/// Leaves a reference and a record as a submission does that is cut off right after.
async fn leave_record(queue: &Nats, job: &NewJob) {
    queue.refer(&job.picture.digest.to_string(), &job.owner, job.id).await.unwrap();
    let record = stored::StoredJob::new(job, None);
    let name = streams::record_name(&job.owner, job.id);
    queue.streams.jobs.put(&name, &record, table::Expected::Nothing).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn records_without_a_message_are_sent_to_work_by_a_sweep() {
    let Some(engine) = engine("cut-record") else { return };
    let queue = opened(&engine).await;
    // One that is whole lies before them, and one that has ended.
    let (ended, whole) = (job("ended", None), job("whole", None));
    for job in [&ended, &whole] {
        queue.submit(job.clone()).await.unwrap();
    }
    queue.cancel(&ended.owner, ended.id).await.unwrap();
    assert_eq!(claimed(&queue).await.lease.job, whole.id);
    let cut_off = [job("image", None), job("other", None)];
    for job in &cut_off {
        leave_record(&queue, job).await;
    }
    assert_eq!(queue.claim().await.unwrap(), None);
    time_to_complete().await;
    queue.sweep().await.unwrap();
    for job in &cut_off {
        assert_eq!(claimed(&queue).await.lease.job, job.id);
    }
    assert_eq!(queue.claim().await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn references_without_a_job_are_taken_away_by_a_sweep() {
    let Some(engine) = engine("cut-reference") else { return };
    let (queue, whole) = (opened(&engine).await, job("whole", None));
    queue.submit(whole.clone()).await.unwrap();
    let cut_off = [b"image", b"other"].map(|bytes| Digest::of(bytes));
    for blob in cut_off {
        queue.refer(&blob.to_string(), &Owner::Anonymous, JobId::new()).await.unwrap();
    }
    let blobs = vec![whole.picture.digest, cut_off[0], cut_off[1]];
    queue.sweep().await.unwrap();
    assert_eq!(
        queue.referenced(blobs.clone()).await.unwrap().len(),
        3,
        "jobs may come to have them"
    );
    time_to_complete().await;
    let mut given_up = queue.sweep().await.unwrap().given_up;
    given_up.sort();
    let mut expected = cut_off;
    expected.sort();
    assert_eq!(given_up, expected);
    assert_eq!(queue.referenced(blobs).await.unwrap(), [whole.picture.digest].into());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_without_a_record_is_dropped() {
    let Some(engine) = engine("cut-message") else { return };
    let queue = opened(&engine).await;
    let whole = job("whole", None);
    queue.send_to_work(&Owner::Anonymous, JobId::new()).await.unwrap();
    queue.submit(whole.clone()).await.unwrap();
    // A moment for the consumer to hear of both: the first claim passes over what is dropped.
    tokio::time::sleep(InServers::SHORT).await;
    assert_eq!(queue.claim().await.unwrap().unwrap().lease.job, whole.id);
    assert_eq!(queue.stats().await.unwrap().running, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_submission_with_a_word_that_was_cut_off_is_completed_by_the_next() {
    let Some(engine) = engine("cut-word") else { return };
    let queue = opened(&engine).await;
    let first = job("image", Some("word"));
    queue.leave_word(&first).await.unwrap();
    let again = queue.submit(job("image", Some("word"))).await.unwrap();
    let Submitted::Existing(record) = again else { panic!("{again:?}") };
    assert_eq!(record.id, first.id);
    assert_eq!(claimed(&queue).await.lease.job, first.id);
}

/// Has the server forget which messages it was sent, which it otherwise remembers for two minutes.
async fn forget_messages(queue: &Nats) {
    let brief = Duration::from_millis(100);
    let mut config = queue.streams.work.stream().get_info().await.unwrap().config;
    config.duplicate_window = brief;
    queue.broker.context.update_stream(config).await.unwrap();
    tokio::time::sleep(5 * brief).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_repeated_word_sends_to_work_what_waits_without_a_message_and_nothing_else() {
    let Some(engine) = engine("cut-word-record") else { return };
    let queue = opened(&engine).await;
    let first = job("image", Some("word"));
    queue.leave_word(&first).await.unwrap();
    leave_record(&queue, &first).await;
    assert_eq!(queue.claim().await.unwrap(), None);
    let submitted = queue.submit(job("image", Some("word"))).await.unwrap();
    assert!(matches!(&submitted, Submitted::Existing(job) if job.id == first.id), "{submitted:?}");
    assert_eq!(claimed(&queue).await.lease.job, first.id);

    let ended = job("image", Some("other word"));
    queue.submit(ended.clone()).await.unwrap();
    assert_eq!(queue.cancel(&ended.owner, ended.id).await.unwrap(), Cancellation::Cancelled);
    forget_messages(&queue).await;
    let submitted = queue.submit(job("image", Some("other word"))).await.unwrap();
    assert!(matches!(&submitted, Submitted::Existing(job) if job.id == ended.id), "{submitted:?}");
    tokio::time::sleep(InServers::SHORT).await;
    let stats = queue.stats().await.unwrap();
    assert_eq!((stats.queued, stats.running), (0, 1), "it has ended");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_that_is_there_before_its_record_is_that_of_the_job() {
    let Some(engine) = engine("cut-word-message") else { return };
    let (queue, first) = (opened(&engine).await, job("image", Some("word")));
    queue.leave_word(&first).await.unwrap();
    queue.send_to_work(&first.owner, first.id).await.unwrap();
    forget_messages(&queue).await;
    let submitted = queue.submit(job("image", Some("word"))).await.unwrap();
    assert!(matches!(&submitted, Submitted::Existing(job) if job.id == first.id), "{submitted:?}");
    assert_eq!(claimed(&queue).await.lease.job, first.id);
    assert_eq!(queue.claim().await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn meshes_that_no_job_comes_to_have_are_given_up() {
    let Some(engine) = engine("late-mesh") else { return };
    let queue = opened(&engine).await;
    let figures = |text: &str| crate::record::MeshFigures {
        progression: None,
        digest: Digest::of(text.as_bytes()).to_string(),
        bytes: text.len() as u64,
        vertices: 4,
        faces: 2,
        mse: 0.25,
        psnr_db: None,
        chunks: Vec::new(),
        timings_ms: Vec::new(),
    };
    // Of a worker whose process has been started again.
    let strange = Lease { job: JobId::new(), fence: 1 };
    let finish = queue.finish(strange, Outcome::Completed(figures("late"))).await.unwrap();
    assert_eq!(finish, Finish::Fenced);
    let [late, unwanted] = ["late", "unwanted"].map(|text| Digest::of(text.as_bytes()));
    assert_eq!(queue.sweep().await.unwrap().given_up, [late]);
    queue.forget(vec![late]).await.unwrap();
    // Of a job that was cancelled meanwhile.
    let cancelled = job("image", None);
    queue.submit(cancelled.clone()).await.unwrap();
    let lease = claimed(&queue).await.lease;
    queue.cancel(&cancelled.owner, cancelled.id).await.unwrap();
    queue.finish(lease, Outcome::Completed(figures("unwanted"))).await.unwrap();
    assert!(queue.referenced(vec![unwanted]).await.unwrap().is_empty());
    assert!(queue.sweep().await.unwrap().given_up.contains(&unwanted));
}
