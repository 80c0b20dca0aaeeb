//! A kernel that panics takes its own job down, and nothing else.

use super::*;
use crate::admission::Limits as WorkLimits;
use crate::digest::Digest;
use crate::extract::owner::Owner;
use crate::jobs::embedded::Embedded;
use crate::jobs::fairness::Caps;
use crate::jobs::folder::DataFolder;
use crate::jobs::queue::{Lookup, Submitted, Terms};
use crate::jobs::record::{JobId, NewJob, Picture, Record};
use crate::jobs::{blobs::Blobs, folder_for_test};
use crate::pipeline;
use pixmesh_codec::probe;

const PICTURE: &[u8] = b"P2\n4 3\n9\n0 1 2 3 4 5 6 7 8 9 0 1\n";

/// Makes meshes, but panics for those of five vertices.
fn panicking(
    source: Weighed<Bytes>,
    order: &Order,
    keeps_progression: bool,
    limits: &Limits,
    watch: &Watch,
) -> Result<(Answer, Option<Vec<u8>>), Problem> {
    assert!(!order.query().contains("size=5"), "on purpose");
    pipeline::mesh_of_job(source, order, keeps_progression, limits, watch)
}

fn jobs() -> Jobs {
    let folder = Arc::new(DataFolder::take(&folder_for_test("panics")).unwrap());
    let hour = Duration::from_secs(3600);
    let caps = Caps { queued: 100, queued_per_owner: 100, running_per_owner: 100 };
    let terms =
        Terms { caps, lease: hour, result_ttl: hour, idempotency_ttl: hour, gone_ttl: hour };
    let blobs = Blobs::in_folder(&folder.path().join("blobs")).unwrap();
    let queue = Arc::new(Embedded::open(folder, terms).unwrap());
    Jobs { queue, blobs, durations: Arc::default() }
}

async fn submit(jobs: &Jobs, size: usize) -> JobId {
    let header = probe(PICTURE, &Limits::default()).unwrap();
    let job = NewJob {
        id: JobId::new(),
        owner: Owner::anonymous(),
        order: format!("method=med&size={size}"),
        picture: Picture::new(Digest::of(PICTURE), PICTURE.len(), &header),
        idempotency_key: None,
    };
    match jobs.submit(job, Bytes::from_static(PICTURE)).await.unwrap() {
        Submitted::Created(record) => record.id,
        other => panic!("{other:?}"),
    }
}

/// The job once it has come to its end.
async fn end(jobs: &Jobs, id: JobId) -> Record {
    loop {
        match jobs.queue.get(&Owner::anonymous(), id).await.unwrap() {
            Lookup::Found(record) if record.state.is_final() => return *record,
            Lookup::Found(record) => {
                jobs.queue.events(&Owner::anonymous(), id, record.revision).await.unwrap();
            }
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_kernel_that_panics_fails_its_job_and_the_others_go_on() {
    let jobs = jobs();
    let admission = Admission::new(&WorkLimits {
        workers: 1,
        memory_bytes: 64 << 20,
        queue_s: 10.0,
        running_per_key: 1,
        queued_per_key: 10,
    });
    let worker = Worker {
        jobs: jobs.clone(),
        admission,
        pictures: Limits::default(),
        deadline: Duration::from_secs(60),
        lease: Duration::from_secs(60),
        make: panicking,
    };
    let mut submitted = Vec::new();
    for size in [4, 5, 6, 5, 5, 7] {
        submitted.push((size, submit(&jobs, size).await));
    }
    let stop = CancellationToken::new();
    let working = tokio::spawn(worker.run(stop.clone(), Duration::from_secs(5)));
    for (size, id) in submitted {
        let record = timeout(Duration::from_secs(60), end(&jobs, id)).await.unwrap();
        let problem = record.problem.map(|problem| problem.to_string()).unwrap_or_default();
        assert_eq!(record.mesh.is_some(), size != 5, "{problem}");
        assert_eq!(problem.contains("/problems/internal"), size == 5, "{problem}");
        assert!(!problem.contains("on purpose"), "nothing internal is told");
        assert_eq!(record.attempt, 1);
    }
    stop.cancel();
    working.await.unwrap();
}
