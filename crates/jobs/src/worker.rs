//! Takes jobs from the queue and does them, as many at a time as there are slots to work.
//!
//! A slot is taken before the job: a job that is claimed runs, and its attempt counts. While it
//! runs, its lease is renewed, its progress is written down, and a cancellation stops it within
//! milliseconds. When the service stops, running jobs may end within a time; the others are handed
//! back, and wait for the next process.

use super::Jobs;
use super::blobs::Hold;
use super::blobs::chunks::chunk_digests;
use super::queue::{Claim, Finish, Lease, Outcome, QueueError, Renewal};
use super::record::{KeptProgression, MeshFigures, Picture, Progress};
use crate::telemetry;
use bytes::Bytes;
use pixmesh_codec::Format;
use pixmesh_codec::Limits;
use pixmesh_engine::MeshOptions;
use pixmesh_engine::Weighed;
use pixmesh_engine::digest::Digest;
use pixmesh_engine::pipeline::Answer;
use pixmesh_engine::scheduler::Slot;
use pixmesh_engine::{Context, EngineError, MeshTask, Scheduler, Workers};
use pixmesh_meshing::Cancelled;
use serde_json::Value;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;
use tokio::task::JoinSet;
use tokio::time::{Instant as TokioInstant, MissedTickBehavior, interval_at, timeout};
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

/// How often progress is written down, where there is any.
const PROGRESS_PERIOD: Duration = Duration::from_millis(500);
/// How many times a lease is renewed in its time, progress or not.
const HEARTBEATS_OF_LEASE: u32 = 3;
/// The pause after the queue failed.
const PAUSE_AFTER_ERROR: Duration = Duration::from_secs(1);
/// How long running jobs may take to be handed back.
const HANDING_BACK: Duration = Duration::from_secs(2);

/// What all work on jobs shares.
#[derive(Clone, Debug)]
pub struct Worker {
    /// The jobs.
    pub jobs: Jobs,
    /// Admits each attempt.
    pub scheduler: Scheduler,
    /// The threads that attempts run on.
    pub workers: Workers,
    /// What images may be like.
    pub pictures: Limits,
    /// The longest time of an attempt.
    pub deadline: Duration,
    /// What makes the mesh: [`pixmesh_engine::pipeline::mesh_of_job`], or what a test has in its place.
    pub make: Make,
    /// Makes the problem document of an attempt that failed.
    pub describe: fn(AttemptError) -> Value,
    /// How long a job is kept without its lease being renewed.
    pub lease: Duration,
}

/// Makes the mesh of an image by an order, with its progression or without.
pub type Make = fn(
    Weighed<Bytes>,
    &MeshOptions,
    bool,
    &Limits,
    &Context,
) -> Result<(Answer, Option<Vec<u8>>), EngineError>;

