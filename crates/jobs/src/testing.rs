//! Values and folders that tests share.

use crate::Jobs;
use crate::blobs::Blobs;
use crate::embedded::Embedded;
use crate::folder::DataFolder;
use crate::queue::{Caps, Queue, Submitted, Terms};
use crate::record::{JobId, MeshFigures, NewJob, Picture, PictureShape};
use bytes::Bytes;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;

const HOUR: Duration = Duration::from_hours(1);

/// Terms whose caps and times no test reaches.
pub(crate) fn terms() -> Terms {
    let caps = Caps {
        queued: 10_000,
        queued_per_owner: 10_000,
        running_per_owner: 10_000,
        stored_bytes: u64::MAX,
        stored_bytes_per_owner: u64::MAX,
    };
    Terms {
        caps,
        lease: HOUR,
        result_ttl: HOUR,
        idempotency_ttl: HOUR,
        gone_ttl: HOUR,
        unused_blob_ttl: Duration::ZERO,
        poll_period: Duration::from_secs(1),
    }
}

/// A job with the picture that [`picture`] makes of a text.
pub(crate) fn job(owner: &Owner, image: &str) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: owner.clone(),
        options: "method=med&density=2".into(),
        picture: picture(image.as_bytes()),
        idempotency_key: None,
    }
}

/// A gray picture of 2 by 2 pixels, whose file has these bytes.
pub(crate) fn picture(bytes: &[u8]) -> Picture {
    let shape = PictureShape { width: 2, height: 2, components: 1, precision: 8, weights: None };
    Picture { digest: Digest::of(bytes), bytes: bytes.len() as u64, shape }
}

/// The figures of a mesh whose blob is this text.
pub(crate) fn figures(blob: &str) -> MeshFigures {
    MeshFigures {
        digest: Digest::of(blob.as_bytes()).to_string(),
        bytes: blob.len() as u64,
        vertices: 4,
        faces: 2,
        mse: 0.25,
        psnr_db: Some(54.15),
        timings_ms: vec![("decode".into(), 1.5)],
        chunks: vec![Digest::of(b"a chunk")],
        progression: None,
        texture: None,
        image: None,
    }
}

pub(crate) async fn submit(queue: &dyn Queue, owner: &Owner, image: &str) -> JobId {
    match queue.submit(job(owner, image)).await.unwrap() {
        Submitted::Created(record) => record.id,
        other => panic!("{other:?}"),
    }
}

/// The jobs of one process, in a folder that is deleted with the second value.
pub(crate) fn jobs(terms: Terms) -> (Jobs, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    (jobs_in(folder.path(), terms), folder)
}

/// The jobs of one process in a folder.
pub(crate) fn jobs_in(folder: &Path, terms: Terms) -> Jobs {
    let blobs = Blobs::in_folder(&folder.join("blobs")).unwrap();
    let locked = Arc::new(DataFolder::take(folder, 0).unwrap());
    let queue = Arc::new(Embedded::open(locked, terms).unwrap());
    Jobs::new(queue, blobs, terms)
}

/// Submits an anonymous job with its picture, and returns its id and the digest of the picture.
pub(crate) async fn submit_picture(jobs: &Jobs, picture: &'static str) -> (JobId, Digest) {
    let job = job(&Owner::Anonymous, picture);
    let (id, digest) = (job.id, job.picture.digest);
    jobs.submit(job, Bytes::from_static(picture.as_bytes())).await.unwrap();
    (id, digest)
}

/// Blobs in a folder that is deleted with the second value.
pub(crate) fn blobs() -> (Blobs, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    (Blobs::in_folder(&folder.path().join("blobs")).unwrap(), folder)
}

/// Stores a blob.
pub(crate) async fn put(blobs: &Blobs, bytes: &'static [u8]) -> Digest {
    let (pin, digest) = (blobs.pin().await, Digest::of(bytes));
    blobs.put(&pin, digest, Bytes::from_static(bytes)).await.unwrap();
    digest
}
