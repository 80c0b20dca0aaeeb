//! The worker claims jobs and runs them, one in each slot of the scheduler.
//!
//! It claims a job when it has a slot, because a claim counts as an attempt. While a job runs, the
//! worker renews its lease and stores its progress, and a cancellation stops it within
//! milliseconds. When the service stops, running jobs get a grace period to end; then the worker
//! hands them back.

use crate::Jobs;
use crate::blobs::Pin;
use crate::blobs::chunks::chunk_digests;
use crate::queue::{Claim, Finish, Lease, Outcome, QueueError, Renewal};
use crate::record::{MeshFigures, Picture, Progress, StoredPart};
use crate::telemetry;
use bytes::Bytes;
use pixmesh_codec::{Format, Limits};
use pixmesh_engine::digest::Digest;
use pixmesh_engine::pipeline::{Answer, JobMesh};
use pixmesh_engine::scheduler::Slot;
use pixmesh_engine::{Context, EngineError, MeshOptions, MeshTask, Scheduler, Weighed, Workers};
use pixmesh_meshing::Cancelled;
use serde_json::Value;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;
use tokio::task::JoinSet;
use tokio::time::{Instant as TokioInstant, MissedTickBehavior, interval_at, timeout};
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

/// The interval in which new progress is stored.
const PROGRESS_PERIOD: Duration = Duration::from_millis(500);
/// How often a lease is renewed in its term.
const RENEWALS_PER_LEASE: u32 = 3;
/// The pause before a failed operation is retried.
const PAUSE_AFTER_ERROR: Duration = Duration::from_secs(1);
/// How long handing back the running jobs may take.
const HAND_BACK_TIME: Duration = Duration::from_secs(2);

/// Claims and runs jobs.
#[derive(Clone, Debug)]
pub struct Worker {
    /// The queue and the blobs.
    pub jobs: Jobs,
    /// Admits each attempt.
    pub scheduler: Scheduler,
    /// The threads that attempts run on.
    pub workers: Workers,
    /// The limits of pictures.
    pub pictures: Limits,
    /// The time limit of an attempt.
    pub deadline: Duration,
    /// Makes the mesh: [`pixmesh_engine::pipeline::mesh_of_job`], or another function in tests.
    pub make: Make,
    /// Makes the problem document of a failed attempt.
    pub describe: fn(AttemptError) -> Value,
    /// The term of a lease.
    pub lease: Duration,
}

/// Makes the mesh of a picture, with its progression if the flag says so.
pub type Make =
    fn(Weighed<Bytes>, &MeshOptions, bool, &Limits, &Context) -> Result<JobMesh, EngineError>;

