//! Durable jobs: meshes that are made after the request that submits them.
//!
//! | state | meaning | next |
//! |---|---|---|
//! | queued | waits for a worker | running, or cancelled at once |
//! | running | a worker has a lease | completed, failed or cancelled; or queued again |
//! | completed, failed, cancelled | has ended | kept for the time results are kept, then gone |
//!
//! Guarantees:
//! - A submission is acknowledged when the picture and then the job are on stable storage.
//! - One worker at a time has a job. Each claim has a fence, and a worker with an older fence
//!   changes nothing: a job has one result, however many attempts there were.
//! - An attempt is counted before it starts, and there are at most three. The last attempt runs
//!   alone in its process, so that a job that crashes its process costs no other job an attempt. A
//!   worker that stops in good order hands its jobs back, and those attempts do not count.
//! - The mesh of a job is stored as MODEL, from which all formats are made on request.
//! - Jobs pass the same [scheduler](pixmesh_engine::scheduler) and
//!   [pipeline](pixmesh_engine::pipeline) as requests, so that both stay within one memory budget.
//!
//! | module | what |
//! |---|---|
//! | [`worker`] | claims jobs and runs them |
//! | [`retention`] | periodic maintenance |
//! | [`operating`] | what operators do to jobs of all owners |
//! | [`settings`] | the settings of the queue's engine |
//! | [`embedded`] | the queue in an SQLite database of one process |
//! | [`postgres`] | the queue in a PostgreSQL database that nodes share |
//! | `row` | jobs from the rows of a query |
//! | `transition` | the rules by which jobs change their states |
//! | [`queue`] | the queue as a trait, independent of its engine |
//! | `watchers` | tasks that wait for a change |
//! | [`blobs`] | the store of pictures and meshes |
//! | [`record`] | the record of a job |
//! | [`folder`] | the data folder, which one process locks, and its free space |
//! | [`stored`] | the bytes that the jobs of each owner keep |
//! | [`durations`] | the recent mean duration of attempts |
//! | [`telemetry`] | metrics |

pub mod blobs;
#[cfg(test)]
mod conformance;
pub mod durations;
pub mod embedded;
pub mod folder;
pub mod operating;
pub mod postgres;
pub mod queue;
pub mod record;
pub mod retention;
mod row;
mod secret;
pub mod settings;
pub mod stored;
pub mod telemetry;
#[cfg(test)]
mod testing;
mod transition;
mod watchers;
pub mod worker;

pub use secret::Secret;

use blobs::{BlobEngine, Blobs};
use bytes::Bytes;
use durations::Durations;
use embedded::Embedded;
use folder::DataFolder;
use postgres::Postgres;
pub use queue::{Caps, Paused, Queue, QueueError, Submitted, Terms};
use record::NewJob;
use settings::{QueueEngine, QueueSettings};
use std::error::Error;
use std::path::Path;
use std::sync::{Arc, Mutex};
use stored::StoredBytes;

/// The settings of the jobs.
#[derive(Clone, Debug)]
pub struct Settings<'a> {
    /// The folder of the embedded engine.
    pub data_dir: &'a Path,
    /// The bytes that new jobs leave free in the file system of that folder.
    pub least_free_bytes: u64,
    /// The engine of the queue and its connection.
    pub queue: &'a QueueSettings,
    /// The store of pictures and meshes.
    pub blobs: BlobEngine,
    /// The limits and times of the queue.
    pub terms: Terms,
}

/// Jobs and their blobs.
#[derive(Clone, Debug)]
pub struct Jobs {
    /// The queue.
    pub queue: Arc<dyn Queue>,
    /// Pictures and meshes.
    pub blobs: Blobs,
    /// The durations of attempts in this process.
    pub durations: Arc<Durations>,
    /// The bytes that jobs keep.
    pub stored: Arc<StoredBytes>,
    paused: Arc<Mutex<Paused>>,
}

impl Jobs {
    /// Opens the queue and the store of blobs that the settings name. The embedded engine locks its
    /// data folder.
    ///
    /// # Errors
    /// When the folder cannot be used or another process has it, or when the database or the store
    /// of blobs cannot be used.
    pub async fn open(settings: &Settings<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let Settings { queue, terms, .. } = *settings;
        let jobs = match &queue.queue {
            QueueEngine::Embedded => {
                Self::in_folder(settings).map_err(|error| error.to_string())?
            }
            QueueEngine::Postgres(url) => {
                let blobs = Blobs::shared(&settings.blobs).await?;
                let opened = Postgres::open(url, &queue.postgres, terms).await;
                let queue =
                    Arc::new(opened.map_err(|error| format!("--queue {}: {error}", queue.queue))?);
                Self::new(queue, blobs, terms)
            }
        };
        jobs.learn_paused().await?;
        Ok(jobs)
    }

    /// The embedded queue and its blobs.
    fn in_folder(settings: &Settings<'_>) -> Result<Self, Box<dyn Error>> {
        let folder = DataFolder::take(settings.data_dir, settings.least_free_bytes)?;
        let blobs = Blobs::in_folder(&folder.path().join("blobs"))?;
        let queue = Arc::new(Embedded::open(Arc::new(folder), settings.terms)?);
        Ok(Self::new(queue, blobs, settings.terms))
    }

    fn new(queue: Arc<dyn Queue>, blobs: Blobs, terms: Terms) -> Self {
        let stored = Arc::new(StoredBytes::new(terms.caps));
        Self { queue, blobs, durations: Arc::default(), stored, paused: Arc::default() }
    }

    /// Whether the last writes succeeded.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        self.queue.is_healthy() && self.blobs.is_healthy()
    }

    /// Fails if no new jobs are accepted now.
    ///
    /// # Errors
    /// [`QueueError::Paused`], or that there is no room.
    pub fn check_intake(&self) -> Result<(), QueueError> {
        if self.paused().intake { Err(QueueError::Paused) } else { self.queue.check_room() }
    }

    /// Puts a picture and then its job on stable storage. A submission that has started goes on
    /// when its future is dropped.
    ///
    /// # Errors
    /// When the blob or the job cannot be stored.
    pub async fn submit(&self, job: NewJob, image: Bytes) -> Result<Submitted, QueueError> {
        self.check_intake()?;
        let (owner, bytes) = (job.owner.clone(), job.picture.stored_bytes());
        if let Some(refused) = self.stored.add(&owner, bytes) {
            return Ok(refused);
        }
        let jobs = self.clone();
        let storing = tokio::spawn(async move {
            let submitted = jobs.store(job, image).await;
            if !matches!(submitted, Ok(Submitted::Created(_))) {
                jobs.stored.subtract(&owner, bytes);
            }
            submitted
        });
        storing.await.map_err(|error| QueueError::Storage(error.to_string()))?
    }

    async fn store(&self, job: NewJob, image: Bytes) -> Result<Submitted, QueueError> {
        let pin = self.blobs.pin().await;
        self.queue.expect(job.picture.digest).await?;
        self.blobs.put(&pin, job.picture.digest, image).await?;
        self.queue.submit(job).await
    }
}
