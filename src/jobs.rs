//! Jobs: what is to be meshed later, and what became of it.
//!
//! | state | what | next |
//! |---|---|---|
//! | queued | waits for a worker | running, or cancelled at once |
//! | running | a worker has it | completed, failed or cancelled; or queued, when the worker stops or falls silent |
//! | completed, failed, cancelled | its end | kept for the time results are kept, then gone |
//!
//! What is promised:
//! - A submission is acknowledged when the image and then the job are on stable storage.
//! - A job has one worker at a time. Each claim has a fence, and whoever comes with an older one
//!   changes nothing: a job has one effect, however many attempts there were.
//! - An attempt is counted before it begins, and there are at most three. A job whose worker ended
//!   in each of them is failed as such. The last attempt is made alone, so that a job that takes its
//!   process down uses up no other's attempts. A worker that stops in peace gives its attempt back.
//! - What a job leaves is kept as MODEL, from which every format is made when it is asked for.
//! - Jobs pass the same [scheduler](pixmesh_engine::scheduler) as requests, and both the same
//!   [pipeline](pixmesh_engine::pipeline): together they never take more than the budget.
//!
//! | module | what |
//! |---|---|
//! | [`record`] | what is kept of a job |
//! | [`queue`] | the queue as a trait, whatever engine keeps it |
//! | [`fairness`] | whose job is next |
//! | [`embedded`] | the queue in an SQLite database of this process |
//! | [`nats`] | the queue in a broker that many nodes share |
//! | [`blobs`] | pictures and meshes, by the digest of their bytes |
//! | [`folder`] | the folder of both, which one process has at a time |
//! | [`durations`] | how long jobs took of late |
//! | [`worker`] | takes jobs from the queue and does them |
//! | [`retention`] | deletes what is no longer kept |

pub mod blobs;
#[cfg(test)]
mod conformance;
pub mod durations;
pub mod embedded;
pub mod fairness;
pub mod folder;
pub mod nats;
pub mod queue;
pub mod record;
pub mod retention;
pub mod worker;

use crate::config::Settings;
use crate::problem::{Kind, Problem, internal};
use blobs::Blobs;
use bytes::Bytes;
use durations::Durations;
use embedded::Embedded;
use fairness::Caps;
use folder::DataFolder;
use nats::{Broker, Nats};
use queue::{Queue, QueueError, Submitted, Terms};
use record::NewJob;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

/// How long the word that a client gave for a submission is remembered.
const IDEMPOTENCY_TTL: Duration = Duration::from_hours(24);
/// Seconds after which a client may try again when what nodes share does not answer: a cluster has
/// elected a new leader by then.
const RETRY_AFTER_S: u64 = 5;
/// How long it is remembered that there was a job.
const GONE_TTL: Duration = Duration::from_hours(7 * 24);
/// How often whoever waits for work, or for a change of a job, looks whether a call was missed.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Jobs and their blobs.
#[derive(Clone, Debug)]
pub struct Jobs {
    /// The queue.
    pub queue: Arc<dyn Queue>,
    /// Pictures and meshes.
    pub blobs: Blobs,
    /// How long jobs took here.
    pub durations: Arc<Durations>,
}

impl Jobs {
    /// Opens them where the settings say: in a folder, which is taken, or with a broker.
    ///
    /// # Errors
    /// When the folder cannot be used or another process has it, or the broker or the store of blobs
    /// cannot be used.
    pub async fn open(settings: &Settings) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let jobs = &settings.jobs;
        if !jobs.broker.is_shared() {
            return Self::in_folder(settings).map_err(|error| error.to_string().into());
        }
        let broker = Broker::connect(&jobs.broker).await?;
        let blobs = Blobs::shared(&jobs.blob_engine(), &broker).await?;
        let queue = Nats::open(broker, terms(settings)).await;
        let queue = queue.map_err(|error| format!("--queue {}: {error}", jobs.broker))?;
        Ok(Self { queue: Arc::new(queue), blobs, durations: Arc::default() })
    }

    /// Opens those of one process.
    fn in_folder(settings: &Settings) -> Result<Self, Box<dyn Error>> {
        let folder = Arc::new(DataFolder::take(&settings.jobs.data_dir)?);
        let blobs = Blobs::in_folder(&folder.path().join("blobs"))?;
        let queue = Arc::new(Embedded::open(folder, terms(settings))?);
        Ok(Self { queue, blobs, durations: Arc::default() })
    }

    /// Whether jobs can be kept, as far as is known from the last ones.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        self.queue.is_healthy() && self.blobs.is_healthy()
    }

    /// Puts a job and its image on stable storage: first the image, then the job. What was begun is
    /// ended, also when nobody waits for it any more.
    ///
    /// # Errors
    /// `storage-full` or `storage-unavailable`.
    pub async fn submit(&self, job: NewJob, image: Bytes) -> Result<Submitted, Problem> {
        let jobs = self.clone();
        let storing = tokio::spawn(async move {
            let hold = jobs.blobs.hold().await;
            jobs.queue.expect(job.picture.digest).await?;
            jobs.blobs.put(&hold, job.picture.digest, image).await?;
            jobs.queue.submit(job).await
        });
        let stored =
            storing.await.map_err(|error| internal("a job could not be stored", &error))?;
        Ok(stored?)
    }
}

/// What the settings ask of the queue.
fn terms(settings: &Settings) -> Terms {
    let jobs = &settings.jobs;
    let access = &settings.access;
    Terms {
        caps: Caps {
            queued: jobs.max_queued_jobs.get(),
            queued_per_owner: access.key_queued_jobs.get(),
            running_per_owner: access.running(settings.worker_count()),
        },
        lease: jobs.job_lease.0,
        result_ttl: jobs.result_ttl.0,
        idempotency_ttl: IDEMPOTENCY_TTL,
        gone_ttl: GONE_TTL,
        look_again: LOOK_AGAIN,
    }
}

impl From<QueueError> for Problem {
    fn from(error: QueueError) -> Self {
        let problem = match &error {
            QueueError::StorageFull(_) => {
                Self::new(Kind::StorageFull, "there is no room left for jobs").setting("--data-dir")
            }
            QueueError::Storage(_) => {
                Self::new(Kind::StorageUnavailable, "jobs can be neither stored nor read now")
                    .setting("--data-dir")
            }
            QueueError::Damaged(_) => {
                Self::new(Kind::StorageDamaged, "what was stored of this job is damaged")
            }
            QueueError::Blobs(_) => Self::new(
                Kind::StorageUnavailable,
                "pictures and meshes can be neither stored nor read now",
            )
            .setting("--blobs")
            .retry_after_s(RETRY_AFTER_S),
            QueueError::BrokerFull(_) => {
                Self::new(Kind::StorageFull, "the broker has no room left for jobs")
                    .setting("--queue")
            }
            QueueError::Broker(_) => Self::new(
                Kind::StorageUnavailable,
                "the broker can neither store nor read jobs now",
            )
            .setting("--queue")
            .retry_after_s(RETRY_AFTER_S),
            QueueError::Unreachable(_) => {
                Self::new(Kind::StorageUnavailable, "the broker that keeps jobs does not answer")
                    .setting("--queue")
                    .retry_after_s(RETRY_AFTER_S)
            }
        };
        problem.caused_by(&error)
    }
}

/// A new folder for a test.
#[cfg(test)]
pub(crate) fn folder_for_test(name: &str) -> std::path::PathBuf {
    let name = format!("pixmesh-{name}-{}", record::JobId::new());
    let path = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&path).unwrap();
    path
}