/// Why an attempt failed.
#[derive(Debug, Error)]
pub enum AttemptError {
    /// The task was refused, or failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The queue or the store of blobs failed.
    #[error(transparent)]
    Storage(#[from] QueueError),
    /// The stored picture has another length than the submitted one.
    #[error("the stored image has another length than the submitted one")]
    PictureChanged,
}

impl AttemptError {
    /// Whether another attempt may succeed: if the storage failed. All other errors would repeat.
    fn may_succeed_later(&self) -> bool {
        !matches!(self, Self::Engine(_) | Self::Storage(QueueError::Damaged(_)))
    }
}

impl Worker {
    /// Runs jobs until `stop`, gives the running ones the time `grace` to end, and hands back the
    /// rest.
    pub async fn run(self, stop: CancellationToken, grace: Duration) {
        let (hand_back, mut attempts) = (CancellationToken::new(), JoinSet::new());
        loop {
            let slot = tokio::select! {
                slot = self.scheduler.slot() => slot,
                () = stop.cancelled() => None,
            };
            let Some(slot) = slot else { break };
            // A claim is not cancelled, because a claimed job that nobody runs would lose an
            // attempt.
            let is_paused = self.jobs.paused().work;
            let claim = if is_paused { Ok(None) } else { self.jobs.queue.claim().await };
            match claim {
                Ok(Some(claim)) => {
                    let (worker, hand_back) = (self.clone(), hand_back.clone());
                    let span = tracing::info_span!("job", id = %claim.lease.job);
                    let attempt = async move { worker.attempt(slot, claim, &hand_back).await };
                    attempts.spawn(attempt.instrument(span));
                }
                Ok(None) => {
                    drop(slot);
                    tokio::select! {
                        () = self.jobs.queue.work() => {}
                        () = stop.cancelled() => break,
                    }
                }
                Err(error) => {
                    drop(slot);
                    tracing::warn!(%error, "claim failed");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
            while attempts.try_join_next().is_some() {}
        }
        let all = async { while attempts.join_next().await.is_some() {} };
        if timeout(grace, all).await.is_err() {
            hand_back.cancel();
            let _ = timeout(HAND_BACK_TIME, attempts.join_all()).await;
        }
    }

    /// One attempt at a job.
    async fn attempt(self, slot: Slot, claim: Claim, hand_back: &CancellationToken) {
        telemetry::job_attempt();
        let Claim { lease, attempt, .. } = claim;
        tracing::info!(attempt, "attempt started");
        let began = Instant::now();
        let context = Arc::new(Context::new(Instant::now() + self.deadline));
        let work = self.work(slot, &claim, &context);
        // The mesh must not be deleted before its job is finished.
        let mut pinned = None;
        let outcome = tokio::select! {
            done = work => match done {
                Ok((outcome, pin)) => {
                    pinned = Some(pin);
                    outcome
                }
                Err(error) if error.may_succeed_later() => {
                    tracing::error!(%error, attempt, "attempt failed: storage error");
                    Outcome::Retry((self.describe)(error))
                }
                Err(error) => Outcome::Failed((self.describe)(error)),
            },
            interruption = self.keep_lease(lease, &context) => match interruption {
                Renewal::CancelRequested => Outcome::Cancelled,
                _ => {
                    tracing::warn!("lease lost to another worker");
                    return;
                }
            },
            () = hand_back.cancelled() => Outcome::HandedBack,
        };
        context.cancel();
        if matches!(outcome, Outcome::Completed(_) | Outcome::Failed(_)) {
            self.jobs.durations.add(began.elapsed());
            telemetry::job_duration(began.elapsed());
        }
        self.finish(lease, outcome).await;
        drop(pinned);
    }

    /// Ends the attempt. Retries until the queue accepts the outcome or the lease is lost.
    async fn finish(&self, lease: Lease, outcome: Outcome) {
        loop {
            match self.jobs.queue.finish(lease, outcome.clone()).await {
                Ok(Finish::Committed(state)) => {
                    telemetry::job_ended(state);
                    tracing::info!(state = state.name(), "attempt finished");
                    return;
                }
                Ok(Finish::Fenced) => {
                    tracing::warn!("lease lost before the attempt finished");
                    return;
                }
                Err(error) => {
                    tracing::error!(%error, "outcome not stored");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
    }

    /// Renews the lease and stores progress, until the attempt must stop.
    async fn keep_lease(&self, lease: Lease, context: &Context) -> Renewal {
        let renewing = async {
            let mut ticks = interval_at(TokioInstant::now() + PROGRESS_PERIOD, PROGRESS_PERIOD);
            ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
            let (mut stored, mut renewed) = (None, Instant::now());
            loop {
                ticks.tick().await;
                let progress = context.progress();
                let thousandths = |value: f64| (value * 1e3).floor() / 1e3;
                let progress = progress.map(|progress| Progress {
                    stage: progress.stage.to_owned(),
                    fraction: thousandths(progress.fraction),
                    overall_fraction: thousandths(progress.whole),
                    // Whole seconds, because each change is stored.
                    remaining_s: progress.remaining.map(|rest| rest.as_secs_f64().ceil()),
                });
                let new = progress.filter(|progress| stored.as_ref() != Some(progress));
                if new.is_none() && renewed.elapsed() < self.lease / RENEWALS_PER_LEASE {
                    continue;
                }
                match self.jobs.queue.renew(lease, new.clone()).await {
                    Ok(Renewal::Ok) => renewed = Instant::now(),
                    Ok(interruption) => return interruption,
                    Err(error) => tracing::warn!(%error, "lease not renewed"),
                }
                stored = new.or(stored);
            }
        };
        tokio::select! {
            interruption = self.jobs.queue.interruption(lease) => interruption,
            interruption = renewing => interruption,
        }
    }

    /// Reads the picture, makes the mesh and stores it.
    async fn work(
        &self,
        slot: Slot,
        claim: &Claim,
        context: &Arc<Context>,
    ) -> Result<(Outcome, Pin), AttemptError> {
        let options = MeshOptions::of_stored(&claim.options)?;
        let deadline = Instant::now() + self.deadline;
        let file = self.fetch(claim.picture.digest, deadline).await?;
        let source = split(&file, &claim.picture)?;
        let task = MeshTask::for_job(source.as_bytes(), &options, &self.pictures)?;
        let keeps_progression = task.format == Format::Progression;
        let kept = options.output.keep_image.then(|| source.image.clone());
        drop(file);
        let ticket = self.scheduler.admit_to(slot, task.cost, deadline).await?;
        let (limits, make) = (self.pictures, self.make);
        let answer =
            self.workers.run_watched(ticket, Arc::clone(context), deadline, move |context, _| {
                let made = make(source, &options, keeps_progression, &limits, context)?;
                Ok(MeshBlob::new(made, kept.as_deref(), context)?)
            });
        let mesh = answer.await?;
        self.store(mesh, deadline).await
    }

    /// Reads the blob of the picture. Retries until the deadline while a shared store fails,
    /// because otherwise an outage of the store would use up the attempts of all queued jobs.
    async fn fetch(&self, digest: Digest, deadline: Instant) -> Result<Bytes, AttemptError> {
        loop {
            match self.jobs.blobs.get(digest).await {
                Err(error @ QueueError::Blobs(_)) if Instant::now() < deadline => {
                    tracing::warn!(%error, "picture not read");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
                fetched => return Ok(fetched?),
            }
        }
    }

    /// Stores the mesh. Retries until the deadline.
    async fn store(
        &self,
        mesh: MeshBlob,
        deadline: Instant,
    ) -> Result<(Outcome, Pin), AttemptError> {
        let MeshBlob { figures, digest, bytes } = mesh;
        loop {
            let pin = self.jobs.blobs.pin().await;
            let stored = match self.jobs.queue.expect(digest).await {
                Ok(()) => self.jobs.blobs.put(&pin, digest, bytes.clone()).await,
                Err(error) => Err(error),
            };
            match stored {
                Ok(()) => return Ok((Outcome::Completed(figures), pin)),
                Err(error) if Instant::now() >= deadline => return Err(error.into()),
                Err(error) => {
                    drop(pin);
                    // The picture takes more than its mesh, and goes when that is stored.
                    if matches!(error, QueueError::StorageFull(_)) {
                        self.jobs.queue.release_reserve();
                    }
                    tracing::warn!(%error, "mesh not stored");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
    }
}

/// Splits a blob into the picture and the weights after it, if there are any.
fn split(file: &Bytes, picture: &Picture) -> Result<Weighed<Bytes>, AttemptError> {
    let length = usize::try_from(picture.bytes).unwrap_or(usize::MAX);
    let Some(weights) = picture.shape.weights else {
        return Ok(Weighed { image: file.clone(), weights: None });
    };
    let rest = file.len().checked_sub(length).filter(|&rest| rest as u64 == weights.bytes);
    let Some(_) = rest else {
        return Err(AttemptError::PictureChanged);
    };
    Ok(Weighed { image: file.slice(..length), weights: Some(file.slice(length..)) })
}

/// A mesh and its blob.
struct MeshBlob {
    figures: MeshFigures,
    digest: Digest,
    bytes: Bytes,
}

impl MeshBlob {
    /// The blob is the MODEL text, followed by the progression, the texture and the image if there
    /// are any.
    fn new(made: JobMesh, image: Option<&[u8]>, context: &Context) -> Result<Self, Cancelled> {
        let JobMesh { mut answer, progression, texture } = made;
        let mut figures = figures_of(&answer);
        let mut digest = answer.digest;
        let model_digest = digest.to_string();
        let part = |bytes: &[u8]| StoredPart {
            bytes: bytes.len() as u64,
            model_digest: model_digest.clone(),
        };
        figures.progression = progression.as_deref().map(part);
        figures.texture = texture.as_deref().map(part);
        figures.image = image.map(part);
        let parts = [progression.as_deref(), texture.as_deref(), image];
        let parts = parts.into_iter().flatten().collect::<Vec<_>>();
        if !parts.is_empty() {
            parts.iter().for_each(|part| answer.bytes.extend_from_slice(part));
            digest = Digest::of_while(&answer.bytes, || context.check())?;
            figures.digest = digest.to_string();
        }
        figures.chunks = chunk_digests(&answer.bytes, || context.check())?;
        Ok(Self { figures, digest, bytes: answer.bytes.into() })
    }
}

fn figures_of(answer: &Answer) -> MeshFigures {
    let timing = |(stage, took): &(&str, Duration)| ((*stage).to_owned(), took.as_secs_f64() * 1e3);
    MeshFigures {
        digest: answer.digest.to_string(),
        bytes: answer.bytes.len() as u64,
        vertices: answer.vertices,
        faces: answer.faces,
        mse: answer.mse,
        psnr_db: Some(answer.psnr_db).filter(|psnr| psnr.is_finite()),
        timings_ms: answer.timings.iter().map(timing).collect(),
        chunks: Vec::new(),
        progression: None,
        texture: None,
        image: None,
    }
}

#[cfg(test)]
mod tests;
