//! What time brings, and what was cut off half-way: workers that fell silent, jobs that are no longer
//! kept, records without a message, references without a record.

use super::Nats;
use super::stored::{StoredJob, TakenBack};
use super::streams::{job_of_name, owner_of_word, owner_word, reference_of, work_name};
use super::table::{self, Versioned};
use crate::queue::{QueueError, Stats, Swept};
use crate::record::{JobId, Moment, State};
use async_nats::jetstream::message::StreamMessage;
use futures_util::future::try_join_all;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use std::time::Duration;

/// The most messages of a kind that one sweep looks at, so that it is short.
const MOST_MESSAGES: usize = 1024;
/// How old a record is before its message, or a reference before its record, is looked for: whoever
/// writes one writes the other within that time.
const TIME_TO_COMPLETE: Duration = Duration::from_secs(10);

/// Where the next sweep goes on.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// The version after that of the last record whose message was looked for.
    records: u64,
    /// The same for references.
    references: u64,
    /// The version from which records are looked at for their end.
    ends: u64,
}

impl Nats {
    /// Does what is due.
    pub(super) async fn sweep_all(&self) -> Result<Swept, QueueError> {
        let mut places = self.places.lock().await;
        let mut swept = Swept::default();
        self.owners.refresh().await?;
        if !self.turn.is_ours(&self.streams.blobs).await? {
            return Ok(swept);
        }
        self.take_back_silent(&mut swept).await?;
        swept.expired = self.expire_due(&mut places).await?;
        self.complete_submissions(&mut places).await?;
        self.check_references(&mut places).await?;
        swept.given_up = self.given_up().await?;
        Ok(swept)
    }

    /// Takes jobs from workers that fell silent.
    async fn take_back_silent(&self, swept: &mut Swept) -> Result<(), QueueError> {
        let mut running = Vec::new();
        for owner in self.owners.all() {
            let info = self.owners.info(&owner).await?;
            if info.num_ack_pending > 0 {
                let filter = format!("work.{}.*", owner_word(&owner));
                running.extend(self.given_out(&filter, info.delivered.stream_sequence).await?);
            }
        }
        self.silence.keep_only(&running);
        for (owner, id) in running {
            let Some(record) = self.readable_record(&owner, id).await? else { continue };
            let is_silent = self.silence.is_over(id, record.version, self.terms.lease);
            if record.value.state() == Some(State::Running) && is_silent {
                self.take_back(&owner, id, record, swept).await?;
            }
        }
        Ok(())
    }

    /// The jobs whose messages workers were given.
    async fn given_out(&self, filter: &str, last: u64) -> Result<Vec<(Owner, JobId)>, QueueError> {
        let (mut found, mut version) = (Vec::new(), 1);
        while let Some((name, message)) = self.streams.work.next(filter, version).await? {
            if message.sequence > last || found.len() >= MOST_MESSAGES {
                break;
            }
            found.extend(job_of_name(&name));
            version = message.sequence + 1;
        }
        Ok(found)
    }

    async fn take_back(
        &self,
        owner: &Owner,
        id: JobId,
        record: Versioned<StoredJob>,
        swept: &mut Swept,
    ) -> Result<(), QueueError> {
        let (ttl, version) = (self.terms.result_ttl, record.version);
        // One that was renewed meanwhile is left alone.
        let changed = self.change_version(owner, id, record, |job| job.take_back(ttl)).await?;
        let Some((taken, record)) = changed else { return Ok(()) };
        tracing::info!(job = %id, version, ?taken, "its worker fell silent");
        if taken == TakenBack::Queued {
            swept.requeued += 1;
            self.call_to_work(owner).await;
        } else {
            swept.exhausted += usize::from(taken == TakenBack::Exhausted);
            self.let_go(id, &record.value).await?;
            self.streams.work.take_away(&work_name(owner, id)).await?;
        }
        self.announce(id).await;
        Ok(())
    }

    /// Keeps of jobs past their time nothing but that they were. Records lie in the order of their
    /// last change, and all ended ones are kept equally long: the first that is not over is the last
    /// to look at. One that cannot be read is kept as long as if it had ended with its last change.
    async fn expire_due(&self, places: &mut Places) -> Result<usize, QueueError> {
        let mut expired = 0;
        for _ in 0..MOST_MESSAGES {
            let Some((name, message)) = self.streams.jobs.next("job.*.*", places.ends).await?
            else {
                places.ends = 0;
                break;
            };
            places.ends = message.sequence + 1;
            let Some((owner, id)) = job_of_name(&name) else { continue };
            let Ok(Versioned { value: job, .. }) = table::read::<StoredJob>(&message) else {
                if age(&message) >= self.terms.result_ttl {
                    self.expire_damaged(&owner, id).await?;
                    expired += 1;
                }
                continue;
            };
            if !job.is_final() {
                continue;
            }
            if !job.is_over() {
                places.ends = 0;
                break;
            }
            self.expire(&owner, id, &job).await?;
            expired += 1;
        }
        Ok(expired)
    }

