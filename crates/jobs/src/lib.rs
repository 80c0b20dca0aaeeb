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
//! | [`postgres`] | the queue in a PostgreSQL database that many nodes share |
//! | [`blobs`] | pictures and meshes, by the digest of their bytes |
//! | [`folder`] | the folder of both, which one process has at a time |
//! | [`durations`] | how long jobs took of late |
//! | [`settings`] | the settings of the queue's engine |
//! | [`worker`] | takes jobs from the queue and does them |
//! | [`retention`] | deletes what is no longer kept |

pub mod blobs;
#[cfg(test)]
mod conformance;
pub mod durations;
pub mod embedded;
pub mod fairness;
pub mod folder;
pub mod postgres;
pub mod queue;
pub mod record;
pub mod retention;
mod secret;
pub mod settings;
pub mod telemetry;
pub mod worker;

pub use secret::Secret;

use blobs::{BlobEngine, Blobs};
use bytes::Bytes;
use durations::Durations;
use embedded::Embedded;
use folder::DataFolder;
use postgres::Postgres;
pub use queue::{Queue, QueueError, Submitted, Terms};
use record::NewJob;
use settings::QueueSettings;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Where jobs are kept, and what is asked of their queue.
#[derive(Clone, Debug)]
pub struct Settings<'a> {
    /// The folder of a queue of one process.
    pub data_dir: &'a Path,
    /// The engine of the queue and its connection.
    pub queue: &'a QueueSettings,
    /// Where pictures and meshes are kept.
    pub blobs: BlobEngine,
    /// What the queue is asked to keep to.
    pub terms: Terms,
}

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
    /// Opens the queue and the store of blobs that the settings name. The embedded engine locks its
    /// data folder.
    ///
    /// # Errors
    /// When the folder cannot be used or another process has it, or when the database or the store of
    /// blobs cannot be used.
    pub async fn open(settings: &Settings<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let Settings { queue, terms, .. } = *settings;
        let Some(database) = queue.postgres() else {
            return Self::in_folder(settings).map_err(|error| error.to_string().into());
        };
        let blobs = Blobs::shared(&settings.blobs).await?;
        let opened = Postgres::open(&database, terms).await;
        let queue = Arc::new(opened.map_err(|error| format!("--queue {queue}: {error}"))?);
        Ok(Self { queue, blobs, durations: Arc::default() })
    }

    /// Opens the jobs of one process.
    fn in_folder(settings: &Settings<'_>) -> Result<Self, Box<dyn Error>> {
        let folder = Arc::new(DataFolder::take(settings.data_dir)?);
        let blobs = Blobs::in_folder(&folder.path().join("blobs"))?;
        let queue = Arc::new(Embedded::open(folder, settings.terms)?);
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
    /// When the blob or the job cannot be stored.
    pub async fn submit(&self, job: NewJob, image: Bytes) -> Result<Submitted, QueueError> {
        let jobs = self.clone();
        let storing = tokio::spawn(async move {
            let hold = jobs.blobs.hold().await;
            jobs.queue.expect(job.picture.digest).await?;
            jobs.blobs.put(&hold, job.picture.digest, image).await?;
            jobs.queue.submit(job).await
        });
        storing.await.map_err(|error| QueueError::Storage(error.to_string()))?
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