/// Why an attempt failed.
#[derive(Debug, Error)]
pub enum AttemptError {
    /// The task is refused, or fails.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The queue or the store of blobs fails.
    #[error(transparent)]
    Storage(#[from] QueueError),
    /// The stored picture has another length than the one that was submitted.
    #[error("the image is not stored as it was")]
    PictureChanged,
}

impl AttemptError {
    /// Whether the storage failed and another attempt may succeed; all else fails again.
    fn may_succeed_later(&self) -> bool {
        !matches!(self, Self::Engine(_) | Self::Storage(QueueError::Damaged(_)))
    }
}

impl Worker {
    /// Does jobs until `stop`, then lets those that run end within `grace`, and hands back the rest.
    pub async fn run(self, stop: CancellationToken, grace: Duration) {
        let (hand_back, mut attempts) = (CancellationToken::new(), JoinSet::new());
        loop {
            let slot = tokio::select! {
                slot = self.scheduler.slot() => slot,
                () = stop.cancelled() => None,
            };
            let Some(slot) = slot else { break };
            // Not given up half-way: a job that was claimed and then forgotten would have lost an
            // attempt.
            match self.jobs.queue.claim().await {
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
                    tracing::warn!(%error, "no job can be claimed");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
            while attempts.try_join_next().is_some() {}
        }
        let all = async { while attempts.join_next().await.is_some() {} };
        if timeout(grace, all).await.is_err() {
            hand_back.cancel();
            let _ = timeout(HANDING_BACK, attempts.join_all()).await;
        }
    }

    /// One attempt at a job, to whatever end.
    async fn attempt(self, slot: Slot, claim: Claim, hand_back: &CancellationToken) {
        telemetry::job_attempt();
        let Claim { lease, attempt, .. } = claim;
        tracing::info!(attempt, "attempt started");
        let began = Instant::now();
        let context = Arc::new(Context::new(Instant::now() + self.deadline));
        let work = self.work(slot, &claim, &context);
        // Until the job has its mesh, nobody may take the mesh for one that no job has.
        let mut hold = None;
        let outcome = tokio::select! {
            done = work => match done {
                Ok((outcome, held)) => {
                    hold = Some(held);
                    outcome
                }
                Err(error) if error.may_succeed_later() => {
                    tracing::error!(%error, attempt, "the storage failed an attempt");
                    Outcome::Retry((self.describe)(error))
                }
                Err(error) => Outcome::Failed((self.describe)(error)),
            },
            interruption = self.attend(lease, &context) => match interruption {
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
        drop(hold);
    }

    /// Ends the attempt, however long the queue takes to hear of it: until the lease is lost.
    async fn finish(&self, lease: Lease, outcome: Outcome) {
        loop {
            match self.jobs.queue.finish(lease, outcome.clone()).await {
                Ok(Finish::Committed(state)) => {
                    telemetry::job_ended(state);
                    tracing::info!(state = state.name(), "ended");
                    return;
                }
                Ok(Finish::Fenced) => {
                    tracing::warn!("lease lost before the attempt finished");
                    return;
                }
                Err(error) => {
                    tracing::error!(%error, "the end of a job could not be written");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
    }

    /// Renews the lease and writes progress down for as long as the job goes on, and returns when
    /// it must stop.
    async fn attend(&self, lease: Lease, context: &Context) -> Renewal {
        let renewing = async {
            let mut ticks = interval_at(TokioInstant::now() + PROGRESS_PERIOD, PROGRESS_PERIOD);
            ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
            let (mut told, mut renewed) = (None, Instant::now());
            loop {
                ticks.tick().await;
                let progress = context.progress();
                let progress = progress.map(|(stage, fraction)| Progress {
                    stage: stage.to_owned(),
                    fraction: (fraction * 1e3).floor() / 1e3,
                });
                let news = progress.filter(|progress| told.as_ref() != Some(progress));
                if news.is_none() && renewed.elapsed() < self.lease / HEARTBEATS_OF_LEASE {
                    continue;
                }
                match self.jobs.queue.renew(lease, news.clone()).await {
                    Ok(Renewal::Ok) => renewed = Instant::now(),
                    Ok(interruption) => return interruption,
                    Err(error) => tracing::warn!(%error, "a lease could not be renewed"),
                }
                told = news.or(told);
            }
        };
        tokio::select! {
            interruption = self.jobs.queue.interruption(lease) => interruption,
            interruption = renewing => interruption,
        }
    }

    /// The work itself: the image from its blob, the mesh to its own.
    async fn work(
        &self,
        slot: Slot,
        claim: &Claim,
        context: &Arc<Context>,
    ) -> Result<(Outcome, Hold), AttemptError> {
        let options = MeshOptions::of_stored(&claim.order)?;
        let deadline = Instant::now() + self.deadline;
        let file = self.fetch(claim.picture.digest, deadline).await?;
        let source = parted(&file, &claim.picture)?;
        let task = MeshTask::for_job(source.as_bytes(), &options, &self.pictures)?;
        let keeps_progression = task.format == Format::Progression;
        drop(file);
        let ticket = self.scheduler.admit_to(slot, task.cost, deadline).await?;
        let (limits, make) = (self.pictures, self.make);
        let answer =
            self.workers.run_watched(ticket, Arc::clone(context), deadline, move |context, _| {
                let made = make(source, &options, keeps_progression, &limits, context)?;
                Ok(Product::new(made, context)?)
            });
        let product = answer.await?;
        self.store(product, deadline).await
    }

    /// The picture's blob. While a store that nodes share does not give it, again and again until the
    /// deadline: it is the store that fails and not the job, and all that wait would use their attempts
    /// up on it.
    async fn fetch(&self, digest: Digest, deadline: Instant) -> Result<Bytes, AttemptError> {
        loop {
            match self.jobs.blobs.get(digest).await {
                Err(error @ QueueError::Blobs(_)) if Instant::now() < deadline => {
                    tracing::warn!(%error, "a picture could not be read");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
                fetched => return Ok(fetched?),
            }
        }
    }

    /// Stores the mesh; while the storage does not take it, again and again until the deadline.
    async fn store(
        &self,
        product: Product,
        deadline: Instant,
    ) -> Result<(Outcome, Hold), AttemptError> {
        let Product { figures, digest, bytes } = product;
        loop {
            let hold = self.jobs.blobs.hold().await;
            let stored = match self.jobs.queue.expect(digest).await {
                Ok(()) => self.jobs.blobs.put(&hold, digest, bytes.clone()).await,
                Err(error) => Err(error),
            };
            match stored {
                Ok(()) => return Ok((Outcome::Completed(figures), hold)),
                Err(error) if Instant::now() >= deadline => return Err(error.into()),
                Err(error) => {
                    drop(hold);
                    tracing::warn!(%error, "a mesh could not be stored");
                    tokio::time::sleep(PAUSE_AFTER_ERROR).await;
                }
            }
        }
    }
}

/// A picture and the weights behind it, if there are any.
fn parted(file: &Bytes, picture: &Picture) -> Result<Weighed<Bytes>, AttemptError> {
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

/// What a job leaves: its blob, and what is known of it.
struct Product {
    figures: MeshFigures,
    digest: Digest,
    bytes: Bytes,
}

impl Product {
    /// The MODEL, and behind it the order of its vertices where that is kept.
    fn new(
        (mut answer, progression): (Answer, Option<Vec<u8>>),
        context: &Context,
    ) -> Result<Self, Cancelled> {
        let mut figures = figures_of(&answer);
        let mut digest = answer.digest;
        if let Some(progression) = progression {
            let model_digest = digest.to_string();
            figures.progression =
                Some(KeptProgression { bytes: progression.len() as u64, model_digest });
            answer.bytes.extend_from_slice(&progression);
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
    }
}

#[cfg(test)]
mod tests;