    /// Sends to work what was recorded and whose message is missing.
    async fn complete_submissions(&self, places: &mut Places) -> Result<(), QueueError> {
        for _ in 0..MOST_MESSAGES {
            let next = self.streams.jobs.next("job.*.*", places.records).await?;
            let Some((name, message)) = next.filter(|(_, message)| is_older(message)) else {
                break;
            };
            places.records = message.sequence + 1;
            let Some((owner, id, job)) = job_of(&name, &message) else { continue };
            if job.is_final() {
                continue;
            }
            if !self.streams.work.has(&work_name(&owner, id)).await? {
                tracing::warn!(job = %id, "its message was missing");
                self.send_to_work(&owner, id).await?;
            }
        }
        Ok(())
    }

    /// Takes references away whose jobs were never recorded, or need the blob no more.
    async fn check_references(&self, places: &mut Places) -> Result<(), QueueError> {
        for _ in 0..MOST_MESSAGES {
            let next = self.streams.blobs.next("ref.*.*", places.references).await?;
            let Some((name, message)) = next.filter(|(_, message)| is_older(message)) else {
                break;
            };
            places.references = message.sequence + 1;
            let Some((blob, id)) = reference_of(&name) else { continue };
            let owner = table::read::<String>(&message).ok();
            let Some(owner) = owner.and_then(|owner| owner_of_word(&owner.value)) else { continue };
            let is_needed = match self.record(&owner, id).await {
                Ok(record) => record.is_some_and(|record| record.value.needs(blob)),
                // Nobody can tell.
                Err(QueueError::Damaged(_)) => true,
                Err(error) => return Err(error),
            };
            if !is_needed {
                self.release(blob, id).await?;
            }
        }
        Ok(())
    }

    /// The blobs that were given up and that no job has: one that a job has is given up again later.
    async fn given_up(&self) -> Result<Vec<Digest>, QueueError> {
        let mut names = self.streams.blobs.names("free.*").await?;
        names.truncate(MOST_MESSAGES);
        let mut found = Vec::new();
        for name in names {
            let Some(blob) = name.strip_prefix("free.").and_then(|text| text.parse().ok()) else {
                continue;
            };
            if self.is_referenced(blob).await? {
                self.streams.blobs.remove(&name).await?;
            } else {
                found.push(blob);
            }
        }
        Ok(found)
    }

    /// How much there is of what.
    pub(super) async fn count_all(&self) -> Result<Stats, QueueError> {
        let of_owners =
            try_join_all(self.owners.all().into_iter().map(|owner| self.count_of(owner))).await?;
        Ok(of_owners.into_iter().fold(Stats::default(), |sum, next| Stats {
            queued: sum.queued + next.queued,
            running: sum.running + next.running,
            oldest_queued_s: sum.oldest_queued_s.max(next.oldest_queued_s),
        }))
    }

    async fn count_of(&self, owner: Owner) -> Result<Stats, QueueError> {
        let info = self.owners.info(&owner).await?;
        let mut stats = Stats {
            queued: info.num_pending as usize,
            running: info.num_ack_pending,
            oldest_queued_s: 0.0,
        };
        if stats.queued > 0 {
            let filter = format!("work.{}.*", owner_word(&owner));
            let oldest =
                self.streams.work.next(&filter, info.delivered.stream_sequence + 1).await?;
            stats.oldest_queued_s = oldest.map_or(0.0, |(_, message)| age(&message).as_secs_f64());
        }
        Ok(stats)
    }

    /// How many jobs workers have.
    pub(super) async fn running(&self) -> Result<usize, QueueError> {
        self.owners.refresh().await?;
        let owners = self.owners.all();
        let counts = owners.iter().map(|owner| self.owners.info(owner));
        let counts = try_join_all(counts).await?;
        Ok(counts.iter().map(|info| info.num_ack_pending).sum())
    }

    /// The blobs that were given up are seen to.
    pub(super) async fn forget_all(&self, blobs: &[Digest]) -> Result<(), QueueError> {
        for blob in blobs {
            self.streams.blobs.remove(&format!("free.{blob}")).await?;
        }
        Ok(())
    }
}

/// The job of a record's message; `None` for one that cannot be read.
fn job_of(name: &str, message: &StreamMessage) -> Option<(Owner, JobId, StoredJob)> {
    let (owner, id) = job_of_name(name)?;
    Some((owner, id, table::read(message).ok()?.value))
}

/// Whether whoever wrote this has had the time to write what belongs to it.
fn is_older(message: &StreamMessage) -> bool {
    age(message) >= TIME_TO_COMPLETE
}

/// How long ago a message was stored.
fn age(message: &StreamMessage) -> Duration {
    let stored_ms = (message.time.unix_timestamp_nanos() / 1_000_000) as i64;
    Duration::from_millis(Moment::now().0.saturating_sub(stored_ms).max(0) as u64)
}
